"""QGroundControl's files: older versions, values that are none, and what this software does not know."""

from __future__ import annotations

import copy
import json
import pathlib
from typing import Any

import pytest

from mission.documents.plan_file import parse_plan, read_plan
from mission.documents.yaml_file import DocumentError
from mission.geometry.frames import Geodetic

CASES = pathlib.Path(__file__).parents[3] / "data" / "cases"
GOOD: dict[str, Any] = json.loads((CASES / "p01_ok.plan").read_text(encoding="utf-8"))


def changed(path: str, value: Any) -> str:
    """The good plan with another value at "mission.items.0.params.6"; `...` takes the key away."""
    content = copy.deepcopy(GOOD)
    *steps, last = path.split(".")
    place: Any = content
    for step in steps:
        place = place[int(step) if isinstance(place, list) else step]
    if value is ...:
        del place[last]
    else:
        place[int(last) if isinstance(place, list) else last] = value
    return json.dumps(content)


@pytest.mark.parametrize(
    ("file", "items", "home"),
    [
        ("p08_v1items.plan", [(22, 15.0, 1), (16, 20.0, 2)], Geodetic(47.398, 8.5451, 480.0)),
        ("p09_missionItem.plan", [(16, 20.0, 2)], Geodetic(47.398, 8.5451, 480.0)),
        ("p10_old.mission", [(16, 20.0, 2)], Geodetic(47.398, 8.5451, 0.0)),
        ("p11_v2.mission", [(16, 20.0, 1)], Geodetic(47.398, 8.5451, 0.0)),
    ],
)
def test_missions_of_older_versions_are_read(
    file: str, items: list[tuple[int, float, int]], home: Geodetic
) -> None:
    plan = read_plan(CASES / file)
    assert [(item.command, item.params[6], item.jump_id) for item in plan.items] == items
    assert plan.items[-1].params[4:6] == (47.3984, 8.5455)
    assert (plan.home, plan.firmware_type, plan.warnings) == (home, 3, ())
    assert plan.holds == (("mission",) if file.endswith(".mission") else ("mission", "fence", "rally"))


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("mission.items.1.params.6", None, "mission.items[1].params: the altitude is missing"),
        ("mission.items.1.params.4", None, "mission.items[1].params: the latitude is missing"),
        ("mission.items.0.params.6", None, "mission.items[0].params: the altitude is missing"),
        (
            "mission.items.1.params.4",
            "47.4",
            "mission.items[1].params[4]: Expected `float | null`, got `str`",
        ),
        ("mission.items.1.params.4", True, "mission.items[1].params[4]: Expected `float | null`, got `bool`"),
        ("mission.items.1.params.4", 95, "mission.items[1].params: latitude 95.0"),
        ("mission.items.1.params.6", 1e9, "mission.items[1].params: altitude 1e+09 m"),
        ("mission.items.1.frame", 99, "mission.items[1].params: frame 99 is no frame of MAVLink"),
        ("mission.items.1.frame", None, "mission.items[1]: a simple item needs"),
        ("mission.items.1.frame", 3.5, "mission.items[1].frame: Expected `int | null`"),
        ("mission.items.1.command", "16", "mission.items[1].command: Expected `int | null`"),
        ("mission.items.1.command", 70000, "command 70000 is more than a mission item carries"),
        ("mission.items.1.command", ..., "mission.items[1]: a simple item needs"),
        ("mission.items.1.autoContinue", "yes", "mission.items[1].autoContinue: Expected `bool`"),
        ("mission.items.1.doJumpId", 2.5, "mission.items[1].doJumpId: Expected `int`"),
        (
            "mission.items.1.params",
            [0, 0, 0, 0],
            "mission.items[1].params: Expected `array` of length 7, got 4",
        ),
        ("mission.plannedHomePosition", [47, 8, None], "mission.plannedHomePosition: its altitude is null"),
        ("mission.plannedHomePosition", [47, 8], "mission.plannedHomePosition: Expected `array`"),
        ("mission.plannedHomePosition", [47, 8, 1e9], "mission.plannedHomePosition: altitude 1e+09 m"),
        ("mission.plannedHomePosition", [47, 188, 1], "mission.plannedHomePosition: longitude 188"),
        ("mission.items", {}, "mission.items: Expected `array`"),
        ("mission", [[]], "mission: Expected `object`"),
        ("rallyPoints.points", [[47, 8, None]], "rallyPoints.points[0][2]: Expected `float`"),
        ("rallyPoints.points", [[47, 8, -1e9]], "rallyPoints.points[0]: altitude -1e+09 m"),
        (
            "geoFence.polygons.0.polygon.0",
            [47.0, None],
            "geoFence.polygons[0].polygon[0][1]: Expected `float`",
        ),
        ("geoFence.polygons.0.polygon.0", [97.0, 8], "geoFence.polygons[0].polygon[0][0]"),
        ("geoFence.polygons.0.inclusion", "no", "geoFence.polygons[0].inclusion: Expected `bool | null`"),
        ("geoFence.polygons.0.inclusion", ..., "geoFence.polygons[0].inclusion: is missing; write true"),
        ("geoFence.polygons.0.inclusion", None, "geoFence.polygons[0].inclusion: is missing; write true"),
        ("geoFence.polygons.0.version", 2, "geoFence.polygons[0].version: version 2; this software reads"),
        ("geoFence.version", 3, "geoFence.version: version 3; this software reads versions up to 2"),
        ("rallyPoints.version", 3, "rallyPoints.version: version 3"),
        ("mission.version", 0, "mission.version: version 0"),
        ("geoFence.circle", {"radius": 100}, "geoFence.circle: a circle about home"),
        ("fileType", "Parameters", "it holds 'Parameters'"),
        ("fileType", "GeoFence", "save it again as a plan"),
        ("version", 2, "version: plan version 2"),
    ],
)
def test_a_value_that_is_none_is_refused_by_its_place(path: str, value: Any, words: str) -> None:
    with pytest.raises(DocumentError) as caught:
        parse_plan(changed(path, value), "a.plan")
    assert words in str(caught.value)


