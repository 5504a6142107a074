"""Many trials of one rule in recorded air: the rule is compiled into the loop that calls it at every step."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mission.geometry.formation import FloatArray, IntArray
from mission.strategies.tick_rule import EAST, NORTH, OwnSenses, Rule
from simvehicle.compiled import called_by_leaves, compiled, kernel, leaf
from simvehicle.trials.randomness import (
    GENERIC,
    OWN,
    SENSOR,
    geometric_tick,
    open_stream,
    uniform,
    uniform_at,
)
from simvehicle.trials.ticks.arrays import BitArray, Robots, new_robots
from simvehicle.trials.ticks.neighbours import (
    Neighbourhood,
    find_neighbours,
    new_neighbourhood,
    show_neighbours,
)
from simvehicle.trials.tracing.separation import flee, nearest_m, share_of_way, slide_off
from simvehicle.trials.tracing.terrain import Terrain, along_wall, has_room, look_around
from simvehicle.world.compiled_recorded import sample_gas, sample_wind
from simvehicle.world.recorded_air import RecordedAir

NEVER = np.iinfo(np.int64).max

# Columns of the counts: one row a trial.
(
    ARRIVAL,
    ARRIVED,
    CONTACT,
    LOCALISATION,
    SOURCES,
    LOST,
    STEPS,
    FLAW,
    COUNTS,
) = range(9)
"""ARRIVAL, CONTACT: the first step in which a vehicle is near a source, reads anything (NEVER). ARRIVED: which one
(-1). LOCALISATION: vehicles near a source, summed over the steps. SOURCES: how many were reached. LOST: members
that failed. STEPS: flown. FLAW: the robot whose rule gave what is no velocity, plus 1."""
# Columns of the distances.
CLOSEST_M, NEAREST_PAIR_M, DISTANCES = range(3)
"""Of any vehicle to a source; of two vehicles."""


class Rules(NamedTuple):
    """What holds for everybody's flight in a trial, as numbers."""

    step_s: float
    speed_mps: float
    radius_m: float
    avoidance_m: float
    arrival_m: float
    range_m: float
    reach_m: float
    """Of range sensors."""
    detection: float
    lag_s: float
    noise: float
    loss_rate: float
    until_arrival: bool


class Sources(NamedTuple):
    """Where the gas comes from."""

    places_m: FloatArray
    """(moments, sources, 2) north and east; the last moment holds from then on."""
    every_s: float


class Sensors(NamedTuple):
    """The state of every robot's gas sensor."""

    lagged: FloatArray
    draws: BitArray


class Shape(NamedTuple):
    """Sizes of a rule's arrays."""

    state: int
    word: int
    beams: int


@leaf
def _normal(draws: BitArray, i: int) -> float:
    """Of mean 0 and deviation 1 (Box, Muller 1958)."""
    radius = math.sqrt(-2.0 * math.log(1.0 - uniform_at(draws, i)))
    return radius * math.cos(2.0 * math.pi * uniform_at(draws, i))


@leaf
def _sense(
    air: RecordedAir,
    rules: Rules,
    robots: Robots,
    sensors: Sensors,
    sources: Sources,
    reached: IntArray,
    step: int,
    counts: IntArray,
    distances: FloatArray,
) -> bool:
    """What everybody reads in step `step`, and who is near a source then. Whether anybody still flies."""
    time_s = step * rules.step_s
    follows = 1.0 if rules.lag_s == 0.0 or step == 0 else 1.0 - math.exp(-rules.step_s / rules.lag_s)
    moment = min(int(time_s / sources.every_s), sources.places_m.shape[0] - 1)
    near2 = rules.arrival_m * rules.arrival_m
    closest2 = distances[CLOSEST_M] * distances[CLOSEST_M]
    some = False
    for i in range(robots.alive.shape[0]):
        if robots.alive[i] == 0:
            continue
        if robots.fails[i] <= step:
            robots.alive[i] = 0
            counts[LOST] += 1
            continue
        some = True
        north_m, east_m = robots.north_m[i], robots.east_m[i]
        sensors.lagged[i] += follows * (sample_gas(air, north_m, east_m, time_s) - sensors.lagged[i])
        gas = sensors.lagged[i]
        if rules.noise > 0.0:
            gas += rules.noise * _normal(sensors.draws, i)
        robots.gas[i] = gas if gas > rules.detection else 0.0
        if robots.gas[i] > 0.0 and counts[CONTACT] == NEVER:
            counts[CONTACT] = step
        near = False
        for source in range(sources.places_m.shape[1]):
            away_n = sources.places_m[moment, source, 0] - north_m
            away_e = sources.places_m[moment, source, 1] - east_m
            away2 = away_n * away_n + away_e * away_e
            closest2 = min(closest2, away2)
            if away2 <= near2:
                near = True
                if reached[source] == 0:
                    reached[source] = 1
                    counts[SOURCES] += 1
        if near:
            counts[LOCALISATION] += 1
            if counts[ARRIVAL] == NEVER:
                counts[ARRIVAL] = step
                counts[ARRIVED] = i
    distances[CLOSEST_M] = math.sqrt(closest2)
    return some


