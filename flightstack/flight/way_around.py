"""The way around vehicles that hover and make way for nobody, and around obstacles that are known.

Around each vehicle is a room that no drone may enter; an obstacle with its margin is another. A target inside is
moved to the nearest place outside; where they lie on the straight way the shortest way around them is flown, inside
of the fence. A way is kept while nothing has changed, so that a drone does not turn to the other side half way.

Horizontal places are (north_m, east_m) in the swarm's frame, as in `mission.geometry.geofence`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from flightstack.flight.surroundings import ObstaclesAround
from mission.geometry.geofence import LocalFence, LocalPoint

RIM_M: Final = 0.8
"""How far outside of the rooms the way is: near the guard's limit a drone flies slowly."""
SAME_M: Final = 0.5
"""What moved less is where it was: a vehicle that hovers, and a GPS, sway."""
PASSED_M: Final = 1.0
_QUARTER: Final = 4
"""Straight pieces a quarter of a rim; what they cut off its corners is less than `RIM_M` up to a radius of 40 m."""
_FENCE_SLACK_M: Final = 0.5
"""A drone on its way sways about the margin to the fence; the guard keeps it."""
_MOST_ROOMS: Final = 12
"""The nearest so many are gone around; the guard keeps clear of all."""
_COARSE_M: Final = 0.3
"""How far the way around obstacles may cut the corners of their rims, which lie `RIM_M` outside."""
_MOST_CORNERS: Final = 600
"""Of obstacles, the nearest to the straight way."""


_NOTHING: Final = shapely.Point()


class Room(msgspec.Struct, frozen=True):
    """What must not be entered: all within `radius_m` of the stretch from `from_m` to `to_m`, on which it hovers."""

    drone: int
    from_m: LocalPoint
    to_m: LocalPoint
    radius_m: float

    def is_like(self, other: Room) -> bool:
        return (
            self.drone == other.drone
            and math.dist(self.from_m, other.from_m) < SAME_M
            and math.dist(self.to_m, other.to_m) < SAME_M
            and abs(self.radius_m - other.radius_m) < SAME_M
        )


class Way(msgspec.Struct, frozen=True):
    """Where to fly now."""

    point_m: LocalPoint
    last: bool
    """Whether that is the end of the way, not a place to pass."""
    shifted: bool
    """The end is not the target but the nearest place to it outside of the rooms."""
    around: tuple[int, ...] = ()
    """The drones that are gone around, or in whose rooms the target is; empty where the way is straight."""
    walls: bool = False
    """Whether the way leads around obstacles, or the target is in one."""


