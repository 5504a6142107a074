"""ArduPilot's "QGC WPL 110" text: missions of Mission Planner, MAVProxy and QGroundControl, and their fences and
rally points where they were saved in the same form.

Source: the "File Formats" page of mavlink.io; what Mission Planner and MAVProxy write.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Final

import msgspec

from mission.documents.flight_plan import (
    AMSL_FRAMES,
    FRAMES,
    GLOBAL_FRAMES,
    RELATIVE_FRAMES,
    WAYPOINT,
    Parameters,
    Part,
    Plan,
    PlanItem,
    altitude_problem,
    item_problem,
)
from mission.documents.yaml_file import DocumentError
from mission.geometry.frames import Geodetic
from mission.geometry.geofence import WIDEST_M, Circle, Geofence, Vertex

WAYPOINT_HEADER: Final = "QGC WPL 110"
_INTEGER: Final = re.compile(r"-?[0-9]{1,9}(?:\.0{1,9})?", re.ASCII)
"""Some programs write whole numbers as 16.000000."""
_NUMBER: Final = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?", re.ASCII)
_RETURN_POINT: Final = 5000
_INCLUSION, _EXCLUSION, _ROUND_INCLUSION, _ROUND_EXCLUSION = 5001, 5002, 5003, 5004
_FENCE: Final = range(_RETURN_POINT, _ROUND_EXCLUSION + 1)
"""MAV_CMD_NAV_FENCE_…"""
_RALLY: Final = 5100
_FEWEST_VERTICES, _MOST_VERTICES = 3, 65535


class _Row(msgspec.Struct, frozen=True):
    """One line, with its place."""

    number: int
    line: int
    item: PlanItem


def is_waypoints(text: str) -> bool:
    """Whether the first line that says anything begins as these files do, of whatever version."""
    lines = _lines(text)
    return bool(lines) and [word.upper() for word in lines[0][1].split()[:2]] == WAYPOINT_HEADER.split()[:2]


def _lines(text: str) -> list[tuple[int, str]]:
    """The lines, with their numbers, without empty ones and comments."""
    lines = ((number, line.strip()) for number, line in enumerate(text.split("\n"), 1))
    return [(number, line) for number, line in lines if line and not line.startswith("#")]


def parse_waypoints(text: str, file: str) -> Plan:
    """Read "QGC WPL 110" text. Row 0 is home, as ArduPilot keeps it; fence and rally commands are a fence and rally
    points, of which a file may consist altogether; the others are the mission's items."""
    lines = _lines(text)
    if not lines or lines[0][1].split() != WAYPOINT_HEADER.split():
        found = f", not {lines[0][1]!r}: save the file again in a current ground station" if lines else ""
        raise DocumentError(
            file, f"the first line must be {WAYPOINT_HEADER!r}{found}", line=lines[0][0] if lines else 1
        )
    rows = [_row(line, index, file, number) for index, (number, line) in enumerate(lines[1:])]
    if not rows:
        raise DocumentError(file, "there is no waypoint; row 0 must be home")
    home = _home(rows[0], file)
    rest = rows if home is None else rows[1:]
    fence = [row for row in rest if row.item.command in _FENCE]
    rally = [row for row in rest if row.item.command == _RALLY]
    items = [row.item for row in rest if row.item.command not in _FENCE and row.item.command != _RALLY]
    holds: list[Part] = []
    if items or not (fence or rally):
        holds.append("mission")
    if fence:
        holds.append("fence")
    if rally:
        holds.append("rally")
    warnings = [
        f"row {row.number}: a point to return to at a fence is not taken over: copters have none"
        for row in fence
        if row.item.command == _RETURN_POINT
    ]
    return Plan(
        items=tuple(items),
        home=home,
        geofence=_geofence([row for row in fence if row.item.command != _RETURN_POINT], file),
        rally=tuple(_rally_point(row, home, file) for row in rally),
        holds=tuple(holds),
        warnings=tuple(warnings),
    )


