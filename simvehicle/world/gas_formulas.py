"""The formulas of the gases, each once: plain functions of numbers.

The instruments of a flight call them as they are, a microsecond or two a point. Maps and trials call the same
functions compiled (`simvehicle.world.compiled_gas`), so they are written in what numba understands.
"""

from __future__ import annotations

import functools
import math

import numpy as np

from mission.geometry.formation import FloatArray
from simvehicle.world.atmosphere import co2_density_kgpm3

_NEGLIGIBLE_SD2 = 36.0
"""Further from the axis than six standard deviations there is nothing to measure."""
_FARTHEST_M = 1e6
"""Nor is there so far downwind, where the formula's squares would run out of numbers."""

LOCUS_CELL_M = 0.1
LOCUS_LENGTH_M = 200.0
LOCUS_WIDTH_M = 40.0
LOCUS_CUT = 0.005
_CELLS_PER_M = 1.0 / LOCUS_CELL_M


def gaussian_concentration_pm2(
    downwind_m: float, crosswind_m: float, up_m: float, release_m: float, vent_sd_m: float
) -> float:
    """The Gaussian plume of a vent of finite width over flat ground, per unit of Q / (2 pi u): 1/m^2.

    exp(-y^2/2sy^2) [exp(-(z-H)^2/2sz^2) + exp(-(z+H)^2/2sz^2)] / (sy sz), x downwind, y crosswind, z up (Pasquill;
    the second term is the reflection at the ground), with sy^2 = s0^2 + by^2 and sz^2 = s0^2 + bz^2. s0 is the
    spread at the vent, by and bz are Briggs' (1973) spreads over open country in neutral air: 0.08 x (1 + 0.0001
    x)^-1/2 and 0.06 x (1 + 0.0015 x)^-1/2. Upwind of the vent the concentration falls off with exp(-x^2/2s0^2), so
    that the field and its slope are continuous everywhere. 0 below the ground.
    """
    if up_m < 0.0 or abs(downwind_m) > _FARTHEST_M:
        return 0.0
    vent2 = vent_sd_m * vent_sd_m
    sy2 = vent2
    sz2 = vent2
    tail = 0.0
    if downwind_m >= 0.0:
        sy2 += 0.0064 * downwind_m * downwind_m / (1.0 + 0.0001 * downwind_m)
        sz2 += 0.0036 * downwind_m * downwind_m / (1.0 + 0.0015 * downwind_m)
    else:
        tail = downwind_m * downwind_m / vent2
    aside = crosswind_m * crosswind_m / sy2 + tail
    if aside > _NEGLIGIBLE_SD2:
        return 0.0
    above_m, mirrored_m = up_m - release_m, up_m + release_m
    direct = math.exp(-0.5 * above_m * above_m / sz2)
    reflected = math.exp(-0.5 * mirrored_m * mirrored_m / sz2)
    return math.exp(-0.5 * aside) / math.sqrt(sy2 * sz2) * (direct + reflected)


def puff_strength_ppm_m3(mass_kg: float, amsl_m: float) -> float:
    """CO2 at the centre of a round Gaussian puff of this mass and the radius 1 m; 1/r^3 of that at the radius r.

    m / (pi^(3/2) r^3) exp(-D^2 / r^2) kg/m^3 at the distance D from its centre.
    """
    return 1e6 * mass_kg / math.pow(math.pi, 1.5) / co2_density_kgpm3(amsl_m)


@functools.cache
def locus_grid(perturbed: bool, centred: bool = True) -> FloatArray:
    """The plume of the LoCUS paper's experiments as its authors ran it: values in [0, 1].

    2000 x 400 cells of 0.1 m; cell [i, j] has the value of the point (i + 0.5) * 0.1 m downwind and
    (j + 0.5) * 0.1 - 20 m crosswind of the plume's origin, or, not `centred` as in their program, of the point
    i * 0.1 m downwind and j * 0.1 - 20 m crosswind. With xs = x/5, ys = y/5:
    c = Q/(2 pi K xs) exp(-u (ys^2 + H^2)/(4 K xs)), Q = 2, K = 1000, H = 0.15, u = 50000; perturbed: times
    (0.8 + 0.2 sin 4x). Divided by its maximum, values under 0.005 set to 0. The formula as printed cannot have been
    what ran: its peak would lie 1250 m downwind.
    """
    x_m = (np.arange(round(LOCUS_LENGTH_M / LOCUS_CELL_M)) + 0.5 * centred)[:, None] * LOCUS_CELL_M
    y_m = (np.arange(round(LOCUS_WIDTH_M / LOCUS_CELL_M)) + 0.5 * centred)[None, :] * LOCUS_CELL_M
    y_m = y_m - LOCUS_WIDTH_M / 2.0
    xs, ys = np.maximum(x_m, 1e-3) / 5.0, y_m / 5.0  # at the origin itself there is nothing
    decay = np.exp(-50000.0 * (ys**2 + 0.15**2) / (4.0 * 1000.0 * xs))
    grid = np.asarray(2.0 / (2.0 * np.pi * 1000.0 * xs) * decay, dtype=np.float64)
    if perturbed:
        grid *= 0.8 + 0.2 * np.sin(4.0 * x_m)
    grid /= grid.max()
    grid[grid < LOCUS_CUT] = 0.0
    grid.setflags(write=False)
    return grid


def locus_grid_source_m(grid: FloatArray, centred: bool = True) -> tuple[float, float]:
    """The point of the strongest cell, metres downwind and crosswind of the plume's origin."""
    row, column = np.unravel_index(int(np.argmax(grid)), grid.shape)
    row_m, column_m = (int(row) + 0.5 * centred) * LOCUS_CELL_M, (int(column) + 0.5 * centred) * LOCUS_CELL_M
    return row_m, column_m - LOCUS_WIDTH_M / 2.0


def locus_grid_value(grid: FloatArray, downwind_m: float, crosswind_m: float) -> float:
    """The value of the cell that a point lies in, relative to the plume's origin; 0 outside the grid."""
    rows, columns = grid.shape
    row = downwind_m * _CELLS_PER_M
    column = (crosswind_m + LOCUS_WIDTH_M / 2.0) * _CELLS_PER_M
    if 0.0 <= row < rows and 0.0 <= column < columns:
        return float(grid[int(row), int(column)])
    return 0.0
