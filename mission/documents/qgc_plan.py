"""QGroundControl's mission files: today's .plan, and the .mission files and items of its older versions.

A plan is read into one flat list of mission items: survey patterns and other complex items are replaced by the
simple items that they carry.

Sources: the "Plan File Format" page of QGroundControl's developer guide; files written by its versions 2.9 to 4.4.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final

import msgspec

from mission.documents.fence_areas import ring
from mission.documents.flight_plan import Plan, place
from mission.documents.json_text import converted, json_object
from mission.documents.qgc_items import QgcItem, items_of
from mission.documents.yaml_file import DocumentError
from mission.geometry.frames import Geodetic
from mission.geometry.geofence import WIDEST_M, Circle, Geofence, Vertex

_AGAIN: Final = "open the file in QGroundControl and save it again"


class _Mission(msgspec.Struct, rename="camel"):
    items: tuple[QgcItem, ...]
    planned_home_position: tuple[float, float, float | None] | None = None
    cruise_speed: float | None = None
    hover_speed: float | None = None
    firmware_type: int | None = None
    vehicle_type: int | None = None
    version: int = 2


class _Polygon(msgspec.Struct):
    polygon: tuple[Vertex, ...]
    inclusion: bool | None = None
    version: int = 1


class _Round(msgspec.Struct):
    center: Vertex
    radius: float


class _Circle(msgspec.Struct):
    circle: _Round
    inclusion: bool | None = None
    version: int = 1


class _Fence(msgspec.Struct, rename="camel"):
    polygons: tuple[_Polygon, ...] = ()
    circles: tuple[_Circle, ...] = ()
    polygon: tuple[Vertex, ...] = ()
    """Version 1 of the format had this one polygon only, ..."""
    circle: Any = None
    """... and the autopilot's own circle about home, as a radius."""
    breach_return: Any = None
    version: int = 2


class _Rally(msgspec.Struct):
    version: int = 2
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
    _check_versions(raw, file)
    warnings = list(_unread(content))
    fence = _fence(raw.geo_fence, file, warnings) if raw.geo_fence else None
    return Plan(
        items=items_of(mission.items, file, "mission.items"),
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


def _check_versions(raw: _File, file: str) -> None:
    parts = [("mission", raw.mission.version, 2)]
    if raw.geo_fence is not None:
        fence = raw.geo_fence
        parts.append(("geoFence", fence.version, 2))
        parts += [(f"geoFence.polygons[{i}]", area.version, 1) for i, area in enumerate(fence.polygons)]
        parts += [(f"geoFence.circles[{i}]", area.version, 1) for i, area in enumerate(fence.circles)]
    if raw.rally_points is not None:
        parts.append(("rallyPoints", raw.rally_points.version, 2))
    for field, version, newest in parts:
        if not 1 <= version <= newest:
            raise DocumentError(
                file,
                f"version {version}; this software reads versions up to {newest}",
                field=f"{field}.version",
            )


# --- before there were plans: .mission files, of missions only ---


class _OlderMission(msgspec.Struct, rename="camel"):
    items: tuple[QgcItem, ...]
    planned_home_position: QgcItem | tuple[float, float, float | None] | None = None
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
    if isinstance(home, QgcItem):
        home = _home_of_item(home, file)
    unknown = set(content) - _NOTES - {
        "items", "plannedHomePosition", "firmwareType", "MAV_AUTOPILOT", "complexItems", "vehicleType",
        "cruiseSpeed", "hoverSpeed",
    }  # fmt: skip
    return Plan(
        items=items_of(raw.items, file, "items"),
        home=_home(home, file, "plannedHomePosition"),
        firmware_type=raw.firmware_type if raw.firmware_type is not None else raw.autopilot,
        holds=("mission",),
        warnings=(
            *(f"{key}: not read" for key in sorted(unknown)),
            *_unread_items(content.get("items", ()), "items"),
        ),
    )


def _home_of_item(item: QgcItem, file: str) -> tuple[float, float, float | None]:
    latitude_deg, longitude_deg, amsl_m = item.coordinate or (None, None, None)
    if latitude_deg is None or longitude_deg is None:
        raise DocumentError(
            file, "needs a coordinate of latitude, longitude and altitude", field="plannedHomePosition"
        )
    return latitude_deg, longitude_deg, amsl_m


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
        polygons.append(_Polygon(raw.polygon, inclusion=True))
    if not polygons and not raw.circles:
        return None
    for index, circle in enumerate(raw.circles):
        if not 0.0 < circle.circle.radius <= WIDEST_M:
            raise DocumentError(
                file,
                f"a radius must be above 0 m and at most {WIDEST_M / 1000.0:g} km; it is {circle.circle.radius:g} m",
                field=f"geoFence.circles[{index}].circle.radius",
            )

    kinds = [(f"polygons[{index}]", polygon.inclusion) for index, polygon in enumerate(raw.polygons)]
    kinds += [(f"circles[{index}]", circle.inclusion) for index, circle in enumerate(raw.circles)]
    for field, inclusion in kinds:
        if inclusion is None:
            raise DocumentError(
                file,
                "is missing; write true for an area to stay inside of, false for one to stay out of",
                field=f"geoFence.{field}.inclusion",
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
