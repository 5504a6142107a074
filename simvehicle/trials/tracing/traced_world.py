"""A plume with its wind and its obstacles, made once from its seed, and every trial that is flown in it.

Sources: the fluxotaxis paper's second study (D. V. Zarzhitsky, D. F. Spears, D. R. Thayer 2010, see
`mission.strategies.tracing.swarming`); what it leaves open (the wind's speed, the puffs' size and rate) are values
with which its plumes reach across its world. A world's strategies and swarms of all sizes fly in the very same air,
from the same places: the robots of a smaller swarm stand where the first of a larger one do.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple

import msgspec
import numpy as np
import pandas as pd

from mission.geometry.formation import FloatArray
from mission.geometry.frames import Geodetic
from mission.strategies.registry import checked, find
from simvehicle.compiled import engine_identity
from simvehicle.trials.tracing.flying import (
    ARRIVAL,
    CLOSEST_M,
    CONTACT,
    LOCALISATION,
    LOST,
    NEAREST_PAIR_M,
    NEVER,
    SOURCES,
    tracing_kernel,
)
from simvehicle.trials.tracing.swarm_flight import MOST_ROBOTS, Place, Vehicles, fly_trials, make_place
from simvehicle.trials.tracing.terrain import clearances_of
from simvehicle.trials.trials_error import TrialsError
from simvehicle.world.obstacles import Obstacles
from simvehicle.world.recorded_air import RecordedAir, record_air
from simvehicle.world.world_config import (
    FlatFilamentPlume,
    FlatFilamentSource,
    GridWindConfig,
    RectangularObstacle,
    WorldConfig,
)

Regime = Literal["laminar", "transitional", "turbulent"]
REGIMES: tuple[Regime, ...] = ("laminar", "transitional", "turbulent")
_SLOWEST_MPS, _FASTEST_MPS = 0.3, 0.8
"""Mean winds are drawn between these."""
_INNER = 0.15
"""A source keeps this share of the world's length from its edges."""
_SOURCE_CLEAR_M = 1.0
_OBSTACLE_GAP_M = 0.7
"""Between obstacles, and to the walls: a vehicle fits through."""
_LATTICE_M = 0.8
"""Between vehicles at the start: the paper's spacing."""
_TRIES = 10_000
# Streams of a world's chances.
_LAYOUT, _AIR, _START = range(3)
_NOWHERE = Geodetic(0.0, 0.0, 0.0)


