"""Where the swarm may fly: the geofence as a file says it, and as the guard asks it ten times a second.

A point is allowed when it lies in at least one inclusion area (or there is none) and in no exclusion area.
Autopilots differ here: PX4 takes the union of inclusions too, ArduPilot only with bit 1 of FENCE_OPTIONS.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, TypeAlias

import msgspec
import numpy as np
import shapely
from msgspec import Meta
from shapely.geometry.base import BaseGeometry
from shapely.validation import explain_validity

from mission.geometry.frames import Geodetic, LocalFrame

Latitude = Annotated[float, Meta(ge=-90.0, le=90.0)]
Longitude = Annotated[float, Meta(ge=-180.0, le=180.0)]
Vertex: TypeAlias = tuple[Latitude, Longitude]
"""(latitude_deg, longitude_deg)."""
LocalPoint: TypeAlias = tuple[float, float]
"""(north_m, east_m) in a `LocalFrame`."""

WIDEST_M = 100_000.0
"""Vertices farther apart than this are a slip of the pen (a lost sign), and too far for one tangent plane."""
_ENDLESS_M = 1e6
_EVERYWHERE = shapely.box(-_ENDLESS_M, -_ENDLESS_M, _ENDLESS_M, _ENDLESS_M)
"""The allowed area of a fence without inclusions, metres."""
_ARC_SEGMENTS = 32
"""Straight pieces a quarter circle: an arc of 300 m radius is then true to 10 cm."""
_SLACK_M = 0.5
"""Two fences of one shape, drawn in different programs, differ by less."""
_ROUNDING_M = 1e-6
"""How far a computed nearest point may miss the line that it was put on."""


class Circle(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A round area on the ground."""

    latitude_deg: Latitude
    longitude_deg: Longitude
    radius_m: Annotated[float, Meta(gt=0.0, le=WIDEST_M)]


