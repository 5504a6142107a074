"""Fences and rally points of programs that know no missions: read by their content, nothing lost without a word."""

from __future__ import annotations

import json
import pathlib
from typing import Any

import pytest

from mission.documents.flight_plan import Plan
from mission.documents.plan_file import parse_any, read_fence, read_plan
from mission.documents.yaml_file import DocumentError
from mission.geometry.frames import Geodetic

CASES = pathlib.Path(__file__).parents[3] / "data" / "cases"
TRIANGLE = ((47.397, 8.544), (47.397, 8.5465), (47.399, 8.5465))
SQUARE = (*TRIANGLE, (47.399, 8.544))


@pytest.mark.parametrize(
    ("file", "polygon", "warnings"),
    [
        ("fence.kml", TRIANGLE, ()),
        ("fence.geojson", TRIANGLE, ()),
        ("dragonfly.mission", TRIANGLE, ("steps: not taken over", "waypoints: not taken over")),
        ("w07_oldfence.txt", SQUARE, ("line 1: the point to return to",)),
        ("w05_fence5001.txt", SQUARE, ()),
    ],
)
def test_every_program_s_fence_is_read(
    file: str, polygon: tuple[tuple[float, float], ...], warnings: tuple[str, ...]
) -> None:
    fence, told = read_fence(CASES / file)
    assert (fence.inclusion, fence.exclusion) == ((polygon,), ())
    assert len(told) == len(warnings)
    assert all(one.startswith(words) for one, words in zip(told, warnings, strict=True))
    plan = read_plan(CASES / file)
    assert (plan.items, plan.rally, plan.holds) == ((), (), ("fence",))


def test_a_file_without_a_fence_is_no_fence() -> None:
    with pytest.raises(DocumentError, match=r"p03_plane_simple\.plan: there is no geofence"):
        read_fence(CASES / "p03_plane_simple.plan")
    with pytest.raises(DocumentError, match=r"p06_bowtie\.plan: geoFence: .*cross"):
        read_fence(CASES / "p06_bowtie.plan")


# --- KML ---

RING = "<LinearRing><coordinates>{}</coordinates></LinearRing>"
OUTER = "8.544,47.397 8.5465,47.397 8.5465,47.399 8.544,47.397"
INNER = "8.546,47.3975,0 8.5462,47.3975,0 8.5462,47.3978,0 8.546,47.3975,0"


def kml(body: str, head: str = '<kml xmlns="http://www.opengis.net/kml/2.2">') -> Plan:
    return parse_any(
        f'<?xml version="1.0" encoding="UTF-8"?>\n{head}<Document>{body}</Document></kml>', "a.kml"
    )


def polygon(outer: str = OUTER, inner: str = "") -> str:
    hole = f"<innerBoundaryIs>{RING.format(inner)}</innerBoundaryIs>" if inner else ""
    return f"<Polygon><outerBoundaryIs>{RING.format(outer)}</outerBoundaryIs>{hole}</Polygon>"


def test_a_hole_of_a_polygon_excludes() -> None:
    plan = kml(f"<Placemark><name>crater</name>{polygon(inner=INNER)}</Placemark>")
    assert plan.geofence is not None
    assert plan.geofence.inclusion == (TRIANGLE,)
    assert plan.geofence.exclusion == (((47.3975, 8.546), (47.3975, 8.5462), (47.3978, 8.5462)),)


@pytest.mark.parametrize(
    "head",
    [
        "<kml>",
        '<kml xmlns="http://earth.google.com/kml/2.1">',
        '<k:kml xmlns:k="http://www.opengis.net/kml/2.2">',
    ],
)
def test_namespaces_differ(head: str) -> None:
    prefix = "k:" if ":kml" in head else ""
    body = f"<Document><Placemark>{polygon()}</Placemark></Document></kml>"
    if prefix:
        body = body.replace("</", "\0").replace("<", f"<{prefix}").replace("\0", f"</{prefix}")
    assert parse_any(head + body, "a.kml").geofence is not None


