"""A plume with its wind and its obstacles, made once from its seed, and every trial that is flown in it.

Sources: the fluxotaxis paper's second study (D. V. Zarzhitsky, D. F. Spears, D. R. Thayer 2010, see
`mission.strategies.tracing.swarming`); what it leaves open (the wind's speed, the puffs' size and rate) are values
with which its plumes reach across its world. A world's strategies and swarms of all sizes fly in the very same air,
from the same places: the robots of a smaller swarm stand where the first of a larger one do.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple

import msgspec
import numpy as np
import pandas as pd

from mission.geometry.formation import FloatArray
from mission.geometry.frames import Geodetic
from mission.strategies.registry import checked, find
from simvehicle.compiled import engine_identity
from simvehicle.trials.tracing.air_statistics import plume_statistics
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
from simvehicle.trials.tracing.swarm_flight import (
    MOST_ROBOTS,
    TracedScene,
    TracingVehicles,
    fly_trials,
    make_place,
)
from simvehicle.trials.tracing.world_layout import (
    lattice_start,
    source_places,
    source_velocities,
    square_obstacles,
)
from simvehicle.trials.trials_error import TrialsError
from simvehicle.world.obstacles import Obstacles
from simvehicle.world.recorded_air import AirRecordingError, RecordedAir, record_air
from simvehicle.world.world_config import (
    FlatFilamentPlume,
    FlatFilamentSource,
    GridWindConfig,
    WorldConfig,
)

Regime = Literal["laminar", "transitional", "turbulent"]
REGIMES: tuple[Regime, ...] = ("laminar", "transitional", "turbulent")
_SLOWEST_MPS, _FASTEST_MPS = 0.3, 0.8
"""Mean winds are drawn between these."""
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
    parameters: tuple[tuple[str, str, float], ...] = ()
    """(strategy, name, value) of what differs from a strategy's own defaults."""
    robots: tuple[int, ...] = (7, 28, 70)
    condition: str = "plain"
    """What is special about it: a name for tables."""
    length_m: float = 91.4
    sources: int = 1
    source_mps: float = 0.0
    """A source's speed, in a direction of its own."""
    start_m: float = 60.0
    """Swarms start anywhere up to this far from the first source."""
    vehicles: TracingVehicles = TracingVehicles(range_m=1.0)
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
                entry = find(name)
                if entry.ticks is None:
                    found.append(f"strategy {name} is no rule of ticks: it cannot trace a recorded plume")
                else:
                    checked(entry, self.parameters_of(name))
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

    def parameters_of(self, strategy: str) -> dict[str, float]:
        """What `parameters` says of a strategy."""
        return {name: value for owner, name, value in self.parameters if owner == strategy}


class TracedAir(NamedTuple):
    """A world that was made."""

    place: TracedScene
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
    try:
        air = make_air(world, seed)
    except AirRecordingError as error:
        raise TrialsError(f"world {world.number}: {error}") from error
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
                parameters=world.parameters_of(strategy),
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


def make_air(world: TracedWorld, seed: int) -> TracedAir:
    """Wind, plume and obstacles of a world, the same for equal worlds and seeds."""
    rng = np.random.default_rng([seed, world.number, _LAYOUT])
    speed_mps = float(rng.uniform(_SLOWEST_MPS, _FASTEST_MPS))
    from_deg = float(rng.uniform(0.0, 360.0))
    sources_m = source_places(world.length_m, world.sources, rng)
    moving_mps = source_velocities(world.length_m, sources_m, world.source_mps, rng)
    vehicles = world.vehicles
    duration_s = vehicles.limit_steps * vehicles.step_s
    ways_m = np.concatenate([sources_m + moving_mps * time_s for time_s in np.linspace(0.0, duration_s, 50)])
    obstacles = square_obstacles(world.length_m, world.obstacles, world.obstacle_m, ways_m, rng)
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
    return TracedAir(
        make_place(air, places_m, standing, frame_s), standing, plume_statistics(air, vehicles.detection)
    )


def start_places(world: TracedWorld, place: TracedScene, seed: int, trial: int, robots: int) -> FloatArray:
    """(robots, 2) where a swarm starts, the same for every strategy; of fewer robots it is the first of them."""
    rng = np.random.default_rng([seed, world.number, _START, trial])
    source_m = place.sources.places_m[0, 0]
    return lattice_start(place.terrain, source_m, world.start_m, robots, world.vehicles.radius_m, rng)


def _rows(
    world: TracedWorld,
    seed: int,
    first: int,
    strategy: str,
    robots: int,
    starts_m: FloatArray,
    air: TracedAir,
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
