"""From a cell with a reactive strategy to the tallies of its trials."""

from __future__ import annotations

import numba.core.errors
import numpy as np

from mission.geometry.formation import FloatArray, IntArray
from mission.strategies.registry import checked, find
from mission.strategies.tick_rule import numbers
from simvehicle.trials.cell import Cell
from simvehicle.trials.flight import NOW, Scene
from simvehicle.trials.ticks.compiling import not_compiled
from simvehicle.trials.ticks.flying import FLAW, TICK_RESULTS, Sizes, swarm_numbers, tick_kernel
from simvehicle.trials.trials_error import TrialsError

_MOST_SAMPLES = 20_000


class Track:
    """Where the robots of one trial were, sampled evenly; NaN after a robot's failure."""

    def __init__(self, ticks: int, robots: int) -> None:
        self.every = ticks // _MOST_SAMPLES + 1
        self.samples_m: FloatArray = np.full((ticks // self.every + 1, robots, 2), np.nan)
        """(samples, robots, 2) north and east at every `every`-th tick."""

    def places_m(self, ticks: IntArray) -> FloatArray:
        """(n, robots, 2) where they were at these ticks, or at the last sample before."""
        return self.samples_m[np.minimum(ticks // self.every, len(self.samples_m) - 1)]


def fly_swarm(
    cell: Cell,
    scene: Scene,
    setup: FloatArray,
    seed: int,
    first: int,
    count: int,
    track: Track | None = None,
) -> tuple[IntArray, FloatArray]:
    """(results, origins) of trials `first` to `first` + `count` - 1, one row each; `track` gets the last one.

    `TrialsError` names a strategy whose rule cannot be compiled or gives what is no velocity.
    """
    entry = find(cell.strategy)
    rule = entry.ticks
    if rule is None:
        raise ValueError(f"strategy {cell.strategy} is not flown tick by tick")
    results = np.zeros((count, TICK_RESULTS), np.int64)
    origins = np.zeros((count, 2))
    samples_m = np.zeros((0, cell.drones, 2)) if track is None else track.samples_m
    try:
        tick_kernel(rule.rule)(
            scene,
            setup,
            swarm_numbers(rule, cell.speed_mps, cell.acceleration_mps2),
            numbers(checked(entry, dict(cell.parameters))),
            Sizes(cell.drones, rule.state_size, rule.word_size, rule.beams),
            seed,
            first,
            cell.limit_ticks,
            results,
            origins,
            samples_m,
            1 if track is None else track.every,
        )
    except numba.core.errors.NumbaError as error:
        raise TrialsError(not_compiled(cell.strategy, rule, error)) from error
    for row in np.flatnonzero(results[:, FLAW]):
        raise TrialsError(
            f"strategy {cell.strategy}: its rule gave what is no velocity to robot {results[row, FLAW] - 1} in "
            f"tick {results[row, NOW]} of trial {first + row}, seed {seed}"
        )
    return results, origins