class WayAround:
    """One drone's way. `step` once a tick; between the ticks it remembers the way that is being flown."""

    def __init__(
        self, fence: LocalFence | None, margin_m: float, obstacles: ObstaclesAround | None = None
    ) -> None:
        """`margin_m`: to the fence."""
        self._fence = fence
        self._margin_m = margin_m
        self._obstacles = obstacles
        self._target_m: LocalPoint | None = None
        self._rooms: tuple[Room, ...] = ()
        self._walls: BaseGeometry = _NOTHING
        self._closed: BaseGeometry = _NOTHING
        self._way_m: list[LocalPoint] = []
        """What is still to be passed, the end last; empty where no way leads around."""
        self._shifted = False

    @property
    def avoids(self) -> frozenset[int]:
        """The drones whose rooms were in mind in the newest step."""
        return frozenset(room.drone for room in self._rooms)

    def step(
        self,
        position_m: LocalPoint,
        target_m: LocalPoint,
        rooms: Sequence[Room],
        above_home_m: float = 0.0,
        *,
        level: bool = True,
    ) -> Way:
        """The way from here at a height. `level`: the target is at this height too, so that what is in the way is in
        the target's."""
        reach_m = math.dist(position_m, target_m)
        near = sorted((_between_m(room, position_m), room.drone, room) for room in rooms)
        # One that is farther away than the target, by all of its room, is on no way there that is worth flying.
        chosen = tuple(room for away_m, _, room in near if away_m < reach_m + room.radius_m + RIM_M)
        chosen = tuple(sorted(chosen[:_MOST_ROOMS], key=lambda room: room.drone))
        walls = _NOTHING if self._obstacles is None else self._obstacles.walls(above_home_m)
        in_the_way = bool(shapely.intersects(walls, _line(position_m, target_m)))
        if not chosen and not in_the_way:
            self._target_m, self._rooms = None, ()
            return Way(target_m, last=True, shifted=False)
        if not self._is_planned(target_m, chosen, walls):
            self._target_m, self._rooms, self._walls = target_m, chosen, walls
            self._plan(position_m, target_m, above_home_m, level=level)
        self._pass(position_m)
        around = tuple(room.drone for room in chosen)
        if not self._way_m:
            return Way(target_m, last=True, shifted=False, around=around, walls=in_the_way)
        last = len(self._way_m) == 1
        straight = last and not self._shifted
        return Way(
            self._way_m[0],
            last,
            last and self._shifted,
            () if straight else around,
            in_the_way and not straight,
        )

    def _is_planned(self, target_m: LocalPoint, rooms: tuple[Room, ...], walls: BaseGeometry) -> bool:
        return (
            self._target_m is not None
            and math.dist(target_m, self._target_m) < SAME_M
            and walls is self._walls
            and len(rooms) == len(self._rooms)
            and all(room.is_like(old) for room, old in zip(rooms, self._rooms, strict=True))
        )

    def _plan(
        self, position_m: LocalPoint, target_m: LocalPoint, above_home_m: float, *, level: bool
    ) -> None:
        self._closed, rim = _union(self._rooms, 0.0), _union(self._rooms, RIM_M)
        corners = _corners(rim)
        if self._obstacles is not None and not self._walls.is_empty:
            self._closed = shapely.union(self._closed, self._walls)
            corners += self._wall_corners(position_m, target_m, above_home_m)
            rim = shapely.union(rim, self._obstacles.walls(above_home_m, RIM_M))
        shapely.prepare(self._closed)
        goal_m = self._outside(rim, target_m) if level else target_m
        self._shifted = goal_m != target_m
        if self._is_free(position_m, goal_m):
            self._way_m = [goal_m]
            return
        start_m = _nearest_on(rim.boundary, position_m) if self._is_closed(position_m) else position_m
        places = [start_m, goal_m, *(c for c in corners if self._allows(c))]
        way = self._shortest(places)
        self._way_m = [start_m, *way] if way and start_m != position_m else way

    def _wall_corners(
        self, position_m: LocalPoint, target_m: LocalPoint, above_home_m: float
    ) -> list[LocalPoint]:
        """Where the way may turn around obstacles: the corners of their rims, the nearest to the straight way."""
        if self._obstacles is None:
            return []
        rim = shapely.simplify(self._obstacles.walls(above_home_m, RIM_M, pointed=True), _COARSE_M)
        corners = _corners(rim)
        if len(corners) > _MOST_CORNERS:
            away_m = shapely.distance(shapely.points(corners), _line(position_m, target_m))
            corners = [corners[index] for index in np.argsort(away_m, kind="stable")[:_MOST_CORNERS]]
        return corners

    def _outside(self, rim: BaseGeometry, target_m: LocalPoint) -> LocalPoint:
        """The target, or the nearest allowed place to it that is in nobody's room."""
        if not shapely.intersects_xy(rim, *target_m) or not self._is_closed(target_m):
            return target_m
        edge = rim.boundary
        if self._fence is not None:
            edge = shapely.intersection(edge, self._fence.room(self._margin_m))
        return target_m if edge.is_empty else _nearest_on(edge, target_m)

    def _shortest(self, places: list[LocalPoint]) -> list[LocalPoint]:
        """From the first place to the second over some of the others, without the first; empty if no way leads there
        (A*: legs are looked at only from places that are reached)."""
        points = np.array(places)
        to_goal_m = np.hypot(*(points - points[1]).T)
        least_m, before = np.full(len(places), math.inf), np.zeros(len(places), dtype=np.int64)
        open_ones = np.ones(len(places), dtype=bool)
        least_m[0] = 0.0
        while True:
            expected_m = np.where(open_ones, least_m + to_goal_m, math.inf)
            here = int(np.argmin(expected_m))
            if not math.isfinite(expected_m[here]):
                return []
            if here == 1:
                break
            open_ones[here] = False
            over_here_m = least_m[here] + np.hypot(*(points - points[here]).T)
            better = np.flatnonzero(open_ones & (over_here_m < least_m))
            legs = shapely.linestrings(
                np.stack((np.broadcast_to(points[here], (len(better), 2)), points[better]), 1)
            )
            reached = better[self._are_free(legs)]
            least_m[reached], before[reached] = over_here_m[reached], here
        way = [1]
        while before[way[-1]] != 0:
            way.append(int(before[way[-1]]))
        return [places[index] for index in reversed(way)]

    def _are_free(self, legs: NDArray[np.object_]) -> NDArray[np.bool_]:
        free = ~shapely.intersects(self._closed, legs)
        if self._fence is not None:
            free &= shapely.covers(self._fence.room(self._margin_m - _FENCE_SLACK_M), legs)
        return np.asarray(free)

    def _pass(self, position_m: LocalPoint) -> None:
        """Forget what lies behind: a place that is reached, or whose next one is in sight."""
        while len(self._way_m) > 1:
            reached = math.dist(position_m, self._way_m[0]) < PASSED_M
            if not reached and not self._is_free(position_m, self._way_m[1]):
                return
            del self._way_m[0]

    def _is_free(self, a: LocalPoint, b: LocalPoint) -> bool:
        if shapely.intersects(self._closed, _line(a, b)):
            return False
        return self._fence is None or self._fence.path_clear(a, b, self._margin_m - _FENCE_SLACK_M)

    def _is_closed(self, place_m: LocalPoint) -> bool:
        return bool(shapely.intersects_xy(self._closed, *place_m))

    def _allows(self, place_m: LocalPoint) -> bool:
        return not self._is_closed(place_m) and (
            self._fence is None or self._fence.path_clear(place_m, place_m, self._margin_m)
        )


def _union(rooms: Sequence[Room], more_m: float) -> BaseGeometry:
    stretches = [shapely.LineString((room.from_m, room.to_m)) for room in rooms]
    radii_m = [room.radius_m + more_m for room in rooms]
    return shapely.union_all(shapely.buffer(stretches, radii_m, quad_segs=_QUARTER))


def _corners(shape: BaseGeometry) -> list[LocalPoint]:
    return [(float(north_m), float(east_m)) for north_m, east_m in shapely.get_coordinates(shape)]


def _line(a: LocalPoint, b: LocalPoint) -> BaseGeometry:
    return shapely.LineString((a, b))


def _between_m(room: Room, place_m: LocalPoint) -> float:
    return float(shapely.distance(shapely.LineString((room.from_m, room.to_m)), shapely.points(place_m)))


def _nearest_on(edge: BaseGeometry, place_m: LocalPoint) -> LocalPoint:
    line = shapely.shortest_line(edge, shapely.points(place_m))
    north_m, east_m = shapely.get_coordinates(line)[0]
    return float(north_m), float(east_m)
