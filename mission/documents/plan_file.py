"""Plans in the ground stations' own files: QGroundControl's .plan (JSON) and ArduPilot's "QGC WPL 110" text.

A plan is read into one flat list of mission items: survey patterns and other complex items of a .plan are replaced
by the simple items that they carry. Both kinds are written back so that reading gives the same plan again.

Sources: the "Plan File Format" page of QGroundControl's developer guide, the "File Formats" page of mavlink.io.
"""

from __future__ import annotations

import math
import pathlib
import re
from typing import Any

import msgspec

from mission.documents.yaml_file import DocumentError, read_text
from mission.geometry.frames import Geodetic
from mission.geometry.geofence import Circle, Geofence, Vertex

WAYPOINT_HEADER = "QGC WPL 110"
_GLOBAL_FRAMES = frozenset({0, 3, 5, 6, 10, 11})
"""MAV_FRAMEs in which parameters 5 and 6 are latitude and longitude: GLOBAL*, with every kind of altitude."""
_WAYPOINT = 16
Parameters = tuple[
    float | None, float | None, float | None, float | None, float | None, float | None, float | None
]


class PlanItem(msgspec.Struct, frozen=True, kw_only=True):
    """One MAVLink mission item. None stands for NaN: "the vehicle's default"."""

    command: int
    """MAV_CMD."""
    frame: int
    """MAV_FRAME."""
    params: Parameters
    """Parameters 1 to 7; 5 and 6 are latitude_deg and longitude_deg and 7 an altitude in m in global frames."""
    auto_continue: bool = True
    jump_id: int = 0
    """The number by which DO_JUMP items of the same plan name this one."""
    altitude_mode: int | None = None
    """QGroundControl's note of how the altitude was entered; the frame is what counts."""


class Plan(msgspec.Struct, frozen=True, kw_only=True):
    items: tuple[PlanItem, ...] = ()
    home: Geodetic | None = None
    geofence: Geofence | None = None
    rally: tuple[Geodetic, ...] = ()
    """Rally points. Their `amsl_m` holds what the file holds: metres above home."""
    cruise_mps: float | None = None
    hover_mps: float | None = None
    firmware_type: int | None = None
    """MAV_AUTOPILOT."""
    vehicle_type: int | None = None
    """MAV_TYPE."""


def read_plan(path: str | pathlib.Path) -> Plan:
    """Read a .plan or waypoint file, whichever its content says. `DocumentError` tells what is wrong."""
    file, text = str(path), read_text(path)
    return parse_waypoints(text, file) if text.lstrip().startswith("QGC WPL") else parse_plan(text, file)


# --- QGroundControl's JSON ---


class _Item(msgspec.Struct, rename="camel"):
    type: str
    command: int | None = None
    frame: int | None = None
    params: Parameters | None = None
    auto_continue: bool = True
    do_jump_id: int = 0
    complex_item_type: str = ""
    altitude_mode: int | None = msgspec.field(default=None, name="AltitudeMode")
    transects: _Transects | None = msgspec.field(default=None, name="TransectStyleComplexItem")


class _Transects(msgspec.Struct):
    items: tuple[_Item, ...] = msgspec.field(default=(), name="Items")


class _Mission(msgspec.Struct, rename="camel"):
    items: tuple[_Item, ...]
    planned_home_position: tuple[float, float, float | None] | None = None
    cruise_speed: float | None = None
    hover_speed: float | None = None
    firmware_type: int | None = None
    vehicle_type: int | None = None


class _Polygon(msgspec.Struct):
    polygon: tuple[Vertex, ...]
    inclusion: bool = True


class _Round(msgspec.Struct):
    center: Vertex
    radius: float


class _Circle(msgspec.Struct):
    circle: _Round
    inclusion: bool = True


class _Fence(msgspec.Struct):
    polygons: tuple[_Polygon, ...] = ()
    circles: tuple[_Circle, ...] = ()
    polygon: tuple[Vertex, ...] = ()
    """Version 1 of the format had this one polygon only."""


class _Rally(msgspec.Struct):
    points: tuple[tuple[float, float, float], ...] = ()


class _File(msgspec.Struct, rename="camel"):
    mission: _Mission
    file_type: str = ""
    version: int = 0
    geo_fence: _Fence | None = None
    rally_points: _Rally | None = None


