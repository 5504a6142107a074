"""Every trial of a lattice that is flown in one world: tracers and greatest radii, all from the same starts.

Source: the fluxotaxis paper (Zarzhitsky, Spears, Thayer 2010), section 5; worlds are those of the second study
(`simvehicle.trials.tracing.traced_world`), a ninth of their size.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Literal

import msgspec
import numpy as np
import pandas as pd

from mission.geometry.formation import FloatArray
from mission.strategies.lattice.lattice_rule import ANEMOTAXIS, CAST, CHEMOTAXIS, FLUXOTAXIS
from simvehicle.compiled import engine_identity
from simvehicle.trials.tracing.flying import NEVER
from simvehicle.trials.tracing.lattice_flying import (
    CLOSEST_M,
    CONTACT,
    CONTAINED,
    END_M,
    FIRST_INSIDE,
    INSIDE,
    VEHICLES,
    Tracing,
    fly_lattice_trials,
    fly_lattices,
    lattice_places,
)
from simvehicle.trials.tracing.swarm_flight import TracedScene, TracingVehicles, make_place
from simvehicle.trials.tracing.terrain import clearances_of
from simvehicle.trials.tracing.traced_world import Regime, TracedWorld, make_air
from simvehicle.trials.trials_error import TrialsError
from simvehicle.world.recorded_air import RecordedAir

TRACERS: dict[str, int] = {
    "fluxotaxis": FLUXOTAXIS,
    "chemotaxis": CHEMOTAXIS,
    "anemotaxis": ANEMOTAXIS,
    "casting": CAST,
}
PuffKind = Literal["dense", "sparse"]
PUFFS_PER_STEP: dict[PuffKind, float] = {"dense": 6.0, "sparse": 0.5}
LENGTH_M = 30.5
"""Of the world's sides: the paper's 930 m2."""
FACTOR_M = 0.25
"""Of radius an expansion factor: 15 is the paper's greatest diameter of 7.5 m. The least radius is 0.5 m."""
_TRIES = 10_000
_CENTRE = 3
"""Stream of a world's chances, beside those of `traced_world`."""


