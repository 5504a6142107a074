"""When a drone tells its table, or its order: when somebody near knows another one.

Every state bears two digests, of its sender's table and of the order that counts for it. At rest all are the same,
and neither is said but now and then, so that what a drone sends hardly grows with the swarm; where two differ, both
tell, until they agree. Table and order are told apart: a new order, which a root at work gives every few seconds,
tells nobody's table again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from flightstack.swarm.peers import PeerFacts
from flightstack.swarm.wire import NO_TABLE

PERIOD_S: Final = 0.2
"""The time between two tellings of the same, and of any on the average: news, such as a suspicion and its refutation,
may follow each other at once."""

_MOST_NEWS: Final = 2.0
"""How many tellings may follow each other at once."""

REFRESH_S: Final = 5.0
"""The longest: digests of 32 bits may be the same by chance, and an old one may have been the last that was heard."""

SHOWN_S: Final = 1.0
"""How long displays wait at most for what only they need to be told: mostly a claim comes before and tells it."""

DIGEST_S: Final = 2.0
"""A digest that is older is no reason to tell: its drone may be out of reach."""

ANSWER_S: Final = 0.15
"""What is said so soon after a telling may have been on its way before that was heard: it is no answer to it."""


class Exchange:
    """One drone's turn to tell its table; `is_due` once a tick."""

    def __init__(self, tick_s: float) -> None:
        self._tick_s = tick_s
        self._told_s = -math.inf
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
        """Whether that, whose `digest` this is, is to be told in this tick; if so, it counts as told. `slots` (drone
        -> slot), of a table: whom this drone counts in, which is its own matter and not in the digest, but which
        displays follow."""
        self._may_tell = min(_MOST_NEWS, self._may_tell + self._tick_s / PERIOD_S)
        since_s = now_s - self._told_s + 0.5 * self._tick_s
        if digest != self._told_digest:
            is_due = self._may_tell >= 1.0
        elif since_s < PERIOD_S:
            is_due = False
        elif since_s >= (REFRESH_S if slots == self._told_slots else SHOWN_S):
            is_due = True
        else:
            is_due = self._is_asked_for(now_s, digest, peers)
        if is_due:
            self._may_tell = max(0.0, self._may_tell - 1.0)
            self._told_s, self._told_digest, self._told_slots = now_s, digest, slots
        return is_due

    def _is_asked_for(self, now_s: float, digest: int, peers: Mapping[int, PeerFacts]) -> bool:
        """Whether somebody in reach knows another one."""
        for peer in peers.values():
            if peer.table_digest not in (digest, NO_TABLE) and now_s - peer.heard_s < DIGEST_S:
                return True
        return False


class OrderExchange(Exchange):
    """The same for the order that counts for a drone."""

    def _is_asked_for(self, now_s: float, digest: int, peers: Mapping[int, PeerFacts]) -> bool:
        """By what the others have said since it was told: of a large swarm's states some are always lost, and what
        their senders said before is no reason to tell all again."""
        since_s = max(now_s - DIGEST_S, self._told_s + ANSWER_S)
        for peer in peers.values():
            if peer.order_digest != digest and peer.table_digest != NO_TABLE and peer.heard_s > since_s:
                return True
        return False
