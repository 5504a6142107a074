"""Geofences as an autopilot keeps them: written apart from the stack's own guard, so that each checks the other."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mission.geometry.frames import Geodetic, Vector3
from simvehicle.autopilot.missions import StoredItem

_POLYGONS = (
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
)
_CIRCLES = (mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION)


class FenceError(ValueError):
    """Items that make no fence."""


@dataclasses.dataclass(frozen=True, slots=True)
class Area:
    """A polygon or a circle in the local frame."""

    inclusion: bool
    vertices_m: tuple[tuple[float, float], ...] = ()
    center_m: tuple[float, float] = (0.0, 0.0)
    radius_m: float = 0.0

    def contains(self, north_m: float, east_m: float) -> bool:
        if not self.vertices_m:
            return math.dist((north_m, east_m), self.center_m) <= self.radius_m
        inside = False
        n1, e1 = self.vertices_m[-1]
        for n2, e2 in self.vertices_m:
            # a ray to the east crosses the edge: even-odd rule
            if (n1 > north_m) != (n2 > north_m) and east_m < (e2 - e1) * (north_m - n1) / (n2 - n1) + e1:
                inside = not inside
            n1, e1 = n2, e2
        return inside


def areas_of(items: Sequence[StoredItem], local: Callable[[Geodetic], Vector3]) -> tuple[Area, ...]:
    """The areas that uploaded fence items describe (mission type 1, commands 5001 to 5004)."""
    areas: list[Area] = []
    place = 0
    while place < len(items):
        item = items[place]
        if item.command in _CIRCLES:
            north, east = _point(item, local)
            if not 0.0 < item.p1 < 1e7:
                raise FenceError(f"fence item {place}: circle of radius {item.p1}")
            areas.append(Area(item.command == _CIRCLES[0], center_m=(north, east), radius_m=item.p1))
            place += 1
        elif item.command in _POLYGONS:
            count = int(item.p1) if 0.0 <= item.p1 <= len(items) else 0
            corners = items[place : place + count]
            if count < 3 or len(corners) < count or any(c.command != item.command for c in corners):
                raise FenceError(f"fence item {place}: a polygon of {count} vertices that are not there")
            vertices = tuple(_point(corner, local) for corner in corners)
            areas.append(Area(item.command == _POLYGONS[0], vertices_m=vertices))
            place += count
        elif item.command == mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT:
            place += 1
        else:
            raise FenceError(f"fence item {place}: command {item.command} is not a fence")
    return tuple(areas)


def _point(item: StoredItem, local: Callable[[Geodetic], Vector3]) -> tuple[float, float]:
    north, east, _ = local(Geodetic(item.x / 1e7, item.y / 1e7))
    return north, east


def outside(areas: Sequence[Area], north_m: float, east_m: float, *, any_inclusion: bool) -> bool:
    """Whether a point breaks the fence: in an exclusion, or out of an inclusion (of all, with `any_inclusion`)."""
    inside = [area.contains(north_m, east_m) for area in areas if area.inclusion]
    if inside and not (any(inside) if any_inclusion else all(inside)):
        return True
    return any(area.contains(north_m, east_m) for area in areas if not area.inclusion)