def test_all_polygons_of_folders_and_collections_are_read_and_other_shapes_told() -> None:
    plan = kml(
        f"<Folder><Placemark><MultiGeometry>{polygon()}{polygon(INNER)}</MultiGeometry></Placemark></Folder>"
        f"<Placemark><name>way</name><LineString><coordinates>1,2 3,4</coordinates></LineString></Placemark>"
        "<NetworkLink><Link/></NetworkLink>"
    )
    assert plan.geofence is not None
    assert len(plan.geofence.inclusion) == 2
    assert plan.warnings == (
        "placemark 'way': a LineString is no area and not taken over",
        "a placemark: a NetworkLink is no area and not taken over",
    )


BOMB = '<!DOCTYPE kml [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (f"{BOMB}<kml>&b;</kml>", "document type"),
        ("<kml>&b;</kml>", "not XML"),
        ("<kml><Document></kml>", "a.kml:1: not XML: mismatched tag"),
        ("<kml></kml>", "no polygon"),
        ("<gpx></gpx>", "outermost element is <gpx>"),
        ("<" + "a>" * 5, "not XML"),
        ("<kml>" * 200 + "</kml>" * 200, "nested too deeply"),
        (f"<kml>{polygon('8.5,47.3,1,2')}</kml>", "write longitude,latitude"),
        (f"<kml>{polygon('')}</kml>", "write longitude,latitude"),
        (f"<kml>{polygon('8.5,nan 1,2 3,4')}</kml>", "its latitude is 'nan'"),
        (f"<kml>{polygon('8.5,1_0 1,2 3,4')}</kml>", "its latitude is '1_0'"),
        (f"<kml>{polygon('8.5,95 1,2 3,4')}</kml>", "latitude 95 is not within"),
        (f"<kml>{polygon('181,9 1,2 3,4')}</kml>", "longitude 181 is not within"),
        ("<kml><Polygon></Polygon></kml>", "needs one outerBoundaryIs"),
        ("<kml><Polygon><outerBoundaryIs/></Polygon></kml>", "one list of coordinates"),
    ],
)
def test_what_is_no_kml_fence_is_one_line(text: str, words: str) -> None:
    with pytest.raises(DocumentError) as caught:
        parse_any(text, "a.kml")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


# --- GeoJSON ---

LON_LAT = [[lon, lat] for lat, lon in (*TRIANGLE, TRIANGLE[0])]
HOLE = [[8.546, 47.3975], [8.5462, 47.3975], [8.5462, 47.3978], [8.546, 47.3975]]


def geojson(content: Any) -> Plan:
    return parse_any(json.dumps(content), "a.geojson")


def test_a_bare_polygon_a_multipolygon_and_holes() -> None:
    plan = geojson({"type": "Polygon", "coordinates": [LON_LAT, HOLE]})
    assert plan.geofence is not None
    assert (plan.geofence.inclusion, len(plan.geofence.exclusion)) == ((TRIANGLE,), 1)
    several = geojson({"type": "MultiPolygon", "coordinates": [[LON_LAT], [HOLE]]})
    assert several.geofence is not None
    assert len(several.geofence.inclusion) == 2