@pytest.mark.parametrize("radius", [0, -5, 1e9, None, "5", True])
def test_a_circle_has_a_radius(radius: Any) -> None:
    circles = [{"circle": {"center": [47, 8], "radius": radius}, "inclusion": True, "version": 1}]
    with pytest.raises(DocumentError, match=r"geoFence\.circles\[0\]\.circle\.radius"):
        parse_plan(changed("geoFence.circles", circles), "a.plan")


def test_numbers_that_overflow_are_refused() -> None:
    text = json.dumps(GOOD).replace("47.3984", "1e999")
    with pytest.raises(DocumentError, match=r"a\.plan: .*out of range"):
        parse_plan(text, "a.plan")
    with pytest.raises(DocumentError, match="not JSON"):
        parse_plan(text.replace("1e999", "Infinity"), "a.plan")


def test_unset_parameters_stay_unset() -> None:
    plan = parse_plan(changed("mission.items.1.params.0", None), "a.plan")
    assert plan.items[1].params[0] is None


@pytest.mark.parametrize(
    ("path", "value", "warning"),
    [
        ("geoFence.breachReturn", [47.0, 8.0, 30], "geoFence.breachReturn: not taken over"),
        ("geoFence.polygons.0.maxAltitude", 80, "geoFence.polygons[0].maxAltitude: not read"),
        ("mission.items.1.SpeedSection", {}, "mission.items[1].SpeedSection: not read"),
        ("mission.cruise", 5, "mission.cruise: not read"),
        ("notes", "x", "notes: not read"),
    ],
)
def test_what_is_not_read_is_told(path: str, value: Any, warning: str) -> None:
    (told,) = parse_plan(changed(path, value), "a.plan").warnings
    assert told.startswith(warning)


def test_the_vertex_that_closes_a_polygon_is_no_vertex() -> None:
    polygon = GOOD["geoFence"]["polygons"][0]["polygon"]
    plan = parse_plan(changed("geoFence.polygons.0.polygon", [*polygon, polygon[0]]), "a.plan")
    assert plan.geofence is not None
    assert len(plan.geofence.inclusion[0]) == 4
    assert "polygon 0: its last vertex is its first again" in plan.warnings[0]


def test_surveys_of_old_missions_are_to_be_saved_again() -> None:
    content = json.loads((CASES / "p10_old.mission").read_text(encoding="utf-8"))
    content["complexItems"] = [{"type": "survey"}]
    with pytest.raises(
        DocumentError, match=r"complexItems: .*open the file in QGroundControl and save it again"
    ):
        parse_plan(json.dumps(content), "old.mission")


def test_items_of_old_missions_need_all_their_parts() -> None:
    content = json.loads((CASES / "p10_old.mission").read_text(encoding="utf-8"))
    del content["items"][0]["param3"]
    with pytest.raises(DocumentError, match=r"items\[0\]: an item needs param1 to param4 and a coordinate"):
        parse_plan(json.dumps(content), "old.mission")
    content["plannedHomePosition"]["coordinate"] = [None, 8, 0]
    content["items"] = []
    with pytest.raises(DocumentError, match="plannedHomePosition: needs a coordinate"):
        parse_plan(json.dumps(content), "old.mission")


def test_a_structure_scan_is_named_with_what_to_do() -> None:
    with pytest.raises(DocumentError, match=r"mission\.items\[1\]: a structure scan: .*download it there"):
        read_plan(CASES / "p12_structurescan.plan")


@pytest.mark.parametrize(
    ("frame", "mode", "altitude", "words"),
    [
        (3, 1, 50, "its altitude stands twice: Altitude 50 and parameter 7 20"),
        (10, 4, 50, "its altitude stands twice"),
        (3, 2, 20, "AltitudeMode 2 and frame 3 say two things"),
        (3, 4, 20, "AltitudeMode 4 and frame 3 say two things"),
        (3, 1, 20, ""),
        (0, 1, 20, ""),
        (0, 2, 50, ""),  # over the ground, by an old version
        (0, 3, 50, ""),
        (3, None, 50, ""),
        (3, 1, None, ""),
    ],
)
def test_an_altitude_that_stands_twice(
    frame: int, mode: int | None, altitude: float | None, words: str
) -> None:
    content = json.loads((CASES / "p01_ok.plan").read_text())
    content["mission"]["items"][1] |= {"frame": frame, "AltitudeMode": mode, "Altitude": altitude}
    if not words:
        assert len(parse_plan(json.dumps(content), "a.plan").items) == 4
        return
    with pytest.raises(DocumentError, match=rf"a\.plan: mission\.items\[1\]\.params: {words}"):
        parse_plan(json.dumps(content), "a.plan")
