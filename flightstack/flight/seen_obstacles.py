"""What a range finder has seen stand there: places that stay closed until they are seen through, or long not seen.

The guard takes them for walls without a top: a look around is horizontal.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from flightstack.mavlink.obstacle_distance import Ranges
from mission.geometry.frames import Vector3
from mission.geometry.geofence import LocalPoint
from mission.geometry.known_obstacles import Beside

CELL_M: Final = 1.5
"""Of what was seen in one such square the first place is kept."""
KEPT_S: Final = 60.0
"""How long after it was seen last: a vehicle drifts away from where it thinks to be."""
_THROUGH_M: Final = 1.5
"""So far behind a place must be what is seen for the place to be free."""
_MOST: Final = 500
_DRAWN_AFTER_S: Final = 1.0
"""How often walls are drawn anew for the way around: the guard itself keeps clear of every place from the first."""
_APART_RAD: Final = math.radians(50.0)
"""Places in directions that differ less are one wall: the nearest of them counts."""
_NOTHING: Final = shapely.Point()


class SeenObstacles:
    """One drone's memory of its looks around."""

    def __init__(self, margin_m: float) -> None:
        self._margin_m = margin_m
        self._cells: dict[tuple[int, int], tuple[float, float, float]] = {}
        """(north_m, east_m, when it was seen last)"""
        self._places_m: NDArray[np.float64] = np.empty((0, 2))
        self._drawn_m: NDArray[np.float64] = self._places_m
        """The places that the walls are drawn around."""
        self._drawn_s = -math.inf
        self._walls: dict[tuple[float, bool], BaseGeometry] = {}
        self._newest: Ranges | None = None
        self.reach_m = math.inf
        """How far the newest look went; infinite before the first."""

    def look(
        self, now_s: float, position_ned_m: Vector3, ranges: Ranges, known: Callable[[LocalPoint], bool]
    ) -> None:
        """Remember one look, if it is a new one. `known`: what is at that place is kept clear of anyway."""
        if ranges is self._newest:
            return
        self._newest, self.reach_m = ranges, ranges.reach_m
        before = set(self._cells)
        self._forget(now_s, position_ned_m, ranges)
        for bearing_rad, range_m in ranges.beams:
            if range_m < math.inf:
                place = (
                    position_ned_m[0] + range_m * math.cos(bearing_rad),
                    position_ned_m[1] + range_m * math.sin(bearing_rad),
                )
                cell = (math.floor(place[0] / CELL_M), math.floor(place[1] / CELL_M))
                if (
                    cell in self._cells
                ):  # the first place stays: walls that move with the noise would be planned anew
                    self._cells[cell] = (*self._cells[cell][:2], now_s)
                elif not known(place) and len(self._cells) < _MOST:
                    self._cells[cell] = (*place, now_s)
        if set(self._cells) != before:
            self._places_m = np.array([cell[:2] for cell in self._cells.values()]).reshape(-1, 2)
        if self._drawn_m is not self._places_m and now_s - self._drawn_s >= _DRAWN_AFTER_S:
            self._drawn_m, self._drawn_s = self._places_m, now_s
            self._walls.clear()

    def _forget(self, now_s: float, position: Vector3, ranges: Ranges) -> None:
        """What is seen through, and what has not been seen for long."""
        if not self._cells:
            return
        off_m = self._places_m - np.array(position[:2])
        away_m, bearing_rad = np.hypot(*off_m.T), np.arctan2(off_m[:, 1], off_m[:, 0])
        free = np.zeros(len(off_m), dtype=bool)
        for beam_rad, range_m in ranges.beams:
            beside_rad = np.abs((bearing_rad - beam_rad + math.pi) % math.tau - math.pi)
            seen_m = min(range_m, ranges.reach_m)
            free |= (beside_rad < 0.5 * ranges.width_rad) & (away_m < seen_m - _THROUGH_M)
        for cell, through in zip(list(self._cells), free.tolist(), strict=True):
            if through or now_s - self._cells[cell][2] > KEPT_S:
                del self._cells[cell]

    def beside(self, position_ned_m: Vector3, reach_m: float) -> list[Beside]:
        """The nearest place in each direction within reach."""
        if not len(self._places_m):
            return []
        off_m = self._places_m - np.array(position_ned_m[:2])
        away_m = np.hypot(*off_m.T)
        found: list[Beside] = []
        for index in np.argsort(away_m, kind="stable").tolist():
            distance_m = float(away_m[index])
            if distance_m > reach_m:
                break
            towards = (
                float(off_m[index, 0]) / max(distance_m, 1e-6),
                float(off_m[index, 1]) / max(distance_m, 1e-6),
            )
            if all(_between_rad(towards, other.towards) > _APART_RAD for other in found):
                found.append(Beside(distance_m, -math.inf, towards))
        return found

    def beside_walls_m(self, north_m: float, east_m: float) -> float:
        """Distance to the nearest place; infinite without any."""
        if not len(self._places_m):
            return math.inf
        off_m = self._places_m - np.array((north_m, east_m))
        return float(np.min(np.hypot(*off_m.T), initial=math.inf))

    def walls(self, wider_m: float, *, pointed: bool) -> BaseGeometry:
        """The places with the margin around them and `wider_m` more, as `LocalObstacles.walls`."""
        key = (wider_m, pointed)
        if key not in self._walls:
            if not len(self._drawn_m):
                return _NOTHING
            places = shapely.multipoints(self._drawn_m)
            around = self._margin_m + wider_m
            # A circle's corners lie inside of it: those that a way turns at are to lie outside.
            around = around / math.cos(math.pi / 12.0) if pointed else around
            self._walls[key] = shapely.buffer(places, around, quad_segs=3 if pointed else 4)
            shapely.prepare(self._walls[key])
        return self._walls[key]


def _between_rad(a: LocalPoint, b: LocalPoint) -> float:
    return math.acos(min(max(a[0] * b[0] + a[1] * b[1], -1.0), 1.0))
