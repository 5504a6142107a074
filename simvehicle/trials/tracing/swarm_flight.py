"""From a strategy, a recorded air and starting places to the results of trials."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import msgspec
import numba.core.errors
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mission.geometry.formation import FloatArray, IntArray
from mission.strategies.registry import checked, find
from mission.strategies.tick_rule import TickRule, numbers
from simvehicle.trials.ticks.compiling import not_compiled
from simvehicle.trials.tracing.flying import (
    COUNTS,
    DISTANCES,
    FLAW,
    NEVER,
    STEPS,
    Rules,
    Shape,
    Sources,
    tracing_kernel,
)
from simvehicle.trials.tracing.terrain import Prisms, Terrain, clearances_of, make_terrain
from simvehicle.trials.trials_error import TrialsError
from simvehicle.world.recorded_air import RecordedAir

MOST_ROBOTS = 1000


class TracingVehicles(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The disks that fly, their sensors, and how long. Defaults: the fluxotaxis paper's, study 2."""

    step_s: float = 1.2
    speed_mps: float = 0.1
    radius_m: float = 0.15
    avoidance_m: float = 0.35
    """Nearer to another than this a vehicle flees, whatever its rule wants."""
    arrival_m: float = 1.0
    """A vehicle this near to a source has arrived (the paper's R_s)."""
    limit_steps: int = 7000
    until_arrival: bool = False
    """Whether a trial ends with the first arrival, not at the limit (or when all members are lost)."""
    range_m: float | None = None
    """How far away others are seen and heard at most; None: as far as the rule can use."""
    reach_m: float = 1.0
    """Of range sensors, for rules with beams."""
    detection: float = 1e-5
    """Readings up to this are none, in the plume's unit."""
    lag_s: float = 0.0
    """Time constant of the gas sensor."""
    noise: float = 0.0
    """Standard deviation of each reading, in the plume's unit."""
    loss_rate: float = 0.0
    """Probability a member and step that it fails and is gone."""

    def problems(self) -> list[str]:
        """What makes this impossible, one clear sentence each."""
        found = [
            f"{name} must be above 0, not {getattr(self, name):g}"
            for name in ("step_s", "speed_mps", "radius_m", "arrival_m", "reach_m")
            if not 0.0 < getattr(self, name) < np.inf
        ]
        found += [
            f"{name} must not be below 0, but is {getattr(self, name):g}"
            for name in ("avoidance_m", "detection", "lag_s", "noise")
            if not 0.0 <= getattr(self, name) < np.inf
        ]
        if self.range_m is not None and not self.range_m > 0.0:
            found.append(f"range_m must be above 0, not {self.range_m:g}")
        if not 0.0 <= self.loss_rate <= 1.0:
            found.append(f"loss_rate is a probability from 0 to 1, not {self.loss_rate:g}")
        if self.limit_steps < 1:
            found.append(f"a trial needs at least 1 step, not {self.limit_steps}")
        if not found and self.step_s * self.speed_mps > 2.0 * self.radius_m:
            found.append(
                f"a step of {self.step_s:g} s at {self.speed_mps:g} m/s is longer than a vehicle, which could pass "
                f"through a corner unseen; take at most {2.0 * self.radius_m / self.speed_mps:.3g} s"
            )
        return found


class TracedScene(msgspec.Struct, frozen=True):
    """Where trials are flown."""

    air: RecordedAir
    terrain: Terrain
    sources: Sources


class TracedFlights(NamedTuple):
    """The results of trials, a row each."""

    counts: IntArray
    """(trials, COUNTS), see `flying`; NEVER where a step never came."""
    distances_m: FloatArray
    """(trials, DISTANCES)"""
    tracks_m: FloatArray
    """(samples, robots, 2) of the last trial; NaN after a robot's failure and the trial's end."""
    parameters: FloatArray


def make_place(
    air: RecordedAir,
    sources_m: NDArray[np.float64],
    obstacles: Prisms | None = None,
    every_s: float | None = None,
) -> TracedScene:
    """`sources_m`: (sources, 2) north and east, or (moments, sources, 2) of which each holds `every_s`.

    `ValueError`: a source outside the world or inside an obstacle.
    """
    terrain = make_terrain(air.length_m, obstacles)
    places = np.ascontiguousarray(sources_m, np.float64)
    places = places[None] if places.ndim == 2 else places
    for source in places.reshape(-1, 2):
        if not (0.0 <= source[0] <= air.length_m[0] and 0.0 <= source[1] <= air.length_m[1]):
            raise ValueError(
                f"the source at ({source[0]:g}, {source[1]:g}) m is outside the world of {air.length_m[0]:g} x "
                f"{air.length_m[1]:g} m"
            )
    for number in np.flatnonzero(clearances_of(terrain, places.reshape(-1, 2)) < 0.0):
        source = places.reshape(-1, 2)[number]
        raise ValueError(f"the source at ({source[0]:g}, {source[1]:g}) m is inside an obstacle")
    return TracedScene(air, terrain, Sources(places, np.inf if every_s is None else every_s))


