"""The way around vehicles that hover and make way for nobody.

Around each of them is a room that no drone may enter. A target inside is moved to the nearest place outside; where
rooms lie on the straight way the shortest way around them is flown, inside of the fence. A way is kept while
nothing has changed, so that a drone does not turn to the other side half way.

Horizontal places are (north_m, east_m) in the swarm's frame, as in `mission.geometry.geofence`.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

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


class WayAround:
    """One drone's way. `step` once a tick; between the ticks it remembers the way that is being flown."""

    def __init__(self, fence: LocalFence | None, margin_m: float) -> None:
        self._fence = fence
        self._margin_m = margin_m
        self._target_m: LocalPoint | None = None
        self._rooms: tuple[Room, ...] = ()
        self._closed: BaseGeometry = shapely.Point()
        self._way_m: list[LocalPoint] = []
        """What is still to be passed, the end last; empty where no way leads around."""
        self._shifted = False

    @property
    def avoids(self) -> frozenset[int]:
        """The drones whose rooms were in mind in the newest step."""
        return frozenset(room.drone for room in self._rooms)

    def step(
        self, position_m: LocalPoint, target_m: LocalPoint, rooms: Sequence[Room], *, level: bool = True
    ) -> Way:
        """The way from here. `level`: the target is at this altitude, so that the rooms are in its way too."""
        reach_m = math.dist(position_m, target_m)
        near = sorted((_between_m(room, position_m), room.drone, room) for room in rooms)
        # One that is farther away than the target, by all of its room, is on no way there that is worth flying.
        chosen = tuple(room for away_m, _, room in near if away_m < reach_m + room.radius_m + RIM_M)
        chosen = tuple(sorted(chosen[:_MOST_ROOMS], key=lambda room: room.drone))
        if not chosen:
            self._target_m, self._rooms = None, ()
            return Way(target_m, last=True, shifted=False)
        if not self._is_planned(target_m, chosen):
            self._target_m, self._rooms = target_m, chosen
            self._plan(position_m, target_m, level=level)
        self._pass(position_m)
        around = tuple(room.drone for room in chosen)
        if not self._way_m:
            return Way(target_m, last=True, shifted=False, around=around)
        last = len(self._way_m) == 1
        straight = last and not self._shifted
        return Way(self._way_m[0], last, last and self._shifted, () if straight else around)

    def _is_planned(self, target_m: LocalPoint, rooms: tuple[Room, ...]) -> bool:
        return (
            self._target_m is not None
            and math.dist(target_m, self._target_m) < SAME_M
            and len(rooms) == len(self._rooms)
            and all(room.is_like(old) for room, old in zip(rooms, self._rooms, strict=True))
        )

    def _plan(self, position_m: LocalPoint, target_m: LocalPoint, *, level: bool) -> None:
        self._closed = _union(self._rooms, 0.0)
        shapely.prepare(self._closed)
        rim = _union(self._rooms, RIM_M)
        goal_m = self._outside(rim, target_m) if level else target_m
        self._shifted = goal_m != target_m
        if self._is_free(position_m, goal_m):
            self._way_m = [goal_m]
            return
        start_m = _nearest_on(rim.boundary, position_m) if self._is_closed(position_m) else position_m
        corners = [(float(north_m), float(east_m)) for north_m, east_m in shapely.get_coordinates(rim)]
        places = [start_m, goal_m, *(c for c in corners if self._allows(c))]
        way = self._shortest(places)
        self._way_m = [start_m, *way] if way and start_m != position_m else way

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
        (Dijkstra's)."""
        points = np.array(places)
        first, second = (np.ravel(index) for index in np.triu_indices(len(places), 1))
        legs = shapely.linestrings(np.stack((points[first], points[second]), axis=1))
        free = ~shapely.intersects(self._closed, legs)
        if self._fence is not None:
            free &= shapely.covers(self._fence.room(self._margin_m - _FENCE_SLACK_M), legs)
        next_to: dict[int, list[tuple[int, float]]] = {}
        for a, b in zip(first[free].tolist(), second[free].tolist(), strict=True):
            leg_m = math.dist(places[a], places[b])
            next_to.setdefault(a, []).append((b, leg_m))
            next_to.setdefault(b, []).append((a, leg_m))
        least_m, before = {0: 0.0}, {0: 0}
        queue = [(0.0, 0)]
        while queue:
            so_far_m, here = heapq.heappop(queue)
            if here == 1:
                break
            for there, leg_m in next_to.get(here, ()) if so_far_m <= least_m[here] else ():
                if so_far_m + leg_m < least_m.get(there, math.inf):
                    least_m[there], before[there] = so_far_m + leg_m, here
                    heapq.heappush(queue, (so_far_m + leg_m, there))
        if 1 not in before:
            return []
        way = [1]
        while before[way[-1]] != 0:
            way.append(before[way[-1]])
        return [places[index] for index in reversed(way)]

    def _pass(self, position_m: LocalPoint) -> None:
        """Forget what lies behind: a place that is reached, or whose next one is in sight."""
        while len(self._way_m) > 1:
            reached = math.dist(position_m, self._way_m[0]) < PASSED_M
            if not reached and not self._is_free(position_m, self._way_m[1]):
                return
            del self._way_m[0]

    def _is_free(self, a: LocalPoint, b: LocalPoint) -> bool:
        if shapely.intersects(self._closed, shapely.LineString((a, b))):
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


def _between_m(room: Room, place_m: LocalPoint) -> float:
    return float(shapely.distance(shapely.LineString((room.from_m, room.to_m)), shapely.points(place_m)))


def _nearest_on(edge: BaseGeometry, place_m: LocalPoint) -> LocalPoint:
    line = shapely.shortest_line(edge, shapely.points(place_m))
    north_m, east_m = shapely.get_coordinates(line)[0]
    return float(north_m), float(east_m)
