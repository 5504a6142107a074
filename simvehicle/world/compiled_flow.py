"""The kernels of the flowing wind: one step of advection and diffusion, and the wind at many places."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mission.geometry.formation import FloatArray, IntArray
from simvehicle.compiled import compiled, leaf
from simvehicle.world import wind_formulas

flow_at = leaf(wind_formulas.flow_at)
log_law = leaf(wind_formulas.log_law)


@compiled
def flow_step(
    wind_mps: FloatArray,
    after_mps: FloatArray,
    corners_mps: FloatArray,
    solid: NDArray[np.bool_],
    spacing_m: float,
    k_m2ps: float,
    dt_s: float,
) -> None:
    """Fill `after_mps` (2, nodes, nodes; north and east components) from `wind_mps`: rows go north, columns east.

    du/dt = -(u . grad) u + K laplace(u): forward Euler in time, central differences in space. Where the wind crosses
    a cell faster than K mixes it, |u| dx > 2 K, K is as much as makes the differences upwind ones (Spalding 1972):
    every new value is then a mean of old ones, and no step up to `stable_step_s` makes a wind that was not there. On
    the edges it is interpolated between the corners, (2, south or north, west or east); `solid` nodes have no wind.
    """
    nodes = solid.shape[0]
    for axis in range(2):
        for end in range(2):
            edge = end * (nodes - 1)
            for k in range(nodes):
                share = k / (nodes - 1.0)
                after_mps[axis, edge, k] = 0.0
                if not solid[edge, k]:
                    after_mps[axis, edge, k] = (
                        corners_mps[axis, end, 0] * (1.0 - share) + corners_mps[axis, end, 1] * share
                    )
                after_mps[axis, k, edge] = 0.0
                if not solid[k, edge]:
                    after_mps[axis, k, edge] = (
                        corners_mps[axis, 0, end] * (1.0 - share) + corners_mps[axis, 1, end] * share
                    )
    advect = 0.5 * dt_s / spacing_m
    diffuse = k_m2ps * dt_s / (spacing_m * spacing_m)
    for i in range(1, nodes - 1):
        for j in range(1, nodes - 1):
            if solid[i, j]:
                after_mps[0, i, j] = after_mps[1, i, j] = 0.0
                continue
            along_n, along_e = advect * wind_mps[0, i, j], advect * wind_mps[1, i, j]
            mix_n, mix_e = max(diffuse, abs(along_n)), max(diffuse, abs(along_e))
            for axis in range(2):
                here = wind_mps[axis, i, j]
                north, south = wind_mps[axis, i + 1, j], wind_mps[axis, i - 1, j]
                east, west = wind_mps[axis, i, j + 1], wind_mps[axis, i, j - 1]
                after_mps[axis, i, j] = (
                    here
                    - along_n * (north - south)
                    - along_e * (east - west)
                    + mix_n * (north + south - 2.0 * here)
                    + mix_e * (east + west - 2.0 * here)
                )


@compiled
def flow_winds(
    before: FloatArray,
    after: FloatArray,
    share: float,
    planes: IntArray,
    touched: NDArray[np.bool_],
    nodes: int,
    south_m: float,
    west_m: float,
    spacing_m: float,
    roughness_m: float,
    positions_ned_m: FloatArray,
    winds_mps: FloatArray,
    doubtful: NDArray[np.bool_],
) -> None:
    """Fill (n, 3) `winds_mps` for (n, 3) positions, each in the flow of its plane, and (n,) `doubtful`: which are
    outside the square or in a cell that is `touched` (planes, nodes - 1, nodes - 1) by an obstacle.

    `before`, `after`: (planes, 2 * nodes * nodes). A roughness of 0: the same wind at every height.
    """
    for k in range(positions_ned_m.shape[0]):
        row = (positions_ned_m[k, 0] - south_m) / spacing_m
        column = (positions_ned_m[k, 1] - west_m) / spacing_m
        plane = planes[k]
        north, east = flow_at(before[plane], after[plane], share, nodes, row, column)
        strength = 1.0 if roughness_m == 0.0 else log_law(-positions_ned_m[k, 2], roughness_m)
        doubtful[k] = (
            not (0.0 <= row < nodes - 1 and 0.0 <= column < nodes - 1)
            or (touched[plane, int(row), int(column)])
        )
        winds_mps[k, 0], winds_mps[k, 1], winds_mps[k, 2] = strength * north, strength * east, 0.0
