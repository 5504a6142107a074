"""The kernel of the wind over open ground: mean, gusts and thermals at many places."""

from __future__ import annotations

from mission.geometry.formation import FloatArray
from simvehicle.compiled import compiled, kernel
from simvehicle.world import wind_formulas
from simvehicle.world.turbulence import LANES, LEVELS, SAMPLES

gusts_at = kernel(wind_formulas.gusts_at)
log_law = kernel(wind_formulas.log_law)
turbulence_level = kernel(wind_formulas.turbulence_level)
turbulence_sds_mps = kernel(wind_formulas.turbulence_sds_mps)
updraught_mps = kernel(wind_formulas.updraught_mps)


@compiled
def boundary_layer_winds(
    series: FloatArray,
    speeds_mps: FloatArray,
    spacings_m: FloatArray,
    lanes_m: FloatArray,
    thermals: FloatArray,
    cells: int,
    generations: int,
    cell_m: float,
    life_s: float,
    convective_mps: float,
    mixed_layer_m: float,
    mean_ned_mps: FloatArray,
    toward: FloatArray,
    speed_mps: float,
    roughness_m: float,
    gusts_mps: float,
    time_s: float,
    positions_ned_m: FloatArray,
    winds_mps: FloatArray,
) -> None:
    """Fill (n, 3) `winds_mps` for (n, 3) positions; `toward` is the mean wind's unit vector, `gusts_mps` the wind at
    20 ft that the turbulence goes by."""
    toward_n, toward_e = toward[0], toward[1]
    for k in range(positions_ned_m.shape[0]):
        north_m, east_m, up_m = positions_ned_m[k, 0], positions_ned_m[k, 1], -positions_ned_m[k, 2]
        along_mps = speed_mps * log_law(up_m, roughness_m)
        across_mps = down_mps = 0.0
        if gusts_mps > 0.0:
            u, v, w = gusts_at(
                series,
                speeds_mps,
                spacings_m,
                lanes_m,
                LANES,
                SAMPLES,
                turbulence_level(up_m, LEVELS),
                north_m * toward_n + east_m * toward_e,
                east_m * toward_n - north_m * toward_e,
                time_s,
            )
            level_sd_mps, vertical_sd_mps = turbulence_sds_mps(up_m, gusts_mps)
            along_mps += level_sd_mps * u
            across_mps = level_sd_mps * v
            down_mps = vertical_sd_mps * w
        if convective_mps > 0.0:
            down_mps -= updraught_mps(
                thermals,
                cells,
                generations,
                cell_m,
                life_s,
                convective_mps,
                mixed_layer_m,
                north_m - mean_ned_mps[0] * time_s,
                east_m - mean_ned_mps[1] * time_s,
                up_m,
                time_s,
            )
        winds_mps[k, 0] = along_mps * toward_n - across_mps * toward_e
        winds_mps[k, 1] = along_mps * toward_e + across_mps * toward_n
        winds_mps[k, 2] = down_mps