@leaf
def _within(rows: FloatArray, count: int, range_m: float) -> int:
    """Take those beyond `range_m` out of the rows; how many are left."""
    left = 0
    for k in range(count):
        if rows[k, NORTH] * rows[k, NORTH] + rows[k, EAST] * rows[k, EAST] <= range_m * range_m:
            for place in range(rows.shape[1]):
                rows[left, place] = rows[k, place]
            left += 1
    return left


@leaf
def _inside(terrain: Terrain, radius_m: float, axis: int, place_m: float, step_s: float, mps: float) -> float:
    """One component of a velocity, cut so that the walls are not touched."""
    low_m, high_m = radius_m, float(terrain.length_m[axis]) - radius_m
    return min(max(mps, min(low_m - place_m, 0.0) / step_s), max(high_m - place_m, 0.0) / step_s)


@leaf
def permitted(
    terrain: Terrain, rules: Rules, robots: Robots, i: int, count: int, north_mps: float, east_mps: float
) -> tuple[float, float]:
    """What robot i may fly of the velocity that it wants: within its limits, the walls, off obstacles and others."""
    rows, step_s = robots.rows, rules.step_s
    north_m, east_m = robots.north_m[i], robots.east_m[i]
    speed2 = north_mps * north_mps + east_mps * east_mps
    cut = rules.speed_mps / math.sqrt(max(speed2, rules.speed_mps * rules.speed_mps))
    north_mps, east_mps = cut * north_mps, cut * east_mps
    reach_m = rules.radius_m
    if not has_room(terrain, north_m + step_s * north_mps, east_m + step_s * east_mps, reach_m):
        north_mps, east_mps = along_wall(terrain, north_m, east_m, north_mps, east_mps)
    apart_m = 2.0 * rules.radius_m
    if nearest_m(rows, count) < apart_m + 2.0 * step_s * rules.speed_mps:
        north_mps, east_mps = slide_off(rows, count, north_mps, east_mps, apart_m, step_s)
    north_mps = _inside(terrain, reach_m, 0, north_m, step_s, north_mps)
    east_mps = _inside(terrain, reach_m, 1, east_m, step_s, east_mps)
    # What was changed last may break what came first: less of the same way breaks nothing but, at a corner of an
    # obstacle, its clearance.
    share = share_of_way(rows, count, north_mps, east_mps, apart_m, step_s)
    north_mps, east_mps = share * north_mps, share * east_mps
    if not has_room(terrain, north_m + step_s * north_mps, east_m + step_s * east_mps, reach_m):
        return 0.0, 0.0
    return north_mps, east_mps


@leaf
def _move(robots: Robots, terrain: Terrain, rules: Rules) -> None:
    high_n = terrain.length_m[0] - rules.radius_m
    high_e = terrain.length_m[1] - rules.radius_m
    for i in range(robots.alive.shape[0]):
        robots.north_mps[i], robots.east_mps[i] = robots.wanted_north_mps[i], robots.wanted_east_mps[i]
        north_m = robots.north_m[i] + rules.step_s * robots.north_mps[i]
        east_m = robots.east_m[i] + rules.step_s * robots.east_mps[i]
        robots.north_m[i] = min(max(north_m, rules.radius_m), high_n)
        robots.east_m[i] = min(max(east_m, rules.radius_m), high_e)
        for place in range(robots.heard.shape[1]):
            robots.heard[i, place] = robots.said[i, place]


@leaf
def _record(robots: Robots, tracks: FloatArray, sample: int) -> None:
    for i in range(robots.alive.shape[0]):
        if robots.alive[i] == 1:
            tracks[sample, i, 0] = robots.north_m[i]
            tracks[sample, i, 1] = robots.east_m[i]


@leaf
def _begin_tally(counts: IntArray, distances: FloatArray) -> None:
    for place in range(COUNTS):
        counts[place] = 0
    counts[ARRIVAL] = counts[CONTACT] = NEVER
    counts[ARRIVED] = -1
    for place in range(DISTANCES):
        distances[place] = math.inf


@kernel
def _begin(
    robots: Robots, sensors: Sensors, starts_m: FloatArray, loss_rate: float, seed: int, trial: int
) -> None:
    stream = np.zeros(1, np.uint64)
    for i in range(robots.alive.shape[0]):
        robots.north_m[i], robots.east_m[i] = starts_m[i, 0], starts_m[i, 1]
        robots.north_mps[i] = robots.east_mps[i] = 0.0
        robots.alive[i] = 1
        open_stream(stream, seed, trial, GENERIC + i)
        robots.fails[i] = geometric_tick(uniform(stream), loss_rate)
        open_stream(stream, seed, trial, OWN + i)
        robots.draws[i] = stream[0]
        open_stream(stream, seed, trial, SENSOR + i)
        sensors.draws[i] = stream[0]
        sensors.lagged[i] = 0.0
        robots.state[i] = 0.0
        robots.heard[i] = 0.0
        robots.said[i] = 0.0


