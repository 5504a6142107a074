"""What each experiment flies: worlds, and the cells into which their rows are sorted."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np
import pandas as pd

from simvehicle.experiments.experiment import Experiment, Options, Summary
from simvehicle.experiments.lattice.lattice_flights import PUFFS_PER_STEP, TRACERS, LatticeWorld, PuffKind
from simvehicle.experiments.statistics import wilson
from simvehicle.experiments.tracing.traced_cells import refuse_others
from simvehicle.experiments.tracing.traced_table import arrivals, mean_interval
from simvehicle.trials.tracing.flying import NEVER
from simvehicle.trials.tracing.lattice_flying import VEHICLES
from simvehicle.trials.tracing.traced_world import REGIMES, Regime
from simvehicle.trials.trials_error import TrialsError

_TITLES = {
    "fluxo-1": "A lattice of seven: proximity and success by its greatest radius",
    "fluxo-2": "A lattice of seven: containment of the source among obstacles",
}
NAMES = tuple(_TITLES)
_COURSES: tuple[tuple[int, float, float], ...] = (
    (0, 1.5, 0.0),
    (1, 3.0, 0.01),
    (4, 1.5, 0.01),
    (2, 3.0, 0.02),
    (8, 1.5, 0.02),
)
"""Obstacles, their sides in metres, the share of the ground that the paper gives for them."""


class LatticeSize(msgspec.Struct, frozen=True):
    """How much is flown."""

    worlds: int
    starts: int
    factors: tuple[int, ...]
    """With a factor of 2 all three of fluxotaxis' radii would be equal."""


_SIZES: dict[str, tuple[LatticeSize, LatticeSize, LatticeSize]] = {
    "fluxo-1": (
        LatticeSize(6, 4, (3, 15)),
        LatticeSize(12, 20, (3, 6, 9, 12, 15)),
        LatticeSize(35, 200, (3, 4, 6, 7, 8, 10, 11, 12, 14, 15)),
    ),
    "fluxo-2": (LatticeSize(5, 4, (12,)), LatticeSize(30, 20, (12,)), LatticeSize(150, 500, (12,))),
}
"""Quick, usual, full: the last is the paper's. Its second experiment has a spacing of 3 m: factor 12."""


class LatticeCell(msgspec.Struct, frozen=True, kw_only=True):
    """A line of the table."""

    strategy: str
    plume: PuffKind
    factor: int
    obstacle_share: float


def define(name: str, options: Options) -> Experiment:
    """The experiment called `name`. `TrialsError` names what is impossible."""
    refuse_others(name, options)
    if set(options.sizes) - {VEHICLES}:
        raise TrialsError(f"{name} flies lattices of {VEHICLES} vehicles, no other --sizes")
    for regime in options.regimes:
        if regime not in REGIMES:
            raise TrialsError(f"no regime is called {regime!r}; there are {', '.join(REGIMES)}")
    tracers = tuple(dict.fromkeys(options.strategies)) or ("fluxotaxis", "chemotaxis", "anemotaxis")
    for tracer in tracers:
        if tracer not in TRACERS:
            raise TrialsError(f"{name} flies {', '.join(TRACERS)}, not {tracer!r}")
    quick, usual, full = _SIZES[name]
    size = full if options.full else quick if options.quick else usual
    starts = size.starts if options.trials is None else options.trials
    number_of_worlds = size.worlds if options.worlds is None else options.worlds
    for option, number in (("trials", starts), ("worlds", number_of_worlds)):
        if not 1 <= number <= 1000:
            raise TrialsError(f"--{option} must be 1 to 1000, not {number}")
    regimes = tuple(regime for regime in REGIMES if not options.regimes or regime in options.regimes)
    worlds = tuple(
        LatticeWorld(
            number=number,
            regime=regime,
            plume=plume,
            obstacles=obstacles,
            obstacle_m=obstacle_m,
            obstacle_share=share,
            tracers=tracers,
            factors=size.factors,
            start_m=None if name == "fluxo-1" else 25.0,
            head_start_s=360.0 if name == "fluxo-1" else 3600.0,
            limit_steps=3000 if name == "fluxo-1" else 7000,
        )
        for number, regime, plume, (obstacles, obstacle_m, share) in itertools.islice(
            _plan(name, regimes), number_of_worlds
        )
    )
    cells = tuple(
        LatticeCell(strategy=tracer, plume=plume, factor=factor, obstacle_share=share)
        for plume in dict.fromkeys(world.plume for world in worlds)
        for share in sorted({world.obstacle_share for world in worlds if world.plume == plume})
        for tracer in tracers
        for factor in size.factors
    )
    return Experiment(name, _TITLES[name], cells, (), starts, worlds)


def _plan(
    name: str, regimes: tuple[Regime, ...]
) -> Iterator[tuple[int, Regime, PuffKind, tuple[int, float, float]]]:
    """(number, regime, plume, obstacles) of one world after the other, the kinds mixed evenly.

    The second experiment's numbers of kinds have no common factor, so that all are met with all.
    """
    plumes: tuple[PuffKind, ...] = tuple(PUFFS_PER_STEP)
    for number in itertools.count():
        regime = regimes[number % len(regimes)]
        if name == "fluxo-1":
            yield number, regime, plumes[number // len(regimes) % len(plumes)], _COURSES[0]
        else:
            yield number, regime, plumes[number % len(plumes)], _COURSES[number % len(_COURSES)]


def select(rows: pd.DataFrame, cell: LatticeCell) -> pd.DataFrame:
    """The rows of a cell, by world and trial."""
    mine = (
        (rows["strategy"] == cell.strategy)
        & (rows["plume"] == cell.plume)
        & (rows["factor"] == cell.factor)
        & (rows["obstacle_share"] == cell.obstacle_share)
    )
    return rows[mine].sort_values(["world", "trial"])


def summarise(rows: pd.DataFrame, cell: Any) -> Summary:
    """The JSON row of a cell. Arrival is the first step with the source inside the ring, the limit without any;
    success is to have it inside at the end."""
    mine = select(rows, cell)
    trials, successes = len(mine), int(mine["success"].sum())
    low, high = wilson(successes, trials)
    found: Summary = {
        "strategy": cell.strategy,
        "robots": VEHICLES,
        "regime": ", ".join(dict.fromkeys(mine["regime"])),
        "plume": cell.plume,
        "obstacle_share": cell.obstacle_share,
        "factor": cell.factor,
        "trials": trials,
        "success_rate": successes / trials if trials else None,
        "success_low": low,
        "success_high": high,
    }
    steps = arrivals(mine)
    found["arrival_steps_mean"] = _number(steps.mean()) if trials else None
    found["arrival_steps_median"] = _number(np.median(steps)) if trials else None
    found["localisation_mean"] = _number(mine["localisation"].mean())
    for name in ("proximity", "containment"):
        values = mine[name].to_numpy(dtype=np.float64)
        low, high = mean_interval(mine, values) if trials else (np.nan, np.nan)
        found[f"{name}_mean"] = _number(values.mean()) if trials else None
        # Both are shares; Student's interval of few worlds does not know that.
        found[f"{name}_low"], found[f"{name}_high"] = _number(max(low, 0.0)), _number(min(high, 1.0))
    for name in ("intermittency", "peak_to_mean", "plume_share"):
        found[name] = _number(mine[name].mean())
    return found


def _number(value: Any) -> float | None:
    number = float(value)
    return number if abs(number) < NEVER else None
