"""Many trials of one rule: the rule is compiled into the loop that calls it for every robot at every tick."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mission.geometry.formation import FloatArray, IntArray
from mission.strategies.tick_rule import OwnSenses, Rule, TickRule
from simvehicle.compiled import called_by_leaves, compiled, leaf
from simvehicle.trials.flight import NOW, ORIGIN_X, ORIGIN_Y, SURVIVORS, Scene
from simvehicle.trials.motion import TICKS_PER_S
from simvehicle.trials.randomness import uniform_at
from simvehicle.trials.start import prepare_world
from simvehicle.trials.ticks.arrays import Robots, new_robots
from simvehicle.trials.ticks.neighbours import (
    Neighbourhood,
    find_neighbours,
    new_neighbourhood,
    show_neighbours,
)
from simvehicle.trials.ticks.sampling import sample_wind
from simvehicle.trials.ticks.stepping import (
    ACCELERATION_MPS2,
    RANGE_M,
    SPEED_MPS,
    TICK_NUMBERS,
    arena_edge_m,
    begin_tally,
    move,
    prepare_robots,
    sense,
)

FLAW = SURVIVORS + 1
"""Column of the results: the robot whose rule gave what is no velocity, plus 1; 0 if all went well."""
TICK_RESULTS = FLAW + 1


class Sizes(NamedTuple):
    robots: int
    state: int
    word: int
    beams: int


@functools.cache
def tick_kernel(rule: Rule) -> Callable[..., None]:
    """Fly trials `first`, `first` + 1, ... by `rule`: one row of `results` and `origins` a trial.

    `tracks` (samples, robots, 2) gets the places at every `every`-th tick of the last trial, as far as it reaches.
    """

    called_by_leaves(rule)

    @leaf
    def decide_all(
        robots: Robots,
        around: Neighbourhood,
        ranges_m: FloatArray,
        wind_mps: FloatArray,
        parameters: FloatArray,
        range_m: float,
        tick: int,
    ) -> None:
        for i in range(robots.alive.shape[0]):
            if robots.alive[i] == 0:
                continue
            own = OwnSenses(
                robots.north_m[i],
                robots.east_m[i],
                robots.north_mps[i],
                robots.east_mps[i],
                robots.gas[i],
                wind_mps[0],
                wind_mps[1],
                tick / TICKS_PER_S,
                1.0 / TICKS_PER_S,
                uniform_at(robots.draws, i),
            )
            count = show_neighbours(around, robots, i, range_m)
            north_mps, east_mps = rule(
                own, robots.rows, count, ranges_m, robots.state[i], robots.said[i], parameters
            )
            robots.wanted_north_mps[i] = north_mps
            robots.wanted_east_mps[i] = east_mps

    def fly_ticks(
        scene: Scene,
        setup: FloatArray,
        swarm: FloatArray,
        parameters: FloatArray,
        sizes: Sizes,
        seed: int,
        first: int,
        limit: int,
        results: IntArray,
        origins: FloatArray,
        tracks: FloatArray,
        every: int,
    ) -> None:
        robots = new_robots(sizes.robots, sizes.state, sizes.word)
        around = new_neighbourhood(sizes.robots)
        ranges_m = np.full(sizes.beams, np.inf)
        wind_mps = np.zeros(2)
        range_m = swarm[RANGE_M]
        for trial in range(results.shape[0]):
            tally = results[trial]
            begin_tally(tally, limit)
            prepare_world(scene, setup, seed, first + trial)
            prepare_robots(scene, robots, setup, seed, first + trial)
            going = limit > 0
            while going:
                tick = tally[NOW]
                if tracks.shape[0] > 0 and tick % every == 0 and tick // every < tracks.shape[0]:
                    for i in range(sizes.robots):
                        if robots.alive[i] == 1:
                            tracks[tick // every, i, 0] = robots.north_m[i]
                            tracks[tick // every, i, 1] = robots.east_m[i]
                sample_wind(scene, tick, wind_mps)
                find_neighbours(around, robots, range_m)
                decide_all(robots, around, ranges_m, wind_mps, parameters, range_m, tick)
                flawed = move(robots, swarm, arena_edge_m(scene))
                tally[NOW] = tick + 1
                going = sense(scene, robots, tally)
                if flawed >= 0:
                    tally[FLAW] = flawed + 1
                    going = False
            tally[SURVIVORS] = 0
            for i in range(sizes.robots):
                tally[SURVIVORS] += robots.alive[i]
            origins[trial, 0] = scene.world[ORIGIN_X]
            origins[trial, 1] = scene.world[ORIGIN_Y]

    return compiled(fly_ticks)


def swarm_numbers(rule: TickRule, speed_mps: float, acceleration_mps2: float) -> FloatArray:
    """What the kernels know of a swarm besides its parameters."""
    found = np.zeros(TICK_NUMBERS)
    found[RANGE_M], found[SPEED_MPS], found[ACCELERATION_MPS2] = rule.range_m, speed_mps, acceleration_mps2
    return found