def parse_plan(text: str, file: str) -> Plan:
    """Read the text of a QGroundControl .plan file. `DocumentError` names the place of what is wrong."""
    try:
        kind = msgspec.json.decode(text)
        if not isinstance(kind, dict) or kind.get("fileType") != "Plan":
            raise DocumentError(
                file, 'not a QGroundControl plan: it must be a JSON object with "fileType": "Plan"'
            )
        if kind.get("version") != 1:
            raise DocumentError(
                file, f"plan version {kind.get('version')!r}; this software reads version 1", field="version"
            )
        raw = msgspec.json.decode(text, type=_File)
    except msgspec.ValidationError as error:
        problem, _, where = str(error).partition(" - at `$.")
        field = where.rstrip("`") or None
        raise DocumentError(file, problem, field=field) from error
    except msgspec.DecodeError as error:
        position = re.search(r"byte (\d+)", str(error))
        line = text.encode().count(b"\n", 0, int(position[1])) + 1 if position else None
        raise DocumentError(file, f"not JSON: {error}", line=line) from error
    items: list[PlanItem] = []
    for index, item in enumerate(raw.mission.items):
        items += _simple_items(item, file, f"mission.items[{index}]")
    mission = raw.mission
    return Plan(
        items=tuple(items),
        home=_home(mission, file),
        geofence=_fence(raw.geo_fence, file) if raw.geo_fence else None,
        rally=tuple(
            _point(point, file, f"rallyPoints.points[{index}]")
            for index, point in enumerate(raw.rally_points.points if raw.rally_points else ())
        ),
        cruise_mps=mission.cruise_speed,
        hover_mps=mission.hover_speed,
        firmware_type=mission.firmware_type,
        vehicle_type=mission.vehicle_type,
    )


def _simple_items(item: _Item, file: str, field: str) -> list[PlanItem]:
    if item.type == "ComplexItem":
        if item.transects is None or not item.transects.items:
            raise DocumentError(
                file,
                f"the complex item of type {item.complex_item_type!r} carries no simple items; in "
                "QGroundControl, replace it by waypoints",
                field=field,
            )
        return [
            simple
            for index, inner in enumerate(item.transects.items)
            for simple in _simple_items(inner, file, f"{field}.TransectStyleComplexItem.Items[{index}]")
        ]
    if item.type != "SimpleItem":
        raise DocumentError(
            file, f'{item.type!r} is neither "SimpleItem" nor "ComplexItem"', field=f"{field}.type"
        )
    if item.command is None or item.frame is None or item.params is None:
        raise DocumentError(file, "a simple item needs command, frame and 7 params", field=field)
    simple = PlanItem(
        command=item.command,
        frame=item.frame,
        params=item.params,
        auto_continue=item.auto_continue,
        jump_id=item.do_jump_id,
        altitude_mode=item.altitude_mode,
    )
    problem = _item_problem(simple)
    if problem:
        raise DocumentError(file, problem, field=f"{field}.params")
    return [simple]


def _item_problem(item: PlanItem) -> str | None:
    if any(value is not None and math.isinf(value) for value in item.params):
        return "a parameter is infinite"
    latitude_deg, longitude_deg = item.params[4], item.params[5]
    if item.frame in _GLOBAL_FRAMES:
        if latitude_deg is not None and abs(latitude_deg) > 90.0:
            return f"latitude {latitude_deg} is not within -90 to 90 degrees"
        if longitude_deg is not None and abs(longitude_deg) > 180.0:
            return f"longitude {longitude_deg} is not within -180 to 180 degrees"
    return None


def _point(values: tuple[float, float, float], file: str, field: str) -> Geodetic:
    try:
        return Geodetic(*values)
    except ValueError as error:
        raise DocumentError(file, str(error), field=field) from error


def _home(mission: _Mission, file: str) -> Geodetic | None:
    if mission.planned_home_position is None:
        return None
    latitude_deg, longitude_deg, amsl_m = mission.planned_home_position
    return _point((latitude_deg, longitude_deg, amsl_m or 0.0), file, "mission.plannedHomePosition")


def _fence(raw: _Fence, file: str) -> Geofence | None:
    polygons = list(raw.polygons)
    if raw.polygon:
        polygons.append(_Polygon(raw.polygon))
    if not polygons and not raw.circles:
        return None
    for index, circle in enumerate(raw.circles):
        if not circle.circle.radius > 0.0:
            raise DocumentError(
                file, "a radius must be above 0 m", field=f"geoFence.circles[{index}].circle.radius"
            )

    def rounds(inclusion: bool) -> tuple[Circle, ...]:
        return tuple(
            Circle(*c.circle.center, c.circle.radius) for c in raw.circles if c.inclusion is inclusion
        )

    return Geofence(
        inclusion=tuple(p.polygon for p in polygons if p.inclusion),
        exclusion=tuple(p.polygon for p in polygons if not p.inclusion),
        inclusion_circles=rounds(inclusion=True),
        exclusion_circles=rounds(inclusion=False),
    )


