"""The table of faults: what can go wrong with a drone or with its swarm, how it begins and how it ends."""

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


SwarmFaultKind = Literal[
    "kill",
    "freeze",
    "reboot",
    "radio_dead",
    "one_way",
    "partition",
    "loss",
    "clock_jump",
    "pilot",
    "ground_gone",
    "command",
]
CommandWord = Literal["start", "pause", "resume", "abort", "rtl", "land"]


class SwarmFaultSpec(Section, frozen=True, kw_only=True):
    """Something that goes wrong with agents, radio or people, `at_s` seconds of simulated time after the first
    take-off. Which fields a kind needs stands in `SWARM_FAULTS`."""

    at_s: Annotated[float, Meta(ge=0.0)]
    kind: SwarmFaultKind
    until_s: float | None = None
    """When it is over; None: never."""
    drone: int = 0
    """Whom it befalls; for "command" whom the command is for, 0: everybody."""
    towards: int = 0
    """Of "one_way": who no longer hears the drone, although it hears them."""
    parts: tuple[tuple[int, ...], ...] = ()
    """Of "partition": the drones of each part; who is named in none is in the first, as the ground station is."""
    loss: Annotated[float, Meta(ge=0.0, lt=1.0)] = 0.0
    """Of "loss": the probability that a message vanishes, on every link."""
    by_s: Annotated[float, Meta(ge=0.0)] = 0.0
    """Of "clock_jump": how far the drone's clock jumps ahead, seconds."""
    command: CommandWord | None = None


class SwarmVictim(Protocol):
    """What faults do to a swarm; each call may be repeated without harm."""

    def kill(self, drone: int) -> None:
        """Its agent ends as by kill -9; the vehicle flies on by itself."""
        ...

    def start_again(self, drone: int) -> None:
        """Its agent starts anew and remembers nothing."""
        ...

    def set_frozen(self, drone: int, frozen: bool) -> None:
        """Its agent stands still as by SIGSTOP, and what arrives waits for it."""
        ...

    def set_radio(self, node: int | None, working: bool) -> None:
        """A drone's radio to the swarm, or (None) the ground station's."""
        ...

    def set_one_way(self, drone: int, towards: int, heard: bool) -> None:
        """Whether `towards` hears `drone`."""
        ...

    def set_parts(self, fault: SwarmFaultSpec, apart: bool) -> None:
        """Whether the parts of a partition hear each other."""
        ...

    def set_loss(self, loss: float | None) -> None:
        """On every link; None: as before."""
        ...

    def advance_clock(self, drone: int, by_s: float) -> None: ...

    def take_by_pilot(self, drone: int) -> None:
        """The pilot switches the vehicle to a mode in which the sticks fly it."""
        ...

    def command(self, word: CommandWord, drone: int) -> None:
        """The operator's; 0: to everybody."""
        ...


@dataclasses.dataclass(frozen=True)
class SwarmFault:
    begin: Callable[[SwarmVictim, SwarmFaultSpec], None]
    end: Callable[[SwarmVictim, SwarmFaultSpec], None] | None = None
    """None: it does not mend itself, and `until_s` makes no sense."""
    needs: tuple[str, ...] = ("drone",)
    """The fields that it must be given."""


def _command(victim: SwarmVictim, fault: SwarmFaultSpec) -> None:
    if fault.command is not None:
        victim.command(fault.command, fault.drone)


SWARM_FAULTS: dict[SwarmFaultKind, SwarmFault] = {
    "kill": SwarmFault(lambda victim, fault: victim.kill(fault.drone)),
    "freeze": SwarmFault(
        lambda victim, fault: victim.set_frozen(fault.drone, True),
        lambda victim, fault: victim.set_frozen(fault.drone, False),
    ),
    "reboot": SwarmFault(
        lambda victim, fault: victim.kill(fault.drone),
        lambda victim, fault: victim.start_again(fault.drone),
        needs=("drone", "until_s"),
    ),
    "radio_dead": SwarmFault(
        lambda victim, fault: victim.set_radio(fault.drone, False),
        lambda victim, fault: victim.set_radio(fault.drone, True),
    ),
    "one_way": SwarmFault(
        lambda victim, fault: victim.set_one_way(fault.drone, fault.towards, False),
        lambda victim, fault: victim.set_one_way(fault.drone, fault.towards, True),
        needs=("drone", "towards"),
    ),
    "partition": SwarmFault(
        lambda victim, fault: victim.set_parts(fault, True),
        lambda victim, fault: victim.set_parts(fault, False),
        needs=("parts",),
    ),
    "loss": SwarmFault(
        lambda victim, fault: victim.set_loss(fault.loss),
        lambda victim, _: victim.set_loss(None),
        needs=("loss",),
    ),
    "clock_jump": SwarmFault(
        lambda victim, fault: victim.advance_clock(fault.drone, fault.by_s), needs=("drone", "by_s")
    ),
    "pilot": SwarmFault(lambda victim, fault: victim.take_by_pilot(fault.drone)),
    "ground_gone": SwarmFault(
        lambda victim, _: victim.set_radio(None, False),
        lambda victim, _: victim.set_radio(None, True),
        needs=(),
    ),
    "command": SwarmFault(_command, needs=("command",)),
}
"""By the names that scenario files use under `swarm_faults`."""
