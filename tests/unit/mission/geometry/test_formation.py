"""Formations: the paper's numbers, and the promises of radio range and separation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.geometry.formation import LAYOUTS, Hexagonal, Layout, Rings, make_layout, problems, rotated


def test_rings_have_the_capacities_of_lemma_1() -> None:
    assert [Rings(3.0).capacity(level) for level in range(7)] == [1, 4, 12, 18, 24, 31, 37]


def test_hexagons_have_six_slots_a_level_more() -> None:
    assert [Hexagonal(10.0).capacity(level) for level in range(5)] == [1, 6, 12, 18, 24]


def test_the_papers_rings_break_the_papers_radio_range_and_hexagons_do_not() -> None:
    assert Rings(3.0).longest_link_m(17) == pytest.approx(3.72, abs=0.005)
    assert Rings(3.0, spread=2.0).longest_link_m(50) == pytest.approx(3.20, abs=0.005)
    for drones in range(2, 62):
        assert Hexagonal(10.0).longest_link_m(drones) == pytest.approx(10.0)
        assert Hexagonal(10.0).smallest_separation_m(drones) == pytest.approx(10.0)


def test_the_planner_refuses_with_what_to_do() -> None:
    (problem,) = Rings(3.0).problems(20, separation_m=3.0)
    assert "link of 3.72 m" in problem
    assert "at most 2.42 m or the hexagonal layout" in problem
    assert Rings(2.42).problems(20, separation_m=2.4, radio_range_m=3.0) == []
    (problem,) = Hexagonal(10.0).problems(5, separation_m=12.0)
    assert "spacing of at least 12.00 m" in problem
    assert Hexagonal(10.0).problems(19, separation_m=4.0) == []
    assert "at least 1 drone" in Hexagonal(10.0).problems(0, separation_m=4.0)[0]


@pytest.mark.parametrize("layout", [Hexagonal(1e-320), Rings(1e-320)])
def test_a_spacing_of_next_to_nothing_is_refused_with_what_would_do(layout: Layout) -> None:
    found = layout.problems(6, separation_m=4.0, radio_range_m=300.0)
    assert len(found) == 1
    assert f"at least {4.0 / type(layout)(1.0).smallest_separation_m(6):.2f} m" in found[0]


def test_unknown_layouts_and_impossible_numbers_are_named() -> None:
    with pytest.raises(ValueError, match="hexagonal, rings"):
        make_layout("square", 10.0)
    with pytest.raises(ValueError, match="spacing"):
        make_layout("rings", 0.0)
    with pytest.raises(ValueError, match="spread"):
        Rings(3.0, spread=0.5)
    with pytest.raises(ValueError, match="at least 1 slot"):
        Hexagonal(3.0).table(0)


def test_full_levels_count_the_root() -> None:
    assert [Rings(3.0).full_levels(drones) for drones in (1, 4, 5, 16, 17, 20)] == [1, 1, 2, 2, 3, 3]


def test_rotation_goes_from_north_to_east() -> None:
    assert rotated((1.0, 0.0), math.pi / 2) == pytest.approx((0.0, 1.0))


@settings(max_examples=40, deadline=None)
@given(st.sampled_from(sorted(LAYOUTS)), st.integers(1, 150))
def test_a_slot_table_is_a_tree_level_by_level(name: str, drones: int) -> None:
    layout: Layout = make_layout(name, 7.0)
    table = layout.table(drones)
    assert len(table) == drones
    assert table.parent[0] == -1
    for slot in range(drones):
        assert table.level[slot] == layout.level(slot)
        assert math.hypot(*layout.offset_m(slot)) <= 7.0 * layout.level(slot) + 1e-9
        children = table.child[table.child_start[slot] : table.child_start[slot + 1]]
        assert list(children) == [child for child in range(1, drones) if table.parent[child] == slot]
        if slot:
            parent = int(table.parent[slot])
            assert table.level[parent] == table.level[slot] - 1
            inner = table.offset_m[table.level == table.level[slot] - 1]
            away_m = np.linalg.norm(inner - table.offset_m[slot], axis=1)
            own_m = np.linalg.norm(table.offset_m[parent] - table.offset_m[slot])
            assert own_m <= away_m.min() + 1e-6
    if drones > 1:
        assert layout.smallest_separation_m(drones) >= 7.0 - 1e-9


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 2000), st.sampled_from([1.0, 1.5, 2.0, 4.0]))
def test_the_depth_grows_with_the_root_of_the_size(drones: int, spread: float) -> None:
    """Lemma 2: O(sqrt(N / rho)) levels. Level k has about 2 pi k rho slots, so K levels hold pi rho K^2."""
    depth = Rings(3.0, spread=spread).level(drones - 1)
    assert depth <= 1.0 + 1.3 * math.sqrt(drones / (math.pi * spread))


def test_a_file_is_checked_by_the_layouts_name() -> None:
    assert problems(5, 10.0, 4.0) == []
    assert "link of 12.39 m" in problems(20, 10.0, 4.0, 10.0, "rings")[0]
