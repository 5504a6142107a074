"""The wind over open ground: logarithmic mean, Dryden gusts and thermals that drift with it."""

from __future__ import annotations

from typing import Any

import numpy as np

from mission.geometry.formation import FloatArray
from mission.geometry.frames import Vector3, wind_from
from simvehicle.world.thermals import CELLS, GENERATIONS, cell_m, thermals
from simvehicle.world.turbulence import LANES, LEVELS, SAMPLES, Turbulence
from simvehicle.world.wind_formulas import (
    GUSTS_MEASURED_M,
    LOWEST_M,
    TALLEST_M,
    gusts_at,
    log_law,
    turbulence_level,
    turbulence_sds_mps,
    updraught_mps,
)
from simvehicle.world.world_config import BoundaryLayerWindConfig, ThermalsConfig


class BoundaryLayerWind:
    """A `WindField`: a pure function of configuration, seed, position and time."""

    def __init__(self, config: BoundaryLayerWindConfig, seed: int) -> None:
        self.config = config
        self.mean_ned_mps: Vector3 = wind_from(config.speed_mps, config.from_deg)
        self._north, self._east, _ = wind_from(1.0, config.from_deg)
        """Where the mean wind goes."""
        self._gusts_mps = config.gustiness * config.speed_mps * log_law(GUSTS_MEASURED_M, config.roughness_m)
        """The wind at 20 ft that the turbulence goes by."""
        turbulence = self._turbulence = Turbulence(seed)
        heights_m = turbulence.heights_m.tolist()
        speeds_mps = [config.speed_mps * log_law(up_m, config.roughness_m) for up_m in heights_m]
        self._levels = (np.array(speeds_mps), turbulence.spacings_m(), turbulence.lanes_m())
        self._thermals = thermals(seed).reshape(-1)
        # What is left of the formulas' arguments; a view gives plain numbers, several times as fast.
        speeds, spacings, lanes = (each.data for each in self._levels)
        self._drift: tuple[Any, Any, Any, Any, int, int]
        self._drift = (turbulence.flat.data, speeds, spacings, lanes, LANES, SAMPLES)
        rising = config.thermals or ThermalsConfig(convective_mps=0.0)
        self._rising = (
            CELLS,
            GENERATIONS,
            cell_m(rising.mixed_layer_m),
            rising.life_s,
            rising.convective_mps,
            rising.mixed_layer_m,
        )
        self._columns: Any = self._thermals.data

    def wind_ned_mps(self, position_ned_m: Vector3, time_s: float) -> Vector3:
        """Velocity of the air (where it goes); times before 0 are answered as 0."""
        north_m, east_m, down_m = position_ned_m
        config, toward_n, toward_e = self.config, self._north, self._east
        time_s = max(0.0, time_s)
        along_mps = config.speed_mps * log_law(-down_m, config.roughness_m)
        across_mps = down_mps = 0.0
        if self._gusts_mps > 0.0:
            level = turbulence_level(-down_m, LEVELS)
            self._turbulence.make(int(level))
            along_m, across_m = north_m * toward_n + east_m * toward_e, east_m * toward_n - north_m * toward_e
            u, v, w = gusts_at(*self._drift, level, along_m, across_m, time_s)
            level_sd_mps, vertical_sd_mps = turbulence_sds_mps(-down_m, self._gusts_mps)
            along_mps += level_sd_mps * u
            across_mps, down_mps = level_sd_mps * v, vertical_sd_mps * w
        if config.thermals is not None:
            north_m -= self.mean_ned_mps[0] * time_s
            east_m -= self.mean_ned_mps[1] * time_s
            down_mps -= updraught_mps(self._columns, *self._rising, north_m, east_m, -down_m, time_s)
        return (
            along_mps * toward_n - across_mps * toward_e,
            along_mps * toward_e + across_mps * toward_n,
            down_mps,
        )

    def winds_ned_mps(self, positions_ned_m: FloatArray, time_s: float) -> FloatArray:
        # Loaded by who asks for arrays: vehicles ask for points alone, and start without a compiler.
        from simvehicle.world.compiled_gusts import boundary_layer_winds

        positions = np.ascontiguousarray(positions_ned_m, np.float64)
        if self._gusts_mps > 0.0:
            heights_m = np.clip(-positions[:, 2], LOWEST_M, TALLEST_M)
            below = np.searchsorted(self._turbulence.heights_m, heights_m, side="right") - 1
            for level in np.unique(below).tolist():
                # One more: the kernel's logarithm may round to the other side of a level.
                self._turbulence.make(max(level - 1, 0))
                self._turbulence.make(level)
        winds = np.empty((len(positions), 3))
        boundary_layer_winds(
            self._turbulence.flat,
            self._levels[0],
            self._levels[1],
            self._levels[2],
            self._thermals,
            *self._rising,
            np.array(self.mean_ned_mps),
            np.array([self._north, self._east]),
            self.config.speed_mps,
            self.config.roughness_m,
            self._gusts_mps,
            max(0.0, time_s),
            positions,
            winds,
        )
        return winds