class LatticeWorld(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One world and what is flown in it. Worlds of one number and seed differ in nothing but their fields."""

    number: int
    regime: Regime
    plume: PuffKind
    obstacles: int = 0
    obstacle_m: float = 1.5
    obstacle_share: float = 0.0
    """Of the ground, as the paper rounds it."""
    tracers: tuple[str, ...]
    factors: tuple[int, ...]
    """Greatest radii, in FACTOR_M."""
    start_m: float | None
    """Lattices start up to so far from the source; None: anywhere."""
    head_start_s: float
    limit_steps: int


def fly_world(world: LatticeWorld, seed: int, first: int, count: int) -> pd.DataFrame:
    """Trials `first` to `first` + `count` - 1 of all that is flown in a world, one tidy row each.

    With a `count` of 0 the kernel is only compiled.
    """
    if count == 0:
        _compile()
        return pd.DataFrame()
    vehicles = TracingVehicles(limit_steps=world.limit_steps)
    air = make_air(_traced(world, vehicles), seed)
    source_m = air.place.sources.places_m[0, 0]
    centres_m = np.array([_centre(world, air.place, seed, trial) for trial in range(first, first + count)])
    frames = []
    for tracer in world.tracers:
        for factor in world.factors:
            flown = fly_lattice_trials(
                air.place,
                vehicles,
                Tracing(tracer=TRACERS[tracer], most_radius_m=FACTOR_M * factor),
                centres_m,
                seed=seed,
                first=1000 * world.number + first,
            )
            counts, distances_m = flown.counts, flown.distances_m

            def steps(column: int, counts: np.ndarray = counts) -> FloatArray:
                return np.where(counts[:, column] < NEVER, counts[:, column].astype(np.float64), np.nan)

            frames.append(
                pd.DataFrame(
                    {
                        "strategy": tracer,
                        "robots": VEHICLES,
                        "regime": world.regime,
                        "plume": world.plume,
                        "obstacle_share": world.obstacle_share,
                        "factor": factor,
                        "world": world.number,
                        "seed": seed,
                        "trial": np.arange(first, first + count),
                        "start_m": np.linalg.norm(centres_m - source_m, axis=1),
                        "success": counts[:, INSIDE] == 1,
                        "proximity": 1.0 - distances_m[:, END_M] / _farthest_m(source_m),
                        "arrival_steps": steps(FIRST_INSIDE),
                        "contact_steps": steps(CONTACT),
                        "limit_steps": world.limit_steps,
                        "localisation": counts[:, CONTAINED],
                        "containment": counts[:, CONTAINED] / world.limit_steps,
                        "closest_m": distances_m[:, CLOSEST_M],
                        **air.statistics,
                    }
                )
            )
    return pd.concat(frames, ignore_index=True)


def _traced(world: LatticeWorld, vehicles: TracingVehicles) -> TracedWorld:
    return TracedWorld(
        number=world.number,
        regime=world.regime,
        obstacles=world.obstacles,
        obstacle_m=world.obstacle_m,
        obstacle_share=world.obstacle_share,
        strategies=(),
        robots=(VEHICLES,),
        length_m=LENGTH_M,
        vehicles=vehicles,
        puffs_per_step=PUFFS_PER_STEP[world.plume],
        spacing_m=0.3,
        head_start_s=world.head_start_s,
    )


def _centre(world: LatticeWorld, place: TracedScene, seed: int, trial: int) -> FloatArray:
    """Where a lattice starts: uniform over the world, or in distance and bearing from the source."""
    rng = np.random.default_rng([seed, world.number, _CENTRE, trial])
    source_m = place.sources.places_m[0, 0]
    ring = lattice_places(0.5)
    for _ in range(_TRIES):
        if world.start_m is None:
            centre = rng.uniform(0.0, LENGTH_M, 2)
        else:
            bearing_rad = rng.uniform(0.0, 2.0 * math.pi)
            toward = np.array([math.cos(bearing_rad), math.sin(bearing_rad)])
            centre = source_m + rng.uniform(0.0, world.start_m) * toward
        places = centre + ring
        inside = np.all((places > 0.2) & (places < LENGTH_M - 0.2))
        if inside and np.all(clearances_of(place.terrain, places) > 0.2):
            return centre
    raise TrialsError(f"world {world.number}: no room for a lattice")


def _farthest_m(source_m: FloatArray) -> float:
    """The distance of the world's farthest corner: there the proximity is 0."""
    return float(np.hypot(*np.maximum(source_m, LENGTH_M - source_m)))


def code_of(world: LatticeWorld) -> str:
    """Equal for worlds that need the same machine code: all of them."""
    del world
    return "lattice"


def kernels_of(world: LatticeWorld) -> tuple[Callable[..., Any], ...]:
    """The compiled entry that flies trials of `world`."""
    del world
    return (fly_lattices,)


def engine_of(worlds: Sequence[LatticeWorld]) -> str:
    """Equal where the rows of `worlds` are: rows that different code computed are never put together."""
    del worlds
    return engine_identity(fly_lattices, fly_world)


def _compile() -> None:
    """Fly one step in still, clean air."""
    air = RecordedAir(
        np.zeros((1, 2, 2), np.float32),
        np.zeros((1, 2, 2, 2), np.float32),
        np.zeros((2, 2), np.bool_),
        np.zeros(2),
        LENGTH_M,
        np.zeros(2),
        LENGTH_M,
        1.0,
        np.full(2, LENGTH_M),
    )
    middle_m = np.full((1, 2), 0.5 * LENGTH_M)
    fly_lattice_trials(
        make_place(air, middle_m), TracingVehicles(limit_steps=1), Tracing(tracer=CAST), middle_m, seed=0
    )
