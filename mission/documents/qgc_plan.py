"""QGroundControl's mission files: today's .plan, and the .mission files and items of its older versions.

A plan is read into one flat list of mission items: survey patterns and other complex items are replaced by the
simple items that they carry. It is written so that reading gives the same plan again.

Sources: the "Plan File Format" page of QGroundControl's developer guide; files written by its versions 2.9 to 4.4.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final, TypeAlias

import msgspec

from mission.documents.fence_areas import ring
from mission.documents.flight_plan import Parameters, Plan, PlanItem, item_problem, place
from mission.documents.json_text import converted, json_object
from mission.documents.yaml_file import DocumentError
from mission.geometry.frames import Geodetic
from mission.geometry.geofence import WIDEST_M, Circle, Geofence, Vertex

Number: TypeAlias = float | None
Unset: TypeAlias = msgspec.UnsetType
_AGAIN: Final = "open the file in QGroundControl and save it again"
_EXPAND: Final = (
    "upload the plan from QGroundControl to a (simulated) vehicle, download it there and save that"
)


class _Item(msgspec.Struct, rename="camel"):
    type: str
    command: int | None = None
    frame: int | None = None
    params: tuple[Number, ...] | None = None
    auto_continue: bool = True
    do_jump_id: int = 0
    complex_item_type: str = ""
    altitude_mode: int | None = msgspec.field(default=None, name="AltitudeMode")
    transects: _Transects | None = msgspec.field(default=None, name="TransectStyleComplexItem")
    coordinate: tuple[Number, Number, Number] | None = None
    """Versions before 3.2 kept parameters 5 to 7 here, ..."""
    param1: Number | Unset = msgspec.UNSET
    """... and until 3.0 the others by name."""
    param2: Number | Unset = msgspec.UNSET
    param3: Number | Unset = msgspec.UNSET
    param4: Number | Unset = msgspec.UNSET
    id: int = 0


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


class _Fence(msgspec.Struct, rename="camel"):
    polygons: tuple[_Polygon, ...] = ()
    circles: tuple[_Circle, ...] = ()
    polygon: tuple[Vertex, ...] = ()
    """Version 1 of the format had this one polygon only, ..."""
    circle: Any = None
    """... and the autopilot's own circle about home, as a radius."""
    breach_return: Any = None


class _Rally(msgspec.Struct):
    points: tuple[tuple[float, float, float], ...] = ()


class _File(msgspec.Struct, rename="camel"):
    mission: _Mission
    file_type: str = ""
    version: int = 0
    geo_fence: _Fence | None = None
    rally_points: _Rally | None = None


_NOTES: Final = frozenset({"version", "groundStation", "fileType", "globalPlanAltitudeMode"})
_KNOWN: Final = {
    "": {"mission", "geoFence", "rallyPoints"},
    "mission": {
        "items", "plannedHomePosition", "cruiseSpeed", "hoverSpeed", "firmwareType", "vehicleType",
    },
    "item": {
        "type", "command", "frame", "params", "autoContinue", "doJumpId", "AltitudeMode", "Altitude",
        "AMSLAltAboveTerrain", "coordinate", "param1", "param2", "param3", "param4", "id", "MISSION_ITEM_ID",
        "altDifference", "altPercent", "azimuth", "distance", "isCurrentItem", "terrainPercent", "editorVersion",
    },
    "geoFence": {"polygons", "circles", "polygon", "circle", "breachReturn"},
    "area": {"polygon", "circle", "inclusion"},
    "rallyPoints": {"points"},
}  # fmt: skip
"""The keys that are read, or that say again what others say."""


def is_qgc(content: Mapping[str, Any]) -> bool:
    """Whether a JSON object is a file of QGroundControl's, of whatever kind."""
    return (
        "fileType" in content or content.get("groundStation") == "QGroundControl" or "complexItems" in content
    )


def parse_plan(text: str, file: str) -> Plan:
    """Read the text of a QGroundControl file. `DocumentError` names the place of what is wrong."""
    content = json_object(text, file)
    if not isinstance(content, dict) or not is_qgc(content):
        raise DocumentError(
            file, 'not a QGroundControl plan: it must be a JSON object with "fileType": "Plan"'
        )
    return plan_of(content, file)


def plan_of(content: dict[str, Any], file: str) -> Plan:
    """As `parse_plan`, from the decoded object, which `is_qgc`."""
    kind, version = content.get("fileType"), content.get("version")
    if kind == "Plan" and version == 1:
        return _plan(content, file)
    if kind == "Plan":
        raise DocumentError(file, f"plan version {version!r}; this software reads version 1", field="version")
    if kind == "Mission" or (kind is None and "items" in content):
        return _older_mission(content, file)
    raise DocumentError(
        file,
        f'not a QGroundControl plan: it holds {kind!r}, and what is read is "fileType": "Plan"; {_AGAIN} as a plan',
    )


