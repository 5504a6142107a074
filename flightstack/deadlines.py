"""When a tick is due, and which ticks were missed."""

from __future__ import annotations

import dataclasses


@dataclasses.dataclass
class Deadlines:
    """Which ticks were missed: those whose outputs left more than one period after they were due."""

    period_s: float
    ticks: int = 0
    late: int = 0
    worst_s: float = 0.0

    def next_due_s(self, due_s: float, finished_s: float) -> float:
        """Count the tick that was due at `due_s` and tell when the next one is; missed ones are not made up."""
        self.ticks += 1
        behind_s = finished_s - due_s
        self.worst_s = max(self.worst_s, behind_s)
        missed = max(0, int(behind_s / self.period_s))
        self.late += missed
        self.ticks += missed
        return due_s + (missed + 1) * self.period_s
