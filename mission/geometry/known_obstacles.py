"""What stands where the swarm flies, as far as it is known: obstacles as a file says them, and as the guard asks.

Each is a prism with a flat top that rises from the ground. One that ends well below a drone is flown over.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, NamedTuple

import msgspec
import numpy as np
import shapely
from msgspec import Meta
from shapely.geometry.base import BaseGeometry
from shapely.validation import explain_validity

from mission.geometry.frames import Geodetic, LocalFrame, Vector3
from mission.geometry.geofence import WIDEST_M, LocalFence, LocalPoint, Vertex

_MITRE_LIMIT = 2.0
_ROUNDING_M = 1e-6
SIGHT_M = 20.0
_BEARINGS_RAD = tuple(index * math.tau / 24.0 for index in range(24))
_BEAMS = np.array([(math.cos(bearing_rad), math.sin(bearing_rad)) for bearing_rad in _BEARINGS_RAD])
_NOTHING = shapely.Point()


class KnownObstacle(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One obstacle of a file. Its outline is simple, of either winding, and may be concave."""

    corners: Annotated[tuple[Vertex, ...], Meta(max_length=1000)] = ()
    """(latitude_deg, longitude_deg)."""
    corners_north_east_m: Annotated[tuple[tuple[float, float], ...], Meta(max_length=1000)] = ()
    """Instead of `corners`: metres from the origin of the swarm's frame."""
    top_above_home_m: Annotated[float, Meta(gt=0.0, le=1e4)] | None = None
    """None: nothing flies over the obstacle."""

    @property
    def top_m(self) -> float:
        """Above home; infinite where nothing flies over."""
        return math.inf if self.top_above_home_m is None else self.top_above_home_m

    def outline(self, frame: LocalFrame) -> tuple[LocalPoint, ...]:
        """(north_m, east_m) of its corners."""
        places = (Geodetic(*corner, frame.origin.amsl_m) for corner in self.corners)
        return tuple(frame.to_ned(place)[:2] for place in places) or self.corners_north_east_m

    def problem(self, frame: LocalFrame) -> str:
        """What is wrong with it, in a clear sentence; nothing for one that can stand."""
        if bool(self.corners) == bool(self.corners_north_east_m):
            return "give corners (latitude, longitude) or corners_north_east_m (metres), one of them"
        numbers = [number for corner in self.corners or self.corners_north_east_m for number in corner]
        if not all(math.isfinite(number) for number in numbers) or math.isnan(self.top_m):
            return "a number of it is not finite"
        outline = self.outline(frame)
        if len(set(outline)) < 3:
            return f"it has {len(set(outline))} different corners; an outline has three or more"
        if max(max(map(abs, corner)) for corner in outline) > WIDEST_M:
            return (
                f"a corner is more than {WIDEST_M / 1000.0:.0f} km from the origin: probably a wrong number"
            )
        shape = shapely.Polygon(outline)
        if not shape.is_valid:
            what = explain_validity(shape).partition("[")[0].lower()
            where = "its sides cross or touch each other" if "intersection" in what else what
            return f"it is not simple: {where}; put the corners in the order in which one walks round it"
        return "" if shape.area > 0.0 else "it covers no ground: its corners lie on one line"


class Beside(NamedTuple):
    """One obstacle as seen from a point."""

    aside_m: float
    """Horizontal distance to its outline, negative over it or inside."""
    above_m: float
    """Height over its top, negative beside it or inside."""
    towards: LocalPoint
    """Horizontal direction (north, east) in which it comes nearer; the way deeper into it for one that is over it."""


