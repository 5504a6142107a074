"""Who takes part, as one drone knows it: suspicion, its refutation, loss, departure, return.

Every member has a register of three counters, and merging takes of each the greater: lost, repeated and reordered
messages do no harm. A *life* is the time between two doubts about a member. Whoever misses a neighbour says that it
is *suspected* in its present life. That alone moves nobody: the suspected one hears of it, by whatever way it still
hears the swarm, and begins its next life, which refutes it. Only a suspicion that stands for `SETTLE_S` makes a
member *lost*, and everybody counts that time on its own clock, and trusts its own ears: whoever has heard the
suspected one of late waits for `OBJECTION_S`. A member that is lost and heard again later refutes in the same way,
and takes part again.

A member *leaves* by saying so, or by a state that says that it does not take part; it returns with its next life,
once it is in the air.

Lives rise by one at a time. What is told beyond `STRIDE` above the known life counts for that much only, and a
suspicion or departure never for more than the present life: a member that lies can make another one refute, but
neither outrun its refutation nor use up the numbers within a flight.
"""

from __future__ import annotations

import enum
import zlib
from collections import deque
from collections.abc import Collection, Mapping
from typing import Final, TypeAlias

import msgspec

from flightstack.swarm.peers import PeerFacts
from flightstack.swarm.reception import Reception
from flightstack.swarm.wire import MemberRegister
from mission.tree.slot_registers import STRIDE

SETTLE_S: Final = 0.3
"""How long a suspicion must stand unrefuted: word and answer take a tick of 0.1 s each, and one to spare. Where much
is lost it is longer, as the silence is that makes one suspected (`flightstack.swarm.reception`)."""

TOLD_SETTLE_S: Final = 0.2
"""The same where another has missed the drone before, as this one does now: two who miss it, and the word has been on
its way for a tick."""

OBJECTION_S: Final = 2.0
"""How long a drone waits for the refutation that has itself heard the suspected one of late, or knows that others do:
who only speaks and hears nobody cannot be a member, but a radio that loses a third needs more than one try."""

MOST_IN_VAIN: Final = 3
"""A drone that does not hear another one, which refutes all the same, doubles its patience with it so often."""

HEARD_S: Final = 2.0
"""A member heard within this time supports what this drone claims."""

STEADY_SUPPORT_S: Final = 5.0
"""Support is the least of this time: a drone that has just got its hearing back has none yet."""

JOIN_S: Final = 30.0
"""How long after the start a member may be unheard, or not arming yet, before that counts against it."""

_INSTANT_S: Final = 1e-6
"""Times are sums of ticks, and not exact."""


class Standing(enum.Enum):
    """What one member counts as."""

    ALIVE = "alive"
    SUSPECTED = "suspected"
    """Missed by a neighbour; it keeps its slot, and nobody moves for it yet."""
    LOST = "lost"
    LEFT = "left"
    """It said that it leaves, or does not take part: its heir does not wait for silence."""


MemberRegisters: TypeAlias = Mapping[int, MemberRegister]
"""By drone; a member that is not in it is in its first life, without doubt."""

UNDOUBTED: Final = MemberRegister()


def merge_members(ours: MemberRegisters, theirs: MemberRegisters) -> dict[int, MemberRegister]:
    """What both tell together: commutative, associative, idempotent."""
    merged = dict(ours)
    for drone, told in theirs.items():
        known = merged.get(drone, UNDOUBTED)
        merged[drone] = MemberRegister(
            max(known.life, told.life), max(known.suspected, told.suspected), max(known.left, told.left)
        )
    return merged


