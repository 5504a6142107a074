"""The kernel of the flowing wind: one step of advection and diffusion on a square grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mission.geometry.formation import FloatArray
from simvehicle.compiled import compiled


@compiled
def flow_step(
    wind_mps: FloatArray,
    after_mps: FloatArray,
    solid: NDArray[np.bool_],
    spacing_m: float,
    k_m2ps: float,
    dt_s: float,
) -> None:
    """Fill the interior of `after_mps` (2, rows, columns; north and east components) from `wind_mps`.

    du/dt = -(u . grad) u + K laplace(u): forward Euler in time, central differences in space. Rows go north, columns
    east. Edges are left alone, `solid` nodes have no wind.
    """
    advect = 0.5 * dt_s / spacing_m
    diffuse = k_m2ps * dt_s / (spacing_m * spacing_m)
    rows, columns = solid.shape
    for i in range(1, rows - 1):
        for j in range(1, columns - 1):
            if solid[i, j]:
                after_mps[0, i, j] = after_mps[1, i, j] = 0.0
                continue
            along_n, along_e = advect * wind_mps[0, i, j], advect * wind_mps[1, i, j]
            for axis in range(2):
                here = wind_mps[axis, i, j]
                north, south = wind_mps[axis, i + 1, j], wind_mps[axis, i - 1, j]
                east, west = wind_mps[axis, i, j + 1], wind_mps[axis, i, j - 1]
                after_mps[axis, i, j] = (
                    here
                    - along_n * (north - south)
                    - along_e * (east - west)
                    + diffuse * (north + south + east + west - 4.0 * here)
                )
