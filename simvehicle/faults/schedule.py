"""When faults begin and end: one schedule for launched surveys, scenarios and real autopilots."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Generic, TypeVar

from simvehicle.faults.fault_table import FAULTS, SWARM_FAULTS, FaultSpec, SwarmFaultSpec, SwarmVictim, Victim

Spec = TypeVar("Spec", FaultSpec, SwarmFaultSpec)


class Timetable(Generic[Spec]):
    """What begins and ends, in the order of the times, which count from the first take-off.

    Of what is due at one time, what begins comes before what ends.
    """

    def __init__(self, faults: Iterable[Spec]) -> None:
        listed = tuple(faults)
        entries: list[tuple[float, bool, Spec]] = [(fault.at_s, True, fault) for fault in listed]
        entries += [(fault.until_s, False, fault) for fault in listed if fault.until_s is not None]
        self._waiting: list[tuple[float, bool, Spec]] = sorted(entries, key=lambda entry: entry[0])

    def due(self, since_takeoff_s: float) -> Iterator[tuple[bool, Spec]]:
        """(whether it begins, the fault) of what has become due; to be called with times that do not go back."""
        while self._waiting and self._waiting[0][0] <= since_takeoff_s:
            _, begins, fault = self._waiting.pop(0)
            yield begins, fault


class FaultSchedule:
    """The faults of a simulation's drones."""

    def __init__(self, faults: Iterable[FaultSpec]) -> None:
        self._timetable = Timetable(faults)

    def strike(self, since_takeoff_s: float, victims: Mapping[int, Victim]) -> None:
        """Do to the drones, by id, what has become due; to be called with times that do not go back."""
        for begins, fault in self._timetable.due(since_takeoff_s):
            kind = FAULTS[fault.kind]
            act = kind.begin if begins else kind.end
            if act is not None:
                act(victims[fault.drone], fault)


class SwarmFaultSchedule:
    """The faults of a swarm's agents, radio and people."""

    def __init__(self, faults: Iterable[SwarmFaultSpec]) -> None:
        self._timetable = Timetable(faults)

    def strike(self, since_takeoff_s: float, victim: SwarmVictim) -> list[tuple[bool, SwarmFaultSpec]]:
        """Do to the swarm what has become due, and say what that was: (whether it begins, the fault)."""
        struck = []
        for begins, fault in self._timetable.due(since_takeoff_s):
            kind = SWARM_FAULTS[fault.kind]
            act = kind.begin if begins else kind.end
            if act is not None:
                act(victim, fault)
                struck.append((begins, fault))
        return struck
