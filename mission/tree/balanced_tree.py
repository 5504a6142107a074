"""The balanced tree over a formation's slots: heirs, healing of lost drones, rebalancing, insertion.

Which slot is whose parent is fixed by the layout; what changes is which drone holds which slot. All rules
work on `holder`, an array with the drone of each slot (-1: nobody), and are plain functions of small
integer arrays: the agent calls them as they are, the trials compile them.

Sources: LoCUS paper III-A to III-C. What departs from it:

* The paper says that the heir (in-order successor or predecessor) is always a leaf. With a node whose only
  child has a child that is false, and the heir leaves a hole. Here a leaf is chosen where there is one;
  otherwise the hole is healed in its turn, by the same rule (the cascade).
* Outer-Level First needs no list of failures: the deepest empty slot that still has somebody below it is
  always the next to be filled. Every drone that knows the same assignment and the same losses
  computes the same outcome, which is what makes it distributed.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import msgspec
import numpy as np

from mission.geometry.formation import IntArray, Layout, SlotTable

NOBODY = -1


class Move(msgspec.Struct, frozen=True):
    """A drone changes its slot."""

    drone: int
    from_slot: int
    to_slot: int


class Healed(msgspec.Struct, frozen=True):
    slots: dict[int, int]
    """drone -> slot of every survivor."""
    moves: tuple[Move, ...]
    """One move for each survivor whose slot changed, ordered by target slot. Flown one after another in this
    order every target is empty when its turn comes, because all moves lead to lower slots."""


class Place(msgspec.Struct, frozen=True):
    """A drone's relations in the tree, as drones (not slots)."""

    parent: int | None
    children: tuple[int, ...]
    heir: int | None
    """Who takes this drone's slot when it is lost; None for a leaf."""
    parent_heir: int | None
    root: int


# --- Rules on arrays: plain loops, so that they compile. ---


def first_in_order(slot: int, holder: IntArray, child_start: IntArray, child: IntArray) -> int:
    """The first slot of the in-order traversal of `slot`'s subtree.

    A node comes after the first floor(m/2) of its m children: with one child it comes before it.
    """
    while True:
        count = 0
        first = NOBODY
        for k in range(child_start[slot], child_start[slot + 1]):
            if holder[child[k]] != NOBODY:
                count += 1
                if first == NOBODY:
                    first = child[k]
        if count < 2:
            return slot
        slot = first


def last_in_order(slot: int, holder: IntArray, child_start: IntArray, child: IntArray) -> int:
    """The last slot of the in-order traversal of `slot`'s subtree: always a leaf."""
    while True:
        last = NOBODY
        for k in range(child_start[slot], child_start[slot + 1]):
            if holder[child[k]] != NOBODY:
                last = child[k]
        if last == NOBODY:
            return slot
        slot = last


def heir_slot(slot: int, holder: IntArray, child_start: IntArray, child: IntArray) -> int:
    """The slot of `slot`'s heir, or -1 for a leaf.

    The in-order successor if it is a leaf, else the predecessor in the subtree (always a leaf), else, where
    there is no predecessor, the successor, whose own slot must then be healed in its turn.
    """
    count = 0
    for k in range(child_start[slot], child_start[slot + 1]):
        if holder[child[k]] != NOBODY:
            count += 1
    if count == 0:
        return NOBODY
    before = NOBODY
    after = NOBODY
    seen = 0
    for k in range(child_start[slot], child_start[slot + 1]):
        if holder[child[k]] != NOBODY:
            seen += 1
            if seen == count // 2:
                before = child[k]
            elif seen == count // 2 + 1:
                after = child[k]
    successor = first_in_order(after, holder, child_start, child)
    leaf = True
    for k in range(child_start[successor], child_start[successor + 1]):
        if holder[child[k]] != NOBODY:
            leaf = False
    if leaf or before == NOBODY:
        return successor
    return last_in_order(before, holder, child_start, child)


def next_heal(
    holder: IntArray, parent: IntArray, child_start: IntArray, child: IntArray, below: IntArray
) -> tuple[int, int]:
    """The next step of healing as (from slot, to slot), or (-1, -1) when the tree is whole.

    The empty slot of the deepest level with anybody below it is filled by its heir. Slots are numbered level
    by level, so a walk from the last slot to the first meets the outermost level first. `below` is scratch
    space of the length of `holder`.
    """
    for slot in range(holder.shape[0]):
        below[slot] = 0
    for slot in range(holder.shape[0] - 1, -1, -1):
        if holder[slot] == NOBODY and below[slot] == 1:
            return heir_slot(slot, holder, child_start, child), slot
        if slot > 0 and (holder[slot] != NOBODY or below[slot] == 1):
            below[parent[slot]] = 1
    return -1, -1


