"""Trials of a lattice in recorded air: seven disks that fly to their places, and decide when all have got there."""

from __future__ import annotations

import math
from typing import NamedTuple

import msgspec
import numpy as np

from mission.geometry.formation import FloatArray, IntArray
from mission.strategies.lattice.lattice_rule import (
    CENTRE_E,
    CENTRE_N,
    DETECTION,
    FLUX,
    HIGH_E,
    HIGH_N,
    LATTICE_NUMBERS,
    LATTICE_STATE,
    LEAST_M,
    LOW_E,
    LOW_N,
    MOST_M,
    RADIUS_M,
    STEP_M,
    TRACER,
    WIDEN_M,
    lattice_begin,
    lattice_next,
)
from mission.strategies.tick_rule import EAST, NORTH
from simvehicle.compiled import compiled, kernel, leaf
from simvehicle.trials.randomness import DECISIONS, SENSOR, open_stream, uniform, uniform_at
from simvehicle.trials.ticks.arrays import BitArray, Robots, new_robots
from simvehicle.trials.tracing.flying import NEVER, Rules, permitted
from simvehicle.trials.tracing.swarm_flight import TracedScene, TracingVehicles, rules_of, start_problems
from simvehicle.trials.tracing.terrain import Terrain
from simvehicle.trials.trials_error import TrialsError
from simvehicle.world.compiled_recorded import sample_gas, sample_wind
from simvehicle.world.recorded_air import RecordedAir

VEHICLES = 7
# Columns of the counts: one row a trial.
CONTACT, FIRST_INSIDE, CONTAINED, INSIDE, WAYPOINTS, LATTICE_COUNTS = range(6)
"""CONTACT, FIRST_INSIDE: the first step in which anybody reads anything, the source is inside the ring (NEVER).
CONTAINED: steps in which it is. INSIDE: 1 where it is so at the end."""
# Columns of the distances.
END_M, CLOSEST_M, LATTICE_DISTANCES = range(3)
"""Of the centre to the source: at the end, at the least."""

_THERE_M = 0.01
"""Who is so near to its place has arrived."""
_STILL_M = 1e-3
"""When nobody moves farther in a step, nobody will: what stands in the way stays there."""
_PATIENCE = 4.0
"""Times the steps that the way would take without anything in it: then the lattice decides where it is."""


