"""The swarm's tree as one drone knows it: who holds which slot, what the root ordered, who is lost.

The protocol is state, not conversation. Every drone tells its whole knowledge (`TreeState`) several times a
second; merging is idempotent, so lost, repeated and reordered messages do no harm, and knowledge travels as many
hops as it must.

* An *epoch* is one assignment of slots. Each heal makes one from the one before, and so has a *lineage*: for every
  epoch since the start, how many survivors its author heard, and who that was. A descendant stands against its
  ancestors. Where two halves of a swarm that could not hear each other have healed apart, the one stands whose
  author heard more survivors when they parted (then the lower id): a drone whose own radio failed for a while, and
  that therefore counted everybody else out, must not send the others home when it is heard again.
* Parent and children watch each other. Who falls silent, or says by its phase that it left, is *lost*, and that
  spreads. While somebody is lost the swarm stops.
* Whoever will be root after healing makes the next epoch: the root itself, or its heir when it is the root that
  was lost, or the heir's heir: everybody computes the same (`mission.tree.balanced_tree.heal`). One that does
  not act in time is lost as well.
* The new epoch comes with an order that keeps the formation where it stopped. Its readings are complete only once
  every moved drone is in its slot, so the search goes on by itself when the tree is whole again.
* Orders go down and readings go up through the same messages.
* A survey is known by the command that started it. Two operators who start at once, or one who starts again for a
  drone that did not hear the first time, make two; then everybody joins the one that has come further.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import msgspec

from flightstack.swarm.news import TreeNews
from flightstack.swarm.peers import PeerFacts
from flightstack.swarm.wire import TreeState
from mission.estimation.estimates import Reading
from mission.geometry.formation import Layout, rotated
from mission.geometry.frames import Vector3
from mission.strategies.contract import Decision, Order, Stage, TreePlace
from mission.tree.balanced_tree import Place, heal, place, problems

SETTLE_S = 0.5
"""How long the next root waits for news of further losses before it makes the new epoch."""

HEARD_S = 2.0
"""A survivor heard within this time is known to live when an epoch is made."""

JOIN_S = 30.0
"""How long after the start a member may be unheard or not yet arming before it counts as lost."""

STEADY_S = 1.0
"""How long a peer must tell of one survey before that counts: its newest state and tree may be of two surveys for as
long as it takes to send both."""


class _Flown(msgspec.Struct):
    """The tree of a peer that takes part in a survey."""

    tree: TreeState
    counts_us_in: bool
    since_s: float
    """When the peer was first heard to take part in this survey."""
    heard_s: float

    @property
    def steady(self) -> bool:
        return self.heard_s - self.since_s >= STEADY_S


class SwarmTree:
    """One drone's part in the tree protocol; `step` once a tick, then `place`, `order` and `readings` to read."""

    def __init__(
        self,
        drone: int,
        members: tuple[int, ...],
        layout: Layout,
        *,
        frame_identity: int,
        incarnation: int,
        lost_after_s: float,
    ) -> None:
        self._drone = drone
        self._members = members
        self._layout = layout
        self._frame_identity = frame_identity
        self._incarnation = incarnation
        self._lost_after_s = lost_after_s
        self.survey: str | None = None
        self.shut_out = False
        """The others fly a survey that does not count this drone in."""
        self._flown: dict[int, _Flown] = {}
        self._family: Place | None = None
        """This drone's relations in the present assignment, once they were asked for."""
        self._reset()

    def _reset(self) -> None:
        self._assign((), {drone: slot for slot, drone in enumerate(self._members)})
        self.order: Order | None = None
        self.heals = 0
        self._lost: set[int] = set()
        self._awaited: int | None = None
        """Who has to make the next epoch, while somebody is lost."""
        self._awaited_since_s = 0.0
        self._readings: dict[int, Reading] = {}
        self._started_s = 0.0
        self._start_ned_m: Vector3 = (0.0, 0.0, 0.0)
        self._watched_since_s: dict[int, float] = {}
        self._joined: set[int] = set()

    def _assign(self, lineage: tuple[tuple[int, int], ...], slots: Mapping[int, int]) -> None:
        self.lineage = lineage
        self.slots = dict(slots)
        self._assigned = tuple(sorted(slots.items()))

        self._family = None

    def begin(self, now_s: float, survey: str, anchor_ned_m: Vector3) -> None:
        """A survey starts: everybody in the slot that the configuration gives, formed up over the anchor."""
        self._reset()
        self.survey = survey
        self._start_ned_m = anchor_ned_m
        self._started_s = now_s
        if self.slots.get(self._drone) == 0:
            self.order = Order(1, Stage.FORM, anchor_ned_m, 0.0)

    @property
    def epoch(self) -> int:
        return len(self.lineage)

    @property
    def member(self) -> bool:
        return self._drone in self.slots

    def step(
        self,
        now_s: float,
        heard: Iterable[TreeState],
        peers: Mapping[int, PeerFacts],
        decision: Decision | None,
        own_position_ned_m: Vector3 | None,
    ) -> TreeNews:
        """Merge what came, adopt this drone's own decision of the tick before, look for losses, heal."""
        heard = tuple(heard)
        self._look_at_surveys(now_s, heard, peers)
        if self.survey is None:
            return TreeNews()
        joined = self._join_the_foremost(now_s)
        slot, order, lost, lineage = self.slots.get(self._drone), self.order, set(self._lost), self.lineage
        for state in heard:
            self._merge(state)
        if decision is not None and self.member:
            self._adopt(decision)
        if self.member:
            self._watch(now_s, peers)
            self._heal_if_mine(now_s, peers, own_position_ned_m)
        return TreeNews(
            lost=tuple(sorted(self._lost - lost)),
            healed=self.lineage != lineage,
            moved=self.slots.get(self._drone) != slot,
            order=self.order if self.order != order else None,
            joined=joined,
        )

    def place(self, now_s: float, peers: Mapping[int, PeerFacts]) -> TreePlace:
        """This drone's place. `healing` while somebody is lost or another is on the way to its new slot."""
        if not self.member:
            return TreePlace(self.epoch, -1, dict(self.slots), None, (), None, None, -1, False)
        family = self._relations()
        moving = any(
            peer.moving and drone in self.slots and now_s - peer.heard_s < self._lost_after_s
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
            bool(self._lost) or moving,
        )

    @property
    def readings(self) -> tuple[Reading, ...]:
        """The readings for the current order that have reached this drone, by ascending drone."""
        return tuple(self._readings[drone] for drone in sorted(self._readings))

    def message(self) -> TreeState:
        return TreeState(
            self._drone,
            self._incarnation,
            self._frame_identity,
            self.epoch,
            self.lineage[-1][1] if self.lineage else 0,
            self._assigned,
            tuple(sorted(self._lost)),
            self.order,
            self.readings,
            self.heals,
            self.survey or "",
            self.lineage,
        )

    def _relations(self) -> Place:
        """This drone's relations, computed once an assignment."""
        if self._family is None:
            self._family = place(self.slots, self._layout, self._drone)
        return self._family

    # -- which survey -----------------------------------------------------------------------------------------

    def _look_at_surveys(
        self, now_s: float, heard: Iterable[TreeState], peers: Mapping[int, PeerFacts]
    ) -> None:
        for state in heard:
            peer = peers.get(state.sender)
            before = self._flown.pop(state.sender, None)
            if peer is None or not peer.taking_part or not state.survey:
                continue
            if before is not None and before.tree is state:
                before.heard_s = now_s
                self._flown[state.sender] = before
                continue
            again = before is not None and before.tree.survey == state.survey
            since_s = before.since_s if before is not None and again else now_s
            self._flown[state.sender] = _Flown(state, _counts_in(state, self._drone), since_s, now_s)
        for drone, flown in tuple(self._flown.items()):
            if now_s - flown.heard_s > self._lost_after_s:
                del self._flown[drone]
        self.shut_out = any(not flown.counts_us_in and flown.steady for flown in self._flown.values())

    def _join_the_foremost(self, now_s: float) -> bool:
        joined = False
        for flown in self._flown.values():
            tree = flown.tree
            if (
                tree.survey != self.survey
                and flown.steady
                and flown.counts_us_in
                and _foremost_first(tree) < _foremost_first(self.message())
                and not problems(dict(tree.slots), self._layout)
            ):
                self.begin(now_s, tree.survey, self._start_ned_m)
                self._merge(tree)
                joined = True
        return joined

    # -- merging ----------------------------------------------------------------------------------------------

    def _merge(self, state: TreeState) -> None:
        if state.survey != self.survey:
            return
        if (state.lineage, state.slots) != (self.lineage, self._assigned):
            theirs, ours = _rank(state.lineage, state.slots), _rank(self.lineage, self._assigned)
            if theirs > ours:
                if problems(dict(state.slots), self._layout):
                    return  # not a tree: never to be flown
                self._assign(state.lineage, dict(state.slots))
                self.heals = state.heals
                self._lost = set()
                self._awaited = None
                self._set_order(state.order)
            elif theirs != ours:
                return
        if state.lost:
            self._lost |= set(state.lost) & self.slots.keys() - {self._drone}
        if state.order is not None and (self.order is None or state.order.sequence > self.order.sequence):
            self._set_order(state.order)
        for reading in state.readings:
            self._note_reading(reading)

    def _adopt(self, decision: Decision) -> None:
        if decision.reading is not None:
            self._note_reading(decision.reading)
        order = decision.order
        if order is None or self._lost or self.slots[self._drone] != 0:
            return
        if self.order is None or order.sequence > self.order.sequence:
            self._set_order(order)

    def _set_order(self, order: Order | None) -> None:
        self.order = order
        self._readings = {}

    def _note_reading(self, reading: Reading) -> None:
        if self.order is not None and reading.order == self.order.sequence and reading.drone in self.slots:
            self._readings[reading.drone] = reading

    # -- losses and healing -----------------------------------------------------------------------------------

    def _watch(self, now_s: float, peers: Mapping[int, PeerFacts]) -> None:
        """Find out whether parent and children live, by their voice and by what they say of themselves."""
        if self.order is not None and self.order.stage in (Stage.FOUND, Stage.GIVE_UP):
            return  # everybody is on the way home
        family = self._relations()
        watched = set(family.children)
        if family.parent is not None:
            watched.add(family.parent)
        self._watched_since_s = {d: self._watched_since_s.get(d, now_s) for d in watched}
        early = now_s - self._started_s < JOIN_S
        for drone in sorted(watched - self._lost):
            silence_s = min(_silence_s(now_s, peers, drone), now_s - self._watched_since_s[drone])
            peer = peers.get(drone)
            if peer is not None and peer.taking_part:
                self._joined.add(drone)
            patience_s = JOIN_S if early and drone not in self._joined else self._lost_after_s
            left = peer is not None and not peer.taking_part and (drone in self._joined or not early)
            if silence_s > patience_s or left:
                self._lost.add(drone)

    def _heal_if_mine(
        self, now_s: float, peers: Mapping[int, PeerFacts], own_position_ned_m: Vector3 | None
    ) -> None:
        """Make the next epoch if this drone is the root of the healed tree."""
        if not self._lost:
            return
        healed = heal(self.slots, self._layout, self._lost)
        heir = next(drone for drone, slot in healed.slots.items() if slot == 0)
        if heir != self._awaited:
            self._awaited, self._awaited_since_s = heir, now_s
        waited_s = now_s - self._awaited_since_s
        if heir != self._drone:
            if waited_s > self._lost_after_s + SETTLE_S:
                self._lost.add(
                    heir
                )  # it must have heard by now: it is gone too, and the next one's turn comes
            return
        if waited_s < SETTLE_S:
            return
        order = self.order or Order(0, Stage.FORM, self._start_ned_m, 0.0)
        anchor_ned_m = order.anchor_ned_m
        if order.stage is not Stage.FORM and not order.apart:
            where = {d: p.position_ned_m for d, p in peers.items() if now_s - p.heard_s < HEARD_S}
            where[self._drone] = own_position_ned_m
            stay = {d: s for d, s in healed.slots.items() if self.slots[d] == s}
            anchor_ned_m = self._stopped_anchor(stay, order, where)
        order = msgspec.structs.replace(order, sequence=order.sequence + 1, anchor_ned_m=anchor_ned_m)
        heard = sum(_silence_s(now_s, peers, drone) < HEARD_S for drone in healed.slots)
        self._assign((*self.lineage, (1 + heard, self._drone)), healed.slots)
        self.heals += 1
        self._lost = set()
        self._awaited = None
        self._set_order(order)

    def _stopped_anchor(
        self, stay: Mapping[int, int], order: Order, where: Mapping[int, Vector3 | None]
    ) -> Vector3:
        """Where the formation stands now: the mean of where those who keep their slots are, less their offsets."""
        corners: list[tuple[float, float]] = []
        for drone, slot in stay.items():
            position = where.get(drone)
            if position is not None:
                offset_n, offset_e = rotated(self._layout.offset_m(slot), order.rotation_rad)
                corners.append((position[0] - offset_n, position[1] - offset_e))
        if not corners:
            return order.anchor_ned_m
        north_m, east_m = (math.fsum(axis) / len(corners) for axis in zip(*corners, strict=True))
        return north_m, east_m, order.anchor_ned_m[2]


def _silence_s(now_s: float, peers: Mapping[int, PeerFacts], drone: int) -> float:
    """Seconds since `drone` was last heard directly; infinite if never."""
    peer = peers.get(drone)
    return now_s - peer.heard_s if peer is not None else math.inf


def _counts_in(tree: TreeState, drone: int) -> bool:
    return drone not in tree.lost and any(member == drone for member, _ in tree.slots)


def _foremost_first(tree: TreeState) -> tuple[int, int, str]:
    """By how far a survey has come; between two that have only begun, everybody must choose the same."""
    return -tree.epoch, -tree.order.sequence if tree.order is not None else 0, tree.survey


def _rank(
    lineage: tuple[tuple[int, int], ...], slots: Iterable[tuple[int, int]]
) -> tuple[tuple[tuple[int, int], ...], list[tuple[int, int]]]:
    """Which of two assignments stands: the greater one. A total order, in which descendants follow ancestors.

    Equal lineages with different slots come from files that list the members in different orders.
    """
    return tuple((heard, -author) for heard, author in lineage), sorted(slots)
