"""What stands in a world: rocks and walls as prisms that rise from the ground."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from shapely.validation import explain_validity

from mission.geometry.formation import FloatArray
from mission.geometry.frames import Vector3
from simvehicle.world import obstacle_formulas
from simvehicle.world.world_config import Obstacle

TOUCHES_M = 0.5
"""A vehicle whose middle is nearer than this touches: half of its width over its rotors."""


class Obstacles:
    """An `ObstacleField` of prisms with flat tops; they may overlap."""

    def __init__(self, obstacles: Sequence[Obstacle]) -> None:
        """`ValueError` names what is wrong with the first that cannot be."""
        for problem in problems(obstacles):
            raise ValueError(problem)
        outlines = [obstacle.outline() for obstacle in obstacles]
        self.corners_m = np.array([corner for outline in outlines for corner in outline]).reshape(-1, 2)
        """(m, 2) north, east of all corners, one outline after another."""
        self.first = np.array([0, *itertools.accumulate(map(len, outlines))], dtype=np.int64)
        """(k + 1,) the first corner of each outline."""
        tops = (obstacle.top_above_home_m for obstacle in obstacles)
        self.tops_m = np.array([math.inf if top_m is None else top_m for top_m in tops], dtype=np.float64)
        """(k,) above home; infinite where nothing flies over."""

    def clearance_m(self, position_ned_m: Vector3) -> float:
        """`clearances_m` at one point."""
        north_m, east_m, down_m = position_ned_m
        return obstacle_formulas.clearance_m(
            self.corners_m, self.first, self.tops_m, north_m, east_m, -down_m
        )

    def range_m(self, position_ned_m: Vector3, bearing_rad: float) -> float:
        """`ranges_m` at one point."""
        north_m, east_m, down_m = position_ned_m
        return obstacle_formulas.range_m(
            self.corners_m, self.first, self.tops_m, north_m, east_m, -down_m, bearing_rad
        )

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


def problems(obstacles: Sequence[Obstacle]) -> Iterator[str]:
    """What is wrong with obstacles, one clear line each."""
    for number, obstacle in enumerate(obstacles):
        outline = obstacle.outline()
        if not all(math.isfinite(number_m) for corner in outline for number_m in corner):
            yield f"obstacle {number} has a corner that is not a finite number"
            continue
        shape = shapely.Polygon(outline) if len(outline) >= 3 else shapely.Polygon()
        if len(outline) < 3:
            yield f"obstacle {number} has {len(outline)} corners; an outline has three or more"
        elif not shape.is_valid:
            yield f"obstacle {number} has no proper outline: {explain_validity(shape)}"
        elif any(a == b for a, b in itertools.pairwise((*outline, outline[0]))):
            yield f"obstacle {number} has one corner twice in a row"
        elif shape.area <= 0.0:
            yield f"obstacle {number} covers no ground"
