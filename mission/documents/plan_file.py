"""Files with missions, geofences and rally points, whichever program wrote them: read by what they contain."""

from __future__ import annotations

import pathlib
from typing import Any, Final

import msgspec

from mission.documents.dragonfly_mission import is_dragonfly, parse_dragonfly
from mission.documents.fence_lines import is_fence_lines, parse_fence_lines
from mission.documents.flight_plan import Plan, PlanItem
from mission.documents.geojson_fence import is_geojson, parse_geojson
from mission.documents.json_text import json_object
from mission.documents.kml_fence import parse_kml
from mission.documents.printable import printable
from mission.documents.qgc_plan import is_qgc, parse_plan, plan_of
from mission.documents.qgc_text import plan_text
from mission.documents.waypoint_text import is_waypoints, parse_waypoints, waypoints_text
from mission.documents.yaml_file import DocumentError, read_text
from mission.geometry.geofence import Geofence

__all__ = [
    "FORMATS",
    "Plan",
    "PlanItem",
    "parse_any",
    "parse_plan",
    "parse_waypoints",
    "plan_text",
    "read_fence",
    "read_plan",
    "waypoints_text",
]

FORMATS: Final = (
    "QGroundControl plans and missions (.plan, .mission), QGC WPL 110 (.waypoints, .txt), fences and rally points of "
    "MAVProxy and Mission Planner (.txt, .fen, .poly, .ral), KML, GeoJSON and Dragonfly missions"
)
_JSON: Final = ((is_qgc, plan_of), (is_geojson, parse_geojson), (is_dragonfly, parse_dragonfly))


def read_plan(path: str | pathlib.Path) -> Plan:
    """Read a file, whichever format its content says. `DocumentError` tells what is wrong."""
    return parse_any(read_text(path), str(path))


def read_fence(path: str | pathlib.Path) -> tuple[Geofence, tuple[str, ...]]:
    """The geofence of a file of any format, fit to be flown in, and what was not taken over."""
    plan = read_plan(path)
    if plan.geofence is None:
        raise DocumentError(str(path), "there is no geofence in this file; draw one and save it again")
    for problem in plan.geofence.problems():
        raise DocumentError(str(path), problem, field="geoFence")
    return plan.geofence, plan.warnings


def parse_any(text: str, file: str) -> Plan:
    """As `read_plan`, from the text of the file named `file`."""
    plan = _parsed(text, file)
    # They name what stands in the file, whatever that is.
    return msgspec.structs.replace(plan, warnings=tuple(map(printable, plan.warnings)))


def _parsed(text: str, file: str) -> Plan:
    start = text.lstrip()
    if is_waypoints(text):
        return parse_waypoints(text, file)
    if start.startswith("<"):
        return parse_kml(text, file)
    if start.startswith(("{", "[", "//", "/*")):
        return _of_json(json_object(text, file), file)
    if is_fence_lines(text):
        return parse_fence_lines(text, file)
    raise DocumentError(file, f"not a plan, fence or rally file of a known format; what is read: {FORMATS}")


def _of_json(content: Any, file: str) -> Plan:
    if isinstance(content, dict):
        for recognises, reader in _JSON:
            if recognises(content):
                return reader(content, file)
    raise DocumentError(
        file,
        "JSON, but not a QGroundControl plan, no GeoJSON and no Dragonfly mission; is it the right file?",
    )
