"""A reactive rule in the situations of a compiled trial: flown by the agent's strategy object, it decides the same.

The trial's robots can reach any speed within a tick, so its track tells what every robot decided. The same places,
velocities, readings, words and draws are given to the strategy objects that fly.
"""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest

from mission.geometry.formation import FloatArray, Hexagonal
from mission.strategies import registry
from mission.strategies.contract import (
    Neighbour,
    Observation,
    Order,
    OwnState,
    Scalar,
    Stage,
    TreePlace,
    Velocity,
    Wind,
)
from mission.strategies.reactive import reactive_strategy
from mission.strategies.tick_rule import EAST, EAST_MPS, NORTH, NORTH_MPS, WORD, OwnSenses, TickRule
from simvehicle.compiled import compiled
from simvehicle.trials import randomness
from simvehicle.trials.cell import Cell
from simvehicle.trials.motion import TICKS_PER_S
from simvehicle.trials.outcome import record_trial
from simvehicle.trials.plume import WIND_MPS, reading

SEED, TRIAL, ROBOTS, TICKS = 11, 4, 12, 120
HEIGHT_M = -10.0
SOURCE = (-30.0, 3.0)
PLACE = TreePlace(1, 0, {1: 0}, None, (), None, None, 1, False)
ORDER = Order(1, Stage.SEARCH, (0.0, 0.0, HEIGHT_M), 0.0)


class DriftParameters(msgspec.Struct, frozen=True):
    pull_per_s: float = 0.1
    home_per_s: float = 0.2


def drift(
    own: OwnSenses,
    neighbours: FloatArray,
    count: int,
    ranges_m: FloatArray,
    state: FloatArray,
    word: FloatArray,
    parameters: FloatArray,
) -> tuple[float, float]:
    """Use all that a rule is given."""
    state[0] += own.draw - 0.5
    state[1] = 0.9 * state[1] + own.gas
    # At the first tick an agent knows no interval yet.
    phase_rad = state[0] + own.elapsed_s * (1.0 + own.interval_s)
    north_mps = 0.2 * own.velocity_north_mps - parameters[1] * own.north_m - 0.1 * own.wind_north_mps
    east_mps = 0.2 * own.velocity_east_mps - parameters[1] * own.east_m + 0.1 * own.wind_east_mps
    for k in range(count):
        pull = parameters[0] * (1.0 + neighbours[k, WORD] - 0.2 * neighbours[k, WORD + 1])
        north_mps += pull * neighbours[k, NORTH] + 0.01 * neighbours[k, NORTH_MPS]
        east_mps += pull * neighbours[k, EAST] + 0.01 * neighbours[k, EAST_MPS]
    word[0] = state[1]
    word[1] = count
    free = 3.0 if ranges_m[0] > 5.0 else 0.0
    return north_mps + free * math.cos(phase_rad), east_mps + free * math.sin(phase_rad) + own.gas


RULE = TickRule(rule=drift, parameters=DriftParameters, range_m=5.0, state_size=2, word_size=2, beams=2)


@compiled
def _read(plume: FloatArray, grid: FloatArray, x: float, y: float, time_s: float) -> float:
    return reading(plume, grid, x, y, time_s)


class Draws:
    """A robot's stream in the place of an agent's generator."""

    def __init__(self, robot: int) -> None:
        self._stream = np.zeros(1, np.uint64)
        randomness.open_stream(self._stream, SEED, TRIAL, randomness.OWN + robot)

    def random(self) -> float:
        return float(randomness.uniform(self._stream))


def test_an_agent_decides_what_the_trial_decided(monkeypatch: pytest.MonkeyPatch) -> None:
    entry = reactive_strategy("drift", RULE)
    monkeypatch.setitem(registry.BUILT_IN, "drift", entry)
    cell = Cell(
        strategy="drift",
        drones=ROBOTS,
        speed_mps=1e3,
        acceleration_mps2=1e6,
        arena_m=100.0,
        success_m=1e-6,
        limit_ticks=TICKS,
        source=SOURCE,
    )
    recorded = record_trial(cell, SEED, TRIAL)
    assert recorded.track is not None
    assert recorded.track.every == 1
    places_m = recorded.track.samples_m
    velocities_mps = np.diff(places_m, axis=0, prepend=places_m[:1]) * TICKS_PER_S
    scene = recorded.setup.scene

    make: Any = entry.make
    strategies = [make(Hexagonal(10.0), DriftParameters()) for _ in range(ROBOTS)]
    draws: list[Any] = [Draws(robot) for robot in range(ROBOTS)]
    words = [b""] * ROBOTS
    shown, smelled = set(), 0
    for tick in range(TICKS - 1):
        gas = [
            _read(scene.plume, scene.grid, *(place - SOURCE), tick / TICKS_PER_S) for place in places_m[tick]
        ]
        positions = [(north_m, east_m, HEIGHT_M) for north_m, east_m in places_m[tick].tolist()]
        velocities = [(north_mps, east_mps, 0.0) for north_mps, east_mps in velocities_mps[tick].tolist()]
        heard = list(words)
        for i, strategy in enumerate(strategies):
            own = OwnState(
                i + 1,
                positions[i],
                velocities[i],
                Scalar(gas[i], 0.0, 0.1),
                Wind((WIND_MPS, 0.0, 0.0), 0.1, 0.1),
                0.9,
            )
            others = tuple(
                Neighbour(j + 1, positions[j], velocities[j], 0.0, airborne=True, word=heard[j])
                for j in range(ROBOTS)
                if j != i
            )
            observation = Observation(tick / TICKS_PER_S, own, others, PLACE, ORDER, ())
            decision = strategy.decide(observation, draws[i])
            words[i] = decision.word
            assert isinstance(decision.intent, Velocity)
            assert decision.intent.velocity_ned_mps[:2] == pytest.approx(
                velocities_mps[tick + 1, i], rel=1e-9, abs=1e-9
            ), (tick, i)
            shown.add(sum(math.dist(positions[i], other.position_ned_m) <= RULE.range_m for other in others))
            smelled += gas[i] > 0.0
    # The situations are of all kinds.
    assert {0, 1, 2, 3} <= shown
    assert 0 < smelled < (TICKS - 1) * ROBOTS
