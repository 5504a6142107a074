"""Where in the uploaded mission a vehicle is."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence

from simvehicle.autopilot.flight import Flight
from simvehicle.autopilot.maneuvers import Return
from simvehicle.autopilot.mission_run import MissionRun, Surroundings, Told
from simvehicle.autopilot.missions import MISSION, StoredItem


@dataclasses.dataclass(frozen=True, slots=True)
class MissionStyle:
    """How an autopilot flies missions."""

    first: int
    """Sequence number of the first item to fly: ArduPilot's item 0 is home."""
    arrival_m: Callable[[], float]
    """Within which a waypoint is reached."""
    back: Callable[[], Return]
    """A new return-to-launch."""


class MissionProgress:
    def __init__(
        self, flight: Flight, lists: Mapping[int, Sequence[StoredItem]], style: MissionStyle
    ) -> None:
        self._flight = flight
        self._lists = lists
        self._style = style
        self.next = 0
        """Sequence number of the item to fly."""
        self.complete = False
        self.rejected = False
        """The mission is kept, but is not to be flown (PX4)."""

    @property
    def can_fly(self) -> bool:
        return bool(self.items) and not self.rejected

    @property
    def items(self) -> Sequence[StoredItem]:
        return self._lists[MISSION]

    @property
    def total(self) -> int:
        """Items to fly."""
        return max(0, len(self.items) - self._style.first)

    def start(self) -> MissionRun:
        """A manoeuvre that flies the mission from the item that is next."""
        return self._run(self.items)

    def _run(self, items: Sequence[StoredItem]) -> MissionRun:
        flight, style = self._flight, self._style
        home_amsl_m = flight.vehicle.estimator.geodetic(flight.nav.home_m).amsl_m
        local = flight.vehicle.estimator.local
        around = Surroundings(local, home_amsl_m, style.arrival_m(), style.back, style.first)
        return MissionRun(items, around, self.next)

    def from_the_start(self) -> None:
        self.next = 0
        self.complete = False

    def replaced(self, items: Sequence[StoredItem]) -> None:
        """Another mission is about to be kept; one that is being flown goes on with it."""
        self.from_the_start()
        if isinstance(self._flight.maneuver, MissionRun):
            self._flight.maneuver = self._run(items)

    def set_current(self, sequence: int) -> bool:
        if not 0 <= sequence < len(self.items):
            return False
        self.next = sequence
        self.complete = False
        if isinstance(self._flight.maneuver, MissionRun):
            return self._flight.maneuver.go_to(sequence)
        return True

    def take_told(self) -> list[tuple[Told, int]]:
        """What happened in this tick: (what, sequence number of the item)."""
        run = self._flight.maneuver
        if not isinstance(run, MissionRun):
            return []
        self.next = run.current
        told, run.told = run.told, []
        return told