def fly_trials(
    place: TracedScene,
    vehicles: TracingVehicles,
    strategy: str,
    starts_m: FloatArray,
    *,
    seed: int,
    first: int = 0,
    parameters: Mapping[str, float] | None = None,
    every: int = 0,
) -> TracedFlights:
    """Fly a trial for each row of `starts_m` (trials, robots, 2); with `every`, the last one's tracks at such steps.

    Trial `first` + k draws the same losses and sensor noise whatever the strategy. `TrialsError` names what is wrong
    with strategy, parameters, vehicles or starts; the same for a rule that gives what is no velocity.
    """
    entry = find(strategy)
    if entry.ticks is None:
        raise TrialsError(f"strategy {strategy} is no rule of ticks: it cannot trace a recorded plume")
    struct = checked(entry, dict(parameters or {}))
    return fly_rule(place, vehicles, entry.ticks, starts_m, strategy, numbers(struct), seed, first, every)


def fly_rule(
    place: TracedScene,
    vehicles: TracingVehicles,
    rule: TickRule,
    starts_m: FloatArray,
    name: str,
    parameters: FloatArray,
    seed: int,
    first: int,
    every: int,
) -> TracedFlights:
    """`fly_trials` for a rule that has no name in the registry."""
    starts = np.ascontiguousarray(starts_m, np.float64)
    for problem in (*vehicles.problems(), *start_problems(place, vehicles, starts)):
        raise TrialsError(problem)
    trials, robots, _ = starts.shape
    counts = np.zeros((trials, COUNTS), np.int64)
    distances = np.zeros((trials, DISTANCES))
    samples = (vehicles.limit_steps - 1) // every + 1 if every else 0
    tracks = np.full((samples, robots, 2), np.nan)
    try:
        tracing_kernel(rule.rule)(
            place.air,
            place.terrain,
            place.sources,
            rules_of(vehicles, rule.range_m),
            Shape(rule.state_size, rule.word_size, rule.beams),
            parameters,
            starts,
            seed,
            first,
            vehicles.limit_steps,
            counts,
            distances,
            tracks,
            max(every, 1),
        )
    except numba.core.errors.NumbaError as error:
        raise TrialsError(not_compiled(name, rule, error)) from error
    for row in np.flatnonzero(counts[:, FLAW]):
        raise TrialsError(
            f"strategy {name}: its rule gave what is no velocity to robot {counts[row, FLAW] - 1} in step "
            f"{counts[row, STEPS] - 1} of trial {first + row}, seed {seed}"
        )
    return TracedFlights(counts, distances, tracks, parameters)


def start_problems(place: TracedScene, vehicles: TracingVehicles, starts_m: FloatArray) -> list[str]:
    """What is wrong with starting places (trials, robots, 2)."""
    if starts_m.ndim != 3 or starts_m.shape[2] != 2 or not 1 <= starts_m.shape[1] <= MOST_ROBOTS:
        return [f"starting places are (trials, 1 to {MOST_ROBOTS} robots, 2), not {starts_m.shape}"]
    radius_m, length_m = vehicles.radius_m, place.terrain.length_m
    flat = starts_m.reshape(-1, 2)
    if not np.all((flat >= radius_m) & (flat <= length_m - radius_m)):
        return ["a vehicle would start outside the world, or in its wall"]
    if np.any(clearances_of(place.terrain, flat) < radius_m):
        return ["a vehicle would start in an obstacle"]
    for number, places in enumerate(starts_m):
        if len(places) > 1 and cKDTree(places).query(places, 2)[0][:, 1].min() < 2.0 * radius_m:
            return [f"two vehicles of trial {number} would start in each other"]
    return []


def seconds(steps: IntArray, vehicles: TracingVehicles) -> FloatArray:
    """Steps as seconds, NaN for NEVER."""
    return np.where(steps < NEVER, steps * vehicles.step_s, np.nan)


def rules_of(vehicles: TracingVehicles, range_m: float) -> Rules:
    return Rules(
        float(vehicles.step_s),
        float(vehicles.speed_mps),
        float(vehicles.radius_m),
        float(vehicles.avoidance_m),
        float(vehicles.arrival_m),
        min(float(range_m), np.inf if vehicles.range_m is None else vehicles.range_m),
        float(vehicles.reach_m),
        float(vehicles.detection),
        float(vehicles.lag_s),
        float(vehicles.noise),
        float(vehicles.loss_rate),
        bool(vehicles.until_arrival),
    )