def _row(line: str, index: int, file: str, number: int) -> _Row:
    fields = line.split()
    if len(fields) != 12:
        raise DocumentError(file, f"a waypoint has 12 fields, here are {len(fields)}", line=number)
    sequence, current, frame, command = (_integer(field, file, number) for field in fields[:4])
    values = [_number(field, file, number) for field in fields[4:11]]
    auto_continue = _integer(fields[11], file, number)
    if sequence != index:
        raise DocumentError(file, f"row {sequence} where row {index} was expected", line=number)
    for name, flag in (("2 (current)", current), ("12 (autocontinue)", auto_continue)):
        if flag not in (0, 1):
            raise DocumentError(file, f"row {index}: field {name} is 0 or 1, not {flag}", line=number)
    first, second, third, fourth, x, y, z = values
    item = PlanItem(
        command=command,
        frame=frame,
        params=(first, second, third, fourth, x, y, z),
        auto_continue=auto_continue == 1,
        jump_id=index,
    )
    problem = item_problem(item)
    if problem:
        raise DocumentError(file, f"{problem} (row {index})", line=number)
    return _Row(index, number, item)


def _integer(field: str, file: str, number: int) -> int:
    if not _INTEGER.fullmatch(field):
        raise DocumentError(
            file, f"a field is not a number: {field!r} where a whole one belongs", line=number
        )
    return int(field.partition(".")[0])


def _number(field: str, file: str, number: int) -> float | None:
    """A number; None for NaN, "the vehicle's default"."""
    if field.lower().lstrip("+-") == "nan":
        return None
    if field.lower().lstrip("+-") in ("inf", "infinity"):
        raise DocumentError(file, f"a parameter is infinite: {field!r}; write a number", line=number)
    if not _NUMBER.fullmatch(field):
        hint = f"; write {field.replace(',', '.')}" if _NUMBER.fullmatch(field.replace(",", ".", 1)) else ""
        raise DocumentError(file, f"a field is not a number: {field!r}{hint}", line=number)
    value = float(field)
    if math.isinf(value):
        raise DocumentError(file, f"a parameter is infinite: {field!r} is too large", line=number)
    return value


def _home(first: _Row, file: str) -> Geodetic | None:
    """Row 0 as the home position that it must be; None where the file is a fence or rally points without one."""
    item = first.item
    if item.command in _FENCE or item.command == _RALLY:
        return None
    # Mission Planner has written command 0 there too.
    if item.command not in (0, WAYPOINT) or item.frame not in AMSL_FRAMES or any(item.params[:4]):
        raise DocumentError(
            file,
            f"row 0 is not a home position but command {item.command} in frame {FRAMES[item.frame]} with parameters "
            f"{_words(item.params[:4])}: autopilots take row 0 for home and would lose it; put a row before it with "
            "the launch point (command 16, frame 0, parameters 0, altitude above the sea) and number the rows anew",
            line=first.line,
        )
    latitude_deg, longitude_deg, amsl_m = item.params[4:]
    if latitude_deg is None or longitude_deg is None or amsl_m is None:
        raise DocumentError(
            file, "row 0: home needs latitude, longitude and altitude as numbers", line=first.line
        )
    return Geodetic(latitude_deg, longitude_deg, amsl_m)


def _words(params: Sequence[float | None]) -> str:
    return ", ".join("NaN" if value is None else f"{value:g}" for value in params)


# --- fences and rally points in the same form ---


def _place(row: _Row, file: str) -> Vertex:
    latitude_deg, longitude_deg = row.item.params[4], row.item.params[5]
    if row.item.frame not in GLOBAL_FRAMES or latitude_deg is None or longitude_deg is None:
        raise DocumentError(
            file,
            f"row {row.number}: a fence or rally point needs latitude and longitude in a global frame, such as 3",
            line=row.line,
        )
    return latitude_deg, longitude_deg


