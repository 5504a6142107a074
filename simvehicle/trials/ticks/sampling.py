"""What robots sense of the world in tick mode: fields are arrays, each with a compiled function that samples it.

Another field (ranges to obstacles, another gas) is another function here, with its arrays in the `Scene`.
"""

from __future__ import annotations

import math

from mission.geometry.formation import FloatArray
from simvehicle.compiled import leaf
from simvehicle.trials.flight import ORIGIN_X, ORIGIN_Y, Scene
from simvehicle.trials.motion import TICKS_PER_S
from simvehicle.trials.plume import GRID, KIND, WAVE_COUNT, WAVES, WIND, WIND_MPS, reading
from simvehicle.trials.plume import OMEGA_RADPS as WAVE_RADPS


@leaf
def gas_at(scene: Scene, north_m: float, east_m: float, tick: int) -> float:
    """What a sensor there reads, in [0, 1]."""
    x = north_m - scene.world[ORIGIN_X]
    y = east_m - scene.world[ORIGIN_Y]
    return reading(scene.plume, scene.grid, x, y, tick / TICKS_PER_S)


@leaf
def sample_wind(scene: Scene, tick: int, wind_mps: FloatArray) -> None:
    """The wind (north, east), the same everywhere: along the plume, and across it as its waves are now."""
    if scene.plume[KIND] == GRID:
        wind_mps[0] = WIND_MPS
        wind_mps[1] = 0.0
        return
    wind_mps[0] = scene.plume[WIND]
    wind_mps[1] = 0.0
    for wave in range(WAVE_COUNT):
        if scene.plume[WAVES + wave] > 0.0:
            phase_rad = WAVE_RADPS[wave] * tick / TICKS_PER_S + scene.plume[WAVES + WAVE_COUNT + wave]
            wind_mps[1] += scene.plume[WAVES + wave] * math.cos(phase_rad)
