"""Plume models: how much CO2 over the background there is at a point.

Each has a cheap scalar form for the instruments (a few microseconds) and an array form for maps, of one
formula.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

from mission.geometry.frames import Vector3
from simvehicle.fleet.fleet_config import GaussianPlume, LocusGridPlume
from simvehicle.world.atmosphere import air_density_kgpm3

Floats = NDArray[np.float64]

_CO2_TO_AIR_MASS = 44.0095 / 28.9647
"""Molar masses of CO2 and dry air: their ratio is that of the gases' densities at one temperature and
pressure."""
_CALM_MPS = 0.5
"""A Gaussian plume has no meaning in calm air; below this wind speed it is computed as for this speed."""
_NEGLIGIBLE_SD = 6.0
"""Further from the axis than this many standard deviations there is nothing to measure."""


class Gaussian:
    """The Gaussian plume of a vent of finite width, in a steady mean wind, over flat ground at the height of
    home.

    c = Q / (2 pi u sy sz) exp(-y^2/2sy^2) [exp(-(z-H)^2/2sz^2) + exp(-(z+H)^2/2sz^2)], x downwind, y
    crosswind, z up (Pasquill; the second term is the reflection at the ground), with sy^2 = s0^2 + by^2 and
    sz^2 = s0^2 + bz^2. s0 is the spread at the vent, by and bz are Briggs' (1973) spreads over open country
    in neutral air: 0.08 x (1 + 0.0001 x)^-1/2 and 0.06 x (1 + 0.0015 x)^-1/2. Upwind of the vent the
    concentration falls off with exp(-x^2/2s0^2), so that the field and its slope are continuous everywhere.
    The plume follows the mean wind; gusts do not bend it.
    """

    def __init__(self, config: GaussianPlume, mean_wind_ned_mps: Vector3, amsl_m: float) -> None:
        """`amsl_m`: altitude of the ground (home) above mean sea level, for the density of the air."""
        self._north_m = config.source_north_m
        self._east_m = config.source_east_m
        self._height_m = config.source_above_home_m
        self._vent_sd2_m2 = config.vent_sd_m**2
        speed_mps = math.hypot(mean_wind_ned_mps[0], mean_wind_ned_mps[1])
        # In still air any direction would do; north it is.
        self._cos, self._sin = (
            (mean_wind_ned_mps[0] / speed_mps, mean_wind_ned_mps[1] / speed_mps)
            if speed_mps > 0.0
            else (1.0, 0.0)
        )
        co2_kgpm3 = _CO2_TO_AIR_MASS * air_density_kgpm3(amsl_m + self._height_m)
        self._strength_ppm_m2 = (
            config.emission_kgps / (2.0 * math.pi * max(speed_mps, _CALM_MPS)) / co2_kgpm3 * 1e6
        )
        self._source_ned_m = self._strongest()

    @property
    def source_ned_m(self) -> Vector3:
        """Where the concentration is largest at the height of release: the vent itself, unless the plume is
        so wide that its reflection at the ground moves the maximum downwind."""
        return self._source_ned_m

    def excess_co2_ppm(self, position_ned_m: Vector3, time_s: float) -> float:  # noqa: ARG002 (steady)
        """CO2 over the background, ppm by volume; 0 below the ground."""
        north_m, east_m = position_ned_m[0] - self._north_m, position_ned_m[1] - self._east_m
        up_m = -position_ned_m[2]
        downwind_m = north_m * self._cos + east_m * self._sin
        crosswind_m = east_m * self._cos - north_m * self._sin
        vent2 = self._vent_sd2_m2
        if downwind_m >= 0.0:
            by2 = 0.0064 * downwind_m * downwind_m / (1.0 + 0.0001 * downwind_m)
            bz2 = 0.0036 * downwind_m * downwind_m / (1.0 + 0.0015 * downwind_m)
            sy2, sz2, tail = vent2 + by2, vent2 + bz2, 0.0
        else:
            sy2 = sz2 = vent2
            tail = downwind_m * downwind_m / vent2
        across = crosswind_m * crosswind_m / sy2 + tail
        if across > _NEGLIGIBLE_SD**2 or up_m < 0.0:
            return 0.0
        direct = math.exp(-0.5 * (across + (up_m - self._height_m) ** 2 / sz2))
        reflected = math.exp(-0.5 * (across + (up_m + self._height_m) ** 2 / sz2))
        return self._strength_ppm_m2 / math.sqrt(sy2 * sz2) * (direct + reflected)

    def excess_map_ppm(self, north_m: Floats, east_m: Floats, above_home_m: float) -> Floats:
        """`excess_co2_ppm` for arrays of points at one height, for maps."""
        north, east = np.asarray(north_m) - self._north_m, np.asarray(east_m) - self._east_m
        downwind = north * self._cos + east * self._sin
        crosswind = east * self._cos - north * self._sin
        inside = np.maximum(downwind, 0.0)
        sy2 = self._vent_sd2_m2 + 0.0064 * inside**2 / (1.0 + 0.0001 * inside)
        sz2 = self._vent_sd2_m2 + 0.0036 * inside**2 / (1.0 + 0.0015 * inside)
        across = crosswind**2 / sy2 + np.minimum(downwind, 0.0) ** 2 / self._vent_sd2_m2
        direct = np.exp(-0.5 * (across + (above_home_m - self._height_m) ** 2 / sz2))
        reflected = np.exp(-0.5 * (across + (above_home_m + self._height_m) ** 2 / sz2))
        excess: Floats = self._strength_ppm_m2 / np.sqrt(sy2 * sz2) * (direct + reflected)
        return np.where((across > _NEGLIGIBLE_SD**2) | (above_home_m < 0.0), 0.0, excess)

    def _strongest(self) -> Vector3:
        """The maximum along the axis at the height of release, to 0.1 m; the field is symmetric about the
        axis."""
        downwind_m = np.arange(0.0, 40.0 * math.sqrt(self._vent_sd2_m2), 0.1)
        north_m, east_m = self._north_m + downwind_m * self._cos, self._east_m + downwind_m * self._sin
        best = int(np.argmax(self.excess_map_ppm(north_m, east_m, self._height_m)))
        return float(north_m[best]), float(east_m[best]), -self._height_m


LOCUS_CELL_M = 0.1
LOCUS_LENGTH_M = 200.0
LOCUS_WIDTH_M = 40.0
LOCUS_CUT = 0.005


@functools.cache
def locus_grid(perturbed: bool) -> Floats:
    """The plume of the LoCUS paper's experiments as its authors ran it: values in [0, 1].

    2000 x 400 cells of 0.1 m; cell [i, j] is centred (i + 0.5) * 0.1 m downwind and (j + 0.5) * 0.1 - 20 m
    crosswind of the plume's origin. With xs = x/5, ys = y/5: c = Q/(2 pi K xs) exp(-u (ys^2 + H^2)/(4 K
    xs)), Q = 2, K = 1000, H = 0.15, u = 50000; perturbed: times (0.8 + 0.2 sin 4x). Divided by its maximum,
    values under 0.005 set to 0. The formula as printed cannot have been what ran: its peak would lie 1250 m
    downwind.
    """
    x_m = (np.arange(round(LOCUS_LENGTH_M / LOCUS_CELL_M)) + 0.5)[:, None] * LOCUS_CELL_M
    y_m = (np.arange(round(LOCUS_WIDTH_M / LOCUS_CELL_M)) + 0.5)[None, :] * LOCUS_CELL_M - LOCUS_WIDTH_M / 2.0
    xs, ys = x_m / 5.0, y_m / 5.0
    decay = np.exp(-50000.0 * (ys**2 + 0.15**2) / (4.0 * 1000.0 * xs))
    grid = np.asarray(2.0 / (2.0 * np.pi * 1000.0 * xs) * decay, dtype=np.float64)
    if perturbed:
        grid *= 0.8 + 0.2 * np.sin(4.0 * x_m)
    grid /= grid.max()
    grid[grid < LOCUS_CUT] = 0.0
    grid.setflags(write=False)
    return grid


class LocusGrid:
    """`locus_grid` laid over the survey area: downwind is north (whatever the wind), and it is the same at
    every height."""

    def __init__(self, config: LocusGridPlume) -> None:
        self._north_m, self._east_m = config.source_north_m, config.source_east_m
        self._peak_ppm = config.peak_ppm
        self._grid = locus_grid(config.perturbed)
        self._rows, self._columns = self._grid.shape

    @property
    def source_ned_m(self) -> Vector3:
        """Centre of the strongest cell (about 1.4 m north of the plume's origin), at the paper's height of
        10 m."""
        row, column = np.unravel_index(int(np.argmax(self._grid)), self._grid.shape)
        return (
            self._north_m + (int(row) + 0.5) * LOCUS_CELL_M,
            self._east_m + (int(column) + 0.5) * LOCUS_CELL_M - LOCUS_WIDTH_M / 2.0,
            -10.0,
        )

    def excess_co2_ppm(self, position_ned_m: Vector3, time_s: float) -> float:  # noqa: ARG002 (steady)
        """The value of the cell that the point lies in times `peak_ppm`; 0 outside the grid."""
        row = math.floor((position_ned_m[0] - self._north_m) / LOCUS_CELL_M)
        column = math.floor((position_ned_m[1] - self._east_m + LOCUS_WIDTH_M / 2.0) / LOCUS_CELL_M)
        if 0 <= row < self._rows and 0 <= column < self._columns:
            return self._peak_ppm * float(self._grid[row, column])
        return 0.0

    def excess_map_ppm(self, north_m: Floats, east_m: Floats, above_home_m: float) -> Floats:  # noqa: ARG002
        """`excess_co2_ppm` for arrays of points."""
        row = np.floor((np.asarray(north_m) - self._north_m) / LOCUS_CELL_M).astype(np.int64)
        column = np.floor((np.asarray(east_m) - self._east_m + LOCUS_WIDTH_M / 2.0) / LOCUS_CELL_M).astype(
            np.int64
        )
        inside = (row >= 0) & (row < self._rows) & (column >= 0) & (column < self._columns)
        values = self._grid[np.clip(row, 0, self._rows - 1), np.clip(column, 0, self._columns - 1)]
        excess: Floats = np.where(inside, self._peak_ppm * values, 0.0)
        return excess


class CleanAir:
    """No plume at all: what instruments and search strategies must not mistake for one."""

    source_ned_m: Vector3 = (math.nan, math.nan, math.nan)

    def excess_co2_ppm(self, position_ned_m: Vector3, time_s: float) -> float:  # noqa: ARG002
        return 0.0

    def excess_map_ppm(self, north_m: Floats, east_m: Floats, above_home_m: float) -> Floats:  # noqa: ARG002
        shape = np.broadcast_shapes(np.shape(north_m), np.shape(east_m))
        return np.zeros(shape)


AnyPlume = Gaussian | LocusGrid | CleanAir


def make_plume(
    config: GaussianPlume | LocusGridPlume | None, mean_wind_ned_mps: Vector3, amsl_m: float
) -> AnyPlume:
    """The plume that a configuration describes; None is clean air."""
    if config is None:
        return CleanAir()
    if isinstance(config, LocusGridPlume):
        return LocusGrid(config)
    return Gaussian(config, mean_wind_ned_mps, amsl_m)
