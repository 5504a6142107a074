"""Running the trials of a cell: cells to arrays for the kernels, and the kernels' tallies to tidy rows."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import msgspec
import numpy as np
import pandas as pd

from mission.geometry.formation import FloatArray
from mission.strategies.locus import rule
from mission.strategies.locus.groups import group_count
from mission.strategies.locus.spiral import arm_spacing_m
from mission.strategies.registry import find
from simvehicle.compiled import engine_identity
from simvehicle.trials import locus as locus_kernel
from simvehicle.trials.cell import GRIDS, Cell
from simvehicle.trials.engine import RUNS
from simvehicle.trials.flight import (
    ARENA_M,
    CONTACT,
    HEAL_TICKS,
    HEALS,
    IN_PLUME_DRAWS,
    IN_PLUME_RATE,
    LEG,
    LEGS,
    MOVES,
    NEVER,
    NOW,
    ORIGIN_X,
    ORIGIN_Y,
    SUCCESS,
    SUCCESS_M,
    SURVIVORS,
    TALLY,
    WAYPOINTS,
    WORLD_NUMBERS,
    Scene,
)
from simvehicle.trials.motion import PAPER_UPDATES, TICKS_PER_S, Cruise, Motion, Pd, motion_numbers, powers_of
from simvehicle.trials.plume import SOURCE_X, SOURCE_Y, plume_numbers
from simvehicle.trials.start import (
    CUT_GOAL,
    FIXED_SOURCE,
    GENERIC_RATE,
    GOAL_X,
    GOAL_Y,
    GROUP,
    MOBS_STEP_M,
    SETUP_NUMBERS,
)
from simvehicle.trials.ticks.flying import tick_kernel
from simvehicle.trials.ticks.swarm import Track, fly_swarm

_MOBS_STEP_M = 1.0
_SAME_POINT_M = 1e-6
"""Readings that are nearer together than this were taken at one point."""


class Setup(NamedTuple):
    """A cell as the kernels take it."""

    scene: Scene
    slots: locus_kernel.Slots
    numbers: FloatArray
    setup: FloatArray
    drones: int


def kernel_setup(cell: Cell) -> Setup:
    """`ValueError` with every problem of the cell in one line if it is impossible."""
    problems = cell.problems()
    if problems:
        raise ValueError("; ".join(problems))
    layout = cell.formation()
    spokes = cell.strategy == "locus-multi"
    groups = group_count(cell.drones, cell.group) if spokes else 1
    members = math.ceil(cell.drones / groups)
    table = layout.table(members)
    slots = locus_kernel.Slots(
        table.level.copy(),
        table.parent.copy(),
        table.offset_m.copy(),
        table.child_start.copy(),
        table.child.copy(),
    )
    numbers = np.zeros(locus_kernel.LOCUS_NUMBERS)
    numbers[locus_kernel.HEALING] = float(cell.healing)
    numbers[locus_kernel.NOBODY] = float(cell.unhealed == "nobody")
    numbers[locus_kernel.FIRST_TURN_RAD] = math.pi
    numbers[locus_kernel.DROP_M] = cell.r_min_m
    numbers[rule.STEP_M] = cell.step_m
    numbers[rule.JITTER_M] = cell.jitter_m
    numbers[rule.TURN_RAD] = cell.turn_rad
    numbers[rule.NOISE] = 1.0
    numbers[rule.EXTENT_M] = _SAME_POINT_M
    numbers[rule.PATTERN] = rule.SPOKES if spokes else rule.SPIRAL
    numbers[rule.ARMS_M] = arm_spacing_m(layout.full_levels(members), cell.r_max_m)
    numbers[rule.LIMIT_M] = math.inf
    numbers[rule.SPOKE_M] = cell.arena_m
    numbers[rule.SPOKE_STEP_M] = cell.r_max_m
    setup = np.zeros(SETUP_NUMBERS)
    setup[GENERIC_RATE] = cell.failure_rate if cell.failure == "generic" else 0.0
    setup[MOBS_STEP_M] = _MOBS_STEP_M
    setup[FIXED_SOURCE] = float(cell.source is not None)
    setup[GROUP] = cell.group
    world = np.zeros(WORLD_NUMBERS)
    world[ORIGIN_X], world[ORIGIN_Y] = cell.source or (0.0, 0.0)
    world[SUCCESS_M] = cell.success_m
    world[IN_PLUME_RATE] = cell.failure_rate if cell.failure == "in-plume" else 0.0
    world[IN_PLUME_DRAWS] = cell.in_plume_draws
    world[ARENA_M] = cell.arena_m
    if cell.plume in GRIDS:
        plume, grid = plume_numbers("locus-grid", cell.plume == "perturbed", 0.0, cell.cut_cells)
    else:
        plume, grid = plume_numbers("gaussian", False, cell.gust_sd_mps if cell.plume == "gusty" else 0.0)
    setup[CUT_GOAL] = float(cell.cut_goal)
    setup[GOAL_X], setup[GOAL_Y] = plume[SOURCE_X], plume[SOURCE_Y]
    motion = _motion(cell)
    scene = Scene(motion_numbers(motion), world, plume.copy(), grid, powers_of(motion))
    return Setup(scene, slots, numbers, setup, cell.drones)


def _motion(cell: Cell) -> Motion:
    if cell.motion == "cruise":
        return Cruise(cell.speed_mps, cell.acceleration_mps2, cell.settle_s)
    return Pd(PAPER_UPDATES if cell.motion == "paper" else 1)


def run_cell(cell: Cell, seed: int, first: int, count: int) -> pd.DataFrame:
    """Trials `first` to `first` + `count` - 1 of a cell, one tidy row each; the same however they are split."""
    setup = kernel_setup(cell)
    if find(cell.strategy).ticks is not None:
        results, origins = fly_swarm(cell, setup.scene, setup.setup, seed, first, count)
        return _rows(cell, seed, first, results, origins)
    results = np.zeros((count, TALLY + 1), np.int64)
    origins = np.zeros((count, 2))
    RUNS[cell.strategy](
        setup.scene,
        setup.slots,
        setup.numbers,
        setup.setup,
        setup.drones,
        seed,
        first,
        cell.limit_ticks,
        np.zeros((0, LEG)),
        results,
        origins,
    )
    return _rows(cell, seed, first, results, origins)


def kernel_of(cell: Cell) -> Callable[..., Any]:
    """The compiled entry that flies trials of `cell`."""
    ticks = find(cell.strategy).ticks
    return RUNS[cell.strategy] if ticks is None else tick_kernel(ticks.rule)


def engine_of(cells: Sequence[Cell]) -> str:
    """Equal where the rows of `cells` are: rows that different code computed are never put together."""
    kernels = {cell.strategy: kernel_of(cell) for cell in cells}
    return engine_identity(*(kernels[name] for name in sorted(kernels)), kernel_setup, _rows)


def code_of(cell: Cell) -> str:
    """Equal for cells that need the same machine code."""
    return cell.strategy


def kernels_of(cell: Cell) -> tuple[Callable[..., Any], ...]:
    """`kernel_of`, as `batch.Trials` has it."""
    return (kernel_of(cell),)


class RecordedTrial(msgspec.Struct, frozen=True):
    """One trial with everything that a plot of it needs."""

    row: dict[str, object]
    """Its tidy row."""
    legs: FloatArray
    """(m, LEG) the legs flown, see `flight`."""
    setup: Setup
    """With the plume where it was."""
    track: Track | None = None
    """Instead of legs: where the robots of a reactive strategy were."""


def record_trial(cell: Cell, seed: int, trial: int, most_legs: int = 400_000) -> RecordedTrial:
    """Fly one trial and keep its legs."""
    setup = kernel_setup(cell)
    if find(cell.strategy).ticks is not None:
        results, origins = fly_swarm(cell, setup.scene, setup.setup, seed, trial, 1)
        track = Track(int(results[0, NOW]), cell.drones)
        fly_swarm(cell, setup.scene, setup.setup, seed, trial, 1, track)
        row = _rows(cell, seed, trial, results, origins).iloc[0].to_dict()
        return RecordedTrial(row, np.zeros((0, LEG)), setup, track)
    results = np.zeros((1, TALLY + 1), np.int64)
    origins = np.zeros((1, 2))
    legs = np.zeros((most_legs, LEG))
    RUNS[cell.strategy](
        setup.scene,
        setup.slots,
        setup.numbers,
        setup.setup,
        setup.drones,
        seed,
        trial,
        cell.limit_ticks,
        legs,
        results,
        origins,
    )
    row = _rows(cell, seed, trial, results, origins).iloc[0].to_dict()
    return RecordedTrial(row, legs[: results[0, LEGS]].copy(), setup)


def _seconds(ticks: np.ndarray) -> FloatArray:
    """Ticks as seconds, NaN where it never happened."""
    return np.where(ticks < NEVER, ticks / TICKS_PER_S, np.nan)


def _rows(cell: Cell, seed: int, first: int, results: np.ndarray, origins: FloatArray) -> pd.DataFrame:
    success = results[:, SUCCESS] < NEVER
    over = results[:, NOW] >= cell.limit_ticks
    everybody = results[:, SURVIVORS] == 0
    ended = np.where(success, "source", np.where(everybody, "all_failed", np.where(over, "limit", "other")))
    count = len(results)
    return pd.DataFrame(
        {
            "strategy": cell.strategy,
            "drones": cell.drones,
            "plume": cell.plume,
            "arena_m": cell.arena_m,
            "motion": cell.motion if find(cell.strategy).ticks is None else "cruise",
            "healing": cell.healing,
            "unhealed": cell.unhealed,
            "failure": cell.failure,
            "failure_rate": cell.failure_rate,
            "seed": seed,
            "trial": np.arange(first, first + count),
            "success": success,
            "contact_s": _seconds(results[:, CONTACT]),
            "source_s": _seconds(results[:, SUCCESS]),
            "end_s": results[:, NOW] / TICKS_PER_S,
            "ended": ended,
            "survivors": results[:, SURVIVORS],
            "heals": results[:, HEALS],
            "moves": results[:, MOVES],
            "heal_s": results[:, HEAL_TICKS] / TICKS_PER_S,
            "waypoints": results[:, WAYPOINTS],
            "plume_north_m": origins[:, 0],
            "plume_east_m": origins[:, 1],
        }
    )