def _plan(content: dict[str, Any], file: str) -> Plan:
    raw = converted(content, _File, file)
    mission = raw.mission
    warnings = list(_unread(content))
    fence = _fence(raw.geo_fence, file, warnings) if raw.geo_fence else None
    return Plan(
        items=_items(mission.items, file, "mission.items"),
        home=_home(mission.planned_home_position, file, "mission.plannedHomePosition"),
        geofence=fence,
        rally=tuple(
            _point(point, file, f"rallyPoints.points[{index}]")
            for index, point in enumerate(raw.rally_points.points if raw.rally_points else ())
        ),
        cruise_mps=mission.cruise_speed,
        hover_mps=mission.hover_speed,
        firmware_type=mission.firmware_type,
        vehicle_type=mission.vehicle_type,
        warnings=tuple(warnings),
    )


# --- before there were plans: .mission files, of missions only ---


class _OlderMission(msgspec.Struct, rename="camel"):
    items: tuple[_Item, ...]
    planned_home_position: _Item | tuple[float, float, float | None] | None = None
    firmware_type: int | None = None
    autopilot: int | None = msgspec.field(default=None, name="MAV_AUTOPILOT")
    complex_items: tuple[Any, ...] = ()


def _older_mission(content: dict[str, Any], file: str) -> Plan:
    raw = converted(content, _OlderMission, file)
    if raw.complex_items:
        raise DocumentError(
            file, f"survey patterns of an old version, which are no waypoints; {_AGAIN}", field="complexItems"
        )
    home = raw.planned_home_position
    if isinstance(home, _Item):
        home = _home_of_item(home, file)
    unknown = set(content) - _NOTES - {
        "items", "plannedHomePosition", "firmwareType", "MAV_AUTOPILOT", "complexItems", "vehicleType",
        "cruiseSpeed", "hoverSpeed",
    }  # fmt: skip
    return Plan(
        items=_items(raw.items, file, "items"),
        home=_home(home, file, "plannedHomePosition"),
        firmware_type=raw.firmware_type if raw.firmware_type is not None else raw.autopilot,
        holds=("mission",),
        warnings=(
            *(f"{key}: not read" for key in sorted(unknown)),
            *_unread_items(content.get("items", ()), "items"),
        ),
    )


def _home_of_item(item: _Item, file: str) -> tuple[float, float, float | None]:
    latitude_deg, longitude_deg, amsl_m = item.coordinate or (None, None, None)
    if latitude_deg is None or longitude_deg is None:
        raise DocumentError(
            file, "needs a coordinate of latitude, longitude and altitude", field="plannedHomePosition"
        )
    return latitude_deg, longitude_deg, amsl_m


# --- items ---


def _items(raw: Iterable[_Item], file: str, field: str) -> tuple[PlanItem, ...]:
    found: list[PlanItem] = []
    for index, item in enumerate(raw):
        found += _simple_items(item, file, f"{field}[{index}]")
    return tuple(found)


def _simple_items(item: _Item, file: str, field: str) -> Iterator[PlanItem]:
    if item.type == "ComplexItem":
        yield from _carried(item, file, field)
        return
    if item.type not in ("SimpleItem", "missionItem"):
        raise DocumentError(
            file, f'{item.type!r} is neither "SimpleItem" nor "ComplexItem"', field=f"{field}.type"
        )
    params = _params(item, file, field)
    if item.command is None or item.frame is None or params is None:
        raise DocumentError(file, "a simple item needs command, frame and 7 params", field=field)
    simple = PlanItem(
        command=item.command,
        frame=item.frame,
        params=params,
        auto_continue=item.auto_continue,
        jump_id=item.do_jump_id or item.id,
        altitude_mode=item.altitude_mode,
    )
    problem = item_problem(simple)
    if problem:
        raise DocumentError(file, problem, field=f"{field}.params")
    yield simple


def _carried(item: _Item, file: str, field: str) -> Iterator[PlanItem]:
    if item.complex_item_type == "StructureScan":
        raise DocumentError(
            file,
            "a structure scan: QGroundControl keeps its settings in the file and not its waypoints, and makes those "
            f"when it uploads; {_EXPAND}",
            field=field,
        )
    if item.transects is None or not item.transects.items:
        raise DocumentError(
            file,
            f"the complex item of type {item.complex_item_type!r} carries no simple items; in QGroundControl, "
            f"replace it by waypoints, or {_EXPAND}",
            field=field,
        )
    for index, inner in enumerate(item.transects.items):
        yield from _simple_items(inner, file, f"{field}.TransectStyleComplexItem.Items[{index}]")


