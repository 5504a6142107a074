"""What each experiment flies: worlds, and the cells into which their rows are sorted."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import pandas as pd

from simvehicle.experiments.experiment import Experiment, Options, Summary
from simvehicle.experiments.forces.forces_arena import ARENAS, ArenaName, ForcesWorld
from simvehicle.experiments.forces.forces_flights import TRACKER, VARIANTS
from simvehicle.experiments.statistics import Floats, wilson
from simvehicle.experiments.tracing.traced_cells import refuse_others
from simvehicle.trials.trials_error import TrialsError

_TITLES = {
    "forces-small": "Virtual forces among obstacles, arena of 4 by 6 m",
    "forces-large": "Virtual forces in a meandering plume, arena of 30 by 40 m",
}
NAMES = tuple(_TITLES)
_ARENA: dict[str, ArenaName] = {"forces-small": "small", "forces-large": "large"}
_OBSTACLES = {"forces-small": (0, 5, 10), "forces-large": (0,)}
_EMISSIONS_GPS = {"forces-small": (0.01, 0.02, 0.05), "forces-large": (0.05,)}
_SIZES = {"forces-small": (5, 15, 20, 30), "forces-large": (10, 20, 30, 40, 60)}
"""The paper's; of 30 and 40 robots in the large arena its figure says the one, its text the other."""
_QUICK_SIZES = {"forces-small": (5, 30), "forces-large": (10, 60)}
_PLUMES = {"forces-small": 6, "forces-large": 12}
"""For each number of obstacles; with --full three times as many."""
_STARTS = {"forces-small": 10, "forces-large": 5}
"""Repeats in one plume: 60 in all."""


class ForcesCell(msgspec.Struct, frozen=True, kw_only=True):
    """A line of the table."""

    arena: ArenaName
    variant: str
    robots: int
    obstacles: int
    emission_gps: float


def define(name: str, options: Options) -> Experiment:
    """The experiment called `name`. `TrialsError` names what is impossible."""
    refuse_others(name, options)
    if options.regimes:
        raise TrialsError(f"{name} has no use for --regimes: its arena has one wind")
    sizes = tuple(sorted(set(options.sizes))) or (_QUICK_SIZES[name] if options.quick else _SIZES[name])
    variants = tuple(dict.fromkeys(options.strategies)) or tuple(VARIANTS)
    for variant in variants:
        if variant not in VARIANTS:
            raise TrialsError(f"{name} flies {', '.join(VARIANTS)}, not {variant!r}")
    for size in sizes:
        if not 1 <= size <= 60:
            raise TrialsError(f"a swarm of {name} has 1 to 60 robots, not {size}")
    starts = options.trials if options.trials is not None else _STARTS[name]
    usual = 2 if options.quick else _PLUMES[name] * (3 if options.full else 1)
    numbers = options.worlds if options.worlds is not None else usual
    for option, number in (("trials", starts), ("worlds", numbers)):
        if number < 1:
            raise TrialsError(f"--{option} must be at least 1, not {number}")
    if starts > 100:
        raise TrialsError(
            f"--trials are the starts in one plume, 100 at most, not {starts}; ask for more --worlds"
        )
    emissions_gps = _EMISSIONS_GPS[name]
    worlds = tuple(
        ForcesWorld(
            arena=_ARENA[name],
            number=100 * place + number,
            obstacles=obstacles,
            emissions_gps=emissions_gps,
            robots=sizes,
            variants=variants,
        )
        for place, obstacles in enumerate(_OBSTACLES[name])
        for number in range(numbers)
    )
    middle_gps = emissions_gps[len(emissions_gps) // 2]
    cells = tuple(
        ForcesCell(
            arena=_ARENA[name], variant=variant, robots=robots, obstacles=obstacles, emission_gps=emission_gps
        )
        for variant in variants
        for obstacles in _OBSTACLES[name]
        for emission_gps in (emissions_gps if variant == TRACKER else (middle_gps,))
        for robots in sizes
    )
    return Experiment(name, _TITLES[name], cells, (), starts, worlds)


def select(rows: pd.DataFrame, cell: ForcesCell) -> pd.DataFrame:
    """The rows of a cell, by world and trial."""
    mine = (
        (rows["strategy"] == cell.variant)
        & (rows["robots"] == cell.robots)
        & (rows["obstacles"] == cell.obstacles)
        & (rows["emission_gps"] == cell.emission_gps)
    )
    return rows[mine].sort_values(["world", "trial"])


def times_s(mine: pd.DataFrame) -> Floats:
    """Search times of some rows; of those that did not arrive the limit, by which they had not."""
    steps = mine["arrival_steps"].fillna(mine["limit_steps"])
    found: Floats = (steps * mine["step_s"]).to_numpy(dtype=np.float64)
    return found


def summarise(rows: pd.DataFrame, cell: Any) -> Summary:
    """The JSON row of a cell. Steps are of all trials, those without arrival counted at the limit."""
    mine = select(rows, cell)
    successes, trials = int(mine["success"].sum()), len(mine)
    low, high = wilson(successes, trials)
    steps = mine["arrival_steps"].fillna(mine["limit_steps"])
    return {
        "strategy": cell.variant,
        "robots": cell.robots,
        "regime": cell.arena,
        "obstacles": cell.obstacles,
        "obstacle_share": _number(mine["obstacle_share"].mean()),
        "emission_gps": cell.emission_gps,
        "trials": trials,
        "success_rate": successes / trials if trials else None,
        "success_low": low,
        "success_high": high,
        "arrival_steps_mean": _number(steps.mean()),
        "arrival_steps_median": _number(steps.median()),
        "arrival_s_mean": _number(times_s(mine).mean()) if trials else None,
        "arrival_s_median": _number((steps * mine["step_s"]).median()),
        "localisation_mean": _number(mine["localisation"].mean()),
        "closest_m_mean": _number(mine["closest_m"].mean()),
        "nearest_pair_m_median": _number(mine["nearest_pair_m"].median()),
        "followers_mean": _number(mine["followers"].mean()),
        "intermittency": _number(mine["intermittency"].mean()),
        "peak_to_mean": _number(mine["peak_to_mean"].mean()),
        "meander": _number(mine["meander"].mean()),
        "limit_s": ARENAS[cell.arena].vehicles.limit_steps * ARENAS[cell.arena].vehicles.step_s,
    }


def _number(value: Any) -> float | None:
    number = float(value)
    return number if number == number else None