def next_rebalance(holder: IntArray, level: IntArray) -> tuple[int, int]:
    """The next step of rebalancing a whole tree as (from slot, to slot), or (-1, -1) when it is balanced.

    A branch that ends before a free slot of level k has height k - 1; the first free slot ends the
    shallowest. While height_max - height_min > 1 the last drone of the deepest level, a leaf, takes it.
    """
    free = 0
    while free < holder.shape[0] and holder[free] != NOBODY:
        free += 1
    last = holder.shape[0] - 1
    while last >= 0 and holder[last] == NOBODY:
        last -= 1
    if free < last and level[last] - (level[free] - 1) > 1:
        return last, free
    return -1, -1


def first_free(holder: IntArray) -> int:
    """The slot that a new drone takes: the lowest free one, whose parent is always taken in a whole tree."""
    free = 0
    while free < holder.shape[0] and holder[free] != NOBODY:
        free += 1
    return free


# --- The same in terms of drones, for the agent. ---


def holders(slots: Mapping[int, int], table: SlotTable) -> IntArray:
    """The array of holders of an assignment drone -> slot. `ValueError` if two drones hold one slot."""
    holder = np.full(len(table), NOBODY, dtype=np.int64)
    for drone, slot in slots.items():
        if holder[slot] != NOBODY:
            raise ValueError(f"drones {holder[slot]} and {drone} both hold slot {slot}")
        holder[slot] = drone
    return holder


def heal(slots: Mapping[int, int], layout: Layout, lost: Collection[int] = ()) -> Healed:
    """The assignment of the survivors after `lost` drones are gone: healed Outer-Level First, rebalanced.

    A pure function: every drone that knows the same assignment and the same losses finds the same result.
    Holes that are in `slots` already are healed too, whoever made them.
    """
    survivors = {drone: slot for drone, slot in slots.items() if drone not in lost}
    if not survivors:
        return Healed({}, ())
    table = layout.table(max(survivors.values()) + 1)
    holder = holders(survivors, table)
    below = np.zeros_like(holder)
    while True:
        source, target = next_heal(holder, table.parent, table.child_start, table.child, below)
        if target < 0:
            source, target = next_rebalance(holder, table.level)
        if target < 0:
            break
        holder[target], holder[source] = holder[source], NOBODY
    healed = {int(drone): slot for slot, drone in enumerate(holder) if drone != NOBODY}
    moves = [
        Move(drone, survivors[drone], slot) for drone, slot in healed.items() if survivors[drone] != slot
    ]
    return Healed(healed, tuple(sorted(moves, key=lambda move: move.to_slot)))


def insert(slots: Mapping[int, int], drone: int) -> dict[int, int]:
    """The assignment with `drone` added at the first free slot (paper III-A2); unchanged if it is in."""
    if drone in slots:
        return dict(slots)
    taken = set(slots.values())
    return {**slots, drone: next(slot for slot in range(len(taken) + 1) if slot not in taken)}


def place(slots: Mapping[int, int], layout: Layout, drone: int) -> Place:
    """Where `drone` stands in the tree of a whole assignment. `KeyError` if it is not in it."""
    slot = slots[drone]
    table = layout.table(max(slots.values()) + 1)
    holder = holders(slots, table)

    def heir_of(of_slot: int) -> int | None:
        heir = heir_slot(of_slot, holder, table.child_start, table.child)
        return int(holder[heir]) if heir != NOBODY else None

    children = table.child[table.child_start[slot] : table.child_start[slot + 1]]
    above = int(table.parent[slot]) if slot else None
    has_parent = above is not None and holder[above] != NOBODY
    return Place(
        parent=int(holder[above]) if has_parent else None,
        children=tuple(int(holder[child]) for child in children if holder[child] != NOBODY),
        heir=heir_of(slot),
        parent_heir=heir_of(above) if has_parent and above is not None else None,
        root=int(holder[0]) if holder[0] != NOBODY else drone,
    )


def problems(slots: Mapping[int, int], layout: Layout) -> list[str]:
    """What is wrong with an assignment that came from elsewhere: empty for a whole tree."""
    if any(slot < 0 for slot in slots.values()):
        return ["a slot number is negative"]
    taken = set(slots.values())
    found = [] if len(taken) == len(slots) else ["a slot is held twice"]
    found += [
        f"slot {slot} has no parent in the tree"
        for slot in sorted(taken)
        if slot and layout.parent(slot) not in taken
    ]
    if slots and 0 not in taken:
        found.append("nobody holds the root's slot")
    return found
