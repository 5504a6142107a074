"""How a trial begins, whatever flies in it: where its plume is, where each drone starts and how long it lives."""

from __future__ import annotations

import math

import numpy as np

from mission.geometry.formation import FloatArray
from simvehicle.compiled import kernel
from simvehicle.trials.flight import ARENA_M, ORIGIN_X, ORIGIN_Y, Scene
from simvehicle.trials.plume import AT_X, AT_Y, CUT_GRID, KIND, SOURCE_X, SOURCE_Y, WAVE_COUNT, WAVES
from simvehicle.trials.randomness import (
    GENERIC,
    IN_PLUME,
    START,
    WORLD,
    geometric_tick,
    open_stream,
    survival_limit,
    uniform,
)

# Places in the setup's numbers.
GENERIC_RATE, MOBS_STEP_M, FIXED_SOURCE, GROUP, CUT_GOAL, GOAL_X, GOAL_Y, SETUP_NUMBERS = range(8)
"""GOAL: the maximum from the plume's origin; CUT_GOAL: what counts instead is its whole metres in the world."""

_START_M = 8.0
"""Drones start at rest, uniform in the square of +-8 m about the launch point (authors)."""


@kernel
def _whole_decimetres(metres: float) -> float:
    return int(10.0 * metres) / 10.0


@kernel
def _whole_metres(metres: float) -> float:
    """Of a length in decimetres: cut towards zero."""
    return float(int(round(10.0 * metres) / 10.0))


@kernel
def prepare_world(scene: Scene, setup: FloatArray, seed: int, trial: int) -> None:
    """The plume's place (uniform in the arena's square, outside its radius drawn again) and its wind's phases."""
    stream = np.zeros(1, np.uint64)
    open_stream(stream, seed, trial, WORLD)
    arena_m = scene.world[ARENA_M]
    if setup[FIXED_SOURCE] == 0.0:
        while True:
            x = arena_m * (2.0 * uniform(stream) - 1.0)
            y = arena_m * (2.0 * uniform(stream) - 1.0)
            if math.hypot(x, y) <= arena_m:
                break
        if scene.plume[KIND] == CUT_GRID:
            x, y = _whole_decimetres(x), _whole_decimetres(y)
        scene.world[ORIGIN_X] = x
        scene.world[ORIGIN_Y] = y
    x, y = scene.world[ORIGIN_X], scene.world[ORIGIN_Y]
    scene.plume[AT_X], scene.plume[AT_Y] = x, y
    if setup[CUT_GOAL] > 0.0:
        scene.plume[SOURCE_X] = _whole_metres(x + setup[GOAL_X]) - x
        scene.plume[SOURCE_Y] = _whole_metres(y + setup[GOAL_Y]) - y
    for wave in range(WAVE_COUNT):
        scene.plume[WAVES + WAVE_COUNT + wave] = 2.0 * math.pi * uniform(stream)


@kernel
def drone_start(setup: FloatArray, seed: int, trial: int, drone: int) -> tuple[float, float, int, float]:
    """(north_m, east_m, fails, limit): its place, the tick at which it fails of itself, its `survival_limit`."""
    stream = np.zeros(1, np.uint64)
    open_stream(stream, seed, trial, START + drone)
    north_m = _START_M * (2.0 * uniform(stream) - 1.0)
    east_m = _START_M * (2.0 * uniform(stream) - 1.0)
    open_stream(stream, seed, trial, GENERIC + drone)
    fails = geometric_tick(uniform(stream), setup[GENERIC_RATE])
    open_stream(stream, seed, trial, IN_PLUME + drone)
    return north_m, east_m, fails, survival_limit(uniform(stream))
