"""All that stands around a drone: what its file tells, and what its range finder has seen."""

from __future__ import annotations

import math
from collections.abc import Sequence

import shapely
from shapely.geometry.base import BaseGeometry

from flightstack.flight.guidance import whereabouts
from flightstack.flight.seen_obstacles import SeenObstacles
from flightstack.mavlink.obstacle_distance import Ranges
from mission.geometry.frames import Vector3
from mission.geometry.geofence import LocalPoint
from mission.geometry.known_obstacles import Beside, LocalObstacles
from mission.strategies.contract import Neighbour

_KNOWN_M = 1.0
"""What is seen so near to a known obstacle is that obstacle."""
_NEIGHBOUR_M = 2.5
"""And so near to another drone that drone, which the guard keeps apart from anyway."""


class ObstaclesAround:
    """Asked by the guard as `LocalObstacles` are."""

    def __init__(self, known: LocalObstacles | None, margin_m: float) -> None:
        self.margin_m = margin_m
        self._known = known
        self._seen = SeenObstacles(margin_m)
        self._united: dict[tuple[float, bool], tuple[BaseGeometry, BaseGeometry, BaseGeometry]] = {}
        """By how wide it is: the parts, and the whole."""

    @property
    def reach_m(self) -> float:
        """How far is seen what is not known; infinite where nobody looks."""
        return self._seen.reach_m

    def look(
        self, now_s: float, position_ned_m: Vector3, ranges: Ranges, neighbours: Sequence[Neighbour]
    ) -> None:
        """Take in one look around."""
        others = [whereabouts(other, position_ned_m)[:2] for other in neighbours if other.airborne]
        above_home_m = -position_ned_m[2]

        def known(place: LocalPoint) -> bool:
            if any(math.dist(place, other) < _NEIGHBOUR_M for other in others):
                return True
            return self._known is not None and self._known.beside_walls_m(*place, above_home_m) < _KNOWN_M

        self._seen.look(now_s, position_ned_m, ranges, known)

    def beside(self, position_ned_m: Vector3, reach_m: float) -> list[Beside]:
        seen = self._seen.beside(position_ned_m, reach_m)
        return seen if self._known is None else self._known.beside(position_ned_m, reach_m) + seen

    def beside_walls_m(self, north_m: float, east_m: float, above_home_m: float) -> float:
        seen_m = self._seen.beside_walls_m(north_m, east_m)
        if self._known is None:
            return seen_m
        return min(seen_m, self._known.beside_walls_m(north_m, east_m, above_home_m))

    def walls(self, above_home_m: float, wider_m: float = 0.0, *, pointed: bool = False) -> BaseGeometry:
        seen = self._seen.walls(wider_m, pointed=pointed)
        if self._known is None:
            return seen
        known = self._known.walls(above_home_m, wider_m, pointed=pointed)
        if seen.is_empty:
            return known
        key = (wider_m, pointed)
        parts = self._united.get(key)
        if parts is None or parts[0] is not known or parts[1] is not seen:
            whole = shapely.union(known, seen)
            shapely.prepare(whole)
            self._united[key] = parts = (known, seen, whole)
        return parts[2]
