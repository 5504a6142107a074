"""Simulated time that one process makes and the others follow: a slow machine then only makes the flight slower.

The processes of a simulated flight could each run on the wall clock times the speed-up. On a machine that cannot
keep up, the vehicles then fly on while their agents miss ticks: the flight tells of the machine and not of the
software. Here the vehicles' process makes the time: it goes as fast as the speed-up says, but
never past what its followers have promised. A real flight has no such clock.

The clock is a small file that all map into memory: first the time, then one promise a follower. A promise is the time
until which the follower has done its work; 0 before its first, infinity when it has left.
"""

from __future__ import annotations

import math
import pathlib
import time

from flightstack.mapped_numbers import NUMBER_BYTES, MappedNumbers
from mission.documents.yaml_file import DocumentError

STANDSTILL_WALL_S = 1.0
"""A sleeper wakes when the time has stood still for so long: to notice that it is told to stop, for one."""
_SHORTEST_NAP_S = 0.001
_LONGEST_NAP_S = 0.02


class ClockCells(MappedNumbers):
    """The numbers of a clock file."""

    def __init__(self, path: str | pathlib.Path) -> None:
        """`DocumentError` where the file is not there or is no clock."""
        super().__init__(path, "no clock to follow")

    @staticmethod
    def make(path: pathlib.Path, followers: int) -> ClockCells:
        """A new clock file at time 0, for this many followers (slots 1 to `followers`)."""
        path.write_bytes(bytes(NUMBER_BYTES * (1 + followers)))
        return ClockCells(path)

    def leave(self, slot: int) -> None:
        """Nobody waits for this follower any more."""
        self.values[slot] = math.inf


class SharedClock:
    """The clock as a follower has it (`flightstack.recording.clock.Clock`)."""

    def __init__(self, path: str | pathlib.Path, slot: int, speedup: float) -> None:
        self._cells = ClockCells(path)
        if not 1 <= slot < len(self._cells.values):
            raise DocumentError(str(path), f"has no slot {slot}, only 1 to {len(self._cells.values) - 1}")
        self._slot = slot
        self._speedup = speedup

    def now_s(self) -> float:
        return self._cells.values[0]

    def sleep_until(self, deadline_s: float) -> None:
        """Also the promise that all work up to `deadline_s` is done: others may go on until then."""
        values = self._cells.values
        values[self._slot] = deadline_s
        seen_s, seen_wall_s = values[0], time.monotonic()
        while (left_s := deadline_s - values[0]) > 0.0:
            time.sleep(min(max(left_s / self._speedup, _SHORTEST_NAP_S), _LONGEST_NAP_S))
            if values[0] != seen_s:
                seen_s, seen_wall_s = values[0], time.monotonic()
            elif time.monotonic() - seen_wall_s > STANDSTILL_WALL_S:
                return
