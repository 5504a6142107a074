"""What a drone of the trials reads at a point: the world's plumes, normalised to a peak of 1.

* `locus-grid`: the plume of the paper's experiments (`simvehicle.world.gas_formulas.locus_grid`), downwind north.
* `gaussian`: the physical plume (`gaussian_concentration_pm2`) cut at the drones' height, and with a gusting wind it
  meanders: the puff that is now x downwind left the vent x/u ago and was carried sideways by the crosswind since
  (Gifford 1959), here a sum of four waves.

Values under the paper's cut of 0.005 are 0.
"""

from __future__ import annotations

import functools
import math
from typing import Literal

import numpy as np

from mission.geometry.formation import FloatArray
from simvehicle.compiled import kernel, leaf
from simvehicle.world import gas_formulas
from simvehicle.world.compiled_gas import gaussian_concentration_pm2, locus_grid_value
from simvehicle.world.gas import Gaussian
from simvehicle.world.gas_formulas import (
    LOCUS_CELL_M,
    LOCUS_CUT,
    LOCUS_WIDTH_M,
    locus_grid,
    locus_grid_source_m,
)
from simvehicle.world.world_config import GaussianPlume

PlumeName = Literal["locus-grid", "gaussian"]

# Places in a plume's numbers; AT_X and AT_Y are its origin in the world, where its cells are cut there.
KIND, SOURCE_X, SOURCE_Y, LOW_X, HIGH_X, LOW_Y, HIGH_Y = range(7)
VENT, HEIGHT, PEAK, WIND, AT_X, AT_Y, WAVES = range(7, 14)
WAVE_COUNT = 4
NUMBERS = WAVES + 2 * WAVE_COUNT
GRID, GAUSSIAN, CUT_GRID = range(3)

VENT_SD_M = 4.0
HEIGHT_M = 10.0
WIND_MPS = 3.0
_WAVE_PERIODS_S = (7.0, 19.0, 43.0, 101.0)
"""Periods of the crosswind's waves: gusts of seconds to a slow veering of minutes, no two in step."""


@functools.cache
def plume_numbers(
    name: PlumeName, perturbed: bool, gust_sd_mps: float, cut_cells: bool = False
) -> tuple[FloatArray, FloatArray]:
    """(numbers, grid) of a plume about the origin; the source's place and box are relative to it.

    `cut_cells`: cells are cut towards zero in the world's coordinates, which moves them by up to a cell, and have the
    value of their first corner.
    """
    numbers = np.zeros(NUMBERS)
    if name == "locus-grid":
        grid = locus_grid(perturbed, not cut_cells)
        rows, columns = np.nonzero(grid)
        numbers[KIND] = CUT_GRID if cut_cells else GRID
        numbers[SOURCE_X], numbers[SOURCE_Y] = locus_grid_source_m(grid, not cut_cells)
        numbers[LOW_X] = rows.min() * LOCUS_CELL_M
        numbers[HIGH_X] = (rows.max() + 1) * LOCUS_CELL_M
        numbers[LOW_Y] = columns.min() * LOCUS_CELL_M - LOCUS_WIDTH_M / 2.0
        numbers[HIGH_Y] = (columns.max() + 1) * LOCUS_CELL_M - LOCUS_WIDTH_M / 2.0
        if cut_cells:
            numbers[LOW_X] -= LOCUS_CELL_M
            numbers[LOW_Y] -= LOCUS_CELL_M
        return numbers, grid
    config = GaussianPlume(
        source_north_m=0.0, source_east_m=0.0, source_above_home_m=HEIGHT_M, vent_sd_m=VENT_SD_M
    )
    steady = Gaussian(config, (WIND_MPS, 0.0, 0.0), 0.0)
    numbers[KIND] = GAUSSIAN
    numbers[SOURCE_X], numbers[SOURCE_Y], _ = steady.source_ned_m
    numbers[LOW_X] = numbers[LOW_Y] = -math.inf
    numbers[HIGH_X] = numbers[HIGH_Y] = math.inf
    numbers[VENT], numbers[HEIGHT], numbers[WIND] = VENT_SD_M, HEIGHT_M, WIND_MPS
    numbers[PEAK] = gas_formulas.gaussian_concentration_pm2(
        float(numbers[SOURCE_X]), 0.0, HEIGHT_M, HEIGHT_M, VENT_SD_M
    )
    # Four waves of equal amplitude a have the variance 4 a^2 / 2. Their phases are the trial's.
    numbers[WAVES : WAVES + WAVE_COUNT] = gust_sd_mps * math.sqrt(2.0 / WAVE_COUNT)
    return numbers, np.zeros((1, 1))


OMEGA_RADPS = np.array([2.0 * math.pi / period_s for period_s in _WAVE_PERIODS_S])


@kernel
def _meandering_value(plume: FloatArray, x: float, y: float, time_s: float) -> float:
    """The Gaussian plume, shifted sideways by what the crosswind's waves did to the puff that is now at x."""
    shift = 0.0
    if x > 0.0 and plume[WAVES] > 0.0:
        left_s = time_s - x / plume[WIND]
        for wave in range(WAVE_COUNT):
            omega = OMEGA_RADPS[wave]
            phase = plume[WAVES + WAVE_COUNT + wave]
            swing = math.sin(omega * time_s + phase) - math.sin(omega * left_s + phase)
            shift += plume[WAVES + wave] / omega * swing
    height_m = plume[HEIGHT]
    value = gaussian_concentration_pm2(x, y - shift, height_m, height_m, plume[VENT]) / plume[PEAK]
    return value if value >= LOCUS_CUT else 0.0


@kernel
def _cut_value(plume: FloatArray, grid: FloatArray, x: float, y: float) -> float:
    """The grid's value where the cell is found from the place in the world, in decimetres cut towards zero."""
    row = int((x + plume[AT_X]) / LOCUS_CELL_M) - round(plume[AT_X] / LOCUS_CELL_M)
    column = int((y + plume[AT_Y]) / LOCUS_CELL_M) - round(plume[AT_Y] / LOCUS_CELL_M) + grid.shape[1] // 2
    if 0 <= row < grid.shape[0] and 0 <= column < grid.shape[1]:
        return float(grid[row, column])
    return 0.0


@leaf
def reading(plume: FloatArray, grid: FloatArray, x: float, y: float, time_s: float) -> float:
    """What a sensor at (x, y) north and east of the plume's origin reads, in [0, 1]."""
    if plume[KIND] == GRID:
        return locus_grid_value(grid, x, y)
    if plume[KIND] == CUT_GRID:
        return _cut_value(plume, grid, x, y)
    return _meandering_value(plume, x, y, time_s)
