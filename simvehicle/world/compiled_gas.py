"""The gases' formulas compiled: for kernels that call them, and over arrays of positions."""

from __future__ import annotations

from mission.geometry.formation import FloatArray
from simvehicle.compiled import compiled, kernel
from simvehicle.world import gas_formulas

gaussian_concentration_pm2 = kernel(gas_formulas.gaussian_concentration_pm2)
locus_grid_value = kernel(gas_formulas.locus_grid_value)


@compiled
def gaussian_excesses(
    positions_ned_m: FloatArray,
    source_ned_m: FloatArray,
    downwind_north: float,
    downwind_east: float,
    vent_sd_m: float,
    strength_ppm_m2: float,
    excesses_ppm: FloatArray,
) -> None:
    """Fill (n,) `excesses_ppm` for (n, 3) positions; (downwind_north, downwind_east) is the wind's unit vector."""
    for i in range(positions_ned_m.shape[0]):
        north_m = positions_ned_m[i, 0] - source_ned_m[0]
        east_m = positions_ned_m[i, 1] - source_ned_m[1]
        excesses_ppm[i] = strength_ppm_m2 * gaussian_concentration_pm2(
            north_m * downwind_north + east_m * downwind_east,
            east_m * downwind_north - north_m * downwind_east,
            -positions_ned_m[i, 2],
            -source_ned_m[2],
            vent_sd_m,
        )


@compiled
def locus_grid_excesses(
    positions_ned_m: FloatArray,
    grid: FloatArray,
    origin_north_m: float,
    origin_east_m: float,
    peak_ppm: float,
    excesses_ppm: FloatArray,
) -> None:
    """Fill (n,) `excesses_ppm` for (n, 3) positions."""
    for i in range(positions_ned_m.shape[0]):
        excesses_ppm[i] = peak_ppm * locus_grid_value(
            grid, positions_ned_m[i, 0] - origin_north_m, positions_ned_m[i, 1] - origin_east_m
        )
