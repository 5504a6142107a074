"""The search of tick mode, all against all and by cells, against plain distances."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mission.strategies.tick_rule import WORD
from simvehicle.compiled import compiled
from simvehicle.trials.ticks.arrays import new_robots
from simvehicle.trials.ticks.neighbours import (
    find_neighbours,
    lowest_bit,
    new_neighbourhood,
    show_neighbours,
)

FloatArray = Any


@compiled
def _neighbours(
    north_m: FloatArray, east_m: FloatArray, alive: FloatArray, range_m: float, found: FloatArray, again: bool
) -> int:
    robots = new_robots(north_m.shape[0], 0, 1)
    around = new_neighbourhood(north_m.shape[0])
    for i in range(north_m.shape[0]):
        robots.north_m[i], robots.east_m[i], robots.alive[i] = north_m[i], east_m[i], alive[i]
        robots.heard[i, 0] = i
    if again:
        for i in range(north_m.shape[0]):
            robots.north_m[i], robots.east_m[i] = east_m[i], 2.0 * north_m[i]
        find_neighbours(around, robots, range_m)
        for i in range(north_m.shape[0]):
            robots.north_m[i], robots.east_m[i] = north_m[i], east_m[i]
    find_neighbours(around, robots, range_m)
    for i in range(north_m.shape[0]):
        count = show_neighbours(around, robots, i, range_m)
        for k in range(count):
            found[i, k] = robots.rows[k, WORD]
    left = 0
    for i in range(north_m.shape[0]):
        robots.alive[i] = 0
    find_neighbours(around, robots, range_m)
    for i in range(north_m.shape[0]):
        left += show_neighbours(around, robots, i, range_m)
    return left


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 2**32 - 1), st.integers(1, 150), st.floats(0.5, 30.0), st.floats(0.1, 300.0), st.booleans()
)
@example(seed=1, count=64, range_m=5.0, half_m=20.0, again=True)
@example(seed=1, count=65, range_m=5.0, half_m=20.0, again=True)
def test_the_search_shows_who_is_within_range(
    seed: int, count: int, range_m: float, half_m: float, again: bool
) -> None:
    rng = np.random.default_rng(seed)
    # Many stand exactly on the edges of cells.
    places = np.round(rng.uniform(-half_m, half_m, (count, 2)) / range_m, 1) * range_m
    alive = rng.integers(0, 4, count).clip(0, 1)
    found = np.full((count, count), -1.0)
    assert _neighbours(places[:, 0].copy(), places[:, 1].copy(), alive, range_m, found, again) == 0
    away = places[None, :, :] - places[:, None, :]
    near = (away[:, :, 0] ** 2 + away[:, :, 1] ** 2 <= range_m * range_m) & (alive == 1)[None, :]
    for i in range(count):
        near[i, i] = False
        assert [j for j in found[i] if j >= 0] == list(np.flatnonzero(near[i])), i


@pytest.mark.parametrize("range_m", [0.3, 5.0, 10.0])
def test_two_that_are_the_range_apart_are_seen_wherever_cells_end(range_m: float) -> None:
    for edge in range(-40, 40):
        places = np.full((65, 2), 1e6)  # so many are searched by cells
        places[0] = np.nextafter(edge * range_m, -math.inf), 0.0
        places[1] = places[0] + [range_m, 0.0]
        found = np.full((65, 65), -1.0)
        _neighbours(places[:, 0].copy(), places[:, 1].copy(), np.ones(65, np.int64), range_m, found, False)
        near = (places[1, 0] - places[0, 0]) ** 2 <= range_m * range_m
        assert (found[0, 0], found[1, 0]) == ((1.0, 0.0) if near else (-1.0, -1.0)), edge


@compiled
def _lowest(bits: np.uint64) -> int:
    return lowest_bit(bits)


@given(st.integers(1, 2**64 - 1))
@settings(deadline=None)
def test_the_lowest_bit_is_found(bits: int) -> None:
    assert _lowest(np.uint64(bits)) == (bits & -bits).bit_length() - 1
