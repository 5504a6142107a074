"""The table of faults: what can go wrong with a drone or with its swarm, how it begins and how it ends."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Annotated, Literal, Protocol

from msgspec import Meta

from flightstack.config import Section

FaultKind = Literal[
    "unplug",
    "stuck",
    "lying",
    "gps_loss",
    "gps_jump",
    "battery_low",
    "failsafe",
    "motor",
    "tumble",
    "silence",
    "range_silent",
    "range_lying",
]
Unheard = Literal["remote_control", "ground_link"]
"""What an autopilot misses, by which its failsafe acts."""


class FaultSpec(Section, frozen=True, kw_only=True):
    """Something that goes wrong, `at_s` seconds of simulated time after the first take-off."""

    drone: int
    at_s: Annotated[float, Meta(ge=0.0)]
    kind: FaultKind
    """"silence" stops the vehicle's MAVLink; "motor" makes it fall flat, "tumble" on its back. Which fields a kind
    needs stands in `FAULTS`."""
    instrument: str = ""
    """Of "unplug"; of "stuck", which goes on measuring the air of that moment; of "lying"."""
    by_ppm: Annotated[float, Meta(ge=-1e6, le=1e6)] = 500.0
    """Of "lying": so much more than there is says an instrument for CO2."""
    by_m: Annotated[float, Meta(ge=-1000.0, le=1000.0)] = 10.0
    """Of "gps_jump": so far north of where it is does the autopilot believe the vehicle to be. Of "range_lying": so
    much farther than it is does the range finder see what is there (negative: nearer)."""
    unheard: Unheard | None = None
    """Of "failsafe": what the autopilot hears no longer. It does what its parameters say."""
    until_s: float | None = None
    """When it mends itself; None: never."""


class Victim(Protocol):
    """What faults do to a drone; each call may be repeated without harm."""

    def set_plugged(self, instrument: str, plugged: bool) -> None:
        """The cable of one of its instruments."""
        ...

    def set_stuck(self, instrument: str, stuck: bool) -> None:
        """Whether one of its instruments goes on measuring the air of this moment."""
        ...

    def set_lying(self, instrument: str, by_ppm: float) -> None:
        """How much more CO2 than there is one of its instruments measures."""
        ...

    def set_gps(self, working: bool) -> None: ...

    def set_gps_error(self, north_m: float) -> None:
        """How far north of where it is the autopilot believes it to be."""
        ...

    def set_heard(self, what: Unheard, heard: bool) -> None:
        """Whether its autopilot hears what it has a failsafe for."""
        ...

    def set_motors(self, working: bool) -> None: ...

    def set_turned_over(self, turned_over: bool) -> None:
        """Its motors stop, and it falls on its back."""
        ...

    def set_range_finder(self, *, silent: bool, lies_m: float) -> None:
        """Whether its range finder says nothing, and how much farther than they are it sees things."""
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
    needs: tuple[Literal["instrument", "unheard"], ...] = ()
    """The fields that it must be given."""


def _unheard(victim: Victim, fault: FaultSpec, heard: bool) -> None:
    if fault.unheard is not None:
        victim.set_heard(fault.unheard, heard)


FAULTS: dict[FaultKind, Fault] = {
    "unplug": Fault(
        lambda victim, fault: victim.set_plugged(fault.instrument, False),
        lambda victim, fault: victim.set_plugged(fault.instrument, True),
        needs=("instrument",),
    ),
    "stuck": Fault(
        lambda victim, fault: victim.set_stuck(fault.instrument, True),
        lambda victim, fault: victim.set_stuck(fault.instrument, False),
        needs=("instrument",),
    ),
    "lying": Fault(
        lambda victim, fault: victim.set_lying(fault.instrument, fault.by_ppm),
        lambda victim, fault: victim.set_lying(fault.instrument, 0.0),
        needs=("instrument",),
    ),
    "gps_loss": Fault(lambda victim, _: victim.set_gps(False), lambda victim, _: victim.set_gps(True)),
    "gps_jump": Fault(
        lambda victim, fault: victim.set_gps_error(fault.by_m), lambda victim, _: victim.set_gps_error(0.0)
    ),
    "battery_low": Fault(lambda victim, _: victim.weaken_battery()),
    "failsafe": Fault(
        lambda victim, fault: _unheard(victim, fault, False),
        lambda victim, fault: _unheard(victim, fault, True),
        needs=("unheard",),
    ),
    "motor": Fault(lambda victim, _: victim.set_motors(False), lambda victim, _: victim.set_motors(True)),
    "tumble": Fault(lambda victim, _: victim.set_turned_over(True)),
    "range_silent": Fault(
        lambda victim, _: victim.set_range_finder(silent=True, lies_m=0.0),
        lambda victim, _: victim.set_range_finder(silent=False, lies_m=0.0),
    ),
    "range_lying": Fault(
        lambda victim, fault: victim.set_range_finder(silent=False, lies_m=fault.by_m),
        lambda victim, _: victim.set_range_finder(silent=False, lies_m=0.0),
    ),
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
