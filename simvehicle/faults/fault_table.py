"""The table of faults: what can go wrong with a drone, how it begins and how it ends."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Annotated, Literal, Protocol

from msgspec import Meta

from flightstack.config import Section

FaultKind = Literal["unplug", "gps_loss", "battery_low", "motor", "tumble", "silence"]


class FaultSpec(Section, frozen=True, kw_only=True):
    """Something that goes wrong, `at_s` seconds of simulated time after the first take-off."""

    drone: int
    at_s: Annotated[float, Meta(ge=0.0)]
    kind: FaultKind
    """"unplug" needs `instrument`; "silence" stops the vehicle's MAVLink; "motor" makes it fall flat,
    "tumble" on its back."""
    instrument: str = ""
    until_s: float | None = None
    """When it mends itself; None: never."""


class Victim(Protocol):
    """What faults do to a drone; each call may be repeated without harm."""

    def set_plugged(self, instrument: str, plugged: bool) -> None:
        """The cable of one of its instruments."""
        ...

    def set_gps(self, working: bool) -> None: ...

    def set_motors(self, working: bool) -> None: ...

    def set_turned_over(self, turned_over: bool) -> None:
        """Its motors stop, and it falls on its back."""
        ...

    def set_silent(self, silent: bool) -> None:
        """Its autopilot neither sends nor hears."""
        ...

    def weaken_battery(self) -> None:
        """Its charge falls below what makes the autopilot's battery failsafe act."""
        ...


@dataclasses.dataclass(frozen=True)
class Fault:
    begin: Callable[[Victim, FaultSpec], None]
    end: Callable[[Victim, FaultSpec], None] | None = None
    """None: it does not mend itself, whatever `until_s` says."""
    needs_instrument: bool = False


FAULTS: dict[FaultKind, Fault] = {
    "unplug": Fault(
        lambda victim, fault: victim.set_plugged(fault.instrument, False),
        lambda victim, fault: victim.set_plugged(fault.instrument, True),
        needs_instrument=True,
    ),
    "gps_loss": Fault(lambda victim, _: victim.set_gps(False), lambda victim, _: victim.set_gps(True)),
    "battery_low": Fault(lambda victim, _: victim.weaken_battery()),
    "motor": Fault(lambda victim, _: victim.set_motors(False), lambda victim, _: victim.set_motors(True)),
    "tumble": Fault(lambda victim, _: victim.set_turned_over(True)),
    "silence": Fault(lambda victim, _: victim.set_silent(True), lambda victim, _: victim.set_silent(False)),
}
"""By the names that survey files and `--fault` use (there with "-" for "_")."""
