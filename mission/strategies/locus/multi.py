"""LoCUS multi: sub-swarms of about `group` drones, each a LoCUS swarm of its own on golden spokes of its own.

The rules are those of the trials (`simvehicle.trials`): `group_begin` parts the swarm, `locus_next` decides for each
sub-swarm. In flight there is one tree; its root parts the swarm once all have formed up, and ends the survey. In
between each sub-swarm is a `Locus` that is given the sub-swarm for its tree: its first live member is its root, and
orders and readings go by the drones' words instead of the tree's messages. What a flight does otherwise than the
trials, and why:

* Sub-swarms begin side by side (`group_gap_m`), not all in one place: drones are not points. Where their ways cross
  later the guard keeps them apart, and a drone that is held back counts as arrived (`blocked_s`).
* Who is lost is replaced by seating the sub-swarm anew, nearest first, not by an heir that flies underneath. The
  tree heals as ever, and so tells everybody who lives, without flying anybody to a slot.
* The first sub-swarm that has found the source ends the survey; the search is given up after `search_limit_s`: golden
  spokes have no end. The root must hear that word: the radios reach over the whole search.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from mission.estimation.estimates import Reading
from mission.geometry.formation import Layout
from mission.geometry.frames import Vector3
from mission.strategies.contract import Decision, Hold, Observation, Order, Stage, TreePlace
from mission.strategies.entry import StrategyEntry
from mission.strategies.locus.groups import group_begin, group_count
from mission.strategies.locus.rule import locus_next
from mission.strategies.locus.strategy import Locus, LocusParameters
from mission.strategies.packed import FARTHEST_M, Packed


class MultiParameters(LocusParameters, frozen=True, forbid_unknown_fields=True, kw_only=True):
    group: Annotated[int, Meta(ge=1)] = 5
    """About how many drones a sub-swarm has."""
    spoke_m: Annotated[float, Meta(gt=0.0)] = 100.0
    """Length of a spoke (paper: the arena's radius)."""
    group_gap_m: Annotated[float, Meta(ge=0.0)] | None = None
    """Distance between the centres of neighbouring sub-swarms; None: a sub-swarm's diameter and one spacing."""
    search_limit_s: Annotated[float, Meta(gt=0.0)] = 1200.0
    """Without a source so long after the drones began to form up, the search is given up."""


class MultiNote(msgspec.Struct, frozen=True, array_like=True, tag="locus-multi"):
    """The order's note once the swarm has parted."""

    groups: tuple[tuple[int, ...], ...]
    """The drones of each sub-swarm."""


class GroupWord(msgspec.Struct, frozen=True, array_like=True, tag="locus-multi"):
    order: Order
    """The newest order of the sub-swarm that the drone knows: whoever missed it hears it from the others."""
    reading: Reading | None = None
    """The drone's own reading for it."""

    def __post_init__(self) -> None:
        reading, source = self.reading, self.order.source_ned_m or (0.0, 0.0, 0.0)
        places = (*self.order.anchor_ned_m, *source, *(reading.position_ned_m if reading else ()))
        if not all(abs(axis) <= FARTHEST_M for axis in places) or not math.isfinite(self.order.rotation_rad):
            raise ValueError("a place in the word is none")
        if not 0 <= self.order.sequence < 1 << 31:
            raise ValueError("the order in the word has no number")
        if reading is not None and not (abs(reading.excess_co2_ppm) <= 1e9 and reading.variance_ppm2 >= 0.0):
            raise ValueError("the reading in the word is none")


_NOTE = Packed(MultiNote)
_WORD = Packed(GroupWord)


def parted(drones: Sequence[int], size: int) -> tuple[tuple[int, ...], ...]:
    """The sub-swarms of `drones`, in their order."""
    groups, count = group_count(len(drones), size), len(drones)
    return tuple(
        tuple(drones[group_begin(g, groups, count) : group_begin(g + 1, groups, count)])
        for g in range(groups)
    )


def group_centre(group: int, groups: int, gap_m: float) -> tuple[float, float]:
    """(north_m, east_m) of the centre of sub-swarm `group` from the swarm's: on a circle, `gap_m` from the next."""
    if groups == 1:
        return 0.0, 0.0
    bearing_rad = 2.0 * math.pi * group / groups
    radius_m = gap_m / (2.0 * math.sin(math.pi / groups))
    return radius_m * math.cos(bearing_rad), radius_m * math.sin(bearing_rad)


class LocusMulti:
    """One drone's part; see the module's text."""

    Parameters = MultiParameters

    def __init__(self, layout: Layout, parameters: MultiParameters | None = None) -> None:
        self._layout = layout
        self._p = parameters or MultiParameters()
        self._whole = Locus(layout, self._p)
        """The swarm until it parts."""
        self._group: Locus | None = None
        self._order: Order | None = None
        """The newest order of the sub-swarm."""

    def decide(self, observation: Observation, rng: np.random.Generator) -> Decision:
        order = observation.order
        note = _NOTE.unpack(order.note) if order is not None else None
        if order is None or note is None:
            return self._form_up(observation, rng)
        words = {n.drone: _WORD.unpack(n.word) for n in observation.neighbours}
        told = {drone: word for drone, word in words.items() if word is not None}
        decision = self._in_group(observation, order, note, told, rng)
        if observation.tree.root != observation.own.drone:
            return decision
        orders = [word.order for word in told.values()] + ([self._order] if self._order else [])
        return msgspec.structs.replace(decision, order=self._survey(observation, order, orders))

    def _form_up(self, observation: Observation, rng: np.random.Generator) -> Decision:
        decision = self._whole.decide(observation, rng)
        if observation.order is None or decision.order is None or decision.order.stage is Stage.FORM:
            return decision
        note = MultiNote(parted(sorted(observation.tree.slots), self._p.group))
        return Decision(
            Hold(),
            decision.reading,
            msgspec.structs.replace(
                decision.order,
                stage=Stage.SEARCH,
                anchor_ned_m=observation.order.anchor_ned_m,
                rotation_rad=observation.order.rotation_rad,
                source_ned_m=None,
                note=_NOTE.pack(note),
                apart=True,
            ),
        )

    def _in_group(
        self,
        observation: Observation,
        order: Order,
        note: MultiNote,
        told: dict[int, GroupWord],
        rng: np.random.Generator,
    ) -> Decision:
        """What the sub-swarm's LoCUS decides; its order and this drone's reading become the word."""
        own = observation.own
        number = next((g for g, members in enumerate(note.groups) if own.drone in members), None)
        if number is None:
            return Decision(Hold())
        if self._group is None:
            start = self._centre(number, note, self._p.start_ned_m or order.anchor_ned_m)
            parameters = msgspec.structs.replace(self._p, start_ned_m=start)
            self._group = Locus(self._layout, parameters, spoke_m=self._p.spoke_m, seated=True)
        members = [drone for drone in note.groups[number] if drone in observation.tree.slots]
        heard = [told[drone] for drone in members if drone in told]
        for word in heard:
            if self._order is None or word.order.sequence > self._order.sequence:
                self._order = word.order
        decision = self._group.decide(_within(observation, members, self._order, heard), rng)
        if decision.order is not None:
            self._order = decision.order
        if self._order is None:
            return Decision(decision.intent)
        reading = decision.reading
        current = reading is not None and reading.order == self._order.sequence
        word = GroupWord(self._order, reading if current else None)
        return Decision(decision.intent, word=_WORD.pack(word))

    def _centre(self, number: int, note: MultiNote, start: Vector3) -> Vector3:
        gap_m = self._p.group_gap_m
        if gap_m is None:
            levels = self._layout.level(max(len(members) for members in note.groups) - 1)
            gap_m = (2 * levels + 1) * self._layout.spacing_m
        north_m, east_m = group_centre(number, len(note.groups), gap_m)
        return start[0] + north_m, start[1] + east_m, start[2]

    def _survey(self, observation: Observation, order: Order, orders: Sequence[Order]) -> Order | None:
        """At the tree's root: the survey's end when it has come, and whether any sub-swarm has contact."""
        for found in orders:
            if found.stage is Stage.FOUND and found.source_ned_m is not None:
                return msgspec.structs.replace(
                    order,
                    sequence=order.sequence + 1,
                    stage=Stage.FOUND,
                    anchor_ned_m=found.source_ned_m,
                    source_ned_m=found.source_ned_m,
                )
        if observation.elapsed_s > self._p.search_limit_s:
            return msgspec.structs.replace(order, sequence=order.sequence + 1, stage=Stage.GIVE_UP)
        stage = Stage.TRACK if any(one.stage is Stage.TRACK for one in orders) else Stage.SEARCH
        if stage is not order.stage:
            return msgspec.structs.replace(order, sequence=order.sequence + 1, stage=stage)
        return None


def _within(
    observation: Observation, members: Sequence[int], order: Order | None, heard: Sequence[GroupWord]
) -> Observation:
    """What a member observes of its sub-swarm: as if that were the whole swarm, its tree and its messages."""
    own = observation.own
    slots = {drone: place for place, drone in enumerate(members)}
    root = members[0]
    tree = TreePlace(0, slots[own.drone], slots, None, (), None, None, root, False)
    readings = tuple(
        word.reading
        for word in heard
        if order is not None and word.reading is not None and word.reading.order == order.sequence
    )
    neighbours = tuple(n for n in observation.neighbours if n.drone in slots)
    return msgspec.structs.replace(
        observation, neighbours=neighbours, tree=tree, order=order, readings=readings
    )


ENTRY = StrategyEntry(
    name="locus-multi",
    make=LocusMulti,
    parameters=MultiParameters,
    rules=(group_count, group_begin, locus_next),
    note=MultiNote,
    word=GroupWord,
    legs=True,
)