class Tracing(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How a lattice traces. Defaults: the fluxotaxis paper's, study 1."""

    tracer: int
    """Of `mission.strategies.lattice.lattice_rule`."""
    least_radius_m: float = 0.5
    most_radius_m: float = 3.75
    widen_m: float = 0.25
    """The paper's R0 is 0.5 m, and a factor of 15 is a greatest diameter of 7.5 m."""
    step_m: float = 1.0
    flux: float = 1e-6


class Seven(NamedTuple):
    """What changes besides the vehicles: scratch for the rule."""

    state: FloatArray
    gas: FloatArray
    wind_north_mps: FloatArray
    wind_east_mps: FloatArray
    goal_n: FloatArray
    goal_e: FloatArray


@leaf
def inside_ring(north_m: FloatArray, east_m: FloatArray, count: int, at_n: float, at_e: float) -> bool:
    """Whether a point is inside the polygon of vehicles 1 to `count` - 1 (W. R. Franklin's crossing test)."""
    inside = False
    before = count - 1
    for k in range(1, count):
        n0, e0 = north_m[before] - at_n, east_m[before] - at_e
        n1, e1 = north_m[k] - at_n, east_m[k] - at_e
        if (n0 > 0.0) != (n1 > 0.0) and e0 - n0 * (e1 - e0) / (n1 - n0) > 0.0:
            inside = not inside
        before = k
    return inside


@leaf
def _set_goals(seven: Seven, count: int) -> None:
    seven.goal_n[0], seven.goal_e[0] = seven.state[CENTRE_N], seven.state[CENTRE_E]
    for k in range(1, count):
        bearing_rad = 2.0 * math.pi * (k - 1) / (count - 1)
        seven.goal_n[k] = seven.state[CENTRE_N] + seven.state[RADIUS_M] * math.cos(bearing_rad)
        seven.goal_e[k] = seven.state[CENTRE_E] + seven.state[RADIUS_M] * math.sin(bearing_rad)


@kernel
def _sense_all(
    air: RecordedAir,
    rules: Rules,
    robots: Robots,
    seven: Seven,
    time_s: float,
    noise: BitArray,
    wind_mps: FloatArray,
) -> bool:
    """What everybody reads; whether that is contact."""
    some = False
    for k in range(seven.gas.shape[0]):
        gas = sample_gas(air, robots.north_m[k], robots.east_m[k], time_s)
        if rules.noise > 0.0:
            radius = math.sqrt(-2.0 * math.log(1.0 - uniform_at(noise, k)))
            gas += rules.noise * radius * math.cos(2.0 * math.pi * uniform_at(noise, k))
        seven.gas[k] = gas if gas > rules.detection else 0.0
        some = some or seven.gas[k] > 0.0
        sample_wind(air, robots.north_m[k], robots.east_m[k], time_s, wind_mps)
        seven.wind_north_mps[k], seven.wind_east_mps[k] = wind_mps[0], wind_mps[1]
    return some


@kernel
def _fly_step(terrain: Terrain, rules: Rules, robots: Robots, seven: Seven) -> tuple[float, float]:
    """Everybody goes a step to its place; the farthest way to go before it, the farthest that anybody moved."""
    count = seven.gas.shape[0]
    farthest2, moved2 = 0.0, 0.0
    for i in range(count):
        rows = 0
        for j in range(count):
            if j != i:
                robots.rows[rows, NORTH] = robots.north_m[j] - robots.north_m[i]
                robots.rows[rows, EAST] = robots.east_m[j] - robots.east_m[i]
                rows += 1
        away_n, away_e = seven.goal_n[i] - robots.north_m[i], seven.goal_e[i] - robots.east_m[i]
        farthest2 = max(farthest2, away_n * away_n + away_e * away_e)
        robots.wanted_north_mps[i], robots.wanted_east_mps[i] = permitted(
            terrain, rules, robots, i, rows, away_n / rules.step_s, away_e / rules.step_s
        )
    for i in range(count):
        north_m, east_m = rules.step_s * robots.wanted_north_mps[i], rules.step_s * robots.wanted_east_mps[i]
        robots.north_m[i] += north_m
        robots.east_m[i] += east_m
        moved2 = max(moved2, north_m * north_m + east_m * east_m)
    return math.sqrt(farthest2), math.sqrt(moved2)


@kernel
def _begin_trial(
    robots: Robots,
    seven: Seven,
    numbers: FloatArray,
    centre_m: FloatArray,
    noise: BitArray,
    draws: BitArray,
    seed: int,
    trial: int,
) -> None:
    open_stream(draws, seed, trial, DECISIONS)
    stream = np.zeros(1, np.uint64)
    for k in range(noise.shape[0]):
        open_stream(stream, seed, trial, SENSOR + k)
        noise[k] = stream[0]
    lattice_begin(seven.state, numbers, centre_m[0], centre_m[1], numbers[LEAST_M], uniform(draws))
    seven.state[CENTRE_N], seven.state[CENTRE_E] = centre_m[0], centre_m[1]
    _set_goals(seven, noise.shape[0])
    for k in range(noise.shape[0]):
        robots.north_m[k], robots.east_m[k] = seven.goal_n[k], seven.goal_e[k]


@compiled
def fly_lattices(
    air: RecordedAir,
    terrain: Terrain,
    source_m: FloatArray,
    rules: Rules,
    numbers: FloatArray,
    centres_m: FloatArray,
    begin_s: float,
    seed: int,
    first: int,
    limit: int,
    counts: IntArray,
    distances: FloatArray,
    tracks: FloatArray,
    every: int,
) -> None:
    """Fly trials `first`, `first` + 1, ...: one row of `centres_m`, `counts` and `distances` a trial.

    The first step is at `begin_s` of the air. `tracks` (samples, vehicles, 2) gets the places in every `every`-th
    step of the last trial.
    """
    robots = new_robots(VEHICLES, 0, 0)
    seven = Seven(
        np.zeros(LATTICE_STATE),
        np.zeros(VEHICLES),
        np.zeros(VEHICLES),
        np.zeros(VEHICLES),
        np.zeros(VEHICLES),
        np.zeros(VEHICLES),
    )
    noise, draws, wind_mps = np.zeros(VEHICLES, np.uint64), np.zeros(1, np.uint64), np.zeros(2)
    for row in range(centres_m.shape[0]):
        tally, apart_m = counts[row], distances[row]
        _begin_trial(robots, seven, numbers, centres_m[row], noise, draws, seed, first + row)
        tally[CONTACT], tally[FIRST_INSIDE], tally[CONTAINED], tally[WAYPOINTS] = NEVER, NEVER, 0, 0
        apart_m[CLOSEST_M] = np.inf
        due, waited = True, 0.0
        for step in range(limit):
            if due:
                if (
                    _sense_all(air, rules, robots, seven, begin_s + step * rules.step_s, noise, wind_mps)
                    and tally[CONTACT] == NEVER
                ):
                    tally[CONTACT] = step
                lattice_next(
                    seven.state,
                    numbers,
                    robots.north_m,
                    robots.east_m,
                    seven.gas,
                    seven.wind_north_mps,
                    seven.wind_east_mps,
                    VEHICLES,
                    uniform(draws),
                )
                _set_goals(seven, VEHICLES)
                tally[WAYPOINTS] += 1
                waited = 0.0
            if step % every == 0 and step // every < tracks.shape[0]:
                for k in range(VEHICLES):
                    tracks[step // every, k, 0] = robots.north_m[k]
                    tracks[step // every, k, 1] = robots.east_m[k]
            to_go_m, moved_m = _fly_step(terrain, rules, robots, seven)
            if waited == 0.0:
                waited = -_PATIENCE * math.ceil(to_go_m / (rules.step_s * rules.speed_mps))
            waited += 1.0
            # One step may have taken everybody there; a lattice that is to stay decides again in the next step.
            to_go_m -= rules.step_s * rules.speed_mps
            due = to_go_m < _THERE_M or moved_m < _STILL_M or waited >= 0.0
            away_n, away_e = robots.north_m[0] - source_m[0], robots.east_m[0] - source_m[1]
            apart_m[END_M] = math.sqrt(away_n * away_n + away_e * away_e)
            apart_m[CLOSEST_M] = min(apart_m[CLOSEST_M], apart_m[END_M])
            tally[INSIDE] = (
                1 if inside_ring(robots.north_m, robots.east_m, VEHICLES, source_m[0], source_m[1]) else 0
            )
            tally[CONTAINED] += tally[INSIDE]
            if tally[CONTAINED] == 1 and tally[INSIDE] == 1:
                tally[FIRST_INSIDE] = step


class LatticesFlown(NamedTuple):
    """The results of trials, a row each."""

    counts: IntArray
    """(trials, LATTICE_COUNTS)"""
    distances_m: FloatArray
    """(trials, LATTICE_DISTANCES)"""
    tracks_m: FloatArray
    """(samples, vehicles, 2) of the last trial."""


def lattice_numbers(place: TracedScene, vehicles: TracingVehicles, tracing: Tracing) -> FloatArray:
    """The rule's numbers: the lattice stays in the world with its vehicles."""
    numbers = np.zeros(LATTICE_NUMBERS)
    numbers[TRACER] = tracing.tracer
    numbers[LEAST_M], numbers[MOST_M] = tracing.least_radius_m, tracing.most_radius_m
    numbers[WIDEN_M], numbers[STEP_M] = tracing.widen_m, tracing.step_m
    numbers[DETECTION], numbers[FLUX] = 0.0, tracing.flux
    numbers[LOW_N] = numbers[LOW_E] = vehicles.radius_m
    numbers[HIGH_N], numbers[HIGH_E] = place.terrain.length_m - vehicles.radius_m
    return numbers


def fly_lattice_trials(
    place: TracedScene,
    vehicles: TracingVehicles,
    tracing: Tracing,
    centres_m: FloatArray,
    *,
    seed: int,
    first: int = 0,
    begin_s: float = 0.0,
    every: int = 0,
) -> LatticesFlown:
    """A trial for each row of `centres_m` (trials, 2), where the lattice begins with its least radius.

    Of the place's sources the first counts, where it is at time 0. `TrialsError`: a start that cannot be.
    """
    centres = np.ascontiguousarray(centres_m, np.float64)
    numbers = lattice_numbers(place, vehicles, tracing)
    ring = lattice_places(tracing.least_radius_m)
    for problem in (*vehicles.problems(), *start_problems(place, vehicles, centres[:, None] + ring)):
        raise TrialsError(problem)
    counts = np.zeros((len(centres), LATTICE_COUNTS), np.int64)
    distances = np.zeros((len(centres), LATTICE_DISTANCES))
    tracks = np.full(((vehicles.limit_steps - 1) // every + 1 if every else 0, VEHICLES, 2), np.nan)
    fly_lattices(
        place.air,
        place.terrain,
        place.sources.places_m[0, 0],
        rules_of(vehicles, np.inf),
        numbers,
        centres,
        begin_s,
        seed,
        first,
        vehicles.limit_steps,
        counts,
        distances,
        tracks,
        max(every, 1),
    )
    return LatticesFlown(counts, distances, tracks)


def lattice_places(radius_m: float) -> FloatArray:
    """(vehicles, 2) from the centre."""
    bearings_rad = 2.0 * np.pi * np.arange(VEHICLES - 1) / (VEHICLES - 1)
    ring = radius_m * np.column_stack([np.cos(bearings_rad), np.sin(bearings_rad)])
    return np.vstack([np.zeros((1, 2)), ring])
