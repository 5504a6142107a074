"""Recorded air compiled: bilinear between the nodes, the nearest earlier frame in time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mission.geometry.formation import FloatArray
from simvehicle.compiled import leaf
from simvehicle.world.recorded_air import RecordedAir

Field = NDArray[np.float32]


@leaf
def _frame(frames: int, frame_s: float, time_s: float) -> int:
    """The newest frame at `time_s`; the first and the last hold before and after."""
    # The small addition: a time that is meant to be a frame's may be rounded to just below it.
    return min(max(int(time_s / frame_s + 1e-6), 0), frames - 1)


@leaf
def _between(share_n: float, share_e: float, sw: float, se: float, nw: float, ne: float) -> float:
    south = sw + share_e * (se - sw)
    north = nw + share_e * (ne - nw)
    return south + share_n * (north - south)


@leaf
def sample_gas(air: RecordedAir, north_m: float, east_m: float, time_s: float) -> float:
    """The gas at a point; beyond the nodes that of the edge."""
    field = air.gas
    rows, columns = field.shape[1], field.shape[2]
    row = min(max((north_m - air.gas_origin_m[0]) / air.gas_spacing_m, 0.0), rows - 1.0)
    column = min(max((east_m - air.gas_origin_m[1]) / air.gas_spacing_m, 0.0), columns - 1.0)
    i, j = min(int(row), rows - 2), min(int(column), columns - 2)
    k = _frame(field.shape[0], air.frame_s, time_s)
    return _between(
        row - i, column - j, field[k, i, j], field[k, i, j + 1], field[k, i + 1, j], field[k, i + 1, j + 1]
    )


@leaf
def sample_wind(air: RecordedAir, north_m: float, east_m: float, time_s: float, out: FloatArray) -> None:
    """Fill (2,) `out` with the wind at a point, north and east; beyond the nodes that of the edge."""
    field = air.wind_mps
    rows, columns = field.shape[2], field.shape[3]
    row = min(max((north_m - air.wind_origin_m[0]) / air.wind_spacing_m, 0.0), rows - 1.0)
    column = min(max((east_m - air.wind_origin_m[1]) / air.wind_spacing_m, 0.0), columns - 1.0)
    i, j = min(int(row), rows - 2), min(int(column), columns - 2)
    k = _frame(field.shape[0], air.frame_s, time_s)
    for axis in range(2):
        out[axis] = _between(
            row - i,
            column - j,
            field[k, axis, i, j],
            field[k, axis, i, j + 1],
            field[k, axis, i + 1, j],
            field[k, axis, i + 1, j + 1],
        )
