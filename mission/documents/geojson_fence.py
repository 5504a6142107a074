"""Fences from geographic information systems: the polygons of a GeoJSON file.

The first ring of a polygon includes, the others exclude, as holes do. A feature with the property
`"inclusion": false` or `"exclusion": true` is the other way round: an area to stay out of. Source: RFC 7946.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

import msgspec

from mission.documents.fence_areas import NO_HEIGHTS, fence_plan, height, vertex
from mission.documents.flight_plan import Plan
from mission.documents.yaml_file import DocumentError
from mission.geometry.geofence import Vertex

TYPES: Final = (
    "Point", "MultiPoint", "LineString", "MultiLineString", "Polygon", "MultiPolygon", "GeometryCollection",
    "Feature", "FeatureCollection",
)  # fmt: skip
_WGS84: Final = ("CRS84", "EPSG::4326", "EPSG:4326")


class _Area(msgspec.Struct, frozen=True):
    rings: Any
    inclusion: bool
    where: str


def is_geojson(content: Mapping[str, Any]) -> bool:
    return content.get("type") in TYPES


def parse_geojson(content: Mapping[str, Any], file: str) -> Plan:
    """The polygons of a decoded GeoJSON object as a fence. `DocumentError` names the feature that is wrong."""
    inclusion: list[tuple[Vertex, ...]] = []
    exclusion: list[tuple[Vertex, ...]] = []
    warnings: list[str] = []
    heights = False
    for area in _areas(content, file, "", True, warnings):
        if not isinstance(area.rings, list) or not area.rings:
            raise DocumentError(file, "a polygon is a list of rings, and there is none", field=area.where)
        given = [_ring(ring, file, f"{area.where}[{index}]") for index, ring in enumerate(area.rings)]
        heights = heights or any(height_m for ring in given for _, height_m in ring)
        rings = [tuple(place for place, _ in ring) for ring in given]
        if not area.inclusion and len(rings) > 1:
            raise DocumentError(
                file, "an area to stay out of has a hole; draw it as several polygons", field=area.where
            )
        (inclusion if area.inclusion else exclusion).append(rings[0])
        exclusion += rings[1:]
    if heights:
        warnings.append(NO_HEIGHTS)
    return fence_plan(inclusion, exclusion, warnings, file, "no Polygon and no MultiPolygon in it")


def _check_reference_system(content: Mapping[str, Any], file: str, path: str) -> None:
    """Old GeoJSON may name another, for any of its objects; the numbers would then be metres of some map."""
    system = content.get("crs")
    if system is not None and not str(system).rstrip("'}\"").endswith(_WGS84):
        raise DocumentError(
            file, "not WGS 84 degrees; export it with the coordinate system EPSG:4326", field=_at(path, "crs")
        )


def _areas(value: Any, file: str, path: str, inclusion: bool, warnings: list[str]) -> Iterator[_Area]:
    if not isinstance(value, dict) or value.get("type") not in TYPES:
        raise DocumentError(
            file,
            "no GeoJSON object: its type must be Feature, FeatureCollection or a geometry",
            field=path or None,
        )
    _check_reference_system(value, file, path)
    kind = value["type"]
    if kind == "FeatureCollection" or kind == "GeometryCollection":
        key = "features" if kind == "FeatureCollection" else "geometries"
        members = value.get(key)
        if not isinstance(members, list):
            raise DocumentError(file, f"a {kind} needs a list of {key}", field=_at(path, key))
        for index, member in enumerate(members):
            yield from _areas(member, file, f"{_at(path, key)}[{index}]", inclusion, warnings)
    elif kind == "Feature":
        if value.get("geometry") is None:
            warnings.append(f"{path or 'the feature'}: it has no geometry")
            return
        included = _inclusion(value.get("properties"), file, path)
        yield from _areas(value["geometry"], file, _at(path, "geometry"), included, warnings)
    elif kind == "Polygon":
        yield _Area(value.get("coordinates"), inclusion, _at(path, "coordinates"))
    elif kind == "MultiPolygon":
        polygons = value.get("coordinates")
        if not isinstance(polygons, list):
            raise DocumentError(file, "a MultiPolygon is a list of polygons", field=_at(path, "coordinates"))
        for index, rings in enumerate(polygons):
            yield _Area(rings, inclusion, f"{_at(path, 'coordinates')}[{index}]")
    else:
        warnings.append(f"{path or 'the file'}: a {kind} is no area and not taken over")


def _at(path: str, key: str) -> str:
    return f"{path}.{key}" if path else key


def _inclusion(properties: Any, file: str, path: str) -> bool:
    said: dict[str, bool] = {}
    for name in ("inclusion", "exclusion"):
        given = properties.get(name) if isinstance(properties, dict) and name in properties else ...
        if isinstance(given, bool):
            said[name] = given
        elif given is not ...:
            raise DocumentError(
                file, f"is {given!r}; write true or false", field=f"{_at(path, 'properties')}.{name}"
            )
    if len(said) > 1 and said["inclusion"] == said["exclusion"]:
        raise DocumentError(
            file, "inclusion and exclusion say two things; write one of them", field=_at(path, "properties")
        )
    return said.get("inclusion", not said.get("exclusion", False))


def _ring(points: Any, file: str, where: str) -> tuple[tuple[Vertex, float], ...]:
    """The vertices with their altitudes."""
    if not isinstance(points, list):
        raise DocumentError(file, "a ring is a list of [longitude, latitude]", field=where)
    found = []
    for index, point in enumerate(points):
        if not isinstance(point, list) or len(point) not in (2, 3):
            raise DocumentError(file, "a point is [longitude, latitude]", field=f"{where}[{index}]")
        at = f"{where}[{index}]"
        height_m = height(point[2], file, at) if len(point) == 3 else 0.0
        found.append((vertex(point[1], point[0], file, at), height_m))
    return tuple(found)