def test_a_feature_may_exclude_and_what_is_no_area_is_told() -> None:
    features = [
        {"type": "Feature", "properties": None, "geometry": {"type": "Polygon", "coordinates": [LON_LAT]}},
        {
            "type": "Feature",
            "properties": {"inclusion": False},
            "geometry": {
                "type": "GeometryCollection",
                "geometries": [
                    {"type": "Polygon", "coordinates": [HOLE]},
                    {"type": "Point", "coordinates": [8, 47]},
                ],
            },
        },
        {"type": "Feature", "properties": {}, "geometry": None},
    ]
    plan = geojson({"type": "FeatureCollection", "features": features})
    assert plan.geofence is not None
    assert (len(plan.geofence.inclusion), len(plan.geofence.exclusion)) == (1, 1)
    assert [warning.partition(":")[0] for warning in plan.warnings] == [
        "features[1].geometry.geometries[1]",
        "features[2]",
    ]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"type": "Polygon", "coordinates": []}, "there is none"),
        ({"type": "Polygon", "coordinates": [[["8.5", "47"], [1, 2], [3, 4]]]}, "its latitude is '47'"),
        ({"type": "Polygon", "coordinates": [[[True, 47.0], [1, 2], [3, 4]]]}, "its longitude is True"),
        ({"type": "Polygon", "coordinates": [[[8.5, None], [1, 2], [3, 4]]]}, "its latitude is None"),
        ({"type": "Polygon", "coordinates": [[[8.5, 95], [1, 2], [3, 4]]]}, "latitude 95 is not within"),
        ({"type": "Polygon", "coordinates": [[[10**400, 5], [1, 2], [3, 4]]]}, "far too large"),
        ({"type": "Polygon", "coordinates": [[[8.5], [1, 2]]]}, "a point is [longitude, latitude]"),
        ({"type": "Polygon", "coordinates": [5]}, "a ring is a list"),
        ({"type": "MultiPolygon", "coordinates": 5}, "list of polygons"),
        ({"type": "Point", "coordinates": [8, 47]}, "no Polygon"),
        ({"type": "FeatureCollection"}, "list of features"),
        ({"type": "Feature", "geometry": {"type": ["x"]}}, "geometry: no GeoJSON object"),
        (
            {"type": "Feature", "properties": {"inclusion": "no"}, "geometry": {"type": "Polygon"}},
            "properties.inclusion: is 'no'",
        ),
        ({"type": "Polygon", "coordinates": [LON_LAT], "crs": {"name": "EPSG:21781"}}, "EPSG:4326"),
        ({"name": 5}, "no GeoJSON"),
        ([1], "no GeoJSON"),
    ],
)
def test_what_is_no_geojson_fence_is_one_line(content: Any, words: str) -> None:
    with pytest.raises(DocumentError) as caught:
        geojson(content)
    assert words in str(caught.value)


def test_json_is_strict() -> None:
    for text, words in (
        ('{"type": "Polygon", "type": "Point"}', "'type' stands twice"),
        ('{"type": "Polygon", "coordinates": NaN}', "not JSON"),
        ('{"type": "Polygon"} trailing', "not JSON"),
        ('{\n"type": "Polygon" // a comment\n}', "a.geojson:2: not JSON"),
        ('{"type": ' + "1" * 5000 + "}", "out of range"),
        ('{"a":' * 3000 + "1" + "}" * 3000, "nested too deeply"),
        ("[" * 100_000, "nested too deeply"),
    ):
        with pytest.raises(DocumentError) as caught:
            parse_any(text, "a.geojson")
        assert words in str(caught.value)


def test_a_web_page_in_a_description_is_no_document_type() -> None:
    text = (CASES / "fence.kml").read_text()
    page = "<description><![CDATA[<!DOCTYPE html><html>survey</html>]]></description>"
    plan = parse_any(text.replace("<Document>", f"<Document>{page}"), "a.kml")
    assert plan.geofence is not None
    assert plan.geofence.inclusion == (TRIANGLE,)


def test_a_document_type_of_the_file_s_own_is_refused_with_its_line() -> None:
    text = (CASES / "fence.kml").read_text().replace("?>", '?>\n<!DOCTYPE kml SYSTEM "x.dtd">', 1)
    with pytest.raises(DocumentError) as caught:
        parse_any(text, "a.kml")
    assert str(caught.value).startswith("a.kml:2: a KML file has no document type of its own")


def test_altitudes_of_areas_are_said_to_be_left_out() -> None:
    kml = (CASES / "fence.kml").read_text()
    geojson = (CASES / "fence.geojson").read_text()
    for text in (
        kml.replace("8.5465,47.399,0", "8.5465,47.399,120"),
        geojson.replace("47.399]", "47.399, 120]"),
    ):
        plan = parse_any(text, "a.kml")
        assert plan.geofence is not None
        assert plan.geofence.inclusion == (TRIANGLE,)
        assert [one for one in plan.warnings if "altitudes" in one] == list(plan.warnings) != []
    for text, shown in (
        (kml.replace("8.5465,47.399,0", "8.5465,47.399,x"), "its altitude is 'x'"),
        (geojson.replace("47.399]", '47.399, "x"]'), "its altitude is 'x'"),
    ):
        with pytest.raises(DocumentError, match=shown):
            parse_any(text, "a.kml")


