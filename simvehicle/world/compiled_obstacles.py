"""The obstacles' formulas compiled: for kernels that call them, and over arrays of positions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mission.geometry.formation import FloatArray, IntArray
from simvehicle.compiled import compiled, kernel
from simvehicle.world import obstacle_formulas

outline_distance_m = kernel(obstacle_formulas.outline_distance_m)
clearance_m = kernel(obstacle_formulas.clearance_m)
stands_at = kernel(obstacle_formulas.stands_at)
range_m = kernel(obstacle_formulas.range_m)


@compiled
def clearances(
    corners_m: FloatArray,
    first: IntArray,
    tops_m: FloatArray,
    positions_ned_m: FloatArray,
    clearances_m: FloatArray,
) -> None:
    """Fill (n,) `clearances_m` for (n, 3) positions."""
    for i in range(positions_ned_m.shape[0]):
        clearances_m[i] = clearance_m(
            corners_m, first, tops_m, positions_ned_m[i, 0], positions_ned_m[i, 1], -positions_ned_m[i, 2]
        )


@compiled
def insides(
    corners_m: FloatArray,
    first: IntArray,
    tops_m: FloatArray,
    positions_ned_m: FloatArray,
    inside: NDArray[np.bool_],
) -> None:
    """Fill (n,) `inside` for (n, 3) positions."""
    for i in range(positions_ned_m.shape[0]):
        inside[i] = stands_at(
            corners_m, first, tops_m, positions_ned_m[i, 0], positions_ned_m[i, 1], -positions_ned_m[i, 2]
        )


@compiled
def ranges(
    corners_m: FloatArray,
    first: IntArray,
    tops_m: FloatArray,
    positions_ned_m: FloatArray,
    bearings_rad: FloatArray,
    ranges_m: FloatArray,
) -> None:
    """Fill (n,) `ranges_m` for (n, 3) positions and (n,) bearings."""
    for i in range(positions_ned_m.shape[0]):
        ranges_m[i] = range_m(
            corners_m,
            first,
            tops_m,
            positions_ned_m[i, 0],
            positions_ned_m[i, 1],
            -positions_ned_m[i, 2],
            bearings_rad[i],
        )
