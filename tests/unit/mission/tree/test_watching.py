"""Whom a drone watches: its neighbours in the tree, beyond empty slots too."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from mission.geometry.formation import make_layout
from mission.tree.watching import watched

TABLE = make_layout("hexagonal", 10.0).table(19)


def slots_of(*holes: int) -> dict[int, int]:
    """Drone 1 in slot 0, and so on, with holes."""
    return {slot + 1: slot for slot in range(19) if slot not in holes}


def children(slot: int) -> set[int]:
    return {below for below in range(19) if TABLE.parent[below] == slot}


def test_parent_and_children() -> None:
    slots = slots_of()
    below = {slot + 1 for slot in children(1)}
    assert below
    assert watched(slots, slots.keys(), TABLE, 2) == {1} | below
    assert watched(slots, slots.keys(), TABLE, 1) == {slot + 1 for slot in children(0)}


def test_beyond_a_hole_the_next_ones() -> None:
    slots = slots_of(1)
    for below in children(1):
        assert 1 in watched(slots, slots.keys(), TABLE, below + 1)
        assert below + 1 in watched(slots, slots.keys(), TABLE, 1)


def test_those_below_an_empty_root_watch_each_other() -> None:
    slots = slots_of(0)
    first = {slot + 1 for slot in children(0)}
    for drone in first:
        assert first - {drone} <= watched(slots, slots.keys(), TABLE, drone)


def test_who_has_no_slot_is_watched_by_all_and_watches_those_alike() -> None:
    slots = slots_of(17, 18)
    present = {*slots, 18, 19}
    assert all({18, 19} <= watched(slots, present, TABLE, drone) for drone in slots)
    assert watched(slots, present, TABLE, 18) == {19}


@given(st.sets(st.integers(0, 18), max_size=18))
def test_everybody_is_watched_by_somebody_and_nobody_by_itself(holes: set[int]) -> None:
    slots = slots_of(*holes)
    seen = {drone: watched(slots, slots.keys(), TABLE, drone) for drone in slots}
    assert all(drone not in whom for drone, whom in seen.items())
    if len(slots) > 1:
        assert set().union(*seen.values()) == slots.keys()
