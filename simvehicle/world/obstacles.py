"""What stands in a world: rocks and walls as prisms that rise from the ground."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.validation import explain_validity

from mission.geometry.formation import FloatArray
from mission.geometry.frames import Vector3
from simvehicle.world import obstacle_formulas
from simvehicle.world.world_config import Obstacle

TOUCHES_M: Final = 0.5
"""A vehicle whose middle is nearer than this touches: half of its width over its rotors."""
_SHORTEST_SIDE_M: Final = 1e-3


class Obstacles:
    """An `ObstacleField` of prisms with flat tops; they may overlap."""

    def __init__(self, obstacles: Sequence[Obstacle]) -> None:
        """`ValueError` names what is wrong with the first that cannot be."""
        for number, problem in problems(obstacles):
            raise ValueError(f"obstacle {number} {problem}")
        self._standing = tuple(obstacles)
        outlines = [obstacle.outline() for obstacle in obstacles]
        corners = [corner for outline in outlines for corner in outline]
        self.corners_m = np.array(corners, dtype=np.float64).reshape(-1, 2)
        """(m, 2) north, east of all corners, one outline after another."""
        self.first = np.array([0, *itertools.accumulate(map(len, outlines))], dtype=np.int64)
        """(k + 1,) the first corner of each outline."""
        self.tops_m = np.array([top_m(obstacle) for obstacle in obstacles], dtype=np.float64)
        """(k,) above home; infinite where nothing flies over."""
        last = [corner for outline in outlines for corner in (*outline[1:], outline[0])]
        self._walls = (
            self.corners_m,
            np.array(last, dtype=np.float64).reshape(-1, 2),
            np.repeat(self.tops_m, [len(outline) for outline in outlines]),
        )
        # Read one by one by vehicles and instruments: a view gives plain numbers, several times as fast.
        self._views: tuple[Any, Any, Any] = (self.corners_m.data, self.first.data, self.tops_m.data)

    @property
    def count(self) -> int:
        return len(self._standing)

    def each(self) -> Iterator[Obstacles]:
        """One after another, alone."""
        return (Obstacles((one,)) for one in self._standing)

    def taller_than(self, up_m: float) -> Obstacles:
        """Those whose tops are above a height above home."""
        return Obstacles([one for one in self._standing if top_m(one) > up_m])

    def near(self, place_m: tuple[float, float], within_m: float) -> Obstacles:
        """Those that are no farther to the side from a place, north and east."""
        corners_m, first, _ = self._views
        return Obstacles(
            [
                one
                for k, one in enumerate(self._standing)
                if obstacle_formulas.outline_distance_m(corners_m, first[k], first[k + 1], *place_m)
                <= within_m
            ]
        )

    def clearance_m(self, position_ned_m: Vector3) -> float:
        """`clearances_m` at one point."""
        north_m, east_m, down_m = position_ned_m
        return obstacle_formulas.clearance_m(*self._views, north_m, east_m, -down_m)

    def stand_at(self, position_ned_m: Vector3) -> bool:
        """Whether a point is inside of one."""
        north_m, east_m, down_m = position_ned_m
        return obstacle_formulas.stands_at(*self._views, north_m, east_m, -down_m)

    def stand_at_all(self, positions_ned_m: FloatArray) -> NDArray[np.bool_]:
        """(n,) whether (n, 3) positions are."""
        from simvehicle.world.compiled_obstacles import insides

        inside = np.empty(len(positions_ned_m), np.bool_)
        positions = np.ascontiguousarray(positions_ned_m, np.float64)
        insides(self.corners_m, self.first, self.tops_m, positions, inside)
        return inside

    def range_m(self, position_ned_m: Vector3, bearing_rad: float) -> float:
        """`ranges_m` at one point."""
        north_m, east_m, down_m = position_ned_m
        return obstacle_formulas.range_m(*self._views, north_m, east_m, -down_m, bearing_rad)

    def ranges_around_m(self, position_ned_m: Vector3, bearings_rad: FloatArray) -> FloatArray:
        """(n,) `range_m` from one point along (n,) bearings: for a vehicle that looks around, without a compiler."""
        starts_m, ends_m, tops_m = self._walls
        standing = tops_m >= -position_ned_m[2]
        start = starts_m[standing] - np.array(position_ned_m[:2])
        along = ends_m[standing] - starts_m[standing]
        toward_n, toward_e = np.cos(bearings_rad)[:, None], np.sin(bearings_rad)[:, None]
        across = toward_n * along[:, 1] - toward_e * along[:, 0]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            away_m = (start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0]) / across
            share = (start[:, 0] * toward_e - start[:, 1] * toward_n) / across
            rounding = obstacle_formulas.ROUNDING
            met = (away_m >= 0.0) & (share >= -rounding) & (share <= 1.0 + rounding)
        ranges_m: FloatArray = np.min(np.where(met, away_m, np.inf), axis=1, initial=np.inf)
        return ranges_m

    def clearances_m(self, positions_ned_m: FloatArray) -> FloatArray:
        # Loaded by who asks for arrays: vehicles ask for points alone, and start without a compiler.
        from simvehicle.world.compiled_obstacles import clearances

        clearances_m = np.empty(len(positions_ned_m))
        positions = np.ascontiguousarray(positions_ned_m, np.float64)
        clearances(self.corners_m, self.first, self.tops_m, positions, clearances_m)
        return clearances_m

    def ranges_m(self, positions_ned_m: FloatArray, bearings_rad: FloatArray) -> FloatArray:
        from simvehicle.world.compiled_obstacles import ranges

        ranges_m = np.empty(len(positions_ned_m))
        positions = np.ascontiguousarray(positions_ned_m, np.float64)
        bearings = np.ascontiguousarray(bearings_rad, np.float64)
        ranges(self.corners_m, self.first, self.tops_m, positions, bearings, ranges_m)
        return ranges_m


def top_m(obstacle: Obstacle) -> float:
    """Height of its top above home, infinite where nothing flies over."""
    return math.inf if obstacle.top_above_home_m is None else obstacle.top_above_home_m


def problems(obstacles: Sequence[Obstacle]) -> Iterator[tuple[int, str]]:
    """(number of the obstacle, what is wrong with it in one clear line)."""
    for number, obstacle in enumerate(obstacles):
        outline = obstacle.outline()
        if not all(math.isfinite(number_m) for corner in outline for number_m in corner):
            yield number, "has a corner that is not a finite number"
        elif any(math.dist(a, b) < _SHORTEST_SIDE_M for a, b in itertools.pairwise((*outline, outline[0]))):
            yield number, "has a corner twice in a row; give it once (an outline closes by itself)"
        elif len(outline) < 3:
            yield number, f"has {len(outline)} corners; an outline has three or more"
        elif not (shape := shapely.Polygon(outline)).is_valid:
            yield number, f"has no proper outline ({explain_validity(shape)}); its sides must not meet"
        elif shape.area <= 0.0:
            yield number, "covers no ground"
