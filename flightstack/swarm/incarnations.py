"""Which of the agents that call themselves one drone speaks for it.

An agent that is started again has a new incarnation, and its old one is never heard again. Two agents with one number
talk in turns. Whoever is heard now counts; while both are, the one that flies its vehicle, then the one that has run
for longer: a twin that comes, is refused and goes must leave nothing behind.
"""

from __future__ import annotations

import math
from typing import Final

import msgspec

from flightstack.swarm.wire import DroneState, Phase

FLYING_PHASES: Final = frozenset(Phase) - {
    Phase.DISARMED,
    Phase.ARMING,
    Phase.LANDED,
    Phase.CRASHED,
    Phase.PILOT,
}
"""The phases in which an agent has its vehicle in the air and is responsible for it."""

SPEAKS_S: Final = 0.9
"""States come every 0.2 s: an agent that was not heard for so long has lost its word to another."""
TWINS_S: Final = 5.0
"""How long two agents that were heard side by side count as running."""
_KEPT: Final = 16


class _Heard(msgspec.Struct):
    sequence: int
    time_s: float
    place: int
    """In the order in which they were first heard."""


class Incarnations:
    """The agents with one drone's number. It is shown every state of theirs, in the order of their coming."""

    def __init__(self) -> None:
        self.speaker: DroneState | None = None
        """The newest state that counts."""
        self.restarts = 0
        """How often a new incarnation took the word."""
        self._heard: dict[int, _Heard] = {}
        self._met = 0
        self._last: int | None = None
        self._side_by_side_s = -math.inf

    def hear(self, now_s: float, state: DroneState) -> bool:
        """Take a state; whether it counts. False for one that is late, and for a twin's."""
        incarnation = state.incarnation
        if incarnation == self._last and len(self._heard) == 1:
            return self._hear_again(now_s, state)
        known = self._heard.pop(incarnation, None)
        if known is not None and state.sequence <= known.sequence:
            self._heard[incarnation] = known
            return False
        place = known.place if known is not None else self._met
        self._met += known is None
        self._heard[incarnation] = _Heard(state.sequence, now_s, place)
        while len(self._heard) > _KEPT:
            del self._heard[next(iter(self._heard))]
        if known is not None and self._last != incarnation:
            other = self._heard.get(self._last) if self._last is not None else None
            is_elder = other is not None and known.place < other.place
            # One that never stopped: a late word of an agent that was replaced proves nothing.
            if is_elder and now_s - known.time_s < SPEAKS_S:
                self._side_by_side_s = now_s
        self._last = incarnation
        speaker = self.speaker
        if speaker is not None and speaker.incarnation != incarnation:
            heard = self._heard.get(speaker.incarnation)
            speaks = heard is not None and now_s - heard.time_s < SPEAKS_S
            if speaks and _rank(state) <= _rank(speaker):
                return False
            self.restarts += known is None
        self.speaker = state
        return True

    def _hear_again(self, now_s: float, state: DroneState) -> bool:
        """The same for the only one that was ever heard."""
        known = self._heard[state.incarnation]
        if state.sequence <= known.sequence:
            return False
        known.sequence, known.time_s = state.sequence, now_s
        self.speaker = state
        return True

    def speaks(self, incarnation: int) -> bool:
        """Whether what this one says counts; also where nothing has been heard of any."""
        return self.speaker is None or self.speaker.incarnation == incarnation

    def has_twins(self, now_s: float) -> bool:
        """Whether two agents with this number are running now."""
        return now_s - self._side_by_side_s <= TWINS_S


def _rank(state: DroneState) -> tuple[bool, int, int]:
    """By ticks and incarnation as the agents themselves decide it (`SwarmMember.comes_second`)."""
    return state.airborne and state.phase in FLYING_PHASES, state.ticks, state.incarnation
