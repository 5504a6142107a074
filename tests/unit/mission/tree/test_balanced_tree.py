"""The tree: heirs, Outer-Level First healing with its cascade, rebalancing, insertion."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.geometry.formation import LAYOUTS, Hexagonal, Layout, Rings, make_layout
from mission.tree import balanced_tree as tree

HEX = Hexagonal(10.0)
RINGS = Rings(3.0)


def formed(drones: int) -> dict[int, int]:
    return {drone: drone - 1 for drone in range(1, drones + 1)}


def inorder(slots: Mapping[int, int], layout: Layout, slot: int) -> list[int]:
    """The paper's traversal, written as the paper defines it."""
    children = sorted(other for other in slots.values() if other and layout.parent(other) == slot)
    half = len(children) // 2
    before = [visited for child in children[:half] for visited in inorder(slots, layout, child)]
    after = [visited for child in children[half:] for visited in inorder(slots, layout, child)]
    return [*before, slot, *after]


def check_whole(slots: Mapping[int, int], layout: Layout) -> None:
    assert tree.problems(slots, layout) == []
    taken = sorted(slots.values())
    if taken:
        # Balanced: every level but the last is full.
        last = layout.level(taken[-1])
        assert all(slot in taken for slot in range(taken[-1]) if layout.level(slot) < last)


def test_the_root_of_five_is_followed_by_its_inorder_successor() -> None:
    healed = tree.heal(formed(5), HEX, [1])
    assert healed.moves == (tree.Move(4, 3, 0),)
    assert healed.slots == {4: 0, 2: 1, 3: 2, 5: 4}


def test_a_leaf_is_removed_without_replacement() -> None:
    healed = tree.heal(formed(5), HEX, [5])
    assert healed.moves == ()
    assert healed.slots == {1: 0, 2: 1, 3: 2, 4: 3}


def test_a_chain_cascades() -> None:
    """Root, its only child, and that child's only child: the paper's heir is not a leaf here."""
    slots = {1: 0, 2: 1, 3: 7}
    healed = tree.heal(slots, HEX, [1])
    assert healed.slots == {2: 0, 3: 1}
    assert healed.moves == (tree.Move(2, 1, 0), tree.Move(3, 7, 1))


def test_rebalancing_fills_the_inner_hole_from_the_deepest_level() -> None:
    slots = formed(19)
    healed = tree.heal(slots, HEX, [4])
    assert len(healed.slots) == 18
    check_whole(healed.slots, HEX)
    assert set(healed.slots.values()) >= set(range(7))


def test_drone_and_heir_lost_together() -> None:
    slots = formed(20)
    heir = tree.place(slots, RINGS, 1).heir
    assert heir is not None
    healed = tree.heal(slots, RINGS, [1, heir])
    assert len(healed.slots) == 18
    check_whole(healed.slots, RINGS)


def test_all_but_one_lost_leaves_the_last_as_root() -> None:
    assert tree.heal(formed(20), RINGS, [drone for drone in range(1, 21) if drone != 13]).slots == {13: 0}
    assert tree.heal(formed(3), RINGS, [1, 2, 3]) == tree.Healed({}, ())


def test_a_returning_drone_takes_the_first_free_slot() -> None:
    slots = tree.heal(formed(5), HEX, [2]).slots
    assert tree.insert(slots, 2) == {**slots, 2: 1}
    assert tree.insert(slots, 3) == slots
    assert tree.insert({}, 9) == {9: 0}


def test_places_tell_the_relations() -> None:
    slots = formed(20)
    root = tree.place(slots, RINGS, 1)
    assert root.parent is None
    assert root.parent_heir is None
    assert root.children == (2, 3, 4, 5)
    assert root.root == 1
    child = tree.place(slots, RINGS, 3)
    assert child.parent == 1
    assert child.parent_heir == root.heir
    leaf = tree.place(slots, RINGS, 20)
    assert leaf.heir is None
    assert leaf.children == ()