def _params(item: _Item, file: str, field: str) -> Parameters | None:
    """Parameters 1 to 7, wherever the file's version keeps them."""
    named = (item.param1, item.param2, item.param3, item.param4)
    given = [value for value in named if not isinstance(value, Unset)]
    if given and item.params is None:
        if len(given) < len(named) or item.coordinate is None:
            raise DocumentError(file, "an item needs param1 to param4 and a coordinate", field=field)
        first: tuple[Number, ...] = tuple(given)
    elif item.params is None:
        return None
    else:
        first = item.params
    values = (*first, *item.coordinate) if item.coordinate is not None and len(first) == 4 else first
    if len(values) != 7:
        raise DocumentError(file, f"Expected `array` of length 7, got {len(first)}", field=f"{field}.params")
    one, two, three, four, x, y, z = values
    return one, two, three, four, x, y, z


def _point(values: tuple[float, float, float], file: str, field: str) -> Geodetic:
    try:
        return place(*values)
    except ValueError as error:
        raise DocumentError(file, str(error), field=field) from error


def _home(raw: tuple[float, float, float | None] | None, file: str, field: str) -> Geodetic | None:
    if raw is None:
        return None
    latitude_deg, longitude_deg, amsl_m = raw
    if amsl_m is None:
        raise DocumentError(
            file,
            "its altitude is null: QGroundControl did not know the ground there; write the metres above the sea",
            field=field,
        )
    return _point((latitude_deg, longitude_deg, amsl_m), file, field)


# --- fence ---


def _fence(raw: _Fence, file: str, warnings: list[str]) -> Geofence | None:
    if raw.circle is not None:
        raise DocumentError(
            file,
            "a circle about home, which old versions of QGroundControl set as a parameter of the autopilot; "
            "remove it, or draw it as a circular fence in a current QGroundControl and save the plan again",
            field="geoFence.circle",
        )
    if raw.breach_return is not None:
        warnings.append(
            "geoFence.breachReturn: not taken over: copters have no point to return to at a fence"
        )
    polygons = list(raw.polygons)
    if raw.polygon:
        polygons.append(_Polygon(raw.polygon))
    if not polygons and not raw.circles:
        return None
    for index, circle in enumerate(raw.circles):
        if not 0.0 < circle.circle.radius <= WIDEST_M:
            raise DocumentError(
                file,
                f"a radius must be above 0 m and at most {WIDEST_M / 1000.0:g} km; it is {circle.circle.radius:g} m",
                field=f"geoFence.circles[{index}].circle.radius",
            )

    def rounds(inclusion: bool) -> tuple[Circle, ...]:
        return tuple(
            Circle(*c.circle.center, c.circle.radius) for c in raw.circles if c.inclusion is inclusion
        )

    warnings += [
        f"geoFence polygon {index}: its last vertex is its first again and is left out"
        for index, polygon in enumerate(polygons)
        if ring(polygon.polygon) != polygon.polygon
    ]
    return Geofence(
        inclusion=tuple(ring(p.polygon) for p in polygons if p.inclusion),
        exclusion=tuple(ring(p.polygon) for p in polygons if not p.inclusion),
        inclusion_circles=rounds(inclusion=True),
        exclusion_circles=rounds(inclusion=False),
    )


# --- what is not read ---


def _unread(content: dict[str, Any]) -> Iterator[str]:
    """One sentence for every key that this reader does not know: it may mean something to whoever wrote it."""
    yield from _unknown(content, "", "")
    for name in ("mission", "geoFence", "rallyPoints"):
        yield from _unknown(content.get(name), name, name)
    yield from _unread_items(content["mission"]["items"], "mission.items")
    fence = content.get("geoFence") or {}
    for name in ("polygons", "circles"):
        for index, area in enumerate(fence.get(name) or ()):
            yield from _unknown(area, "area", f"geoFence.{name}[{index}]")


def _unread_items(items: Iterable[Any], field: str) -> Iterator[str]:
    for index, item in enumerate(items):
        if isinstance(item, dict) and item.get("type") != "ComplexItem":
            yield from _unknown(item, "item", f"{field}[{index}]")


def _unknown(content: Any, kind: str, field: str) -> Iterator[str]:
    if isinstance(content, dict):
        for key in content:
            if key not in _KNOWN[kind] and key not in _NOTES:
                yield f"{field}.{key}: not read: this software does not know it".removeprefix(".")


# --- writing ---


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
