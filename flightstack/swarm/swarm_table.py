"""The swarm as one drone knows it: who takes part, who holds which slot, what the root ordered, what was measured.

The protocol is state, not conversation. What is told is merged register by register, so lost, repeated and reordered
messages do no harm, and knowledge travels as many hops as it must. Nobody decides for others:

* Who takes part is `membership`: neighbours in the tree watch each other, a suspicion moves nobody until it has stood
  unrefuted. Where a neighbour's slot is empty, the next ones beyond it are watched, so that a branch whose drones
  are lost together is found out from both its ends.
* Which slot whose is, each drone claims for itself (`mission.tree.slot_registers`): an heir at once, the others only
  in a table that has not changed for a while, because they may not have heard everything yet.
* The root orders (`orders`). The root whose table has changed orders anew, so that the formation goes on from
  where it stopped.
* While the table changes the swarm holds, but no longer than `HEAL_LIMIT_S` at a time.
* A survey is known by the command that started it. Two operators who start at once make two; then everybody joins
  the one that has come further.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterable, Mapping
from typing import Final

import msgspec

from flightstack.swarm.membership import SETTLE_S, Membership
from flightstack.swarm.news import TreeNews
from flightstack.swarm.orders import Orders, stopped_anchor
from flightstack.swarm.peers import PeerFacts
from flightstack.swarm.wire import TableState
from mission.estimation.estimates import Reading
from mission.geometry.formation import Layout
from mission.geometry.frames import Vector3
from mission.strategies.contract import Decision, Order, Stage, TreePlace
from mission.tree.balanced_tree import Place, place, problems
from mission.tree.slot_registers import (
    NEVER_HELD,
    Registers,
    SlotRegister,
    assignment,
    awaited_heirs,
    configured,
    digest,
    is_settled,
    merge,
    own_claims,
    within_stride,
)

HELD_S: Final = 2.0 * SETTLE_S
"""How long the swarm holds after the table has changed: as long as an objection takes."""

HEAL_LIMIT_S: Final = 60.0
"""How long the swarm holds for a heal that does not come to its end."""

CLAIM_S: Final = 3.0
"""How long an heir may leave a hole above it open before it is passed over."""

STEADY_S: Final = 1.0
"""How long a peer must tell of one survey before that counts."""

POSITION_S: Final = 2.0
"""A position this young tells where a drone stopped."""


class _Flown(msgspec.Struct):
    """What a peer tells that takes part in a survey."""

    told: TableState
    since_s: float
    """When the peer was first heard to take part in this survey."""
    heard_s: float

    @property
    def steady(self) -> bool:
        return self.heard_s - self.since_s >= STEADY_S


class SwarmTable:
    """One drone's part in the protocol; `step` once a tick, then `place`, `order` and `readings` to read."""

    def __init__(
        self,
        drone: int,
        members: tuple[int, ...],
        layout: Layout,
        *,
        frame_identity: int,
        incarnation: int,
        suspect_after_s: float,
    ) -> None:
        self._drone = drone
        self._members = members
        self._layout = layout
        self._table = layout.table(len(members))
        self._frame_identity = frame_identity
        self._incarnation = incarnation
        self._suspect_after_s = suspect_after_s
        self._told = 0
        self._flown: dict[int, _Flown] = {}
        self.survey: str | None = None
        self._reset(0.0, (0.0, 0.0, 0.0), takes_part=True)

    def _reset(self, now_s: float, anchor_ned_m: Vector3, *, takes_part: bool) -> None:
        self._membership = Membership(
            self._drone,
            self._members,
            suspect_after_s=self._suspect_after_s,
            now_s=now_s,
            takes_part=takes_part,
        )
        self.registers: Registers = configured(self._members)
        self.slots: dict[int, int] = {}
        """drone -> slot of every member that counts as there."""
        self.heals = 0
        self._orders = Orders()
        self._start_ned_m = anchor_ned_m
        self._held: int | None = None
        self._changed_s = -math.inf
        self._unsettled_since_s: float | None = None
        self._family: Place | None = None
        self._awaited_since_s: dict[int, float] = {}
        self._passed_over: set[int] = set()
        self._looked_at: tuple[Registers, frozenset[int]] | None = None
        self._look(now_s)
        self._changed_s = -math.inf
        self._settled_slots = self._slots_before = self.slots
        """The newest assignment that was whole and steady, and the one before it."""
        self._ordered_slots = self.slots
        """The assignment for which this drone, as root, has ordered."""

    def begin(self, now_s: float, survey: str, anchor_ned_m: Vector3, *, takes_part: bool = True) -> None:
        """A survey starts: everybody in the slot that the configuration gives, formed up over the anchor."""
        self._reset(now_s, anchor_ned_m, takes_part=takes_part)
        self.survey = survey
        if self.slots.get(self._drone) == 0:
            self._give(Order(1, Stage.FORM, anchor_ned_m, 0.0))

    def leave(self) -> None:
        """Announce that this drone takes no part any more; its heir does not wait for silence."""
        self._held = None
        self._membership.leave()

    def rejoin(self) -> None:
        """This drone is in the air and flies to whatever slot it gets; said again it changes nothing."""
        self._membership.rejoin()

    def has_handed_over(self, now_s: float) -> bool:
        """Whether this drone, which has announced that it leaves, is waited for no more: its heir has claimed its
        slot, and nobody objects."""
        return not self.member and self._is_steady(now_s)

    @property
    def epoch(self) -> int:
        """How often slots were claimed or vacated, as far as is known; it never falls within a survey."""
        return sum(register.version for register in self.registers.values())

    @property
    def digest(self) -> int:
        """32 bits that differ where two drones would tell another table."""
        orders = self._orders
        read = [reading.drone for reading in orders.readings]
        rest = (self.survey, self._membership.digest, orders.order, orders.ordered_by, read)
        return zlib.crc32(msgspec.msgpack.encode(rest), digest(self.registers))

    @property
    def member(self) -> bool:
        return self._drone in self.slots

    @property
    def is_over(self) -> bool:
        """Whether everybody is on the way home, so that nobody is missed any more."""
        return self.order is not None and self.order.stage in (Stage.FOUND, Stage.GIVE_UP)

    @property
    def order(self) -> Order | None:
        return self._orders.order

    @property
    def readings(self) -> tuple[Reading, ...]:
        """The readings for the current order that have reached this drone, by ascending drone."""
        return self._orders.readings

    def step(
        self,
        now_s: float,
        heard: Iterable[TableState],
        peers: Mapping[int, PeerFacts],
        decision: Decision | None,
        own_position_ned_m: Vector3 | None,
    ) -> TreeNews:
        """Merge what came, adopt this drone's own decision of the tick before, look for losses, claim."""
        heard = tuple(heard)
        self._look_at_surveys(now_s, heard, peers)
        if self.survey is None:
            return TreeNews()
        joined = self._join_the_foremost(now_s)
        slot, order, heals = self.slots.get(self._drone), self.order, self.heals
        for told in heard:
            self._merge(told)
        lost: tuple[int, ...] = ()
        if not self.is_over:
            lost = self._membership.step(now_s, peers, self._watched())
        self._look(now_s)
        self._claim(now_s)
        self._count_heals(now_s)
        if self.slots.get(self._drone) == 0:
            self._lead(now_s, peers, decision, own_position_ned_m)
        if decision is not None and decision.reading is not None:
            self._orders.note((decision.reading,), self.slots)
        now_in = self.slots.get(self._drone)
        return TreeNews(
            lost=lost,
            healed=self.heals != heals,
            moved=now_in is not None and now_in != slot,
            order=self.order if self.order != order else None,
            joined=joined,
        )

    def place(self, now_s: float, peers: Mapping[int, PeerFacts]) -> TreePlace:
        """This drone's place; `slot` is -1 without one. `healing` while the table changes or somebody is on the way
        to its new slot."""
        if not self.member:
            return TreePlace(self.epoch, -1, dict(self.slots), None, (), None, None, -1, False)
        family = self._relations()
        moving = any(
            peer.moving and drone in self.slots and now_s - peer.heard_s < POSITION_S
            for drone, peer in peers.items()
        )
        return TreePlace(
            self.epoch,
            self.slots[self._drone],
            dict(self.slots),
            family.parent,
            family.children,
            family.heir,
            family.parent_heir,
            family.root,
            self._is_changing(now_s) or moving,
        )

    def message(self) -> TableState:
        self._told += 1
        return TableState(
            self._drone,
            self._incarnation,
            self._told,
            self._frame_identity,
            self.survey or "",
            tuple(sorted(self.registers.items())),
            tuple(sorted(self._membership.registers.items())),
            tuple(sorted(set(self._members) - self._membership.present)),
            self.order,
            self._orders.ordered_by,
            self.readings,
            self.heals,
        )

    def _relations(self) -> Place:
        """This drone's relations, computed once an assignment."""
        if self._family is None:
            self._family = place(self.slots, self._layout, self._drone)
        return self._family

    # -- which survey -----------------------------------------------------------------------------------------

    def _look_at_surveys(
        self, now_s: float, heard: Iterable[TableState], peers: Mapping[int, PeerFacts]
    ) -> None:
        for told in heard:
            peer = peers.get(told.sender)
            before = self._flown.pop(told.sender, None)
            if peer is None or not peer.taking_part or not told.survey:
                continue
            again = before is not None and before.told.survey == told.survey
            since_s = before.since_s if before is not None and again else now_s
            self._flown[told.sender] = _Flown(told, since_s, now_s)
        self._flown = {d: flown for d, flown in self._flown.items() if now_s - flown.heard_s < POSITION_S}

    def _join_the_foremost(self, now_s: float) -> bool:
        """Take part in the survey that has come further than this drone's own: in the slot that it has there, or, if
        it was counted out, in whatever slot it gets once it says `rejoin`."""
        joined = False
        for flown in self._flown.values():
            told = flown.told
            if told.survey == self.survey or not flown.steady:
                continue
            own = -self.epoch, -self.order.sequence if self.order is not None else 0, self.survey or ""
            if _foremost_first(told) < own:
                counted_in = self._drone not in told.absent
                self.begin(now_s, told.survey, self._start_ned_m, takes_part=counted_in)
                self._orders = Orders()
                self._merge(told)
                joined = True
        return joined

    # -- merging ----------------------------------------------------------------------------------------------

    def _merge(self, told: TableState) -> None:
        if told.survey != self.survey:
            return
        self._membership.merge(dict(told.members))
        slots = {slot: register for slot, register in told.slots if 0 <= slot < len(self._table)}
        self.registers = merge(self.registers, within_stride(self.registers, slots))
        if told.order is not None and told.ordered_by is not None:
            self._orders.offer(told.order, told.ordered_by, self._root_claim)
        self._orders.note(told.readings, self.slots)

    # -- members and slots ------------------------------------------------------------------------------------

    def _watched(self) -> set[int]:
        """Whom this drone has to miss: the next above and below in the tree, beyond empty slots too; the others
        next below an empty root's slot; and who has no slot, and so no neighbours, yet."""
        present = self._membership.present
        watched = set(present - self.slots.keys())
        own = self.slots.get(self._drone)
        if own is None:
            return watched
        holder = {slot: drone for drone, slot in self.slots.items()}
        above = self._next_above(own, holder)
        for slot, drone in holder.items():
            up = self._next_above(slot, holder)
            if slot != own and (up == own or slot == above or (up is None and above is None)):
                watched.add(drone)
        return watched

    def _next_above(self, slot: int, holder: Mapping[int, int]) -> int | None:
        """The nearest held slot on the way to the root."""
        up = int(self._table.parent[slot])
        while up >= 0 and up not in holder:
            up = int(self._table.parent[up])
        return up if up >= 0 else None

    def _look(self, now_s: float) -> None:
        """Who holds which slot now."""
        known = self.registers, self._membership.present
        if known == self._looked_at:
            return
        self._looked_at = known
        slots = assignment(self.registers, self._membership.present)
        if slots != self.slots:
            self.slots = slots
            self._changed_s = now_s
            self._family = None
        if is_settled(self.registers, self._membership.present, self._table):
            self._unsettled_since_s = None
        elif self._unsettled_since_s is None:
            self._unsettled_since_s = now_s

    def _claim(self, now_s: float) -> None:
        present = self._membership.present
        is_whole = not problems(self.slots, self._layout)
        if self._drone in present and is_whole and now_s - self._changed_s < SETTLE_S:
            return
        self._pass_over(now_s, present)
        claimed = own_claims(
            self.registers,
            present - self._passed_over,
            self._table,
            self._drone,
            self._membership.support,
            self._held,
        )
        if claimed:
            self.registers = merge(self.registers, claimed)
            self._look(now_s)
        self._held = self.slots.get(self._drone, self._held)

    def _pass_over(self, now_s: float, present: frozenset[int]) -> None:
        """Count as not there, for this drone's own claims, who lets a hole be that it is the heir of: it is heard, so
        it is not lost, but something in it does not work."""
        if self._unsettled_since_s is None:
            self._passed_over = set()
            self._awaited_since_s = {}
            return
        awaited = awaited_heirs(self.registers, present - self._passed_over, self._table) - {self._drone}
        self._awaited_since_s = {drone: self._awaited_since_s.get(drone, now_s) for drone in awaited}
        self._passed_over |= {d for d, since_s in self._awaited_since_s.items() if now_s - since_s > CLAIM_S}

    def _is_changing(self, now_s: float) -> bool:
        since_s = self._unsettled_since_s
        if since_s is not None:
            return now_s - since_s < HEAL_LIMIT_S
        return now_s - self._changed_s < HELD_S

    def _is_steady(self, now_s: float) -> bool:
        since_s = self._unsettled_since_s
        is_healing = since_s is not None and now_s - since_s < HEAL_LIMIT_S
        return not is_healing and now_s - self._changed_s >= SETTLE_S

    def _count_heals(self, now_s: float) -> None:
        if self.member and not self.is_over and self._is_steady(now_s) and self.slots != self._settled_slots:
            self._slots_before, self._settled_slots = self._settled_slots, self.slots
            self.heals += any(self.slots.get(drone) != slot for drone, slot in self._slots_before.items())

    # -- the root ---------------------------------------------------------------------------------------------

    def _lead(
        self,
        now_s: float,
        peers: Mapping[int, PeerFacts],
        decision: Decision | None,
        own_position_ned_m: Vector3 | None,
    ) -> None:
        """As root: order what the own strategy decided, or anew where the formation stands after a change."""
        if not self._is_steady(now_s):
            return
        known = self.order
        if known is None or self._orders.ordered_by != self._root_claim or self._ordered_slots != self.slots:
            order = known or Order(0, Stage.FORM, self._start_ned_m, 0.0)
            anchor_ned_m = order.anchor_ned_m
            if order.stage is not Stage.FORM and not order.apart:
                where = {d: p.position_ned_m for d, p in peers.items() if now_s - p.heard_s < POSITION_S}
                where[self._drone] = own_position_ned_m
                stay = {d: s for d, s in self.slots.items() if self._slots_before.get(d) == s}
                anchor_ned_m = stopped_anchor(order, self._layout, stay, where)
            sequence = self._orders.next_sequence
            self._give(msgspec.structs.replace(order, sequence=sequence, anchor_ned_m=anchor_ned_m))
            return
        ordered = decision.order if decision is not None else None
        if ordered is not None and ordered.sequence > known.sequence:
            self._give(ordered)

    def _give(self, order: Order) -> None:
        self._ordered_slots = self.slots
        self._orders.set(order, self._root_claim)

    @property
    def _root_claim(self) -> SlotRegister:
        return self.registers.get(0, NEVER_HELD)


def _foremost_first(told: TableState) -> tuple[int, int, str]:
    """By how far a survey has come; between two that have only begun, everybody must choose the same."""
    versions = sum(register.version for _, register in told.slots)
    return -versions, -told.order.sequence if told.order is not None else 0, told.survey
