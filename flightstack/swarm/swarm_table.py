"""The swarm as one drone knows it: who takes part, who holds which slot, what the root ordered, what was measured.

The protocol is state, not conversation. What is told is merged register by register, so lost, repeated and reordered
messages do no harm, and knowledge travels as many hops as it must. Nobody decides for others:

* Who takes part is `membership`: neighbours in the tree watch each other (`mission.tree.watching`), a suspicion moves
  nobody until it has stood unrefuted.
* Which slot whose is, each drone claims for itself (`mission.tree.slot_registers`): an heir at once, the others only
  in a table that has not changed for a while, because they may not have heard everything yet.
* The root orders (`orders`), and readings come up to it (`reading_relay`); both are told apart from the table. The
  root whose table has changed orders anew, so that the formation goes on from where it stopped.
* While the table changes or somebody flies to a new slot the swarm holds (`table_calm`).
* Where the others fly another survey, `survey_choice` says which one to join.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping
from typing import Final

import msgspec

from flightstack.swarm.membership import Membership
from flightstack.swarm.news import TreeNews
from flightstack.swarm.orders import Orders, stopped_anchor
from flightstack.swarm.overdue_heirs import OverdueHeirs
from flightstack.swarm.peers import PeerFacts
from flightstack.swarm.reading_relay import ReadingRelay
from flightstack.swarm.survey_choice import SurveyChoice
from flightstack.swarm.table_calm import TableCalm
from flightstack.swarm.wire import OrderState, ReadingsState, TableState
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
    configured,
    digest,
    is_settled,
    merge,
    own_claims,
    within_stride,
)
from mission.tree.watching import watched

POSITION_S: Final = 2.0
"""A position this young tells where a drone stopped."""


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
        self._orders_told = 0
        self._readings_told = 0
        self._surveys = SurveyChoice()
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
        self._relay = ReadingRelay(self._drone)
        self._start_ned_m = anchor_ned_m
        self._held: int | None = None
        self._calm = TableCalm()
        self._family: Place | None = None
        self._heirs = OverdueHeirs(self._drone, self._table)
        self._is_whole = False
        self._nothing_for: tuple[Registers, frozenset[int], tuple[frozenset[int], int, int | None]] | None = (
            None
        )
        """What this drone knew when there was nothing for it to claim."""
        self._looked_at: tuple[Registers, frozenset[int]] | None = None
        self._watched_in: tuple[Mapping[int, int], frozenset[int]] | None = None
        self._watched: frozenset[int] = frozenset()
        self._digested: tuple[Registers, int] | None = None
        self._digest = 0
        self._placed: tuple[Registers, Mapping[int, int], bool, TreePlace] | None = None
        """The newest place, behind what it was made of."""
        self._look(now_s)
        self._calm = TableCalm()
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
        return not self.member and self._calm.is_steady(now_s)

    @property
    def epoch(self) -> int:
        """How often slots were claimed or vacated, as far as is known; it never falls within a survey."""
        return sum(register.version for register in self.registers.values())

    @property
    def digest(self) -> int:
        """32 bits that differ where two drones would tell another table."""
        registers, members = self.registers, self._membership.digest
        if self._digested is None or self._digested[0] is not registers or self._digested[1] != members:
            self._digested = registers, members
            rest = msgspec.msgpack.encode((self.survey, members))
            self._digest = zlib.crc32(rest, digest(registers))
        return self._digest

    @property
    def order_digest(self) -> int:
        """The same of the order; `NO_ORDER` where none is known."""
        return self._orders.digest(self.survey or "")

    @property
    def member(self) -> bool:
        return self._drone in self.slots

    @property
    def is_over(self) -> bool:
        """Whether everybody is on the way home, so that nobody is missed any more."""
        return self.order is not None and self.order.stage.ends_survey

    @property
    def order(self) -> Order | None:
        return self._orders.order

    @property
    def readings(self) -> tuple[Reading, ...]:
        """The readings for the current order, by ascending drone: at the root all that have come up, elsewhere those
        of the own subtree."""
        return self._relay.readings

    def step(
        self,
        now_s: float,
        heard: Iterable[TableState | OrderState | ReadingsState],
        peers: Mapping[int, PeerFacts],
        decision: Decision | None,
        own_position_ned_m: Vector3 | None,
    ) -> TreeNews:
        """Merge what came, adopt this drone's own decision of the tick before, look for losses, claim."""
        tables: list[TableState] = []
        orders: list[OrderState] = []
        readings: list[ReadingsState] = []
        for told in heard:
            match told:
                case TableState():
                    tables.append(told)
                case OrderState():
                    orders.append(told)
                case ReadingsState():
                    readings.append(told)
        self._surveys.hear(now_s, tables, orders, peers)
        if self.survey is None:
            return TreeNews()
        joined = self._join_the_foremost(now_s)
        slot, order, heals = self.slots.get(self._drone), self.order, self.heals
        for table in tables:
            self._merge(table)
        for ordered in orders:
            self._hear_order(ordered)
        lost: tuple[int, ...] = ()
        if not self.is_over:
            self._look_whom_to_watch()
            lost = self._membership.step(now_s, peers, self._watched)
        self._look(now_s)
        self._claim(now_s)
        self._count_heals(now_s)
        if self.slots.get(self._drone) == 0:
            self._lead(now_s, peers, decision, own_position_ned_m)
        self._relay.follow(self.order, self._relations() if self.member else None)
        for told_readings in readings:
            if told_readings.survey == self.survey:
                self._relay.hear(now_s, told_readings, self.slots)
        if decision is not None and decision.reading is not None and self.member:
            self._relay.note(now_s, decision.reading)
        moving = {drone for drone, peer in peers.items() if peer.moving and now_s - peer.heard_s < POSITION_S}
        self._calm.look(now_s, somebody_moves=not moving.isdisjoint(self.slots))
        now_in = self.slots.get(self._drone)
        return TreeNews(
            lost=lost,
            healed=self.heals != heals,
            moved=now_in is not None and now_in != slot,
            order=self.order if self.order != order else None,
            joined=joined,
        )

    def place(self, now_s: float) -> TreePlace:
        """This drone's place; `slot` is -1 without one. `healing` while the table changes or somebody is on the way
        to its new slot."""
        registers, slots, healing = self.registers, self.slots, self._calm.holds(now_s)
        placed = self._placed
        if placed is not None and placed[0] is registers and placed[1] is slots and placed[2] == healing:
            return placed[3]
        known = TreePlace(self.epoch, -1, dict(slots), None, (), None, None, -1, False)
        if self.member:
            f = self._relations()
            relations = f.parent, f.children, f.heir, f.parent_heir, f.root
            known = TreePlace(self.epoch, slots[self._drone], dict(slots), *relations, healing)
        self._placed = registers, slots, healing, known
        return known

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
            self.heals,
            self.digest,
        )

    def order_message(self) -> OrderState:
        """The order that counts. `ValueError` where none is known."""
        order, ordered_by = self._orders.order, self._orders.ordered_by
        if order is None or ordered_by is None:
            raise ValueError("no order is known")
        self._orders_told += 1
        return OrderState(
            self._drone,
            self._incarnation,
            self._orders_told,
            self._frame_identity,
            self.survey or "",
            order,
            ordered_by,
            self.order_digest,
        )

    def readings_message(self, now_s: float, tick_s: float) -> ReadingsState | None:
        """What this drone has to say of readings in this tick, if anything; it counts as told."""
        due = self._relay.due(now_s, tick_s)
        if due is None or self.survey is None or self.order is None:
            return None
        self._readings_told += 1
        readings, held, to_anybody = due
        return ReadingsState(
            self._drone,
            self._incarnation,
            self._readings_told,
            self._frame_identity,
            self.survey,
            self.order.sequence,
            readings,
            held,
            to_anybody,
        )

    def _relations(self) -> Place:
        """This drone's relations, computed once an assignment."""
        if self._family is None:
            self._family = place(self.slots, self._layout, self._drone)
        return self._family

    def _join_the_foremost(self, now_s: float) -> bool:
        """Take part in the survey that has come further than this drone's own: in the slot that it has there, or, if
        it was counted out, in whatever slot it gets once it says `rejoin`."""
        own = self.survey or ""
        foremost = self._surveys.foremost(own, self.epoch, self.order) if self._surveys.differ(own) else None
        if foremost is None:
            return False
        told, ordered = foremost
        self.begin(now_s, told.survey, self._start_ned_m, takes_part=self._drone not in told.absent)
        self._orders = Orders()
        self._merge(told)
        if ordered is not None:
            self._hear_order(ordered)
        return True

    # -- merging ----------------------------------------------------------------------------------------------

    def _merge(self, told: TableState) -> None:
        if told.survey != self.survey:
            return
        lives = self._membership.registers
        members = {drone: register for drone, register in told.members if lives.get(drone) != register}
        if members:
            self._membership.merge(members)
        ours, size = self.registers, len(self._members)
        slots = {s: register for s, register in told.slots if ours.get(s) != register and 0 <= s < size}
        if slots:
            self.registers = merge(ours, within_stride(ours, slots))

    def _hear_order(self, told: OrderState) -> None:
        if told.survey == self.survey:
            self._orders.offer(told.order, told.ordered_by, self._root_claim)

    # -- members and slots ------------------------------------------------------------------------------------

    def _look_whom_to_watch(self) -> None:
        slots, present = self.slots, self._membership.present
        if self._watched_in is None or self._watched_in[0] is not slots or self._watched_in[1] is not present:
            self._watched_in = slots, present
            self._watched = watched(slots, present, self._table, self._drone)

    def _look(self, now_s: float) -> None:
        """Who holds which slot now."""
        known = self.registers, self._membership.present
        if self._looked_at is not None and known[0] is self._looked_at[0] and known[1] is self._looked_at[1]:
            return
        self._looked_at = known
        slots = assignment(self.registers, self._membership.present)
        if slots != self.slots:
            self.slots = slots
            self._is_whole = not problems(slots, self._layout)
            self._calm.change(now_s)
            self._family = None
        self._calm.settle(is_settled(self.registers, self._membership.present, self._table))
        if self._calm.is_settled:
            self._heirs.forget()

    def _claim(self, now_s: float) -> None:
        present = self._membership.present
        if self._drone in present and self._is_whole and not self._calm.is_unchanged(now_s):
            return
        passed: frozenset[int] = frozenset()
        if not self._calm.is_settled:
            passed = self._heirs.passed_over(now_s, self.registers, present)
        support = self._membership.support
        known = passed, support, self._held
        if self._nothing_for is not None:
            registers, others, rest = self._nothing_for
            if registers is self.registers and others is present and rest == known:
                return
        claimed = own_claims(self.registers, present - passed, self._table, self._drone, support, self._held)
        if claimed:
            self.registers = merge(self.registers, claimed)
            self._look(now_s)
        else:
            self._nothing_for = self.registers, present, known
        self._held = self.slots.get(self._drone, self._held)

    def _count_heals(self, now_s: float) -> None:
        if not self.member or self.is_over:
            return
        if self._calm.is_steady(now_s) and self.slots != self._settled_slots:
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
        if not self._calm.is_steady(now_s):
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
