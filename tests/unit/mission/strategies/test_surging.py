"""Surge-cast and spiral-surge: against the wind in the plume, and each one's pattern where it is lost."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from mission.strategies.registry import find
from mission.strategies.surging.surge import LOCAL, MODE, SEARCHES, SURGE_STATE, SURGES, SurgeParameters
from mission.strategies.tick_rule import WORD, OwnSenses, numbers
from mission.strategies.tracing.swarming import WORD_SIZE
from simvehicle.compiled import compiled

STRATEGIES = ["surge-cast", "spiral-surge"]
WIND = {"wind_north_mps": 0.0, "wind_east_mps": 0.4}
"""To the east: upwind is west."""


class Robot:
    """One robot with its memory, in an empty world: it goes where it wants to."""

    def __init__(self, name: str, rule: Any = None, **parameters: float) -> None:
        ticks = find(name).ticks
        assert ticks is not None
        self.rule = rule or ticks.rule
        self.state, self.word = np.zeros(SURGE_STATE), np.zeros(WORD_SIZE)
        self.parameters = numbers(
            SurgeParameters(speed_mps=0.1, lost_m=0.5, reach_m=0.4, legs=3, **parameters)
        )  # type: ignore[arg-type]
        self.place = np.zeros(2)
        self.velocity = (0.0, 0.0)
        self.time_s = 0.0

    def step(self, gas: float, rows: Any = (), draw: float = 0.1, **wind: float) -> tuple[float, float]:
        self.time_s += 0.5
        north, east = (float(axis) for axis in self.place)
        wind = wind or WIND
        own = OwnSenses(
            north,
            east,
            *self.velocity,
            gas,
            wind["wind_north_mps"],
            wind["wind_east_mps"],
            self.time_s,
            0.5,
            draw,
        )
        table = np.zeros((max(len(rows), 1), WORD + WORD_SIZE))
        for row, place in zip(table, rows, strict=False):
            row[:2] = place
        self.velocity = self.rule(own, table, len(rows), np.zeros(0), self.state, self.word, self.parameters)
        self.place += 0.5 * np.array(self.velocity)
        return self.velocity


@pytest.mark.parametrize("name", STRATEGIES)
def test_it_surges_against_the_wind_and_on_for_a_while_without_gas(name: str) -> None:
    robot = Robot(name)
    searched = robot.step(0.0)
    assert robot.state[MODE] == SEARCHES
    assert np.abs(searched) == pytest.approx([0.1 * math.sqrt(0.5)] * 2)
    assert robot.step(1.0) == pytest.approx((0.0, -0.1))
    for _ in range(10):
        assert robot.step(0.0) == pytest.approx((0.0, -0.1))
    assert robot.state[MODE] == SURGES
    robot.step(0.0)
    assert robot.state[MODE] == LOCAL
    assert robot.step(1.0) == pytest.approx((0.0, -0.1))  # gas again


@pytest.mark.parametrize("name", STRATEGIES)
def test_without_wind_there_is_nothing_to_surge_against(name: str) -> None:
    robot = Robot(name)
    calm = {"wind_north_mps": 0.0, "wind_east_mps": 0.0}
    assert np.abs(robot.step(1.0, **calm)) == pytest.approx([0.1 * math.sqrt(0.5)] * 2)
    assert robot.state[MODE] == SEARCHES


def lost(name: str, draw: float = 0.1) -> tuple[Robot, np.ndarray[Any, Any]]:
    """A robot that has lost the plume, and its places from there on until it gives the place up."""
    robot = Robot(name)
    robot.step(1.0)
    while robot.state[MODE] != LOCAL:
        robot.step(0.0, draw=draw)
    robot.place[:] = 0.0
    places = []
    while robot.state[MODE] == LOCAL:
        robot.step(0.0)
        places.append(robot.place.copy())
    return robot, np.array(places)


@pytest.mark.parametrize(("draw", "side"), [(0.1, 1.0), (0.9, -1.0)])
def test_casts_go_across_the_wind_each_farther_on_the_other_side(draw: float, side: float) -> None:
    _, places = lost("surge-cast", draw)
    places = places[:-1]  # with the last it searches at large again
    assert np.abs(places[:, 1]).max() < 1e-9
    turns = np.flatnonzero(np.diff(np.sign(np.diff(places[:, 0])))) + 1
    assert places[turns, 0] == pytest.approx(side * np.array([0.4, -0.8]), abs=0.06)
    assert places[-1, 0] == pytest.approx(side * 1.2, abs=0.06)


def test_the_spiral_has_arms_of_the_same_distance() -> None:
    _, places = lost("spiral-surge")
    away = np.hypot(*places[:-1].T)
    turned = np.unwrap(np.arctan2(places[:-1, 1], places[:-1, 0]))
    assert places[0, 1] < 0.0  # first against the wind
    whole = np.abs(turned - turned[0]) / (2.0 * math.pi)
    assert whole[-1] == pytest.approx(3.0, abs=0.35)
    late = whole > 0.7
    slope = np.polyfit(whole[late], away[late], 1)[0]
    assert slope == pytest.approx(0.4, abs=0.03)
    steps = np.hypot(*np.diff(places[:-1], axis=0).T)
    assert steps == pytest.approx(0.05)


@pytest.mark.parametrize("name", STRATEGIES)
def test_robots_keep_apart_but_do_not_draw_together(name: str) -> None:
    near, far, alone = Robot(name), Robot(name), Robot(name)
    wanted = alone.step(1.0)
    assert far.step(1.0, [(0.0, -0.95)]) == wanted
    _, east = near.step(1.0, [(0.0, -0.2)])
    assert east > 0.0


@pytest.mark.parametrize("name", STRATEGIES)
def test_trials_compile_the_rule_that_flies(name: str) -> None:
    ticks = find(name).ticks
    assert ticks is not None
    flown, tried = Robot(name), Robot(name, compiled(ticks.rule))
    rng = np.random.default_rng(1)
    for step in range(200):
        gas, draw = float(step in (3, 4, 50, 51, 52)), rng.random()
        rows = [(0.3, 0.1)] if step % 7 == 0 else []
        assert flown.step(gas, rows, draw) == pytest.approx(tried.step(gas, rows, draw), abs=1e-12)