class Geofence(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Inclusion and exclusion areas. Polygons are simple, of either winding, and may be concave."""

    inclusion: tuple[tuple[Vertex, ...], ...] = ()
    exclusion: tuple[tuple[Vertex, ...], ...] = ()
    inclusion_circles: tuple[Circle, ...] = ()
    exclusion_circles: tuple[Circle, ...] = ()

    def problems(self) -> list[str]:
        """What is wrong with this fence, one clear sentence each; empty for a fence that can be flown."""
        found: list[str] = []
        corner = self.first_point()
        if corner is None:
            return found
        if not all(math.isfinite(number) for number in corner):
            return ["the geofence has a vertex that is not a finite number"]
        frame = LocalFrame(Geodetic(*corner))
        for kind, polygons in (("inclusion", self.inclusion), ("exclusion", self.exclusion)):
            for index, vertices in enumerate(polygons):
                problem = _polygon_problem(frame, vertices)
                if problem:
                    found.append(f"geofence {kind} polygon {index} {problem}")
        if found:
            return found
        area = _allowed_area(frame, self)
        if area.is_empty or area.area < 1.0:
            found.append("the geofence leaves no room to fly: its exclusion areas cover its inclusion areas")
        south, west, north, east = area.bounds if not area.is_empty else (0.0, 0.0, 0.0, 0.0)
        bounded = bool(self.inclusion or self.inclusion_circles)
        if bounded and max(north - south, east - west) > WIDEST_M:
            found.append(
                f"the geofence is {max(north - south, east - west) / 1000.0:.0f} km wide, more than "
                f"{WIDEST_M / 1000.0:.0f} km: a vertex is probably wrong"
            )
        return found

    def first_point(self) -> Vertex | None:
        """A corner of the fence, or a circle's centre; None for a fence of nothing."""
        for polygon in (*self.inclusion, *self.exclusion):
            if polygon:
                return polygon[0]
        for circle in (*self.inclusion_circles, *self.exclusion_circles):
            return circle.latitude_deg, circle.longitude_deg
        return None if not (self.inclusion or self.exclusion) else (0.0, 0.0)


class LocalFence:
    """A geofence in the metres of one local frame. Distances are horizontal, calls take microseconds."""

    def __init__(self, frame: LocalFrame, fence: Geofence) -> None:
        problems = fence.problems()
        if problems:
            raise ValueError("; ".join(problems))
        self.area = _allowed_area(frame, fence)
        """Where flying is allowed, a shapely (multi)polygon with x = north and y = east, metres."""
        self._edge = self.area.boundary
        shapely.prepare(self.area)
        shapely.prepare(self._edge)
        self._shrunk: dict[float, BaseGeometry] = {}
        self._measured: tuple[float, float, float] | None = None
        """Where (north, east, m) the clearance was measured last, and what it was."""

    def contains(self, north_m: float, east_m: float) -> bool:
        """Whether the point is allowed; the fence line itself is."""
        return bool(shapely.intersects_xy(self.area, north_m, east_m))

    def clearance_m(self, north_m: float, east_m: float) -> float:
        """Distance to the nearest fence line: positive where flying is allowed, negative where it is not."""
        if self._measured is not None and self._measured[:2] == (north_m, east_m):
            return self._measured[2]
        clearance_m = float(shapely.distance(self._edge, shapely.points(north_m, east_m)))
        if not self.contains(north_m, east_m):
            clearance_m = -clearance_m
        self._measured = (north_m, east_m, clearance_m)
        return clearance_m

    def keeps(self, north_m: float, east_m: float, least_m: float) -> bool:
        """Whether the clearance is `least_m` or more.

        The clearance changes by no more than one moves: far from every fence line the last measurement, made a
        little way off, answers for many ticks.
        """
        if self._measured is not None:
            north_then_m, east_then_m, clearance_m = self._measured
            moved_m = math.hypot(north_m - north_then_m, east_m - east_then_m)
            if clearance_m - moved_m - _ROUNDING_M >= least_m:
                return True
        return self.clearance_m(north_m, east_m) >= least_m

    def nearest_edge_point(self, north_m: float, east_m: float) -> LocalPoint:
        """The point of the fence lines that is nearest. A guard takes the velocity towards it away."""
        line = shapely.shortest_line(self._edge, shapely.points(north_m, east_m))
        north_edge_m, east_edge_m = shapely.get_coordinates(line)[0]
        return float(north_edge_m), float(east_edge_m)

    def nearest_allowed(self, north_m: float, east_m: float, margin_m: float = 0.0) -> LocalPoint:
        """The nearest point that keeps `margin_m` from every fence line: the point itself where it does.

        Where no point of the area keeps that margin, the one that keeps the most.
        """
        room = self.room(margin_m)
        if room.is_empty:
            spine = shapely.maximum_inscribed_circle(self.area)
            north_best_m, east_best_m = shapely.get_coordinates(spine)[0]
            return float(north_best_m), float(east_best_m)
        if shapely.intersects_xy(room, north_m, east_m):
            return north_m, east_m
        line = shapely.shortest_line(room, shapely.points(north_m, east_m))
        north_near_m, east_near_m = shapely.get_coordinates(line)[0]
        return float(north_near_m), float(east_near_m)

    def path_clear(self, a: LocalPoint, b: LocalPoint, margin_m: float = 0.0) -> bool:
        """Whether the straight way from `a` to `b` keeps `margin_m` from every fence line."""
        room = self.room(margin_m - _ROUNDING_M)
        if a == b:
            return bool(shapely.intersects_xy(room, *a))
        return bool(shapely.covers(room, shapely.LineString((a, b))))

    def sticks_out_m(self, margin_m: float, other: LocalFence, other_margin_m: float) -> float:
        """How far what one may fly inside of this fence, `margin_m` from its lines, reaches out of what one may fly
        inside of `other`, `other_margin_m` from its lines; 0 where it does not."""
        inner, outer = self.room(margin_m), other.room(other_margin_m)
        if inner.is_empty or outer.is_empty:
            return 0.0 if inner.is_empty else math.inf
        beyond = shapely.difference(inner, outer.buffer(_SLACK_M))
        if beyond.is_empty:
            return 0.0
        corners = shapely.points(shapely.get_coordinates(beyond))
        return float(max(shapely.distance(corners, outer)))

    def farthest_m(self) -> float:
        """How far from the frame's origin its farthest corner is; infinite where nothing bounds it."""
        farthest_m = float(np.hypot(*shapely.get_coordinates(self.area).T).max())
        return farthest_m if farthest_m < _ENDLESS_M else math.inf

    def room(self, margin_m: float) -> BaseGeometry:
        """The allowed area without its rim of `margin_m`, prepared, made once a margin."""
        room = self._shrunk.get(margin_m)
        if room is None:
            room = self.area.buffer(-margin_m, quad_segs=_ARC_SEGMENTS)
            shapely.prepare(room)
            self._shrunk[margin_m] = room
        return room


def _local(frame: LocalFrame, vertices: Sequence[Vertex]) -> list[LocalPoint]:
    amsl_m = frame.origin.amsl_m
    return [frame.to_ned(Geodetic(latitude, longitude, amsl_m))[:2] for latitude, longitude in vertices]


def _polygon_problem(frame: LocalFrame, vertices: Sequence[Vertex]) -> str | None:
    if not all(math.isfinite(number) for vertex in vertices for number in vertex):
        return "has a vertex that is not a finite number"
    if len(set(vertices)) < 3:
        return f"has {len(set(vertices))} different vertices; it needs at least 3"
    points = _local(frame, vertices)
    if max(max(abs(north), abs(east)) for north, east in points) > 10.0 * WIDEST_M:
        return "has a vertex hundreds of kilometres from the others: probably a wrong sign or swapped numbers"
    polygon = shapely.Polygon(points)
    if polygon.convex_hull.area < 1.0:
        return "has no area: its vertices lie on one line or on one spot"
    if not polygon.is_valid:
        what = explain_validity(polygon).partition("[")[0].lower()
        where = "its sides cross or touch each other" if "intersection" in what else what
        return f"is not simple: {where}; put the vertices in the order in which one walks round the area"
    return None


def _disk(frame: LocalFrame, circle: Circle, *, outside: bool) -> BaseGeometry:
    """A circle as a polygon inside or outside of the true one, so that the error is on the safe side."""
    ((north_m, east_m),) = _local(frame, [(circle.latitude_deg, circle.longitude_deg)])
    stretch = 1.0 / math.cos(math.pi / (4 * _ARC_SEGMENTS)) if outside else 1.0
    return shapely.Point(north_m, east_m).buffer(circle.radius_m * stretch, quad_segs=_ARC_SEGMENTS)


def _allowed_area(frame: LocalFrame, fence: Geofence) -> BaseGeometry:
    inclusions = [shapely.Polygon(_local(frame, polygon)) for polygon in fence.inclusion]
    inclusions += [_disk(frame, circle, outside=False) for circle in fence.inclusion_circles]
    exclusions = [shapely.Polygon(_local(frame, polygon)) for polygon in fence.exclusion]
    exclusions += [_disk(frame, circle, outside=True) for circle in fence.exclusion_circles]
    allowed = shapely.union_all(inclusions) if inclusions else _EVERYWHERE
    return allowed.difference(shapely.union_all(exclusions)) if exclusions else allowed