def _geofence(rows: Sequence[_Row], file: str) -> Geofence | None:
    if not rows:
        return None
    polygons: dict[int, list[tuple[Vertex, ...]]] = {_INCLUSION: [], _EXCLUSION: []}
    circles: dict[int, list[Circle]] = {_ROUND_INCLUSION: [], _ROUND_EXCLUSION: []}
    index = 0
    while index < len(rows):
        row = rows[index]
        command, size = row.item.command, row.item.params[0]
        if command in circles:
            if size is None or not 0.0 < size <= WIDEST_M:
                raise DocumentError(
                    file,
                    f"row {row.number}: a fence circle's radius, its first parameter, must be above 0 m and at most "
                    f"{WIDEST_M / 1000.0:g} km",
                    line=row.line,
                )
            circles[command].append(Circle(*_place(row, file), size))
            index += 1
            continue
        count = _vertices(row, file)
        corners = rows[index : index + count]
        for corner in corners:
            if corner.item.command != command or corner.item.params[0] != size:
                raise DocumentError(
                    file,
                    f"row {corner.number}: the polygon of {count} vertices that begins in row {row.number} goes on "
                    "here; every vertex says the same number as its first parameter",
                    line=corner.line,
                )
        if len(corners) < count:
            raise DocumentError(
                file,
                f"row {row.number}: the fence polygon that begins here says {count} vertices, and {len(corners)} "
                "follow; correct its first parameter or add the rows",
                line=row.line,
            )
        polygons[command].append(tuple(_place(corner, file) for corner in corners))
        index += count
    return Geofence(
        tuple(polygons[_INCLUSION]),
        tuple(polygons[_EXCLUSION]),
        tuple(circles[_ROUND_INCLUSION]),
        tuple(circles[_ROUND_EXCLUSION]),
    )


def _vertices(row: _Row, file: str) -> int:
    count = row.item.params[0]
    if count is None or not count.is_integer() or not _FEWEST_VERTICES <= count <= _MOST_VERTICES:
        said = "NaN" if count is None else f"{count:g}"
        raise DocumentError(
            file,
            f"row {row.number}: a fence vertex says as its first parameter how many vertices its polygon has, "
            f"{_FEWEST_VERTICES} to {_MOST_VERTICES}; here it is {said}",
            line=row.line,
        )
    return int(count)


def _rally_point(row: _Row, home: Geodetic | None, file: str) -> Geodetic:
    """With its altitude over home, whatever frame it stands in."""
    latitude_deg, longitude_deg = _place(row, file)
    altitude_m = row.item.params[6]
    if altitude_m is None:
        raise DocumentError(file, f"row {row.number}: a rally point needs an altitude", line=row.line)
    if row.item.frame in AMSL_FRAMES and home is not None:
        altitude_m -= home.amsl_m
    elif row.item.frame not in RELATIVE_FRAMES:
        raise DocumentError(
            file,
            f"row {row.number}: a rally point's altitude is over home (frame 3), not in frame "
            f"{FRAMES[row.item.frame]}",
            line=row.line,
        )
    problem = altitude_problem(altitude_m)
    if problem:
        raise DocumentError(file, f"{problem} (row {row.number})", line=row.line)
    return Geodetic(latitude_deg, longitude_deg, altitude_m)


# --- writing ---


def waypoints_text(plan: Plan) -> str:
    """`plan` as "QGC WPL 110" text: home and the items, without fence and rally points. Needs a home."""
    if plan.home is None:
        raise ValueError("a waypoint file starts with home, and this plan has none")
    home = plan.home
    place: Parameters = (0.0, 0.0, 0.0, 0.0, home.latitude_deg, home.longitude_deg, home.amsl_m)
    rows = [PlanItem(command=WAYPOINT, frame=0, params=place), *plan.items]
    lines = [WAYPOINT_HEADER]
    for index, item in enumerate(rows):
        values = [str(math.nan if value is None else float(value)) for value in item.params]
        head = [str(index), str(int(index == 0)), str(item.frame), str(item.command)]
        lines.append("\t".join([*head, *values, str(int(item.auto_continue))]))
    return "\n".join(lines) + "\n"
