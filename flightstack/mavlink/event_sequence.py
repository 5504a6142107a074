"""Which of an autopilot's events were lost on the way, and asking for them again.

https://mavlink.io/en/services/events.html: events are numbered, every few seconds the newest number is told, and the
autopilot keeps the newest few.
"""

from __future__ import annotations

import enum
import math
from typing import Any, Final

from flightstack.mavlink.dialect import RequestEventMessage

KEPT: Final = 20
"""So many PX4 keeps; a greater step is a restart."""
AGAIN_S: Final = 1.0
TRIES: Final = 3
_TURN: Final = 65536


class EventArrival(enum.Enum):
    NEW = "new"
    LATE = "late"
    """One that newer ones have overtaken, or that was asked for."""
    KNOWN = "known"
    """It came before."""


class EventSequence:
    """Counts the events of one autopilot. Nothing from before the first one is asked for."""

    def __init__(self) -> None:
        self._newest: int | None = None
        self._lost: dict[int, int] = {}
        """Number, and how often it was asked for."""
        self._asked_s = -math.inf

    def take(self, sequence: int) -> EventArrival:
        """An event with this number has come."""
        if self._lost.pop(sequence, None) is not None:
            return EventArrival.LATE
        ahead = 1 if self._newest is None else (sequence - self._newest) % _TURN
        if ahead == 0 or ahead >= _TURN - KEPT:
            return EventArrival.KNOWN
        self.told(sequence)
        self._lost.pop(sequence, None)
        return EventArrival.NEW

    def told(self, sequence: int) -> None:
        """This is the newest number."""
        ahead = 0 if self._newest is None else (sequence - self._newest) % _TURN
        if ahead >= _TURN - KEPT:
            return
        if ahead > KEPT:
            self._lost.clear()
        elif self._newest is not None:
            lost = self._lost | {(self._newest + step) % _TURN: 0 for step in range(1, ahead + 1)}
            self._lost = dict(list(lost.items())[-KEPT:])
        self._newest = sequence

    def requests(self, now_s: float, system: int, component: int) -> list[Any]:
        """REQUEST_EVENT for what is still missing; not too often, and not for ever."""
        if not self._lost or now_s - self._asked_s < AGAIN_S:
            return []
        self._asked_s = now_s
        self._lost = {number: tries + 1 for number, tries in self._lost.items() if tries < TRIES}
        found: list[tuple[int, int]] = []
        for number in self._lost:
            if found and (found[-1][1] + 1) % _TURN == number:
                found[-1] = (found[-1][0], number)
            else:
                found.append((number, number))
        return [
            RequestEventMessage(
                target_system=system, target_component=component, first_sequence=first, last_sequence=last
            )
            for first, last in found
        ]