def plan_text(plan: Plan) -> str:
    """`plan` as a QGroundControl .plan file."""
    fence = plan.geofence or Geofence()
    home = plan.home
    mission: dict[str, Any] = {
        "version": 2,
        "firmwareType": plan.firmware_type if plan.firmware_type is not None else 0,
        "vehicleType": plan.vehicle_type if plan.vehicle_type is not None else 2,
        "globalPlanAltitudeMode": 1,
        "items": [_item_object(item) for item in plan.items],
    }
    if home is not None:
        mission["plannedHomePosition"] = [home.latitude_deg, home.longitude_deg, home.amsl_m]
    if plan.cruise_mps is not None:
        mission["cruiseSpeed"] = plan.cruise_mps
    if plan.hover_mps is not None:
        mission["hoverSpeed"] = plan.hover_mps
    areas = [(vertices, True) for vertices in fence.inclusion]
    areas += [(vertices, False) for vertices in fence.exclusion]
    rounds = [(circle, True) for circle in fence.inclusion_circles]
    rounds += [(circle, False) for circle in fence.exclusion_circles]
    document = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "mission": mission,
        "geoFence": {
            "version": 2,
            "polygons": [
                {"version": 1, "inclusion": inclusion, "polygon": vertices} for vertices, inclusion in areas
            ],
            "circles": [
                {
                    "version": 1,
                    "inclusion": inclusion,
                    "circle": {
                        "center": [circle.latitude_deg, circle.longitude_deg],
                        "radius": circle.radius_m,
                    },
                }
                for circle, inclusion in rounds
            ],
        },
        "rallyPoints": {
            "version": 2,
            "points": [[point.latitude_deg, point.longitude_deg, point.amsl_m] for point in plan.rally],
        },
    }
    return msgspec.json.format(msgspec.json.encode(document), indent=4).decode() + "\n"


def _item_object(item: PlanItem) -> dict[str, Any]:
    found: dict[str, Any] = {
        "type": "SimpleItem",
        "command": item.command,
        "frame": item.frame,
        "params": item.params,
        "autoContinue": item.auto_continue,
        "doJumpId": item.jump_id,
    }
    if item.altitude_mode is not None:
        # QGroundControl wants the three together.
        found |= {
            "AltitudeMode": item.altitude_mode,
            "Altitude": item.params[6],
            "AMSLAltAboveTerrain": None,
        }
    return found


# --- ArduPilot's text ---


def parse_waypoints(text: str, file: str) -> Plan:
    """Read "QGC WPL 110" text. Its row 0 is home, as ArduPilot keeps it; the others are the items."""
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), 1)]
    lines = [(number, line) for number, line in lines if line and not line.startswith("#")]
    if not lines or lines[0][1].split() != WAYPOINT_HEADER.split():
        raise DocumentError(file, f"the first line must be {WAYPOINT_HEADER!r}", line=1)
    rows = [_row(line, index, file, number) for index, (number, line) in enumerate(lines[1:])]
    if not rows:
        raise DocumentError(file, "there is no waypoint; row 0 must be home")
    latitude_deg, longitude_deg, amsl_m = (value or 0.0 for value in rows[0].params[4:7])
    return Plan(
        items=tuple(rows[1:]),
        home=_point((latitude_deg, longitude_deg, amsl_m), file, "row 0"),
    )


def _row(line: str, index: int, file: str, number: int) -> PlanItem:
    fields = line.split()
    if len(fields) != 12:
        raise DocumentError(file, f"a waypoint has 12 fields, here are {len(fields)}", line=number)
    try:
        sequence, _, frame, command = (int(field) for field in fields[:4])
        values = [float(field) for field in fields[4:11]]
        auto_continue = int(fields[11]) != 0
    except ValueError as error:
        raise DocumentError(file, f"a field is not a number: {error}", line=number) from error
    if sequence != index:
        raise DocumentError(file, f"row {sequence} where row {index} was expected", line=number)
    first, second, third, fourth, x, y, z = (None if math.isnan(value) else value for value in values)
    item = PlanItem(
        command=command,
        frame=frame,
        params=(first, second, third, fourth, x, y, z),
        auto_continue=auto_continue,
        jump_id=index,
    )
    problem = _item_problem(item)
    if problem:
        raise DocumentError(file, problem, line=number)
    return item


def waypoints_text(plan: Plan) -> str:
    """`plan` as "QGC WPL 110" text: home and the items, without fence and rally points. Needs a home."""
    if plan.home is None:
        raise ValueError("a waypoint file starts with home, and this plan has none")
    home = plan.home
    place: Parameters = (0.0, 0.0, 0.0, 0.0, home.latitude_deg, home.longitude_deg, home.amsl_m)
    rows = [PlanItem(command=_WAYPOINT, frame=0, params=place), *plan.items]
    lines = [WAYPOINT_HEADER]
    for index, item in enumerate(rows):
        values = [str(math.nan if value is None else float(value)) for value in item.params]
        head = [str(index), str(int(index == 0)), str(item.frame), str(item.command)]
        lines.append("\t".join([*head, *values, str(int(item.auto_continue))]))
    return "\n".join(lines) + "\n"
