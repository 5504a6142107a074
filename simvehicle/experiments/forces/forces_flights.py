"""Every trial that is flown in one world of the virtual-force paper: variants, swarm sizes, emissions, all paired."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import msgspec
import numpy as np
import pandas as pd

from mission.geometry.formation import FloatArray
from mission.strategies.registry import checked, find
from mission.strategies.tick_rule import TickRule
from simvehicle.compiled import engine_identity
from simvehicle.experiments.forces.forces_arena import (
    ARENAS,
    Arena,
    ForcesWorld,
    make_place_of,
    obstacle_share,
    start_places,
)
from simvehicle.trials.tracing.air_statistics import plume_statistics
from simvehicle.trials.tracing.flying import (
    ARRIVAL,
    ARRIVED,
    CLOSEST_M,
    CONTACT,
    LOCALISATION,
    NEAREST_PAIR_M,
    NEVER,
    tracing_kernel,
)
from simvehicle.trials.tracing.swarm_flight import TracedScene, fly_trials, make_place
from simvehicle.world.recorded_air import RecordedAir

TRACKER = "virtual-forces"
VARIANTS: dict[str, str] = {
    TRACKER: "virtual-forces",
    "no-cohesion": "virtual-forces",
    "upwind": "upwind",
}
"""Variant -> strategy: the paper's, the same without attraction, the baseline."""
_EVERY = 10
"""Steps between the places of robots that are looked at."""


def fly_world(world: ForcesWorld, seed: int, first: int, count: int) -> pd.DataFrame:
    """Trials `first` to `first` + `count` - 1 of all that is flown in a world, one tidy row each.

    With a `count` of 0 the rules are only compiled.
    """
    if count == 0:
        _compile(world)
        return pd.DataFrame()
    place = make_place_of(world, seed)
    arena = ARENAS[world.arena]
    frames = []
    starts = [
        start_places(world, place, seed, trial, max(world.robots)) for trial in range(first, first + count)
    ]
    for emission_gps in world.emissions_gps:
        stronger = msgspec.structs.replace(
            place, air=place.air._replace(gas=place.air.gas * np.float32(emission_gps))
        )
        level = max(arena.forces.clean_air, arena.vehicles.detection)
        statistics = plume_statistics(stronger.air, level)
        middle = emission_gps == sorted(world.emissions_gps)[len(world.emissions_gps) // 2]
        for variant in world.variants:
            if variant != TRACKER and not middle:
                continue
            for robots in world.robots:
                rows = _fly(world, arena, stronger, variant, [s[:robots] for s in starts], seed, first)
                frames.append(
                    rows.assign(emission_gps=emission_gps, obstacle_share=obstacle_share(place), **statistics)
                )
    return pd.concat(frames, ignore_index=True)


def _fly(
    world: ForcesWorld,
    arena: Arena,
    place: TracedScene,
    variant: str,
    starts: Sequence[FloatArray],
    seed: int,
    first: int,
) -> pd.DataFrame:
    found = []
    vehicles = arena.vehicles
    for number, start in enumerate(starts):
        flown = fly_trials(
            place,
            vehicles,
            VARIANTS[variant],
            start[None],
            seed=seed,
            first=100 * world.number + first + number,
            parameters=parameters_of(arena, variant),
            every=_EVERY,
        )
        counts, distances_m = flown.counts[0], flown.distances_m[0]
        arrived = counts[ARRIVAL] < NEVER
        found.append(
            {
                "strategy": variant,
                "robots": len(start),
                "regime": world.arena,
                "obstacles": world.obstacles,
                "world": world.number,
                "seed": seed,
                "trial": first + number,
                "success": bool(arrived),
                "arrival_steps": float(counts[ARRIVAL]) if arrived else np.nan,
                "contact_steps": float(counts[CONTACT]) if counts[CONTACT] < NEVER else np.nan,
                "limit_steps": vehicles.limit_steps,
                "step_s": vehicles.step_s,
                "localisation": int(counts[LOCALISATION]),
                "closest_m": float(distances_m[CLOSEST_M]),
                "nearest_pair_m": float(distances_m[NEAREST_PAIR_M]) if len(start) > 1 else np.nan,
                "followers": _followers(flown.tracks_m, int(counts[ARRIVED]), arena.forces.range_m),
            }
        )
    return pd.DataFrame(found)


def _followers(tracks_m: FloatArray, arrived: int, range_m: float) -> float:
    """The share of the others that are within hearing of the first to arrive when it does; NaN where none does."""
    if arrived < 0 or tracks_m.shape[1] < 2:
        return float("nan")
    last = tracks_m[np.isfinite(tracks_m[:, :, 0]).all(axis=1)][-1]
    away_m = np.linalg.norm(last - last[arrived], axis=1)
    return float((np.delete(away_m, arrived) <= range_m).mean())


def parameters_of(arena: Arena, variant: str) -> dict[str, float]:
    """Those of the arena that the variant's strategy has."""
    values = msgspec.structs.asdict(arena.forces)
    if variant == "no-cohesion":
        values["attraction_m3ps"] = 0.0
    return {name: values[name] for name in find(VARIANTS[variant]).parameters.__struct_fields__}


def code_of(world: ForcesWorld) -> tuple[str, ...]:
    """Equal for worlds that need the same machine code."""
    return tuple(sorted({VARIANTS[variant] for variant in world.variants}))


def kernels_of(world: ForcesWorld) -> tuple[Callable[..., Any], ...]:
    """The compiled entries that fly trials of `world`."""
    return tuple(tracing_kernel(_rule(strategy).rule) for strategy in code_of(world))


def engine_of(worlds: Sequence[ForcesWorld]) -> str:
    """Equal where the rows of `worlds` are: rows that different code computed are never put together."""
    strategies = sorted({strategy for world in worlds for strategy in code_of(world)})
    return engine_identity(*(tracing_kernel(_rule(strategy).rule) for strategy in strategies), fly_world)


@functools.cache
def _rule(strategy: str) -> TickRule:
    rule = find(strategy).ticks
    if rule is None:
        raise ValueError(f"strategy {strategy} is not flown tick by tick")
    return rule


def _compile(world: ForcesWorld) -> None:
    """Fly one step of every rule in still, clean air."""
    arena = ARENAS[world.arena]
    length_m = np.array([arena.north_m, arena.east_m])
    air = RecordedAir(
        np.zeros((1, 2, 2), np.float32),
        np.zeros((1, 2, 2, 2), np.float32),
        np.zeros((2, 2), np.bool_),
        np.zeros(2),
        arena.east_m,
        np.zeros(2),
        arena.east_m,
        1.0,
        length_m,
    )
    place = make_place(air, np.array([arena.source_m]))
    short = msgspec.structs.replace(arena.vehicles, limit_steps=1)
    for variant in world.variants:
        checked(find(VARIANTS[variant]), dict(parameters_of(arena, variant)))
        fly_trials(place, short, VARIANTS[variant], 0.5 * length_m[None, None], seed=0)
