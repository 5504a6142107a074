"""What stands in the way of trials: obstacles and the world's walls, quick to ask for millions of places a second."""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from mission.geometry.formation import FloatArray, IntArray
from simvehicle.compiled import leaf
from simvehicle.world.compiled_obstacles import clearances
from simvehicle.world.obstacle_formulas import clearance_m as _clearance_m
from simvehicle.world.obstacle_formulas import range_m as _range_m

_SPACING_M = 0.5
_MOST_NODES = 1_000_000
_ABOVE_GROUND_M = 0.0
_PROBE_M = 1e-3
"""How far apart the clearance is asked for to know where an obstacle's wall looks."""

clearance_m = leaf(_clearance_m)
_wall_range_m = leaf(_range_m)


class Prisms(Protocol):
    """The arrays of `simvehicle.world.obstacles.Obstacles`."""

    @property
    def corners_m(self) -> FloatArray: ...
    @property
    def first(self) -> IntArray: ...
    @property
    def tops_m(self) -> FloatArray: ...


class Terrain(NamedTuple):
    """A rectangle from (0, 0) to `length_m`, walled in, with obstacles."""

    length_m: FloatArray
    """(2,) to the north and to the east."""
    corners_m: FloatArray
    first: IntArray
    tops_m: FloatArray
    clear_m: NDArray[np.float32]
    """(rows, columns) clearance from obstacles at nodes from (0, 0) on; infinite everywhere without any."""
    spacing_m: float


def make_terrain(length_m: FloatArray, obstacles: Prisms | None = None) -> Terrain:
    """`obstacles` may reach beyond the walls."""
    length = np.ascontiguousarray(length_m, np.float64)
    spacing_m = max(_SPACING_M, math.sqrt(float(length[0] * length[1]) / _MOST_NODES))
    if obstacles is None or len(obstacles.tops_m) == 0:
        nothing = np.full((1, 1), np.inf, np.float32)
        return Terrain(length, np.zeros((0, 2)), np.zeros(1, np.int64), np.zeros(0), nothing, spacing_m)
    rows, columns = (math.ceil(side_m / spacing_m) + 1 for side_m in length)
    places = np.zeros((rows, columns, 3))
    places[:, :, 0] = spacing_m * np.arange(rows)[:, None]
    places[:, :, 1] = spacing_m * np.arange(columns)
    places[:, :, 2] = -_ABOVE_GROUND_M
    clear_m = np.empty(rows * columns)
    clearances(obstacles.corners_m, obstacles.first, obstacles.tops_m, places.reshape(-1, 3), clear_m)
    return Terrain(
        length,
        obstacles.corners_m,
        obstacles.first,
        obstacles.tops_m,
        clear_m.reshape(rows, columns).astype(np.float32),
        spacing_m,
    )


def clearances_of(terrain: Terrain, places_m: FloatArray) -> FloatArray:
    """(n,) clearances from obstacles at (n, 2) places; infinite without any."""
    clear_m = np.full(len(places_m), np.inf)
    if len(terrain.tops_m):
        places = np.zeros((len(places_m), 3))
        places[:, :2] = places_m
        clearances(terrain.corners_m, terrain.first, terrain.tops_m, places, clear_m)
    return clear_m


@leaf
def surely_clear_m(terrain: Terrain, north_m: float, east_m: float) -> float:
    """A distance within which no obstacle is: the clearance of the nearest node less the way to it."""
    last_row, last_column = terrain.clear_m.shape[0] - 1, terrain.clear_m.shape[1] - 1
    row = min(max(int(north_m / terrain.spacing_m + 0.5), 0), last_row)
    column = min(max(int(east_m / terrain.spacing_m + 0.5), 0), last_column)
    away_n, away_e = row * terrain.spacing_m - north_m, column * terrain.spacing_m - east_m
    # A thousandth for the rounding of the nodes' clearances.
    return 0.999 * float(terrain.clear_m[row, column]) - math.sqrt(away_n * away_n + away_e * away_e)


@leaf
def has_room(terrain: Terrain, north_m: float, east_m: float, radius_m: float) -> bool:
    """Whether a disk there is outside all obstacles."""
    if surely_clear_m(terrain, north_m, east_m) >= radius_m:
        return True
    found_m = clearance_m(terrain.corners_m, terrain.first, terrain.tops_m, north_m, east_m, _ABOVE_GROUND_M)
    return bool(found_m >= radius_m)


@leaf
def along_wall(
    terrain: Terrain, north_m: float, east_m: float, north_mps: float, east_mps: float
) -> tuple[float, float]:
    """The velocity without its part into the nearest obstacle."""
    corners_m, first, tops_m = terrain.corners_m, terrain.first, terrain.tops_m
    here_m = clearance_m(corners_m, first, tops_m, north_m, east_m, _ABOVE_GROUND_M)
    away_n = clearance_m(corners_m, first, tops_m, north_m + _PROBE_M, east_m, _ABOVE_GROUND_M) - here_m
    away_e = clearance_m(corners_m, first, tops_m, north_m, east_m + _PROBE_M, _ABOVE_GROUND_M) - here_m
    size2 = away_n * away_n + away_e * away_e
    into = north_mps * away_n + east_mps * away_e
    if size2 > 0.0 and into < 0.0:
        north_mps -= into / size2 * away_n
        east_mps -= into / size2 * away_e
    return north_mps, east_mps


@leaf
def look_around(
    terrain: Terrain, north_m: float, east_m: float, reach_m: float, ranges_m: FloatArray
) -> None:
    """Fill (beams,) `ranges_m` with ranges to obstacles and walls, clockwise from north; `inf` beyond the reach."""
    beams = ranges_m.shape[0]
    clear = surely_clear_m(terrain, north_m, east_m) >= reach_m
    for beam in range(beams):
        bearing_rad = 2.0 * math.pi * beam / beams
        toward_n, toward_e = math.cos(bearing_rad), math.sin(bearing_rad)
        found_m = math.inf
        if toward_n > 1e-9:
            found_m = min(found_m, (terrain.length_m[0] - north_m) / toward_n)
        elif toward_n < -1e-9:
            found_m = min(found_m, -north_m / toward_n)
        if toward_e > 1e-9:
            found_m = min(found_m, (terrain.length_m[1] - east_m) / toward_e)
        elif toward_e < -1e-9:
            found_m = min(found_m, -east_m / toward_e)
        if not clear:
            wall_m = _wall_range_m(
                terrain.corners_m,
                terrain.first,
                terrain.tops_m,
                north_m,
                east_m,
                _ABOVE_GROUND_M,
                bearing_rad,
            )
            found_m = min(found_m, wall_m)
        ranges_m[beam] = found_m if found_m <= reach_m else math.inf
