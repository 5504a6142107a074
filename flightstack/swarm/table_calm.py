"""Whether a drone's table is at rest: when the swarm holds for it, and when the root may go on.

Nobody flies while the table changes or somebody is on the way to a new slot, and a second longer. But a heal that
does not come to its end, one after another, or drones that do not come to their slots stop the swarm for
`HEAL_LIMIT_S` only.
"""

from __future__ import annotations

import math
from typing import Final

CALM_S: Final = 0.5
"""How long a table must not have changed before a free slot is taken, or the root orders anew."""

HELD_S: Final = 1.0
"""How long the swarm holds after the table has changed: nobody flies before an objection to it can have come."""

HEAL_LIMIT_S: Final = 60.0
"""The longest that the swarm holds without having been at rest in between."""


class TableCalm:
    """One drone's judgement of it."""

    def __init__(self) -> None:
        self._changed_s = -math.inf
        self._is_settled = True
        self._holds_since_s: float | None = None
        """Since when there has been a reason to hold; None without one."""

    @property
    def is_settled(self) -> bool:
        """Whether nobody has to claim anything."""
        return self._is_settled

    def change(self, now_s: float) -> None:
        """Somebody has another slot."""
        self._changed_s = now_s

    def settle(self, is_settled: bool) -> None:
        self._is_settled = is_settled

    def look(self, now_s: float, *, somebody_moves: bool) -> None:
        """Once a tick. `somebody_moves`: a drone is on its way to a new slot."""
        if self._is_settled and not somebody_moves and now_s - self._changed_s >= HELD_S:
            self._holds_since_s = None
        elif self._holds_since_s is None:
            self._holds_since_s = now_s

    def holds(self, now_s: float) -> bool:
        """Whether the swarm has to hold, as of the last look."""
        return self._holds_since_s is not None and not self._is_over(now_s)

    def is_unchanged(self, now_s: float) -> bool:
        return now_s - self._changed_s >= CALM_S

    def is_steady(self, now_s: float) -> bool:
        """Whether the table is whole and has not changed for a while, or has been restless for too long."""
        return self._is_over(now_s) or (self._is_settled and self.is_unchanged(now_s))

    def _is_over(self, now_s: float) -> bool:
        return self._holds_since_s is not None and now_s - self._holds_since_s >= HEAL_LIMIT_S