class LocalObstacles:
    """Obstacles in the metres of one local frame, each with a margin around it that is kept free."""

    def __init__(self, frame: LocalFrame, obstacles: Sequence[KnownObstacle], margin_m: float) -> None:
        for obstacle in obstacles:
            problem = obstacle.problem(frame)
            if problem:
                raise ValueError(problem)
        self.margin_m = margin_m
        self._shapes = np.array([shapely.Polygon(obstacle.outline(frame)) for obstacle in obstacles])
        self._edges = shapely.boundary(self._shapes)
        shapely.prepare(self._shapes)
        self._tops_m = np.array([obstacle.top_m for obstacle in obstacles], dtype=np.float64)
        self._walls: dict[tuple[int, float, bool], BaseGeometry] = {}
        self._measured: tuple[LocalPoint, float] = ((0.0, 0.0), -math.inf)
        """Where it was measured last how far it is to the nearest outline, and how far it was."""

    def clearance_m(self, position_ned_m: Vector3) -> float:
        """Distance from a point to the nearest obstacle: negative inside one, infinite without any."""
        nearest_m = math.inf
        for aside_m, above_m, _ in self.beside(position_ned_m, math.inf):
            both = math.hypot(aside_m, above_m) if aside_m > 0.0 and above_m > 0.0 else max(aside_m, above_m)
            nearest_m = min(nearest_m, both)
        return nearest_m

    def beside(self, position_ned_m: Vector3, reach_m: float) -> list[Beside]:
        """The obstacles whose outlines are within `reach_m` of a point, horizontally.

        The distance changes by no more than one moves: far from all of them the last measurement, made a little way
        off, answers for many ticks.
        """
        north_m, east_m, down_m = position_ned_m
        then_m, least_m = self._measured
        if least_m - math.dist(then_m, (north_m, east_m)) - _ROUNDING_M > reach_m:
            return []
        here = shapely.points(north_m, east_m)
        away_m = shapely.distance(self._edges, here)
        inside = shapely.intersects_xy(self._shapes, north_m, east_m)
        self._measured = (
            (north_m, east_m),
            float(np.min(np.where(inside, -math.inf, away_m), initial=math.inf)),
        )
        found = []
        for index in np.flatnonzero(inside | (away_m <= reach_m)).tolist():
            (edge_n, edge_e), _ = shapely.get_coordinates(shapely.shortest_line(self._edges[index], here))
            sign = -1.0 if inside[index] else 1.0
            aside_m = float(away_m[index])
            off_n, off_e = sign * (float(edge_n) - north_m), sign * (float(edge_e) - east_m)
            if aside_m < _ROUNDING_M:  # on its outline: inwards is towards its middle, which is good enough
                middle = shapely.get_coordinates(shapely.point_on_surface(self._shapes[index]))[0]
                off_n, off_e = float(middle[0]) - north_m, float(middle[1]) - east_m
            length_m = math.hypot(off_n, off_e) or 1.0
            towards = (off_n / length_m, off_e / length_m)
            found.append(Beside(sign * aside_m, -down_m - float(self._tops_m[index]), towards))
        return found

    def walls(self, above_home_m: float, wider_m: float = 0.0, *, pointed: bool = False) -> BaseGeometry:
        """What may not be flown in at a height, north and east as x and y: every obstacle that ends less than the
        margin below it, with the margin around and `wider_m` more; prepared, made once. `pointed`: with few corners,
        which lie farther out."""
        walls = self._tops_m + self.margin_m > above_home_m
        key = (
            int(np.count_nonzero(walls)),
            wider_m,
            pointed,
        )  # who is lower than another is no wall before it is
        if key not in self._walls:
            style = {"join_style": "mitre", "mitre_limit": _MITRE_LIMIT} if pointed else {"quad_segs": 8}
            wide = shapely.buffer(self._shapes[walls], self.margin_m + wider_m, **style)
            self._walls[key] = shapely.union_all(wide) if key[0] else _NOTHING
            shapely.prepare(self._walls[key])
        return self._walls[key]

    def beside_walls_m(self, north_m: float, east_m: float, above_home_m: float) -> float:
        """Horizontal distance to the nearest obstacle that is not flown over at that height; 0 inside one, infinite
        without any."""
        walls = self._shapes[self._tops_m + self.margin_m > above_home_m]
        return float(np.min(shapely.distance(walls, shapely.points(north_m, east_m)), initial=math.inf))

    def ranges_m(self, position_ned_m: Vector3) -> tuple[tuple[float, float], ...]:
        """What a range finder would see of them: (bearing_rad from north towards east, range_m), infinite where
        nothing is within `SIGHT_M`; empty where nothing is near at all."""
        near = [one for one in self.beside(position_ned_m, SIGHT_M) if one.above_m < 0.0]
        if not near:
            return ()
        north_m, east_m, down_m = position_ned_m
        walls = self._shapes[self._tops_m > -down_m]
        ends = SIGHT_M * _BEAMS + np.array((north_m, east_m))
        lines = shapely.linestrings(np.stack((np.broadcast_to((north_m, east_m), ends.shape), ends), axis=1))
        hit = shapely.intersection(lines, shapely.union_all(walls))
        away_m = shapely.distance(hit, shapely.points(north_m, east_m))
        return tuple(zip(_BEARINGS_RAD, np.where(np.isnan(away_m), math.inf, away_m).tolist(), strict=True))

    def is_free(self, north_m: float, east_m: float, above_home_m: float) -> bool:
        """Whether a place at a height keeps the margin from all that is not well below it."""
        return not shapely.intersects_xy(self.walls(above_home_m), north_m, east_m)

    def nearest_free(
        self,
        place_m: LocalPoint,
        above_home_m: float,
        wider_m: float,
        fence: LocalFence | None,
        fence_margin_m: float,
    ) -> LocalPoint:
        """The place itself where it keeps the margin at that height; else the nearest that keeps it with `wider_m`
        to spare, inside of the fence if any is."""
        if self.is_free(*place_m, above_home_m):
            return place_m
        edge = self.walls(above_home_m, wider_m).boundary
        if fence is not None:
            inside = shapely.intersection(edge, fence.room(fence_margin_m))
            edge = edge if inside.is_empty else inside
        line = shapely.shortest_line(edge, shapely.points(place_m))
        north_m, east_m = shapely.get_coordinates(line)[0]
        return float(north_m), float(east_m)
