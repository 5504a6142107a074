"""When faults begin and end: one schedule for launched surveys, scenarios and real autopilots."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from simvehicle.faults.fault_table import FAULTS, FaultSpec, Victim


class FaultSchedule:
    """The faults of a simulation in the order of their times, which count from the first take-off.

    Of what is due at one time, what begins comes before what ends.
    """

    def __init__(self, faults: Iterable[FaultSpec]) -> None:
        listed = tuple(faults)
        entries = [(fault.at_s, True, fault) for fault in listed]
        entries += [(fault.until_s, False, fault) for fault in listed if fault.until_s is not None]
        self._waiting = sorted(entries, key=lambda entry: entry[0])

    def strike(self, since_takeoff_s: float, victims: Mapping[int, Victim]) -> None:
        """Do to the drones, by id, what has become due; to be called with times that do not go back."""
        while self._waiting and self._waiting[0][0] <= since_takeoff_s:
            _, begins, fault = self._waiting.pop(0)
            kind = FAULTS[fault.kind]
            act = kind.begin if begins else kind.end
            if act is not None:
                act(victims[fault.drone], fault)
