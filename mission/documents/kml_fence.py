"""Fences drawn in Google Earth and other map programs: polygons of a KML file.

The outer boundary of every polygon includes, its inner boundaries exclude. Source: OGC KML 2.2, sections 10.8
(Polygon) and 16.9 (coordinates: longitude,latitude[,altitude]).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final
from xml.etree import ElementTree
from xml.parsers import expat

from mission.documents.fence_areas import NO_HEIGHTS, fence_plan, height, number, vertex
from mission.documents.flight_plan import Plan
from mission.documents.yaml_file import DocumentError
from mission.geometry.geofence import Vertex

_DEEPEST: Final = 100
_OTHERS: Final = frozenset(
    {"Point", "LineString", "LinearRing", "Track", "MultiTrack", "Model", "GroundOverlay", "NetworkLink"}
)
_SEPARATOR: Final = re.compile(r"\s+")


def parse_kml(text: str, file: str) -> Plan:
    """Read the polygons of a KML file as a fence. `DocumentError` names the placemark that is wrong."""
    root = _root(text, file)
    if _name(root) != "kml":
        raise DocumentError(
            file, f"XML, but no KML: its outermost element is <{_name(root)}>; save the area as KML"
        )
    inclusion: list[tuple[Vertex, ...]] = []
    exclusion: list[tuple[Vertex, ...]] = []
    warnings: list[str] = []
    heights = False
    for placemark, element in _shapes(root, file):
        if _name(element) != "Polygon":
            warnings.append(f"{placemark}: a {_name(element)} is no area and not taken over")
            continue
        outer = [ring for ring in element if _name(ring) == "outerBoundaryIs"]
        if len(outer) != 1:
            raise DocumentError(
                file, f"{placemark}: a polygon needs one outerBoundaryIs, here are {len(outer)}"
            )
        rings = [_ring(outer[0], file, placemark)]
        rings += [
            _ring(ring, file, f"{placemark}, inner boundary")
            for ring in element
            if _name(ring) == "innerBoundaryIs"
        ]
        places = [tuple(place for place, _ in ring) for ring in rings]
        inclusion.append(places[0])
        exclusion += places[1:]
        heights = heights or any(height_m for ring in rings for _, height_m in ring)
    if heights:
        warnings.append(NO_HEIGHTS)
    return fence_plan(
        inclusion, exclusion, warnings, file, "no polygon; draw the area as a polygon, not as a path"
    )


def _root(text: str, file: str) -> ElementTree.Element:
    # The text is decoded already: a declared encoding must not decode it again.
    text = re.sub(r"\A\s*<\?xml[^>]*\?>", "", text)
    try:
        _refuse_document_type(text, file)
        return ElementTree.fromstring(text)  # noqa: S314 (document types, and with them entities, are refused)
    except DocumentError:  # a ValueError, too
        raise
    except expat.ExpatError as error:
        raise DocumentError(file, f"not XML: {str(error).partition(':')[0]}", line=error.lineno) from error
    except (ElementTree.ParseError, RecursionError, ValueError) as error:
        raise DocumentError(file, f"not XML that can be read: {error}") from error


def _refuse_document_type(text: str, file: str) -> None:
    """One of the file's own, that is; web pages in the descriptions of placemarks are text."""

    def refuse(*_: object) -> None:
        raise DocumentError(
            file,
            "a KML file has no document type of its own (<!DOCTYPE …>); remove it",
            line=parser.CurrentLineNumber,
        )

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    parser.Parse(text, True)


def _name(element: ElementTree.Element) -> str:
    """The element's name without its namespace, of which KML has had several."""
    return str(element.tag).rpartition("}")[2]


def _shapes(
    element: ElementTree.Element, file: str, placemark: str = "", depth: int = 0
) -> Iterator[tuple[str, ElementTree.Element]]:
    """(name of its placemark, shape) of everything that is drawn."""
    if depth > _DEEPEST:
        raise DocumentError(file, "its elements are nested too deeply")
    for child in element:
        name = _name(child)
        if name == "Polygon" or name in _OTHERS:
            yield placemark or "a placemark", child
            continue
        inside = placemark
        if name == "Placemark":
            titles = [(one.text or "").strip() for one in child if _name(one) == "name"]
            inside = f"placemark {titles[0]!r}" if titles and titles[0] else "a placemark without a name"
        yield from _shapes(child, file, inside, depth + 1)


def _ring(boundary: ElementTree.Element, file: str, where: str) -> tuple[tuple[Vertex, float], ...]:
    """The vertices with their altitudes."""
    texts = [one.text or "" for one in boundary.iter() if _name(one) == "coordinates"]
    if len(texts) != 1:
        raise DocumentError(file, f"{where}: a boundary has one list of coordinates, here are {len(texts)}")
    found: list[tuple[Vertex, float]] = []
    for index, tuple_text in enumerate(_SEPARATOR.split(texts[0].strip()), 1):
        numbers = tuple_text.split(",")
        if len(numbers) not in (2, 3):
            raise DocumentError(
                file,
                f"{where}: point {index} is {tuple_text!r}; write longitude,latitude or longitude,latitude,altitude",
            )
        point = f"{where}: point {index}"
        place = vertex(number(numbers[1]), number(numbers[0]), file, point)
        found.append((place, height(number(numbers[2]), file, point) if len(numbers) == 3 else 0.0))
    return tuple(found)
