"""Which of the agents that call themselves one drone speaks for it.

An agent that is started again has a new incarnation, and its old one is never heard again. Two agents with one number
talk in turns. Whoever is heard now counts; while both are, the one that flies its vehicle, then the one that has run
for longer: a twin that comes, is refused and goes must leave nothing behind.
"""

from __future__ import annotations

from collections import deque
from typing import Final, NamedTuple

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
"""Turns within this time are of two agents that both run."""
TURNS: Final = 3
"""So many; fewer are late messages of an agent that has been replaced."""
_KEPT: Final = 16


class _Heard(NamedTuple):
    sequence: int
    time_s: float


class Incarnations:
    """The agents with one drone's number. It is shown every state of theirs, in the order of their coming."""

    def __init__(self) -> None:
        self.speaker: DroneState | None = None
        """The newest state that counts."""
        self.restarts = 0
        """How often a new incarnation took the word."""
        self.clashes = 0
        """How often one spoke after another had: they run side by side."""
        self._heard: dict[int, _Heard] = {}
        self._last: int | None = None
        self._turns_s: deque[float] = deque(maxlen=TURNS)

    def hear(self, now_s: float, state: DroneState) -> bool:
        """Take a state; whether it counts. False for one that is late, and for a twin's."""
        incarnation = state.incarnation
        known = self._heard.pop(incarnation, None)
        if known is not None and state.sequence <= known.sequence:
            self._heard[incarnation] = known
            return False
        self._heard[incarnation] = _Heard(state.sequence, now_s)
        while len(self._heard) > _KEPT:
            del self._heard[next(iter(self._heard))]
        if known is not None and self._last != incarnation:
            self.clashes += 1
            self._turns_s.append(now_s)
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

    def speaks(self, incarnation: int) -> bool:
        """Whether what this one says counts; also where nothing has been heard of any."""
        return self.speaker is None or self.speaker.incarnation == incarnation

    def has_twins(self, now_s: float) -> bool:
        """Whether two agents with this number are running now."""
        return len(self._turns_s) == TURNS and now_s - self._turns_s[0] <= TWINS_S


def _rank(state: DroneState) -> tuple[bool, int, int]:
    """By ticks and incarnation as the agents themselves decide it (`SwarmMember.comes_second`)."""
    return state.airborne and state.phase in FLYING_PHASES, state.ticks, state.incarnation
