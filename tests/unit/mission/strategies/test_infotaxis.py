"""Infotaxis: what the posterior knows, which step it asks for, and what robots tell each other."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.strategies.infotaxis.infotaxis import (
    FIRST,
    IDENTITY,
    MET,
    MOVE_E,
    MOVE_N,
    PLACE_E,
    PLACE_N,
    STATE_SIZE,
    TIME_S,
    WIND_E,
    WIND_N,
    WORD_SIZE,
    InfotaxisParameters,
)
from mission.strategies.infotaxis.posterior import (
    CELLS,
    SIDE,
    begin_grid,
    cell_at,
    cell_centre_m,
    entropy,
    expected_entropy,
    hit_probability,
    observe,
)
from mission.strategies.registry import find
from mission.strategies.tick_rule import WORD, OwnSenses, numbers
from simvehicle.compiled import compiled

PARAMETERS = numbers(InfotaxisParameters())
WIND = (0.0, -0.5)
"""To the west: the source of what is met lies in the east."""


def uniform() -> Any:
    grid = np.zeros(CELLS)
    begin_grid(grid, 0)
    return grid


def mean_m(grid: Any) -> Any:
    centres = np.array([cell_centre_m(k, 3.0) for k in range(CELLS)])
    return grid @ centres


def test_cells_and_their_centres_fit() -> None:
    for cell in (0, 7, SIDE, CELLS // 2, CELLS - 1):
        assert cell_at(*cell_centre_m(cell, 3.0), 3.0) == cell
    assert cell_centre_m(CELLS // 2, 3.0) == (0.0, 0.0)
    edge_m = 1.5 * SIDE
    assert cell_at(edge_m + 0.1, 0.0, 3.0) == cell_at(0.0, -edge_m - 0.1, 3.0) == -1


def test_gas_is_met_downwind_nearby_and_in_time() -> None:
    def chance(north_m: float, east_m: float, time_s: float = 10.0) -> float:
        return hit_probability(north_m, east_m, *WIND, time_s, PARAMETERS)

    assert chance(0.0, -6.0) > 10.0 * chance(0.0, 6.0)
    assert chance(0.0, -6.0) > chance(0.0, -20.0) > chance(3.0, -20.0) > chance(9.0, -20.0)
    assert chance(3.0, -20.0) == pytest.approx(chance(-3.0, -20.0))
    assert chance(0.0, -6.0, 20.0) > chance(0.0, -6.0)
    assert chance(0.0, 80.0) == pytest.approx(0.01)
    # Without wind as the paper's rate: R a / r exp(-r / sqrt(D tau)).
    rate_hz = 0.5 / 5.0 * math.exp(-5.0 / math.sqrt(0.1 * 300.0))
    still = hit_probability(3.0, 4.0, 0.0, 0.0, 2.0, PARAMETERS)
    assert still == pytest.approx(0.01 + 0.98 * (1.0 - math.exp(-2.0 * rate_hz)))


def test_what_is_met_is_upwind_and_what_is_not_is_elsewhere() -> None:
    grid = uniform()
    assert entropy(grid, 0) == pytest.approx(math.log(CELLS))
    observe(grid, 0, 0.0, 0.0, True, *WIND, 10.0, PARAMETERS)
    assert grid.sum() == pytest.approx(1.0)
    assert entropy(grid, 0) < math.log(CELLS) - 0.5
    north_m, east_m = mean_m(grid)
    assert abs(north_m) < 0.5
    assert east_m > 5.0
    blank = uniform()
    observe(blank, 0, 0.0, 0.0, False, *WIND, 10.0, PARAMETERS)
    assert mean_m(blank)[1] < -0.1


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=15)
def test_entropy_falls_in_expectation_and_by_as_much_as_is_said(seed: int) -> None:
    """Over both outcomes, weighed by how probable they are; only the paper's chance to arrive is apart from it."""
    rng = np.random.default_rng(seed)
    grid = rng.random(CELLS) ** 8
    grid /= grid.sum()
    north_m, east_m = rng.uniform(-40.0, 40.0, 2)
    before, chance, left = entropy(grid, 0), 0.0, 0.0
    for k in range(CELLS):
        centre_n, centre_e = cell_centre_m(k, 3.0)
        chance += grid[k] * hit_probability(north_m - centre_n, east_m - centre_e, *WIND, 10.0, PARAMETERS)
    for hit, share in ((True, chance), (False, 1.0 - chance)):
        after = grid.copy()
        observe(after, 0, north_m, east_m, hit, *WIND, 10.0, PARAMETERS)
        left += share * entropy(after, 0)
    assert left <= before + 1e-9
    found = grid[cell_at(north_m, east_m, 3.0)]
    said = expected_entropy(grid, 0, north_m, east_m, *WIND, 10.0, PARAMETERS)
    assert said == pytest.approx((1.0 - found) * left, rel=1e-6)


