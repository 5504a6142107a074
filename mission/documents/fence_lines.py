"""Fences and rally points as MAVProxy and Mission Planner wrote them before they used mission items.

A fence is lines of "latitude longitude": the point to return to, then the polygon, its first vertex again at the end.
A polygon of Mission Planner has no point to return to. Rally points are lines of
"RALLY latitude longitude altitude break_altitude land_direction flags".
"""

from __future__ import annotations

import re
from typing import Final

from mission.documents.fence_areas import fence_plan, number, vertex
from mission.documents.flight_plan import Plan, altitude_problem
from mission.documents.yaml_file import DocumentError
from mission.geometry.frames import Geodetic

_FEWEST: Final = 4
"""Three vertices and the first again."""
_FIRST_LINE: Final = re.compile(r"RALLY\s|[-+.0-9]+[\s,]+[-+.0-9]+\s*$", re.IGNORECASE)


def is_fence_lines(text: str) -> bool:
    lines = _lines(text)
    return bool(lines) and _FIRST_LINE.match(lines[0][1]) is not None


def parse_fence_lines(text: str, file: str) -> Plan:
    """Read a fence or rally points. `DocumentError` names the line that is wrong."""
    lines = _lines(text)
    if lines and lines[0][1].upper().startswith("RALLY"):
        return _rally(lines, file)
    points = []
    for row, line in lines:
        fields = line.split()
        if len(fields) != 2:
            raise DocumentError(
                file,
                f"a line of a fence is latitude and longitude, here are {len(fields)} fields"
                + ("; write a space between them, and points in the numbers" if "," in line else ""),
                line=row,
            )
        points.append(vertex(number(fields[0]), number(fields[1]), file, "a vertex", line=row))
    if len(points) > _FEWEST and points[-1] == points[1]:
        warning = (
            f"line {lines[0][0]}: the point to return to at this fence is not taken over: copters have none"
        )
        return fence_plan([points[1:]], (), [warning], file, "no fence")
    if len(points) >= _FEWEST and points[-1] == points[0]:
        return fence_plan([points], (), (), file, "no fence")
    raise DocumentError(
        file,
        "the polygon is not closed, so it cannot be told whether the first line is a vertex or the point to return "
        "to; end the file with the polygon's first vertex",
        line=lines[-1][0] if lines else None,
    )


def _lines(text: str) -> list[tuple[int, str]]:
    lines = ((number, line.strip()) for number, line in enumerate(text.split("\n"), 1))
    return [(number, line) for number, line in lines if line and not line.startswith("#")]


def _rally(lines: list[tuple[int, str]], file: str) -> Plan:
    points: list[Geodetic] = []
    warnings: list[str] = []
    for row, line in lines:
        fields = line.split()
        if len(fields) != 7 or fields[0].upper() != "RALLY":
            raise DocumentError(
                file,
                "a rally point is a line of RALLY and six numbers: latitude, longitude, altitude, …",
                line=row,
            )
        latitude_deg, longitude_deg = vertex(
            number(fields[1]), number(fields[2]), file, "a rally point", line=row
        )
        values = [number(field) for field in fields[3:]]
        numbers = [value for value in values if isinstance(value, float)]
        if len(numbers) < len(values):
            raise DocumentError(
                file, f"a rally point: not all of {' '.join(fields[3:])} are numbers", line=row
            )
        altitude_m, *others = numbers
        problem = altitude_problem(altitude_m)
        if problem:
            raise DocumentError(file, problem, line=row)
        if any(others):
            warnings.append(
                f"line {row}: break altitude, landing direction and flags are not taken over: they are for planes"
            )
        points.append(Geodetic(latitude_deg, longitude_deg, altitude_m))
    return Plan(rally=tuple(points), holds=("rally",), warnings=tuple(warnings))