@functools.cache
def tracing_kernel(rule: Rule) -> Callable[..., None]:
    """Fly trials `first`, `first` + 1, ... by `rule`: one row of `starts_m`, `counts` and `distances` a trial.

    `tracks` (samples, robots, 2) gets the places in every `every`-th step of the last trial, as far as it reaches.
    """
    called_by_leaves(rule)

    @leaf
    def decide_all(
        air: RecordedAir,
        terrain: Terrain,
        rules: Rules,
        robots: Robots,
        around: Neighbourhood,
        search_m: float,
        ranges_m: FloatArray,
        wind_mps: FloatArray,
        origin_m: FloatArray,
        parameters: FloatArray,
        step: int,
        distances: FloatArray,
    ) -> int:
        flawed = -1
        time_s = step * rules.step_s
        for i in range(robots.alive.shape[0]):
            if robots.alive[i] == 0:
                continue
            north_m, east_m = robots.north_m[i], robots.east_m[i]
            sample_wind(air, north_m, east_m, time_s, wind_mps)
            own = OwnSenses(
                north_m - origin_m[0],
                east_m - origin_m[1],
                robots.north_mps[i],
                robots.east_mps[i],
                robots.gas[i],
                wind_mps[0],
                wind_mps[1],
                time_s,
                rules.step_s,
                uniform_at(robots.draws, i),
            )
            if ranges_m.shape[0] > 0:
                look_around(terrain, north_m, east_m, rules.reach_m, ranges_m)
            near = show_neighbours(around, robots, i, search_m)
            seen = _within(robots.rows, near, rules.range_m) if rules.range_m < search_m else near
            north_mps, east_mps = rule(
                own, robots.rows, seen, ranges_m, robots.state[i], robots.said[i], parameters
            )
            if not north_mps * north_mps + east_mps * east_mps < math.inf:
                flawed = i
                continue
            if seen < near:
                near = show_neighbours(around, robots, i, search_m)
            away_m = nearest_m(robots.rows, near)
            distances[NEAREST_PAIR_M] = min(distances[NEAREST_PAIR_M], away_m)
            if away_m < rules.avoidance_m:
                north_mps, east_mps = flee(robots.rows, near, rules.avoidance_m, rules.speed_mps)
            robots.wanted_north_mps[i], robots.wanted_east_mps[i] = permitted(
                terrain, rules, robots, i, near, north_mps, east_mps
            )
        return flawed

    def fly_tracing(
        air: RecordedAir,
        terrain: Terrain,
        sources: Sources,
        rules: Rules,
        shape: Shape,
        parameters: FloatArray,
        starts_m: FloatArray,
        seed: int,
        first: int,
        limit: int,
        counts: IntArray,
        distances: FloatArray,
        tracks: FloatArray,
        every: int,
    ) -> None:
        size = starts_m.shape[1]
        robots = new_robots(size, shape.state, shape.word)
        around = new_neighbourhood(size)
        sensors = Sensors(np.zeros(size), np.zeros(size, np.uint64))
        ranges_m = np.full(shape.beams, np.inf)
        wind_mps, origin_m = np.zeros(2), np.zeros(2)
        reached = np.zeros(sources.places_m.shape[1], np.int64)
        # Whom a vehicle could meet in a step must be seen too.
        search_m = max(
            rules.range_m, rules.avoidance_m, 2.0 * (rules.radius_m + rules.step_s * rules.speed_mps)
        )
        for trial in range(starts_m.shape[0]):
            _begin(robots, sensors, starts_m[trial], rules.loss_rate, seed, first + trial)
            origin_m[0], origin_m[1] = np.mean(starts_m[trial, :, 0]), np.mean(starts_m[trial, :, 1])
            reached[:] = 0
            tally, apart = counts[trial], distances[trial]
            _begin_tally(tally, apart)
            for step in range(limit):
                tally[STEPS] = step + 1
                going = _sense(air, rules, robots, sensors, sources, reached, step, tally, apart)
                if step % every == 0 and step // every < tracks.shape[0]:
                    _record(robots, tracks, step // every)
                if not going or (rules.until_arrival and tally[ARRIVAL] < NEVER):
                    break
                find_neighbours(around, robots, search_m)
                flawed = decide_all(
                    air,
                    terrain,
                    rules,
                    robots,
                    around,
                    search_m,
                    ranges_m,
                    wind_mps,
                    origin_m,
                    parameters,
                    step,
                    apart,
                )
                if flawed >= 0:
                    tally[FLAW] = flawed + 1
                    break
                _move(robots, terrain, rules)

    return compiled(fly_tracing)