@pytest.mark.parametrize("where", ["features", "geometry"])
def test_metres_of_a_map_are_refused_wherever_the_file_says_so(where: str) -> None:
    content = json.loads((CASES / "fence.geojson").read_text())
    feature = content["features"][0]
    system = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::3857"}}
    (feature if where == "features" else feature["geometry"])["crs"] = system
    with pytest.raises(
        DocumentError, match=rf"features\[0\]\.{'' if where == 'features' else 'geometry.'}crs: not WGS"
    ):
        parse_any(json.dumps(content), "a.geojson")


def test_an_area_to_stay_out_of_by_either_word() -> None:
    content = json.loads((CASES / "fence.geojson").read_text())
    for properties in ({"exclusion": True}, {"inclusion": False}, {"inclusion": False, "exclusion": True}):
        content["features"][0]["properties"] = properties
        plan = parse_any(json.dumps(content), "a.geojson")
        assert plan.geofence is not None
        assert (plan.geofence.inclusion, plan.geofence.exclusion) == ((), (TRIANGLE,))
    content["features"][0]["properties"] = {"inclusion": True, "exclusion": True}
    with pytest.raises(DocumentError, match="say two things"):
        parse_any(json.dumps(content), "a.geojson")


# --- Dragonfly ---


def test_boundaries_of_a_dragonfly_mission() -> None:
    def mission(boundaries: Any) -> str:
        return json.dumps({"steps": [], "waypoints": {}, "boundaries": boundaries})

    for boundaries, words in (
        ({}, "no boundary"),
        ([1], "named boundaries"),
        ({"a": 5}, "boundaries.a: a boundary is a list"),
        ({"a": [5]}, "boundaries.a[0]: a point is an object"),
        ({"a": [{"longitude": 8.5}]}, "its latitude is None"),
    ):
        with pytest.raises(DocumentError) as caught:
            parse_any(mission(boundaries), "d.mission")
        assert words in str(caught.value)


# --- lines of MAVProxy and Mission Planner ---

CLOSED = "47.397 8.544\n47.397 8.5465\n47.399 8.5465\n47.397 8.544\n"


def test_a_polygon_of_mission_planner_has_no_point_to_return_to() -> None:
    plan = parse_any(f"#saved by Mission Planner\n{CLOSED}", "a.poly")
    assert plan.geofence is not None
    assert (plan.geofence.inclusion, plan.warnings) == ((TRIANGLE,), ())


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (CLOSED.rpartition("47.397 8.544")[0], "a.fen:3: the polygon is not closed"),
        ("47.397 8.544\n", "not closed"),
        (CLOSED + "47.3\n", "a.fen:5: a line of a fence is latitude and longitude"),
        (CLOSED + "47.3 x\n", "a.fen:5: a vertex: its longitude is 'x'"),
        (CLOSED + "95 8\n", "a.fen:5: a vertex: latitude 95"),
        ("47.3,8.5\n47.4,8.5\n", "latitude and longitude, here are 1 fields"),
        ("RALLY 47 8 30 0 0\n", "a.fen:1: a rally point is a line of RALLY"),
        ("RALLY 47 8 nan 0 0 0\n", "not all of nan 0 0 0 are numbers"),
        ("RALLY 47 8 1e9 0 0 0\n", "altitude 1e+09 m"),
        ("RALLY 97 8 30 0 0 0\n", "latitude 97"),
        ("RALLY 47 8 30 0 0 0\n47 8\n", "a.fen:2"),
        ("hello\n", "not a plan, fence or rally file"),
        ("", "not a plan, fence or rally file"),
    ],
)
def test_what_is_no_old_fence_is_one_line(text: str, words: str) -> None:
    with pytest.raises(DocumentError) as caught:
        parse_any(text, "a.fen")
    assert words in str(caught.value)


def test_old_rally_points() -> None:
    plan = parse_any("RALLY 47.3981\t8.5452\t30.0\t5.0\t0.0\t0\n", "a.ral")
    assert (plan.rally, plan.holds) == ((Geodetic(47.3981, 8.5452, 30.0),), ("rally",))
    assert "for planes" in plan.warnings[0]


def test_a_name_space_that_the_parser_cannot_hold_is_told() -> None:
    with pytest.raises(DocumentError, match="not XML that can be read"):
        parse_any('<kml xmlns="http://www.opengis.net/}kml/2.2"></kml>', "a.kml")
