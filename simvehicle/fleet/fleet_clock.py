"""The time of a fleet: the wall clock times the speed-up, no faster than this process, and all that share it, can."""

from __future__ import annotations

import math
import time

from flightstack.recording.shared_clock import ClockCells

AHEAD_S = 0.08
"""How far the time may go past the earliest promise. Less than the 0.1 s after which an agent's tick counts as late:
what is done within it is done in time, and for longer the whole simulation waits."""
STUCK_WALL_S = 5.0
"""A follower that has not moved for so long hangs; the others go on without it until it moves again."""


MOST_AT_ONCE_S = 0.5
"""How far the time goes in one step without a shared clock. Less than any time after which an autopilot gives up on
who does not answer: others cannot answer while this process is kept from running, and must not seem silent for it."""


class FleetClock:
    """Asked for the time once a step; the step then belongs to that time."""

    def __init__(self, speedup: float, clock: ClockCells | None = None) -> None:
        self._speedup = speedup
        self._clock = clock
        self._now_s = 0.0
        self._wall_s: float | None = None
        self._promises: dict[int, tuple[float, float]] = {}
        """Slot -> (its newest promise, when it was first seen on the wall clock)."""

    def advance(self) -> float:
        """The simulated time of the step that is due now, seconds since the first call."""
        wall_s = time.monotonic()
        passed_s = 0.0 if self._wall_s is None else (wall_s - self._wall_s) * self._speedup
        self._wall_s = wall_s
        if self._clock is None:
            self._now_s += min(passed_s, MOST_AT_ONCE_S)
        else:
            promised_s = self._promised_s(self._clock, wall_s) + AHEAD_S
            self._now_s = max(self._now_s, min(self._now_s + passed_s, promised_s))
        return self._now_s

    def publish(self) -> None:
        """Tell the followers that the world has got as far as the time last asked for."""
        if self._clock is not None:
            self._clock.values[0] = self._now_s

    def _promised_s(self, clock: ClockCells, wall_s: float) -> float:
        """The earliest promise of all followers that have begun, not left and do not hang."""
        earliest_s = math.inf
        for slot in range(1, len(clock.values)):
            promise_s = clock.values[slot]
            if promise_s <= 0.0:
                continue
            known = self._promises.get(slot)
            if known is None or known[0] != promise_s:
                known = self._promises[slot] = (promise_s, wall_s)
            if wall_s - known[1] < STUCK_WALL_S:
                earliest_s = min(earliest_s, promise_s)
        return earliest_s
