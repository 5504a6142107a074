"""Files with missions, geofences and rally points, whichever program wrote them: read by what they contain."""

from __future__ import annotations

import pathlib

from mission.documents.flight_plan import Plan, PlanItem
from mission.documents.qgc_plan import parse_plan, plan_text
from mission.documents.waypoint_text import parse_waypoints, waypoints_text
from mission.documents.yaml_file import read_text

__all__ = ["Plan", "PlanItem", "parse_plan", "parse_waypoints", "plan_text", "read_plan", "waypoints_text"]


def read_plan(path: str | pathlib.Path) -> Plan:
    """Read a file, whichever format its content says. `DocumentError` tells what is wrong."""
    file, text = str(path), read_text(path)
    return parse_waypoints(text, file) if text.lstrip().startswith("QGC WPL") else parse_plan(text, file)