class TracedWorld(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One world and what is flown in it. Worlds of one number and seed differ in nothing but their fields."""

    number: int
    regime: Regime = "transitional"
    obstacles: int = 0
    obstacle_m: float = 1.5
    """Sides of the obstacles, which are square."""
    obstacle_share: float = 0.0
    """Of the ground, as the paper rounds it: a name for tables."""
    strategies: tuple[str, ...] = ("casting", "chemotaxis", "anemotaxis", "fluxotaxis")
    robots: tuple[int, ...] = (7, 28, 70)
    condition: str = "plain"
    """What is special about it: a name for tables."""
    length_m: float = 91.4
    sources: int = 1
    source_mps: float = 0.0
    """A source's speed, in a direction of its own."""
    start_m: float = 60.0
    """Swarms start anywhere up to this far from the first source."""
    vehicles: Vehicles = Vehicles(range_m=1.0)
    puffs_per_step: float = 0.5
    frame_steps: int = 5
    """Steps for which the air is taken to stand still."""
    spacing_m: float = 0.5
    """Between the nodes at which the gas is recorded."""
    puff_life_s: float = 600.0
    """After which a puff, 44 m wide, is a tenth of what the paper's sensors notice."""
    head_start_s: float = 900.0
    """How long the sources have been at work when the trials begin."""

    def problems(self) -> list[str]:
        """What makes this world impossible, one clear sentence each."""
        found = list(self.vehicles.problems())
        for name in self.strategies:
            try:
                if find(name).ticks is None:
                    found.append(f"strategy {name} is no rule of ticks: it cannot trace a recorded plume")
            except ValueError as error:
                found.append(str(error))
        if self.regime not in REGIMES:
            found.append(f"no regime is called {self.regime!r}; there are {', '.join(REGIMES)}")
        found += [
            f"a swarm has 1 to {MOST_ROBOTS} robots, not {size}"
            for size in self.robots
            if not 1 <= size <= MOST_ROBOTS
        ]
        return found


class Air(NamedTuple):
    """A world that was made."""

    place: Place
    obstacles: Obstacles
    statistics: dict[str, float]


def fly_world(world: TracedWorld, seed: int, first: int, count: int) -> pd.DataFrame:
    """Trials `first` to `first` + `count` - 1 of every strategy and swarm size, one tidy row each.

    With a `count` of 0 the strategies are only compiled. `TrialsError` names what cannot be flown.
    """
    for problem in world.problems():
        raise TrialsError(problem)
    if count == 0:
        _compile(world)
        return pd.DataFrame()
    air = make_air(world, seed)
    frames = []
    most = max(world.robots)
    starts_m = np.stack(
        [start_places(world, air.place, seed, trial, most) for trial in range(first, first + count)]
    )
    for strategy in world.strategies:
        for robots in world.robots:
            flown = fly_trials(
                air.place,
                world.vehicles,
                strategy,
                starts_m[:, :robots],
                seed=_key(seed, world.number),
                first=first,
            )
            frames.append(
                _rows(world, seed, first, strategy, robots, starts_m, air, flown.counts, flown.distances_m)
            )
    return pd.concat(frames, ignore_index=True)


def code_of(world: TracedWorld) -> tuple[str, ...]:
    """Equal for worlds that need the same machine code."""
    return world.strategies


def kernels_of(world: TracedWorld) -> tuple[Callable[..., Any], ...]:
    """The compiled entries that fly trials of `world`. `ValueError` for a strategy that has no rule."""
    found = []
    for name in world.strategies:
        rule = find(name).ticks
        if rule is None:
            raise TrialsError(f"strategy {name} is no rule of ticks: it cannot trace a recorded plume")
        found.append(tracing_kernel(rule.rule))
    return tuple(found)


def engine_of(worlds: Sequence[TracedWorld]) -> str:
    """Equal where the rows of `worlds` are: rows that different code computed are never put together."""
    names = sorted({name for world in worlds for name in world.strategies})
    kernels = [kernel for name in names for kernel in kernels_of(_of_one(name))]
    defaults = [repr(checked(find(name), {})) for name in names]
    return engine_identity(*kernels, fly_world) + "-" + _digest(defaults)


def make_air(world: TracedWorld, seed: int) -> Air:
    """Wind, plume and obstacles of a world, the same for equal worlds and seeds."""
    rng = np.random.default_rng([seed, world.number, _LAYOUT])
    speed_mps = float(rng.uniform(_SLOWEST_MPS, _FASTEST_MPS))
    from_deg = float(rng.uniform(0.0, 360.0))
    sources_m = _source_places(world, rng)
    headings_rad = rng.uniform(0.0, 2.0 * math.pi, world.sources)
    moving_mps = world.source_mps * np.column_stack([np.cos(headings_rad), np.sin(headings_rad)])
    obstacles = _obstacles(world, rng, sources_m, moving_mps)
    vehicles = world.vehicles
    config = WorldConfig(
        origin=_NOWHERE,
        wind=GridWindConfig(
            speed_mps=speed_mps,
            from_deg=from_deg,
            centre_north_m=0.5 * world.length_m,
            centre_east_m=0.5 * world.length_m,
            length_m=world.length_m,
            regime=world.regime,
        ),
        plume=FlatFilamentPlume(
            sources=tuple(
                FlatFilamentSource(
                    north_m=north_m,
                    east_m=east_m,
                    moving_north_mps=moving_north_mps,
                    moving_east_mps=moving_east_mps,
                )
                for (north_m, east_m), (moving_north_mps, moving_east_mps) in zip(
                    (sources_m - world.head_start_s * moving_mps).tolist(), moving_mps.tolist(), strict=True
                )
            ),
            puffs_per_s=world.puffs_per_step / vehicles.step_s,
            lifetime_s=world.puff_life_s,
            reach_m=world.length_m,
            step_s=vehicles.step_s,
        ),
        obstacles=tuple(obstacles),
    )
    duration_s = vehicles.limit_steps * vehicles.step_s
    frame_s = world.frame_steps * vehicles.step_s
    air = record_air(
        config,
        int(np.random.default_rng([seed, world.number, _AIR]).integers(2**31)),
        duration_s,
        frame_s,
        world.spacing_m,
        begin_s=world.head_start_s,
    )
    standing = Obstacles(obstacles)
    moments = (
        np.arange(0.0, duration_s, frame_s)[:, None, None] if world.source_mps > 0.0 else np.zeros((1, 1, 1))
    )
    places_m = sources_m + moments * moving_mps
    return Air(
        make_place(air, places_m, standing, frame_s), standing, plume_statistics(air, vehicles.detection)
    )


def start_places(world: TracedWorld, place: Place, seed: int, trial: int, robots: int) -> FloatArray:
    """(robots, 2) a lattice about a place up to `start_m` from the first source; who would stand in something is left
    out, and the lattice goes on."""
    rng = np.random.default_rng([seed, world.number, _START, trial])
    source_m = place.sources.places_m[0, 0]
    length_m = world.length_m
    sites = _lattice(robots + 4 * (world.obstacles + 1) + robots)
    radius_m = world.vehicles.radius_m
    for _ in range(_TRIES):
        away_m, bearing_rad = world.start_m * rng.random(), 2.0 * math.pi * rng.random()
        centre = source_m + away_m * np.array([math.cos(bearing_rad), math.sin(bearing_rad)])
        if not np.all((centre > 1.0) & (centre < length_m - 1.0)):
            continue
        places = centre + sites
        inside = np.all((places > radius_m) & (places < length_m - radius_m), axis=1)
        free = places[inside & (clearances_of(place.terrain, places) > radius_m)]
        if len(free) >= robots:
            return free[:robots]
    raise TrialsError(
        f"world {world.number}: no room for {robots} robots within {world.start_m:g} m of the source"
    )


def plume_statistics(air: RecordedAir, detection: float) -> dict[str, float]:
    """Of what a sensor that does not move would read where the plume is at all, in the middle of the plume's places.

    `intermittency`: the share of the time without gas. `peak_to_mean`: the 99th percentile over the mean, in time.
    `plume_share`: the share of the ground that ever has gas. `meander`: how far the plume's middle goes about,
    the deviation of its centre of mass over its mean width.
    """
    gas = air.gas[::5]
    coarse = np.ascontiguousarray(gas[:, ::4, ::4], np.float64)
    mean = coarse.mean(axis=0)
    plume = mean > max(detection, 0.0)
    if not plume.any():
        return {"intermittency": 1.0, "peak_to_mean": math.nan, "plume_share": 0.0, "meander": math.nan}
    there = coarse[:, plume]
    peaks = np.percentile(there, 99.0, axis=0) / mean[plume]
    whole = coarse.sum(axis=(1, 2))
    norths, easts = np.arange(coarse.shape[1]), np.arange(coarse.shape[2])
    some = whole > 0.0
    centres = np.column_stack(
        [
            (coarse.sum(axis=2)[some] @ norths) / whole[some],
            (coarse.sum(axis=1)[some] @ easts) / whole[some],
        ]
    )
    spread = math.sqrt(float(plume.sum()) / math.pi)
    return {
        "intermittency": float(np.median((there <= detection).mean(axis=0))),
        "peak_to_mean": float(np.median(peaks)),
        "plume_share": float((coarse.max(axis=0) > detection).mean()),
        "meander": float(np.linalg.norm(centres.std(axis=0)) / spread),
    }


# -- what a world is made of --------------------------------------------------------------------------------


def _source_places(world: TracedWorld, rng: np.random.Generator) -> FloatArray:
    low_m, high_m = _INNER * world.length_m, (1.0 - _INNER) * world.length_m
    return np.asarray(rng.uniform(low_m, high_m, (world.sources, 2)))


def _obstacles(
    world: TracedWorld, rng: np.random.Generator, sources_m: FloatArray, moving_mps: FloatArray
) -> list[RectangularObstacle]:
    """Squares at random, apart from each other, from the walls and from where the sources go."""
    half_m = 0.5 * world.obstacle_m
    low_m, high_m = half_m + _OBSTACLE_GAP_M, world.length_m - half_m - _OBSTACLE_GAP_M
    duration_s = world.vehicles.limit_steps * world.vehicles.step_s
    ways_m = np.concatenate([sources_m + moving_mps * t for t in np.linspace(0.0, duration_s, 50)])
    found: list[FloatArray] = []
    for _ in range(_TRIES):
        if len(found) == world.obstacles:
            break
        at = rng.uniform(low_m, high_m, 2)
        apart = all(np.abs(at - other).max() > world.obstacle_m + _OBSTACLE_GAP_M for other in found)
        if apart and np.abs(at - ways_m).max(axis=1).min() > half_m + _SOURCE_CLEAR_M:
            found.append(at)
    else:
        raise TrialsError(
            f"world {world.number}: no room for {world.obstacles} obstacles of {world.obstacle_m:g} m"
        )
    return [
        RectangularObstacle(
            centre_north_m=float(at[0]),
            centre_east_m=float(at[1]),
            length_north_m=world.obstacle_m,
            length_east_m=world.obstacle_m,
        )
        for at in found
    ]


@functools.cache
def _lattice(sites: int) -> FloatArray:
    """(sites, 2) of a hexagonal lattice, the nearest to its middle first."""
    reach = math.ceil(math.sqrt(sites)) + 1
    along, across = np.meshgrid(np.arange(-reach, reach + 1), np.arange(-reach, reach + 1))
    places = _LATTICE_M * np.column_stack(
        [(along + 0.5 * (across % 2)).ravel(), math.sqrt(0.75) * across.ravel()]
    )
    return np.asarray(places[np.argsort(np.round((places**2).sum(axis=1), 6), kind="stable")][:sites])


# -- rows ---------------------------------------------------------------------------------------------------


def _rows(
    world: TracedWorld,
    seed: int,
    first: int,
    strategy: str,
    robots: int,
    starts_m: FloatArray,
    air: Air,
    counts: np.ndarray,
    distances_m: FloatArray,
) -> pd.DataFrame:
    trials = len(counts)
    source_m = air.place.sources.places_m[0, 0]

    def steps(column: int) -> FloatArray:
        return np.where(counts[:, column] < NEVER, counts[:, column].astype(np.float64), np.nan)

    return pd.DataFrame(
        {
            "strategy": strategy,
            "robots": robots,
            "regime": world.regime,
            "condition": world.condition,
            "obstacle_share": world.obstacle_share,
            "world": world.number,
            "seed": seed,
            "trial": np.arange(first, first + trials),
            "start_m": np.linalg.norm(starts_m[:, 0] - source_m, axis=1),
            "success": counts[:, ARRIVAL] < NEVER,
            "arrival_steps": steps(ARRIVAL),
            "contact_steps": steps(CONTACT),
            "limit_steps": world.vehicles.limit_steps,
            "localisation": counts[:, LOCALISATION],
            "sources_found": counts[:, SOURCES],
            "lost": counts[:, LOST],
            "closest_m": distances_m[:, CLOSEST_M],
            "nearest_pair_m": distances_m[:, NEAREST_PAIR_M],
            **air.statistics,
        }
    )


def _compile(world: TracedWorld) -> None:
    """Fly one step of every strategy in still, clean air."""
    nothing = RecordedAir(
        np.zeros((1, 2, 2), np.float32),
        np.zeros((1, 2, 2, 2), np.float32),
        np.zeros((2, 2), np.bool_),
        np.zeros(2),
        world.length_m,
        np.zeros(2),
        world.length_m,
        1.0,
        np.full(2, world.length_m),
    )
    middle_m = 0.5 * world.length_m
    place = make_place(nothing, np.full((1, 2), middle_m))
    short = msgspec.structs.replace(world.vehicles, limit_steps=1)
    for strategy in world.strategies:
        fly_trials(place, short, strategy, np.full((1, 1, 2), middle_m), seed=0)


def _of_one(strategy: str) -> TracedWorld:
    return TracedWorld(number=0, strategies=(strategy,))


def _key(seed: int, number: int) -> int:
    """Seed of the vehicles' own chances in a world."""
    return int(np.random.SeedSequence([seed, number]).generate_state(1, np.uint64)[0] >> np.uint64(1))


def _digest(parts: Sequence[str]) -> str:
    import hashlib

    return hashlib.sha256("|".join(parts).encode()).hexdigest()[:8]
