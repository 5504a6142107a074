"""The gases of a world: how much CO2 over the background there is at a point, and at many."""

from __future__ import annotations

import functools
import math

import numpy as np

from mission.geometry.formation import FloatArray
from mission.geometry.frames import Vector3
from simvehicle.world.atmosphere import co2_density_kgpm3
from simvehicle.world.fields import OPEN_GROUND, GasField, ObstacleField, WindField
from simvehicle.world.gas_formulas import (
    gaussian_concentration_pm2,
    locus_grid,
    locus_grid_source_m,
    locus_grid_value,
)
from simvehicle.world.world_config import GaussianPlume, LocusGridPlume, Plume

_CALM_MPS = 0.5
"""A Gaussian plume has no meaning in calm air; below this wind speed it is computed as for this speed."""


class Gaussian:
    """The Gaussian plume of a vent, in a steady mean wind, over flat ground at the height of home.

    c = Q / (2 pi u) times `gaussian_concentration_pm2`. The plume follows the mean wind; gusts do not bend it.
    """

    def __init__(self, config: GaussianPlume, mean_wind_ned_mps: Vector3, amsl_m: float) -> None:
        """`amsl_m`: altitude of the ground (home) above mean sea level, for the density of the air."""
        self._north_m = config.source_north_m
        self._east_m = config.source_east_m
        self._height_m = config.source_above_home_m
        self._vent_sd_m = config.vent_sd_m
        speed_mps = math.hypot(mean_wind_ned_mps[0], mean_wind_ned_mps[1])
        # In still air any direction would do; north it is.
        self._cos, self._sin = (
            (mean_wind_ned_mps[0] / speed_mps, mean_wind_ned_mps[1] / speed_mps)
            if speed_mps > 0.0
            else (1.0, 0.0)
        )
        co2_kgpm3 = co2_density_kgpm3(amsl_m + self._height_m)
        self._strength_ppm_m2 = (
            config.emission_kgps / (2.0 * math.pi * max(speed_mps, _CALM_MPS)) / co2_kgpm3 * 1e6
        )

    @functools.cached_property
    def source_ned_m(self) -> Vector3:
        """Where the concentration is largest at the height of release: the vent itself, unless the plume is
        so wide that its reflection at the ground moves the maximum downwind. To 0.1 m along the axis, about which
        the field is symmetric."""
        height_m, vent_sd_m = self._height_m, self._vent_sd_m
        best_m = max(
            (0.1 * step for step in range(math.ceil(400.0 * vent_sd_m))),
            key=lambda x_m: gaussian_concentration_pm2(x_m, 0.0, height_m, height_m, vent_sd_m),
        )
        return self._north_m + best_m * self._cos, self._east_m + best_m * self._sin, -height_m

    def excess_co2_ppm(self, position_ned_m: Vector3, time_s: float) -> float:  # noqa: ARG002 (steady)
        north_m, east_m = position_ned_m[0] - self._north_m, position_ned_m[1] - self._east_m
        return self._strength_ppm_m2 * gaussian_concentration_pm2(
            north_m * self._cos + east_m * self._sin,
            east_m * self._cos - north_m * self._sin,
            -position_ned_m[2],
            self._height_m,
            self._vent_sd_m,
        )

    def excesses_co2_ppm(self, positions_ned_m: FloatArray, time_s: float) -> FloatArray:  # noqa: ARG002
        # Loaded by who asks for arrays: a fleet of vehicles asks for points alone, and starts without a compiler.
        from simvehicle.world.compiled_gas import gaussian_excesses

        excesses_ppm = np.empty(len(positions_ned_m))
        vent_ned_m = np.array([self._north_m, self._east_m, -self._height_m])
        gaussian_excesses(
            np.ascontiguousarray(positions_ned_m, np.float64),
            vent_ned_m,
            self._cos,
            self._sin,
            self._vent_sd_m,
            self._strength_ppm_m2,
            excesses_ppm,
        )
        return excesses_ppm


class LocusGrid:
    """`locus_grid` laid over the survey area: downwind is north (whatever the wind), and it is the same at
    every height."""

    def __init__(self, config: LocusGridPlume) -> None:
        self._north_m, self._east_m = config.source_north_m, config.source_east_m
        self._peak_ppm = config.peak_ppm
        self._grid = locus_grid(config.perturbed)

    @property
    def source_ned_m(self) -> Vector3:
        """Centre of the strongest cell (about 1.4 m north of the plume's origin), at the paper's height of
        10 m."""
        downwind_m, crosswind_m = locus_grid_source_m(self._grid)
        return self._north_m + downwind_m, self._east_m + crosswind_m, -10.0

    def excess_co2_ppm(self, position_ned_m: Vector3, time_s: float) -> float:  # noqa: ARG002 (steady)
        return self._peak_ppm * locus_grid_value(
            self._grid, position_ned_m[0] - self._north_m, position_ned_m[1] - self._east_m
        )

    def excesses_co2_ppm(self, positions_ned_m: FloatArray, time_s: float) -> FloatArray:  # noqa: ARG002
        from simvehicle.world.compiled_gas import locus_grid_excesses

        excesses_ppm = np.empty(len(positions_ned_m))
        locus_grid_excesses(
            np.ascontiguousarray(positions_ned_m, np.float64),
            self._grid,
            self._north_m,
            self._east_m,
            self._peak_ppm,
            excesses_ppm,
        )
        return excesses_ppm


class CleanAir:
    """No plume at all: what instruments and search strategies must not mistake for one."""

    source_ned_m: Vector3 = (math.nan, math.nan, math.nan)

    def excess_co2_ppm(self, position_ned_m: Vector3, time_s: float) -> float:  # noqa: ARG002
        return 0.0

    def excesses_co2_ppm(self, positions_ned_m: FloatArray, time_s: float) -> FloatArray:  # noqa: ARG002
        return np.zeros(len(positions_ned_m))


def make_gas(
    config: Plume | None,
    wind: WindField,
    amsl_m: float,
    seed: int = 0,
    obstacles: ObstacleField = OPEN_GROUND,
) -> GasField:
    """The gas that a configuration describes; None is clean air.

    `amsl_m`: altitude of home above mean sea level.
    """
    if config is None:
        return CleanAir()
    if isinstance(config, LocusGridPlume):
        return LocusGrid(config)
    if isinstance(config, GaussianPlume):
        return Gaussian(config, wind.mean_ned_mps, amsl_m)
    # Loaded by who has such a plume: it brings the compiler.
    from simvehicle.world.filaments import Filaments

    return Filaments(config, wind, amsl_m, seed, obstacles)
