"""When a drone tells its whole table: when somebody near knows another one.

Every state bears the digest of its sender's table. At rest all digests are the same, and the table itself is said
only now and then, so that what a drone sends hardly grows with the swarm; where two differ, both tell, until they
agree.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from flightstack.swarm.peers import PeerFacts
from flightstack.swarm.wire import NO_TABLE

PERIOD_S: Final = 0.2
"""The time between two tellings of the same table, and of any on the average: news, such as a suspicion and
its refutation, may follow each other at once."""

_MOST_NEWS: Final = 2.0
"""How many tellings may follow each other at once."""

REFRESH_S: Final = 5.0
"""The longest: digests of 32 bits may be the same by chance, and an old one may have been the last that was heard."""

SHOWN_S: Final = 1.0
"""How long displays wait at most for what only they need to be told: mostly a claim comes before and tells it."""

DIGEST_S: Final = 2.0
"""A digest that is older is no reason to tell: its drone may be out of reach."""


class Exchange:
    """One drone's turn to tell; `is_due` once a tick."""

    def __init__(self, tick_s: float) -> None:
        self._tick_s = tick_s
        self._told_s: float | None = None
        self._told_digest = 0
        self._told_slots: Mapping[int, int] | None = None
        self._may_tell = _MOST_NEWS
        """How many tellings may follow each other now."""

    def is_due(
        self,
        now_s: float,
        digest: int,
        peers: Mapping[int, PeerFacts],
        slots: Mapping[int, int] | None = None,
    ) -> bool:
        """Whether the table, whose `digest` this is, is to be told in this tick; if so, it counts as told. `slots`
        (drone -> slot): whom this drone counts in, which is its own matter and not in the digest, but which displays
        follow."""
        self._may_tell = min(_MOST_NEWS, self._may_tell + self._tick_s / PERIOD_S)
        if self._told_s is not None:
            since_s = now_s - self._told_s + 0.5 * self._tick_s
            is_new = digest != self._told_digest
            if is_new:
                is_due = self._may_tell >= 1.0
            elif any(
                peer.table_digest not in (digest, NO_TABLE) and now_s - peer.heard_s < DIGEST_S
                for peer in peers.values()
            ):
                is_due = since_s >= PERIOD_S
            else:
                is_due = since_s >= (REFRESH_S if slots == self._told_slots else SHOWN_S)
            if not is_due:
                return False
        self._may_tell = max(0.0, self._may_tell - 1.0)
        self._told_s, self._told_digest, self._told_slots = now_s, digest, slots
        return True
