"""One tick of a swarm, but for the rule: everybody moves as wanted and possible, then senses, fails or finds."""

from __future__ import annotations

import math

import numpy as np

from mission.geometry.formation import FloatArray, IntArray
from simvehicle.compiled import kernel, leaf
from simvehicle.trials.flight import (
    ARENA_M,
    CONTACT,
    CONTACT_DRONE,
    IN_PLUME_DRAWS,
    IN_PLUME_RATE,
    LIMIT,
    LIMIT_FACTOR,
    NEVER,
    NOW,
    ORIGIN_X,
    ORIGIN_Y,
    SUCCESS,
    SUCCESS_M,
    TALLY,
    Scene,
)
from simvehicle.trials.motion import TICKS_PER_S
from simvehicle.trials.plume import SOURCE_X, SOURCE_Y
from simvehicle.trials.randomness import OWN, open_stream
from simvehicle.trials.start import drone_start
from simvehicle.trials.ticks.arrays import Robots
from simvehicle.trials.ticks.sampling import gas_at

# Places in the numbers of a swarm in tick mode.
RANGE_M, SPEED_MPS, ACCELERATION_MPS2, TICK_NUMBERS = range(4)


@kernel
def prepare_robots(scene: Scene, robots: Robots, setup: FloatArray, seed: int, trial: int) -> None:
    """The start of a trial: everybody where, and as long-lived as, trial `trial` has it for every strategy."""
    stream = np.zeros(1, np.uint64)
    for i in range(robots.alive.shape[0]):
        robots.north_m[i], robots.east_m[i], robots.fails[i], robots.limits[i] = drone_start(
            setup, seed, trial, i
        )
        robots.north_mps[i] = 0.0
        robots.east_mps[i] = 0.0
        robots.gas[i] = gas_at(scene, robots.north_m[i], robots.east_m[i], 0)
        robots.alive[i] = 1
        robots.survival[i] = 1.0
        open_stream(stream, seed, trial, OWN + i)
        robots.draws[i] = stream[0]
        for place in range(robots.state.shape[1]):
            robots.state[i, place] = 0.0
        for place in range(robots.heard.shape[1]):
            robots.heard[i, place] = 0.0
            robots.said[i, place] = 0.0


@leaf
def begin_tally(tally: IntArray, limit: int) -> None:
    for place in range(TALLY):
        tally[place] = 0
    tally[LIMIT] = limit
    tally[CONTACT] = NEVER
    tally[CONTACT_DRONE] = -1
    tally[SUCCESS] = NEVER


@leaf
def move(robots: Robots, swarm: FloatArray, most_m: float) -> int:
    """Take everybody forward by a tick; one whose rule gave what is no velocity, or -1.

    The velocity follows the wanted one, which is cut to the speed limit, as fast as the acceleration limit allows.
    """
    speed_mps = swarm[SPEED_MPS]
    change_mps = swarm[ACCELERATION_MPS2] / TICKS_PER_S
    flawed = -1
    # Without branches: a wrong guess of the processor costs more than a root. Who has failed drifts on, unseen.
    for i in range(robots.alive.shape[0]):
        north_mps, east_mps = robots.wanted_north_mps[i], robots.wanted_east_mps[i]
        wanted2 = north_mps * north_mps + east_mps * east_mps
        flawed = flawed if wanted2 < math.inf else i
        cut = speed_mps / math.sqrt(max(wanted2, speed_mps * speed_mps))  # exactly 1 below the limit
        north_mps = cut * north_mps - robots.north_mps[i]
        east_mps = cut * east_mps - robots.east_mps[i]
        change2 = north_mps * north_mps + east_mps * east_mps
        cut = change_mps / math.sqrt(max(change2, change_mps * change_mps))
        robots.north_mps[i] += cut * north_mps
        robots.east_mps[i] += cut * east_mps
        north_m = robots.north_m[i] + robots.north_mps[i] / TICKS_PER_S
        east_m = robots.east_m[i] + robots.east_mps[i] / TICKS_PER_S
        robots.north_m[i] = min(max(north_m, -most_m), most_m)
        robots.east_m[i] = min(max(east_m, -most_m), most_m)
    for i in range(robots.heard.shape[0]):
        for place in range(robots.heard.shape[1]):
            robots.heard[i, place] = robots.said[i, place]
    return flawed


@leaf
def sense(scene: Scene, robots: Robots, tally: IntArray) -> bool:
    """At the tick tally[NOW]: who fails, what the others read, who is at the source. Whether the trial goes on.

    A robot that fails at a tick reads nothing and finds nothing there.
    """
    now = tally[NOW]
    rate = scene.world[IN_PLUME_RATE]
    draws = int(scene.world[IN_PLUME_DRAWS])
    source_x = scene.world[ORIGIN_X] + scene.plume[SOURCE_X]
    source_y = scene.world[ORIGIN_Y] + scene.plume[SOURCE_Y]
    near2 = scene.world[SUCCESS_M] * scene.world[SUCCESS_M]
    some = False
    for i in range(robots.alive.shape[0]):
        if robots.alive[i] == 0:
            continue
        gas = gas_at(scene, robots.north_m[i], robots.east_m[i], now)
        failed = robots.fails[i] <= now
        if gas > 0.0 and rate > 0.0 and not failed:
            kept = max(1.0 - rate * gas, 0.0)
            for _ in range(draws):
                robots.survival[i] *= kept
            failed = robots.survival[i] < robots.limits[i]
        if failed:
            robots.alive[i] = 0
            continue
        some = True
        robots.gas[i] = gas
        if gas > 0.0 and tally[CONTACT] == NEVER:
            tally[CONTACT] = now
            tally[CONTACT_DRONE] = i
        dx, dy = robots.north_m[i] - source_x, robots.east_m[i] - source_y
        if dx * dx + dy * dy < near2:
            tally[SUCCESS] = now
    return some and tally[SUCCESS] == NEVER and now < tally[LIMIT]


@leaf
def arena_edge_m(scene: Scene) -> float:
    return float(LIMIT_FACTOR * scene.world[ARENA_M])
