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
"""The shortest time between two tellings of the table; news do not wait for the end of it after a repetition."""

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
        self._told_again = False
        """The newest telling repeated what had been told before."""

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
        if self._told_s is not None:
            since_s = now_s - self._told_s + 0.5 * self._tick_s
            is_new = digest != self._told_digest
            differs = is_new or any(
                peer.table_digest not in (digest, NO_TABLE) and now_s - peer.heard_s < DIGEST_S
                for peer in peers.values()
            )
            is_shown = slots == self._told_slots
            period_s = PERIOD_S if differs else REFRESH_S if is_shown else SHOWN_S
            if since_s < period_s and not (is_new and self._told_again):
                return False
            self._told_again = not is_new
        self._told_s, self._told_digest, self._told_slots = now_s, digest, slots
        return True