class Membership:
    """One drone's knowledge of who takes part in one survey. Knowledge of another survey must not be merged."""

    def __init__(
        self,
        drone: int,
        members: Collection[int],
        *,
        suspect_after_s: float,
        now_s: float = 0.0,
        takes_part: bool = True,
    ) -> None:
        """`takes_part` False: this drone comes late and has left until it says `rejoin`."""
        self._drone = drone
        self._members = tuple(members)
        self._others = frozenset(members) - {drone}
        self._suspect_after_s = suspect_after_s
        self._began_s = now_s
        self._takes_part = takes_part
        self._is_ready = False
        """In the air: until then others may count it out without an objection, and it waits for a slot later."""
        self._registers: dict[int, MemberRegister] = {}
        self._suspected_since_s: dict[int, tuple[int, float]] = {}
        """By drone: the life in which it is suspected, and since when that is known here."""
        self._missed_since_s: dict[int, float] = {}
        """By watched drone: since when it can have been missed, by its newest life or the beginning of the watch."""
        self._watched: Collection[int] = ()
        """Those that were given last."""
        self._joined: set[int] = set()
        """Members that were heard to take part in this survey."""
        self._incarnations: dict[int, int] = {}
        self._seen: dict[int, PeerFacts] = {}
        """The newest facts of each that have been looked at."""
        self._lost: dict[int, int] = {}
        """By drone: the life in which it was lost."""
        self._reception = Reception()
        self._vain: dict[int, int] = {}
        """By drone: how often it has refuted a suspicion of this drone's, which did not hear it: others do."""
        self._accused: dict[int, int] = {}
        """By drone: the life in which this drone has missed it."""
        self._support: deque[tuple[float, int]] = deque()
        """When how many were heard, of late: what a later time has not undercut, so that the first is the least."""
        self._present = frozenset(self._members)
        self._present_is_stale = True
        self._digest: int | None = None
        self._doubted_are_stale = False
        """Others may have come into doubt, or out of it, since the last step."""
        if not takes_part:
            self.leave()

    @property
    def registers(self) -> MemberRegisters:
        """What there is to tell: of members about whom there ever was a doubt."""
        return self._registers

    @property
    def digest(self) -> int:
        """32 bits that differ where two drones' registers differ."""
        if self._digest is None:
            self._digest = zlib.crc32(msgspec.msgpack.encode(sorted(self._registers.items())))
        return self._digest

    @property
    def present(self) -> frozenset[int]:
        """The members that count as there; the same object as long as it is the same."""
        if self._present_is_stale:
            self._present_is_stale = False
            present = frozenset(drone for drone in self._members if self._is_present(drone))
            if present != self._present:
                self._present = present
        return self._present

    @property
    def support(self) -> int:
        """How many members this drone has steadily heard, itself counted."""
        return self._support[0][1] if self._support else 1

    def standing(self, drone: int) -> Standing:
        register = self._registers.get(drone, UNDOUBTED)
        if register.left == register.life:
            return Standing.LEFT
        if register.suspected < register.life:
            return Standing.ALIVE
        return Standing.LOST if self._lost.get(drone) == register.life else Standing.SUSPECTED

    def leave(self) -> None:
        """This drone takes no part from now on: its heir does not wait for silence. Said again it changes nothing."""
        self._takes_part = self._is_ready = False
        own = self._own
        self._write(self._drone, msgspec.structs.replace(own, left=own.life))

    def rejoin(self) -> None:
        """This drone is in the air and takes part (again). Said again it changes nothing."""
        self._takes_part = self._is_ready = True
        self._refute()

    def merge(self, told: MemberRegisters) -> None:
        """Take what another tells of this survey; what it says of no member is nothing."""
        news = {drone: told[drone] for drone in told if told[drone] != self._registers.get(drone)}
        bounded = {drone: self._bounded(drone, news[drone]) for drone in self._members if drone in news}
        merged = merge_members(self._registers, bounded)
        for drone in bounded:
            self._write(drone, merged[drone])
        if self._takes_part and (self._is_ready or self._own.left < self._own.life):
            self._refute()
        else:
            self.leave()

    def step(self, now_s: float, peers: Mapping[int, PeerFacts], watched: Collection[int]) -> tuple[int, ...]:
        """Look for who is missed among `watched`, and who has left among all that are heard; give who is lost since
        the step before, by ascending id."""
        seen, others = self._seen, self._others
        news = {drone: peer for drone, peer in peers.items() if seen.get(drone) is not peer}
        seen.update(news)
        self._reception.look(news)
        for drone, peer in news.items():
            if drone in others and now_s - peer.heard_s < self._suspect_after_s:
                self._look_at(now_s, drone, peer)
                self._accused.pop(drone, None)
                self._vain.pop(drone, None)
        heard = 1
        for drone, peer in peers.items():
            if peer.taking_part and now_s - peer.heard_s < HEARD_S and drone in others:
                heard += 1
        if self._support and now_s - self._support[-1][0] > self._suspect_after_s:
            self._wake(now_s)
            heard = 1
        self._note_support(now_s, heard)
        self._watch(now_s, peers, watched)
        return self._count_out(now_s, peers)

    @property
    def _own(self) -> MemberRegister:
        return self._registers.get(self._drone, UNDOUBTED)

    def _wake(self, now_s: float) -> None:
        """This program stood still, and heard nobody because of that: nobody is missed for it, and no suspicion has
        stood meanwhile. Nor can it tell who heard it."""
        self._missed_since_s = dict.fromkeys(self._missed_since_s, now_s)
        self._suspected_since_s = {d: (life, now_s) for d, (life, _) in self._suspected_since_s.items()}

    def _write(self, drone: int, register: MemberRegister) -> None:
        if self._registers.get(drone) != register:
            self._registers[drone] = register
            self._present_is_stale, self._digest, self._doubted_are_stale = True, None, True

    def _is_present(self, drone: int) -> bool:
        return drone not in self._registers or self.standing(drone) not in (Standing.LOST, Standing.LEFT)

    def _refute(self) -> None:
        """Begin the next life if the present one is in doubt."""
        own = self._own
        if max(own.suspected, own.left) >= own.life:
            self._write(self._drone, msgspec.structs.replace(own, life=own.life + 1))

    def _bounded(self, drone: int, told: MemberRegister) -> MemberRegister:
        life = min(told.life, self._registers.get(drone, UNDOUBTED).life + STRIDE)
        return MemberRegister(life, min(told.suspected, life), min(told.left, life))

    def _look_at(self, now_s: float, drone: int, peer: PeerFacts) -> None:
        """By what a member has just said of itself: that it takes part, or that it does not, or that it has been
        restarted and knows nothing of the survey any more."""
        restarted = self._incarnations.get(drone, peer.incarnation) != peer.incarnation
        self._incarnations[drone] = peer.incarnation
        if peer.taking_part:
            self._joined.add(drone)
            absent = False
        else:
            absent = drone in self._joined or now_s - self._began_s > JOIN_S
        if (restarted or absent) and self.standing(drone) is not Standing.LEFT:
            register = self._registers.get(drone, UNDOUBTED)
            self._write(drone, msgspec.structs.replace(register, left=register.life))

    def _watch(self, now_s: float, peers: Mapping[int, PeerFacts], watched: Collection[int]) -> None:
        if watched is not self._watched:
            self._watched = watched
            self._missed_since_s = {
                drone: self._missed_since_s.get(drone, now_s) for drone in {*watched} - {self._drone}
            }
        patience_s = self._suspect_after_s * self._reception.patience
        for drone, before_s in self._missed_since_s.items():
            heard_s = peers[drone].heard_s if drone in peers else self._began_s
            missed_s = self._missed_since_s[drone] = max(before_s, heard_s)
            register = self._registers.get(drone, UNDOUBTED)
            if self._accused and self._accused.get(drone, register.life) < register.life:
                self._accused.pop(drone)
                self._vain[drone] = min(self._vain.get(drone, 0) + 1, MOST_IN_VAIN)
            may_be_late = drone not in self._joined and now_s - self._began_s < JOIN_S
            if now_s - missed_s <= patience_s * 2 ** self._vain.get(drone, 0) or may_be_late:
                continue
            if self.standing(drone) is Standing.ALIVE:
                self._write(drone, msgspec.structs.replace(register, suspected=register.life))
                self._accused[drone] = register.life
                # Its next life, if it comes, is a word of its own: it is missed anew from then on.
                self._missed_since_s[drone] = now_s

    def _count_out(self, now_s: float, peers: Mapping[int, PeerFacts]) -> tuple[int, ...]:
        if self._doubted_are_stale:
            self._doubted_are_stale = False
            doubted = {
                drone: register.life
                for drone, register in self._registers.items()
                if register.suspected == register.life and drone != self._drone
            }
            since_s = self._suspected_since_s
            self._suspected_since_s = {
                drone: since_s[drone] if drone in since_s and since_s[drone][0] == life else (life, now_s)
                for drone, life in doubted.items()
            }
        before = self._lost
        if not (self._suspected_since_s or before):
            return ()
        self._lost = {}
        patience = self._reception.patience
        for drone, (life, at_s) in self._suspected_since_s.items():
            is_heard = drone in peers and now_s - peers[drone].heard_s <= self._suspect_after_s * patience
            settle_s = patience * (SETTLE_S if drone in self._accused else TOLD_SETTLE_S)
            waits = is_heard or drone in self._vain
            if now_s - at_s >= (OBJECTION_S if waits else settle_s) - _INSTANT_S:
                self._lost[drone] = life
        if self._lost != before:
            self._present_is_stale = True
        return tuple(sorted(drone for drone, life in self._lost.items() if before.get(drone) != life))

    def _note_support(self, now_s: float, heard: int) -> None:
        support = self._support
        while support and support[-1][1] >= heard:
            support.pop()
        support.append((now_s, heard))
        while now_s - support[0][0] > STEADY_SUPPORT_S:
            support.popleft()