class Robot:
    """One robot with its memory, that goes where it wants to."""

    def __init__(
        self, name: str = "infotaxis", rule: Any = None, place: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        ticks = find(name).ticks
        assert ticks is not None
        self.rule = rule or ticks.rule
        self.state, self.word = np.zeros(STATE_SIZE), np.zeros(WORD_SIZE)
        self.place = np.array(place)
        self.velocity = (0.0, 0.0)
        self.time_s = 0.0

    def step(
        self, gas: float, rows: Any = None, draw: float = 0.3, *, held: bool = False
    ) -> tuple[float, float]:
        self.time_s += 2.0
        rows = np.zeros((0, WORD + WORD_SIZE)) if rows is None else rows
        north, east = (float(axis) for axis in self.place)
        own = OwnSenses(north, east, *self.velocity, gas, *WIND, self.time_s, 2.0, draw)
        self.velocity = self.rule(own, rows, len(rows), np.zeros(0), self.state, self.word, PARAMETERS)
        if not held:
            self.place += 2.0 * np.array(self.velocity)
        return self.velocity

    @property
    def grid(self) -> Any:
        return self.state[FIRST:]


def heard(*words: Any) -> Any:
    rows = np.zeros((len(words), WORD + WORD_SIZE))
    for row, word in zip(rows, words, strict=True):
        row[0] = 5.0
        row[WORD:] = word
    return rows


@pytest.fixture(scope="module")
def fast() -> Any:
    """The rule as trials have it, for what takes many steps."""
    ticks = find("infotaxis").ticks
    assert ticks is not None
    return compiled(ticks.rule)


def test_in_contact_it_goes_against_the_wind(fast: Any) -> None:
    robot, silent = Robot(rule=fast, place=(0.0, -20.0)), Robot(rule=fast, place=(0.0, -20.0))
    for _ in range(30):
        robot.step(1.0)
        silent.step(0.0)
    aside_m, ahead_m = robot.place - (0.0, -20.0)
    assert ahead_m > 2.0 > abs(aside_m)
    assert ahead_m > silent.place[1] + 20.0 + 1.0


def test_where_contact_is_lost_it_casts_across_the_wind_before_it_goes_back(fast: Any) -> None:
    robot = Robot(rule=fast, place=(0.0, -20.0))
    for _ in range(30):
        robot.step(1.0)
    surged_m = robot.place[1] + 20.0
    assert surged_m > 3.0
    lost = robot.place.copy()
    offs = []
    for _ in range(200):
        robot.step(0.0)
        offs.append(robot.place - lost)
    aside, ahead = np.array(offs).T
    assert np.abs(aside).max() > 2.0
    assert ahead.min() > -surged_m


@pytest.mark.parametrize("seed", [0, 2])
def test_it_finds_the_source_of_its_own_model(seed: int, fast: Any) -> None:
    rng = np.random.default_rng(seed)
    source = np.array([4.0, 12.0])
    robot = Robot(rule=fast, place=(0.0, -15.0))
    reached_s = math.inf
    for _ in range(3000):
        north, east = robot.place - source
        chance = hit_probability(north, east, *WIND, 2.0, PARAMETERS)
        gas = float(rng.random() < (chance - 0.01) / 0.98)  # what is met is true
        robot.step(gas, draw=rng.random())
        if math.hypot(*(robot.place - source)) < 1.5:
            reached_s = robot.time_s
            break
    assert reached_s < 6000.0


def test_a_step_that_is_held_up_is_not_tried_again() -> None:
    robot = Robot()
    robot.step(0.0)
    before = (robot.state[MOVE_N], robot.state[MOVE_E])
    assert before != (0.0, 0.0)
    for _ in range(5):
        robot.step(0.0, held=True)
    assert (robot.state[MOVE_N], robot.state[MOVE_E]) != before


def test_together_each_learns_once_what_another_has_met() -> None:
    teller, hearer, alone = Robot("cooperative-infotaxis"), Robot("cooperative-infotaxis"), Robot()
    for robot in (teller, hearer, alone):
        robot.place[:] = (0.0, 0.0)
    for _ in range(6):
        teller.step(1.0)
    assert teller.word[IDENTITY] > 0.0
    assert teller.word[MET] == 1.0
    hearer.step(0.0)
    alone.step(0.0)
    hearer.step(0.0, heard(teller.word))
    alone.step(0.0, heard(teller.word))
    once = hearer.grid.copy()
    assert entropy(once, 0) < entropy(alone.grid, 0) - 0.3
    hearer.step(0.0, heard(teller.word, teller.word))
    np.testing.assert_array_equal(hearer.grid, once)


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (IDENTITY, 0.0),
        (TIME_S, -1.0),
        (TIME_S, 1e9),
        (WIND_N, 1e6),
        (WIND_E, -1e9),
        (PLACE_N, 1e300),
        (PLACE_E, 500.0),
    ],
)
def test_what_cannot_be_is_not_learned(place: int, value: float) -> None:
    robot = Robot("cooperative-infotaxis")
    robot.step(0.0)
    before = robot.grid.copy()
    word = np.zeros(WORD_SIZE)
    word[[IDENTITY, MET, TIME_S, WIND_E]] = 1.5, 1.0, 10.0, -0.5
    word[place] = value
    robot.step(0.0, heard(word))
    np.testing.assert_array_equal(robot.grid, before)


@pytest.mark.parametrize("name", ["infotaxis", "cooperative-infotaxis"])
def test_trials_compile_the_rule_that_flies(name: str) -> None:
    ticks = find(name).ticks
    assert ticks is not None
    flown, tried = Robot(name), Robot(name, compiled(ticks.rule))
    rng = np.random.default_rng(1)
    for step in range(60):
        gas, draw = float(step in (12, 13, 40)), rng.random()
        word = np.zeros(WORD_SIZE)
        word[[IDENTITY, MET, TIME_S, WIND_E]] = 1.0 + step // 9, float(step % 2), 5.0, -0.4
        word[[PLACE_N, PLACE_E]] = rng.uniform(-20.0, 20.0, 2)
        rows = heard(word) if step % 3 == 0 else None
        assert flown.step(gas, rows, draw) == pytest.approx(tried.step(gas, rows, draw), abs=1e-9)
    np.testing.assert_allclose(flown.grid, tried.grid, atol=1e-9)
