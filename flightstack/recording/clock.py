"""Time as an argument: the wall's, the wall's made faster, or a simulation's."""

from __future__ import annotations

import time
from typing import Protocol

from flightstack.config import SharedClockConfig
from flightstack.recording.shared_clock import SharedClock


class Clock(Protocol):
    """Seconds that only go forward. Two machines' clocks are never compared."""

    def now_s(self) -> float: ...

    def sleep_until(self, deadline_s: float) -> None: ...


class WallClock:
    """The machine's monotonic clock, `speedup` times as fast.

    A flight on real vehicles has `speedup` 1. Simulated flights on one machine may run faster; every process
    of the flight must then be given the same factor.
    """

    def __init__(self, speedup: float = 1.0) -> None:
        if not 0.0 < speedup <= 100.0:
            raise ValueError(f"speedup {speedup} is not within 0 to 100")
        self.speedup = speedup

    def now_s(self) -> float:
        return time.monotonic() * self.speedup

    def sleep_until(self, deadline_s: float) -> None:
        left_s = deadline_s / self.speedup - time.monotonic()
        if left_s > 0.0:
            time.sleep(left_s)


def make_clock(speedup: float, shared: SharedClockConfig | None) -> Clock:
    """The clock that a process of a flight runs on: the wall's, unless a simulation gives it another."""
    if shared is None:
        return WallClock(speedup)
    return SharedClock(shared.file, shared.slot, speedup)


class SimulatedClock:
    """A clock that its owner sets: time passes when `sleep_until` is called, at once."""

    def __init__(self, now_s: float = 0.0) -> None:
        self._now_s = now_s

    def now_s(self) -> float:
        return self._now_s

    def sleep_until(self, deadline_s: float) -> None:
        self._now_s = max(self._now_s, deadline_s)
