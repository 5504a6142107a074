"""Obstacles as puffs meet them: most are far from all of them, and a map of distances says so at once."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mission.geometry.formation import FloatArray, IntArray
from simvehicle.compiled import kernel
from simvehicle.world.compiled_obstacles import clearance_m, range_m
from simvehicle.world.fields import OPEN_GROUND, ObstacleField
from simvehicle.world.obstacles import Obstacles

KEPT_AWAY_M = 0.01
"""A puff's centre keeps this distance: more than single precision rounds its place."""
_CELLS = 200
"""Of the map, along its longer side."""
_LEAST_CELL_M = 0.5
_MARGIN_M = 10.0


class Barriers(NamedTuple):
    """The outlines of obstacles (`simvehicle.world.obstacles.Obstacles`), and a map about them."""

    corners_m: FloatArray
    first: IntArray
    tops_m: FloatArray
    free_m: NDArray[np.float32]
    """(rows, columns): no obstacle is nearer to any point of the cell than this; negative near and in them."""
    south_m: float
    west_m: float
    cell_m: float
    beyond_m: float
    """Outside of the map no obstacle is nearer than this."""


def make_barriers(obstacles: ObstacleField) -> Barriers:
    """`TypeError` for obstacles without outlines."""
    if obstacles is OPEN_GROUND or (isinstance(obstacles, Obstacles) and not obstacles.count):
        return Barriers(
            np.zeros((0, 2)),
            np.zeros(1, np.int64),
            np.zeros(0),
            np.zeros((0, 0), np.float32),
            0.0,
            0.0,
            1.0,
            math.inf,
        )
    if not isinstance(obstacles, Obstacles):
        raise TypeError(
            f"a puff plume knows obstacles by their outlines; {type(obstacles).__name__} has none"
        )
    low, high = obstacles.corners_m.min(axis=0) - _MARGIN_M, obstacles.corners_m.max(axis=0) + _MARGIN_M
    cell_m = max(float((high - low).max()) / _CELLS, _LEAST_CELL_M)
    rows, columns = np.ceil((high - low) / cell_m).astype(int).tolist()
    north, east = np.meshgrid(
        low[0] + cell_m * (np.arange(rows) + 0.5), low[1] + cell_m * (np.arange(columns) + 0.5), indexing="ij"
    )
    middles = np.column_stack([north.ravel(), east.ravel(), np.zeros(rows * columns)])
    free = obstacles.clearances_m(middles) - cell_m * math.sqrt(0.5)
    return Barriers(
        obstacles.corners_m,
        obstacles.first,
        obstacles.tops_m,
        free.reshape(rows, columns).astype(np.float32),
        float(low[0]),
        float(low[1]),
        cell_m,
        _MARGIN_M - cell_m,
    )


@kernel
def free_m(barriers: Barriers, north_m: float, east_m: float) -> float:
    """No obstacle is nearer to the point than this."""
    row, column = (north_m - barriers.south_m) / barriers.cell_m, (east_m - barriers.west_m) / barriers.cell_m
    if 0.0 <= row < barriers.free_m.shape[0] and 0.0 <= column < barriers.free_m.shape[1]:
        return float(barriers.free_m[int(row), int(column)])
    return barriers.beyond_m


@kernel
def inside(barriers: Barriers, north_m: float, east_m: float, up_m: float) -> bool:
    """Whether a point is in an obstacle or on its face."""
    if free_m(barriers, north_m, east_m) > 0.0:
        return False
    return clearance_m(barriers.corners_m, barriers.first, barriers.tops_m, north_m, east_m, up_m) <= 0.0


@kernel
def blocked(
    barriers: Barriers,
    north_m: float,
    east_m: float,
    up_m: float,
    to_north_m: float,
    to_east_m: float,
    to_up_m: float,
) -> bool:
    """Whether the straight way between two points meets an obstacle, or ends nearer than `KEPT_AWAY_M` to one."""
    along_n, along_e = to_north_m - north_m, to_east_m - east_m
    away_m = math.hypot(along_n, along_e)
    if away_m + KEPT_AWAY_M < free_m(barriers, north_m, east_m):
        return False
    corners_m, first, tops_m = barriers.corners_m, barriers.first, barriers.tops_m
    if clearance_m(corners_m, first, tops_m, to_north_m, to_east_m, to_up_m) < KEPT_AWAY_M:
        return True
    if away_m == 0.0:
        return False
    lowest_m = min(up_m, to_up_m)
    return (
        range_m(corners_m, first, tops_m, north_m, east_m, lowest_m, math.atan2(along_e, along_n)) <= away_m
    )