def test_what_comes_from_elsewhere_is_checked() -> None:
    assert tree.problems({1: 0, 2: 0}, HEX) == ["a slot is held twice"]
    assert "nobody holds the root" in tree.problems({1: 1}, HEX)[-1]
    assert tree.problems({1: -1}, HEX) == ["a slot number is negative"]
    assert tree.problems({1: 0, 2: 7}, HEX) == ["slot 7 has no parent in the tree"]
    with pytest.raises(ValueError, match="both hold slot 0"):
        tree.heal({1: 0, 2: 0}, HEX)


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(sorted(LAYOUTS)), st.sets(st.integers(1, 40), min_size=1), st.data())
def test_heirs_follow_the_inorder_traversal(name: str, drones: set[int], data: st.DataObject) -> None:
    layout = make_layout(name, 3.0)
    slots = tree.heal(formed(40), layout, set(range(1, 41)) - drones).slots
    drone = data.draw(st.sampled_from(sorted(slots)))
    slot = slots[drone]
    traversal = inorder(slots, layout, slot)
    heir = tree.place(slots, layout, drone).heir
    if len(traversal) == 1:
        assert heir is None
        return
    assert heir is not None
    at = traversal.index(slot)
    neighbours = traversal[max(at - 1, 0) : at] + traversal[at + 1 : at + 2]
    assert slots[heir] in neighbours
    leaves = [other for other in neighbours if len(inorder(slots, layout, other)) == 1]
    if leaves:
        assert slots[heir] in leaves


@settings(max_examples=80, deadline=None)
@given(
    st.sampled_from(sorted(LAYOUTS)),
    st.integers(1, 45),
    st.lists(st.sets(st.integers(1, 60), max_size=12), max_size=8),
    st.lists(st.integers(1, 60), max_size=8),
)
def test_any_sequence_of_losses_heals_and_insertions_keeps_a_whole_tree(
    name: str, size: int, losses: list[set[int]], returns: list[int]
) -> None:
    layout = make_layout(name, 3.0)
    slots = formed(size)
    for step, lost in enumerate(losses):
        before = {drone: slot for drone, slot in slots.items() if drone not in lost}
        healed = tree.heal(slots, layout, lost)
        assert healed.slots.keys() == before.keys()
        check_whole(healed.slots, layout)
        # Flown one after another in the order given, every target is empty when its turn comes.
        standing = dict(before)
        for move in healed.moves:
            assert standing[move.drone] == move.from_slot
            assert move.to_slot < move.from_slot
            assert move.to_slot not in standing.values()
            standing[move.drone] = move.to_slot
        assert standing == healed.slots
        assert tree.heal(healed.slots, layout) == tree.Healed(healed.slots, ())
        slots = healed.slots
        if step < len(returns):
            slots = tree.insert(slots, returns[step])
            check_whole(slots, layout)
            assert list(slots.values()).count(slots[returns[step]]) == 1


@settings(max_examples=60, deadline=None)
@given(st.integers(2, 45), st.sets(st.integers(1, 45), min_size=1))
def test_outer_level_first_and_only_leaves_or_cascades_move(size: int, lost: set[int]) -> None:
    table = RINGS.table(size)
    holder = tree.holders({d: s for d, s in formed(size).items() if d not in lost}, table)
    below = np.zeros_like(holder)
    deepest = 10**6
    cascade = -1
    while True:
        source, target = tree.next_heal(holder, table.parent, table.child_start, table.child, below)
        if target < 0:
            break
        assert holder[target] == tree.NOBODY
        assert holder[source] != tree.NOBODY
        if target == cascade:
            pass
        else:
            assert target < deepest
            deepest = target
        was_leaf = all(holder[c] == tree.NOBODY for c in range(size) if table.parent[c] == source)
        cascade = -1 if was_leaf else source
        holder[target], holder[source] = holder[source], tree.NOBODY
