"""Boundaries of a Dragonfly mission (the swarm's earlier planner): named areas, each a fence to stay inside.

Its steps and waypoints name drones and strategies of that planner; they are no mission of an autopilot.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mission.documents.fence_areas import fence_plan, vertex
from mission.documents.flight_plan import Plan
from mission.documents.yaml_file import DocumentError
from mission.geometry.geofence import Vertex


def is_dragonfly(content: Mapping[str, Any]) -> bool:
    return "boundaries" in content or ("steps" in content and "waypoints" in content)


def parse_dragonfly(content: Mapping[str, Any], file: str) -> Plan:
    """The boundaries of a decoded Dragonfly mission as a fence."""
    boundaries = content.get("boundaries") or {}
    if not isinstance(boundaries, dict):
        raise DocumentError(file, "must be an object of named boundaries", field="boundaries")
    inclusion: list[tuple[Vertex, ...]] = []
    for name, points in boundaries.items():
        field = f"boundaries.{name}"
        if not isinstance(points, list):
            raise DocumentError(file, "a boundary is a list of points", field=field)
        corners = []
        for index, point in enumerate(points):
            if not isinstance(point, dict):
                raise DocumentError(
                    file, "a point is an object with longitude and latitude", field=f"{field}[{index}]"
                )
            corners.append(vertex(point.get("latitude"), point.get("longitude"), file, f"{field}[{index}]"))
        inclusion.append(tuple(corners))
    warnings = [
        f"{key}: not taken over: {len(content[key])} of Dragonfly's own; only boundaries are read"
        for key in ("steps", "waypoints")
        if content.get(key)
    ]
    warnings += [f"{key}: not read" for key in content if key not in ("steps", "waypoints", "boundaries")]
    return fence_plan(inclusion, (), warnings, file, "no boundary in this Dragonfly mission")
