"""Where obstacles are, as plain functions of numbers: prisms of any simple outline that stand on the ground.

`corners_m` (m, 2) holds the corners of all of them, north and east in metres, one outline after another; obstacle k
has the rows from `first[k]` to `first[k + 1]`, and its flat top `tops_m[k]` above home. Written in what numba
understands: instruments call these functions as they are, maps and trials compiled
(`simvehicle.world.compiled_obstacles`).
"""

from __future__ import annotations

import math

from mission.geometry.formation import FloatArray, IntArray

_FARTHEST_M = 1e9
ROUNDING = 1e-9
"""Of a wall's length: no beam slips through a corner between two walls."""


def outline_distance_m(corners_m: FloatArray, begin: int, end: int, north_m: float, east_m: float) -> float:
    """Horizontal distance from a point to the outline of one obstacle: negative inside."""
    # Farther away a square of the distance may not be a number; nobody can tell such distances apart.
    north_m, east_m = (
        min(max(north_m, -_FARTHEST_M), _FARTHEST_M),
        min(max(east_m, -_FARTHEST_M), _FARTHEST_M),
    )
    nearest2 = math.inf
    inside = False
    before = end - 1
    for corner in range(begin, end):
        n0, e0 = corners_m[before, 0] - north_m, corners_m[before, 1] - east_m
        n1, e1 = corners_m[corner, 0] - north_m, corners_m[corner, 1] - east_m
        along_n, along_e = n1 - n0, e1 - e0
        share = -(n0 * along_n + e0 * along_e) / (along_n * along_n + along_e * along_e)
        share = min(max(share, 0.0), 1.0)
        off_n, off_e = n0 + share * along_n, e0 + share * along_e
        nearest2 = min(nearest2, off_n * off_n + off_e * off_e)
        # A ray to the east crosses the edge: W. R. Franklin's crossing test.
        if (n0 > 0.0) != (n1 > 0.0) and e0 - n0 * along_e / along_n > 0.0:
            inside = not inside
        before = corner
    return -math.sqrt(nearest2) if inside else math.sqrt(nearest2)


def clearance_m(
    corners_m: FloatArray, first: IntArray, tops_m: FloatArray, north_m: float, east_m: float, up_m: float
) -> float:
    """Distance from a point to the nearest obstacle: negative inside one, infinite without any."""
    nearest_m = math.inf
    for obstacle in range(len(tops_m)):
        aside_m = outline_distance_m(corners_m, first[obstacle], first[obstacle + 1], north_m, east_m)
        above_m = up_m - tops_m[obstacle]
        if aside_m > 0.0 and above_m > 0.0:
            away_m = math.sqrt(aside_m * aside_m + above_m * above_m)
        else:
            away_m = max(aside_m, above_m)
        nearest_m = min(nearest_m, away_m)
    return nearest_m


def stands_at(
    corners_m: FloatArray, first: IntArray, tops_m: FloatArray, north_m: float, east_m: float, up_m: float
) -> bool:
    """Whether a point is inside of an obstacle: the sign of the clearance, at a third of its cost."""
    for obstacle in range(len(tops_m)):
        if up_m > tops_m[obstacle]:
            continue
        inside = False
        n0, e0 = (
            corners_m[first[obstacle + 1] - 1, 0] - north_m,
            corners_m[first[obstacle + 1] - 1, 1] - east_m,
        )
        for corner in range(first[obstacle], first[obstacle + 1]):
            n1, e1 = corners_m[corner, 0] - north_m, corners_m[corner, 1] - east_m
            if (n0 > 0.0) != (n1 > 0.0) and e0 - n0 * (e1 - e0) / (n1 - n0) > 0.0:
                inside = not inside
            n0, e0 = n1, e1
        if inside:
            return True
    return False


def range_m(
    corners_m: FloatArray,
    first: IntArray,
    tops_m: FloatArray,
    north_m: float,
    east_m: float,
    up_m: float,
    bearing_rad: float,
) -> float:
    """Horizontal distance from a point along a bearing, clockwise from north, to the first wall that it meets, from
    outside or from inside; infinite where it meets none. What ends below the point is not met."""
    north_m, east_m = (
        min(max(north_m, -_FARTHEST_M), _FARTHEST_M),
        min(max(east_m, -_FARTHEST_M), _FARTHEST_M),
    )
    toward_n, toward_e = math.cos(bearing_rad), math.sin(bearing_rad)
    nearest_m = math.inf
    for obstacle in range(len(tops_m)):
        if up_m > tops_m[obstacle]:
            continue
        before = first[obstacle + 1] - 1
        for corner in range(first[obstacle], first[obstacle + 1]):
            n0, e0 = corners_m[before, 0] - north_m, corners_m[before, 1] - east_m
            along_n, along_e = corners_m[corner, 0] - north_m - n0, corners_m[corner, 1] - east_m - e0
            before = corner
            across = toward_n * along_e - toward_e * along_n
            if across == 0.0:
                continue  # a wall along the beam: its ends are met as the ends of its neighbours
            away_m = (n0 * along_e - e0 * along_n) / across
            share = (n0 * toward_e - e0 * toward_n) / across
            if away_m >= 0.0 and -ROUNDING <= share <= 1.0 + ROUNDING:
                nearest_m = min(nearest_m, away_m)
    return nearest_m
