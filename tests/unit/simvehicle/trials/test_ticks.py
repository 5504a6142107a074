"""Tick mode: against a plain step-by-step swarm, rows however they are split."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import msgspec
import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.strategies import registry
from mission.strategies.reactive import reactive_strategy
from mission.strategies.tick_rule import EAST, EAST_MPS, NORTH, NORTH_MPS, WORD, OwnSenses, TickRule, numbers
from simvehicle.compiled import compiled
from simvehicle.trials import randomness
from simvehicle.trials.cell import Cell
from simvehicle.trials.outcome import kernel_setup, record_trial, run_cell
from simvehicle.trials.plume import SOURCE_X, SOURCE_Y, WAVES, reading
from simvehicle.trials.ticks.arrays import new_robots
from simvehicle.trials.ticks.stepping import move
from simvehicle.trials.trace import Tracks
from simvehicle.trials.trials_error import TrialsError

FloatArray = Any


class GatherParameters(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    pull_per_s: float = 0.05
    turn_rad: float = 0.6


def gather(
    own: OwnSenses,
    neighbours: FloatArray,
    count: int,
    ranges_m: FloatArray,
    state: FloatArray,
    word: FloatArray,
    parameters: FloatArray,
) -> tuple[float, float]:
    """Wander; draw near to where the neighbours say that they smell most, and keep off them."""
    state[0] += parameters[1] * (own.draw - 0.5)
    state[1] = max(state[1], own.gas)
    north_mps = 2.0 * math.cos(state[0]) - 0.1 * own.wind_north_mps + (0.0 if ranges_m[0] > 1.0 else -1.0)
    east_mps = 2.0 * math.sin(state[0]) - 0.1 * own.wind_east_mps + own.interval_s * math.sin(own.elapsed_s)
    for k in range(count):
        away2 = neighbours[k, NORTH] ** 2 + neighbours[k, EAST] ** 2
        pull = parameters[0] * (1.0 + neighbours[k, WORD]) - 0.2 / (0.1 + away2)
        north_mps += pull * neighbours[k, NORTH] + 0.01 * neighbours[k, NORTH_MPS]
        east_mps += pull * neighbours[k, EAST] + 0.01 * neighbours[k, EAST_MPS]
    word[0] = state[1]
    word[1] = float(count)
    if math.hypot(own.north_m, own.east_m) > 40.0:
        north_mps -= own.north_m * 0.1
        east_mps -= own.east_m * 0.1
    return north_mps, east_mps


GATHER = TickRule(rule=gather, parameters=GatherParameters, range_m=7.0, state_size=2, word_size=2, beams=3)


def nowhere(
    own: OwnSenses,
    neighbours: FloatArray,
    count: int,
    ranges_m: FloatArray,
    state: FloatArray,
    word: FloatArray,
    parameters: FloatArray,
) -> tuple[float, float]:
    return (math.nan if own.elapsed_s >= 1.0 and own.draw > 0.9 else 0.0), 0.0


def uncompilable(
    own: OwnSenses,
    neighbours: FloatArray,
    count: int,
    ranges_m: FloatArray,
    state: FloatArray,
    word: FloatArray,
    parameters: FloatArray,
) -> tuple[float, float]:
    return own.no_such_sense, 0.0  # type: ignore[attr-defined]


class NoParameters(msgspec.Struct, frozen=True):
    pass


@pytest.fixture(autouse=True)
def _reactive(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, rule in (
        ("gather", GATHER),
        ("nowhere", TickRule(rule=nowhere, parameters=NoParameters, range_m=5.0)),
        ("uncompilable", TickRule(rule=uncompilable, parameters=NoParameters, range_m=5.0)),
    ):
        monkeypatch.setitem(registry.BUILT_IN, name, reactive_strategy(name, rule))


def cell(**changes: Any) -> Cell:
    chosen = {"strategy": "gather", "drones": 9, "arena_m": 40.0, "limit_ticks": 1500, "source": (-5.0, 3.0)}
    return Cell(**(chosen | changes))


@compiled
def _read(plume: FloatArray, grid: FloatArray, x: float, y: float, time_s: float) -> float:
    return reading(plume, grid, x, y, time_s)


@dataclasses.dataclass
class Robot:
    place: FloatArray
    velocity: FloatArray
    stream: FloatArray
    fails: int
    limit: float
    survival: float = 1.0
    gas: float = 0.0
    alive: bool = True
    state: FloatArray = dataclasses.field(default_factory=lambda: np.zeros(2))
    heard: FloatArray = dataclasses.field(default_factory=lambda: np.zeros(2))
    said: FloatArray = dataclasses.field(default_factory=lambda: np.zeros(2))


class PlainSwarm:
    """The same trial without cells, kernels or arrays over robots."""

    def __init__(self, one: Cell, seed: int, trial: int) -> None:
        self.cell = one
        self.setup = kernel_setup(one)
        self.tick = 0
        self.contact: int | None = None
        self.success: int | None = None
        self.parameters = numbers(GatherParameters(**dict(one.parameters)))
        assert one.source is not None
        self.origin = np.array(one.source)
        world = self._stream(seed, trial, randomness.WORLD)
        waves = self.setup.scene.plume
        for wave in range(4):
            waves[WAVES + 4 + wave] = 2.0 * math.pi * randomness.uniform(world)
        self.robots = []
        rate = one.failure_rate if one.failure == "generic" else 0.0
        for i in range(one.drones):
            start = self._stream(seed, trial, randomness.START + i)
            place = np.array([8.0 * (2.0 * randomness.uniform(start) - 1.0) for _ in range(2)])
            generic = randomness.uniform(self._stream(seed, trial, randomness.GENERIC + i))
            in_plume = randomness.uniform(self._stream(seed, trial, randomness.IN_PLUME + i))
            self.robots.append(
                Robot(
                    place,
                    np.zeros(2),
                    self._stream(seed, trial, randomness.OWN + i),
                    randomness.geometric_tick(generic, rate),
                    randomness.survival_limit(in_plume),
                )
            )
            self.robots[-1].gas = self._gas(self.robots[-1])

    def _stream(self, seed: int, trial: int, kind: int) -> FloatArray:
        stream = np.zeros(1, np.uint64)
        randomness.open_stream(stream, seed, trial, kind)
        return stream

    def _gas(self, robot: Robot) -> float:
        scene = self.setup.scene
        x, y = robot.place - self.origin
        return float(_read(scene.plume, scene.grid, x, y, self.tick / 16.0))

    def _wind(self) -> tuple[float, float]:
        plume, time_s = self.setup.scene.plume, self.tick / 16.0
        periods_s = (7.0, 19.0, 43.0, 101.0)
        east = sum(
            plume[WAVES + k] * math.cos(2 * math.pi * time_s / periods_s[k] + plume[WAVES + 4 + k])
            for k in range(4)
        )
        return 3.0, east if self.cell.plume == "gusty" else 0.0

    def _decide(self, i: int) -> FloatArray:
        robot = self.robots[i]
        near = []
        for j, other in enumerate(self.robots):
            away = other.place - robot.place
            if i != j and other.alive and away @ away <= 49.0:
                near.append([*away, *(other.velocity - robot.velocity), *other.heard])
        draw = randomness.uniform(robot.stream)
        own = OwnSenses(
            *robot.place, *robot.velocity, robot.gas, *self._wind(), self.tick / 16.0, 1 / 16.0, draw
        )
        ranges_m = np.full(3, math.inf)
        rows = np.array(near).reshape(-1, 6)
        return np.array(gather(own, rows, len(near), ranges_m, robot.state, robot.said, self.parameters))

    def _move(self, robot: Robot, wanted: FloatArray) -> None:
        speed, change = self.cell.speed_mps, self.cell.acceleration_mps2 / 16.0
        wanted = wanted * min(1.0, speed / max(float(np.linalg.norm(wanted)), 1e-300))
        step = wanted - robot.velocity
        step = step * min(1.0, change / max(float(np.linalg.norm(step)), 1e-300))
        robot.velocity = robot.velocity + step
        edge = 1.5 * self.cell.arena_m
        robot.place = np.clip(robot.place + robot.velocity / 16.0, -edge, edge)

    def _sense(self, i: int) -> None:
        robot = self.robots[i]
        gas = self._gas(robot)
        if robot.fails <= self.tick:
            robot.alive = False
            return
        if self.cell.failure == "in-plume" and gas > 0.0:
            robot.survival *= (1.0 - self.cell.failure_rate * gas) ** 2
            if robot.survival < robot.limit:
                robot.alive = False
                return
        robot.gas = gas
        if gas > 0.0 and self.contact is None:
            self.contact = self.tick
        scene = self.setup.scene
        source = self.origin + np.array([scene.plume[SOURCE_X], scene.plume[SOURCE_Y]])
        if np.linalg.norm(robot.place - source) < self.cell.success_m:
            self.success = self.tick

    def run(self) -> PlainSwarm:
        while (
            any(r.alive for r in self.robots) and self.success is None and self.tick < self.cell.limit_ticks
        ):
            wanted = [self._decide(i) if robot.alive else np.zeros(2) for i, robot in enumerate(self.robots)]
            self.tick += 1
            for i, robot in enumerate(self.robots):
                if robot.alive:
                    self._move(robot, wanted[i])
                    robot.heard = robot.said.copy()
                    self._sense(i)
        return self


@pytest.mark.parametrize(
    "one",
    [
        cell(),
        cell(plume="perturbed", drones=1),
        cell(plume="gusty", parameters=(("turn_rad", 1.5),), limit_ticks=400),
        cell(failure="generic", failure_rate=2e-3),
        cell(failure="in-plume", failure_rate=5e-2, success_m=0.01),
    ],
    ids=lambda one: one.label(),
)
def test_the_compiled_swarm_is_the_plain_one(one: Cell) -> None:
    rows = run_cell(one, seed=3, first=0, count=2)
    for number, row in rows.iterrows():
        plain = PlainSwarm(one, 3, int(number)).run()  # type: ignore[call-overload]
        assert row.end_s * 16 == plain.tick
        assert row.success == (plain.success is not None)
        assert (None if np.isnan(row.contact_s) else row.contact_s * 16) == plain.contact
        assert row.survivors == sum(robot.alive for robot in plain.robots)
        tracks = Tracks(record_trial(one, 3, int(number)), 1 / 16)  # type: ignore[call-overload]
        before = tracks.place_m[plain.tick - 1]
        for robot, place in zip(plain.robots, before, strict=True):
            if robot.alive:
                assert np.hypot(*(robot.place - robot.velocity / 16.0 - place)) < 1e-6


def test_trials_of_a_reactive_strategy_have_the_plumes_and_starts_of_all_strategies() -> None:
    ours, locus = (
        run_cell(cell(strategy=name, source=None, limit_ticks=50), 8, 0, 5) for name in ("gather", "locus")
    )
    pd.testing.assert_series_equal(ours.plume_north_m, locus.plume_north_m)
    assert list(ours.columns) == list(locus.columns)
    assert set(ours.motion) == {"cruise"}


def test_rows_are_the_same_however_the_trials_are_split() -> None:
    one = cell(source=None, failure="generic", failure_rate=1e-3)
    whole = run_cell(one, 5, 0, 7)
    parts = pd.concat([run_cell(one, 5, first, count) for first, count in ((0, 1), (1, 4), (5, 2))])
    pd.testing.assert_frame_equal(whole, parts.reset_index(drop=True))
    assert whole.success.nunique() + whole.end_s.nunique() > 2  # they are not all alike


@compiled
def _moved(place: FloatArray, velocity: FloatArray, wanted: FloatArray, swarm: FloatArray) -> int:
    robots = new_robots(1, 0, 0)
    robots.north_m[0], robots.east_m[0] = place
    robots.north_mps[0], robots.east_mps[0] = velocity
    robots.wanted_north_mps[0], robots.wanted_east_mps[0] = wanted
    flawed = move(robots, swarm, 150.0)
    place[0], place[1] = robots.north_m[0], robots.east_m[0]
    velocity[0], velocity[1] = robots.north_mps[0], robots.east_mps[0]
    return flawed


@given(
    st.lists(st.floats(-150, 150), min_size=2, max_size=2), st.lists(st.floats(-9, 9), min_size=2, max_size=2)
)
@settings(deadline=None)
def test_nobody_is_faster_or_farther_than_possible(start: list[float], wanted: list[float]) -> None:
    place, velocity = np.array(start), np.zeros(2)
    for _ in range(60):
        before = velocity.copy()
        assert _moved(place, velocity, np.array(wanted), np.array([10.0, 4.0, 2.0])) == -1
        assert np.hypot(*velocity) <= 4.0 + 1e-9
        assert np.hypot(*(velocity - before)) <= 2.0 / 16 + 1e-9
        assert np.abs(place).max() <= 150.0
    goal = np.array(wanted) * min(1.0, 4.0 / max(np.hypot(*wanted), 1e-9))
    np.testing.assert_allclose(velocity, goal, atol=1e-9)


def test_what_is_no_velocity_is_told_with_trial_robot_and_tick() -> None:
    with pytest.raises(TrialsError, match=r"strategy nowhere: its rule gave what is no velocity to robot \d"):
        run_cell(cell(strategy="nowhere"), 1, 0, 3)


def test_a_rule_that_does_not_compile_is_named_in_one_line() -> None:
    with pytest.raises(TrialsError, match=r"strategy uncompilable: its rule .*uncompilable cannot") as told:
        run_cell(cell(strategy="uncompilable"), 1, 0, 1)
    assert "\n" not in str(told.value)
    assert "no_such_sense" in str(told.value)


def test_what_a_reactive_cell_cannot_be() -> None:
    assert cell(parameters=(("pull", 1.0),)).problems() == [
        "strategy gather has no parameter 'pull'; it has pull_per_s, turn_rad"
    ]
    assert "not with parameters" in cell(strategy="mobs", parameters=(("pull", 1.0),)).problems()[0]
    assert (
        cell(strategy="nothing")
        .problems()[0]
        .startswith("no strategy is called 'nothing'; there are locus, mobs")
    )
