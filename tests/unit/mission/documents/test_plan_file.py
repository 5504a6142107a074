"""Plan files: real ones, any valid one, and clear refusals of invalid ones."""

from __future__ import annotations

import json
import pathlib
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.documents.plan_file import (
    Plan,
    PlanItem,
    parse_any,
    parse_plan,
    parse_waypoints,
    plan_text,
    read_plan,
    waypoints_text,
)
from mission.documents.yaml_file import DocumentError
from mission.geometry.frames import Geodetic
from mission.geometry.geofence import Circle, Geofence

PLANS = pathlib.Path(__file__).parents[3] / "data" / "plans"

WAYPOINTS = """QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t-35.363262\t149.165237\t584.09\t1
1\t0\t3\t22\t0\t0\t0\t0\t0\t0\t20\t1
2\t0\t3\t16\t0\t0\t0\tnan\t-35.362\t149.166\t25.5\t1

# the end
3\t0\t2\t20\t0\t0\t0\t0\t0\t0\t0\t0
"""


def test_a_real_plan_is_read() -> None:
    plan = read_plan(PLANS / "qgroundcontrol_sample.plan")
    assert [item.command for item in plan.items] == [22, 16, 2000, 16, 16, 20]
    assert plan.items[0].params == (15.0, 0.0, 0.0, None, 47.3977507, 8.5456075, 50.0)
    assert plan.home is not None
    assert plan.home.amsl_m == pytest.approx(488.931, abs=1e-3)
    assert plan.geofence is None
    assert (plan.cruise_mps, plan.hover_mps, plan.firmware_type, plan.vehicle_type) == (15.0, 5.0, 12, 2)


def test_a_survey_pattern_becomes_its_simple_items() -> None:
    plan = read_plan(PLANS / "qgroundcontrol_sample_with_survey.plan")
    assert len(plan.items) == 13
    assert [item.jump_id for item in plan.items] == list(range(1, 14))
    assert parse_plan(plan_text(plan), "again.plan") == plan


def plan_object(**changes: Any) -> dict[str, Any]:
    document: dict[str, Any] = {
        "fileType": "Plan",
        "version": 1,
        "mission": {
            "items": [
                {"type": "SimpleItem", "command": 16, "frame": 3, "params": [0, 0, 0, None, 47.0, 8.0, 50]}
            ]
        },
        "geoFence": {
            "polygons": [
                {"polygon": [[47, 8], [47.1, 8], [47, 8.1]], "inclusion": True, "version": 1},
                {"polygon": [[47.01, 8.01], [47.02, 8.01], [47.01, 8.02]], "inclusion": False},
            ],
            "circles": [{"circle": {"center": [47, 8], "radius": 25}, "inclusion": False, "version": 1}],
            "version": 2,
        },
        "rallyPoints": {"points": [[47.0, 8.0, 30]], "version": 2},
    }
    return document | changes


def test_fence_and_rally_points_are_read() -> None:
    plan = parse_plan(json.dumps(plan_object()), "a.plan")
    assert plan.geofence is not None
    assert plan.geofence.inclusion == (((47.0, 8.0), (47.1, 8.0), (47.0, 8.1)),)
    assert len(plan.geofence.exclusion) == 1
    assert plan.geofence.exclusion_circles == (Circle(47.0, 8.0, 25.0),)
    assert plan.rally == (Geodetic(47.0, 8.0, 30.0),)


def test_the_older_fence_with_one_polygon_is_read() -> None:
    older = plan_object(geoFence={"polygon": [[47, 8], [47.1, 8], [47, 8.1]], "version": 1})
    plan = parse_plan(json.dumps(older), "a.plan")
    assert plan.geofence == Geofence(inclusion=(((47.0, 8.0), (47.1, 8.0), (47.0, 8.1)),))


def item(**changes: Any) -> dict[str, Any]:
    simple = {"type": "SimpleItem", "command": 16, "frame": 3, "params": [0, 0, 0, 0, 47.0, 8.0, 50]}
    return {"items": [simple | changes]}


@pytest.mark.parametrize(
    ("document", "words"),
    [
        ("{", r"a\.plan: not JSON: Input data was truncated"),
        ('{\n "fileType": "Plan",,\n}', r"a\.plan:2: not JSON"),
        ("[]", "not a QGroundControl plan"),
        ('{"fileType": "Parameters"}', "not a QGroundControl plan"),
        (plan_object(version=7), "version: plan version 7"),
        (plan_object(mission={}), "mission: Object missing required field `items`"),
        (plan_object(mission=item(params=[0, 0])), r"mission\.items\[0\]\.params: Expected `array`"),
        (plan_object(mission=item(params=[0] * 4 + [95.0, 8.0, 1])), r"items\[0\]\.params: latitude 95\.0"),
        (plan_object(mission=item(params=[0] * 4 + [9.0, 188.0, 1])), "longitude 188"),
        (plan_object(mission=item(command="go")), r"mission\.items\[0\]\.command: Expected `int"),
        (plan_object(mission=item(type="Odd")), r"items\[0\]\.type: 'Odd' is neither"),
        (plan_object(mission={"items": [{"type": "SimpleItem"}]}), "needs command, frame and 7 params"),
        (
            plan_object(mission={"items": [{"type": "ComplexItem", "complexItemType": "fwLandingPattern"}]}),
            "'fwLandingPattern' carries no simple items",
        ),
        (plan_object(mission=item() | {"plannedHomePosition": [99, 0, 0]}), "plannedHomePosition: latitude"),
        (plan_object(geoFence={"polygons": [{"polygon": [[97, 8]]}]}), r"geoFence\.polygons\[0\]\.polygon"),
        (
            plan_object(geoFence={"circles": [{"circle": {"center": [7, 8], "radius": 0}}]}),
            r"geoFence\.circles\[0\]\.circle\.radius: a radius must be above 0",
        ),
        (plan_object(rallyPoints={"points": [[1, 2, 3], [99, 2, 3]]}), r"rallyPoints\.points\[1\]: latitude"),
    ],
)
def test_what_is_no_plan_is_said_in_one_line(document: str | dict[str, Any], words: str) -> None:
    text = document if isinstance(document, str) else json.dumps(document)
    with pytest.raises(DocumentError, match=words) as caught:
        parse_plan(text, "a.plan")
    assert "\n" not in str(caught.value)


def test_a_file_that_cannot_be_read_is_said(tmp_path: pathlib.Path) -> None:
    with pytest.raises(DocumentError, match="cannot be read"):
        read_plan(tmp_path / "absent.plan")
    (tmp_path / "binary.plan").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DocumentError, match="cannot be read"):
        read_plan(tmp_path / "binary.plan")


def test_waypoint_text_is_read_by_its_content(tmp_path: pathlib.Path) -> None:
    (tmp_path / "mission.txt").write_text(WAYPOINTS)
    plan = read_plan(tmp_path / "mission.txt")
    assert plan.home == Geodetic(-35.363262, 149.165237, 584.09)
    assert [i.command for i in plan.items] == [22, 16, 20]
    assert plan.items[1].params[3] is None
    assert not plan.items[2].auto_continue
    assert parse_waypoints(waypoints_text(plan), "again.txt") == plan


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "the first line must be"),
        ("QGC WPL 120\n", "the first line must be"),
        ("QGC WPL 110\n", "there is no waypoint"),
        ("QGC WPL 110\n0 1 0 16 0 0 0 0 1 2 3\n", r"m\.txt:2: a waypoint has 12 fields, here are 11"),
        ("QGC WPL 110\n0 1 0 16 0 0 0 0 1 x 3 1\n", r"m\.txt:2: a field is not a number"),
        ("QGC WPL 110\n1 1 0 16 0 0 0 0 1 2 3 1\n", "row 1 where row 0 was expected"),
        ("QGC WPL 110\n0 1 0 16 0 0 0 0 91 2 3 1\n", r"m\.txt:2: latitude 91\.0"),
        ("QGC WPL 110\n0 1 0 16 inf 0 0 0 1 2 3 1\n", "infinite"),
    ],
)
def test_what_is_no_waypoint_file_is_said_in_one_line(text: str, words: str) -> None:
    with pytest.raises(DocumentError, match=words):
        parse_waypoints(text, "m.txt")


def test_waypoint_text_needs_a_home() -> None:
    with pytest.raises(ValueError, match="home"):
        waypoints_text(Plan())


number = st.none() | st.floats(-1e6, 1e6)
items = st.builds(
    PlanItem,
    command=st.integers(16, 3000),
    frame=st.just(2),
    params=st.tuples(number, number, number, number, number, number, number),
    auto_continue=st.booleans(),
)
place = st.builds(Geodetic, st.floats(-90, 90), st.floats(-180, 180), st.floats(-400, 9000))


@settings(max_examples=40, deadline=None)
@given(st.lists(items, max_size=5), place, st.lists(place, max_size=3), st.none() | st.floats(0.5, 30.0))
def test_what_is_written_is_read_again(
    drawn: list[PlanItem], home: Geodetic, rally: list[Geodetic], speed_mps: float | None
) -> None:
    numbered = tuple(msgspec.structs.replace(one, jump_id=index) for index, one in enumerate(drawn, 1))
    plan = Plan(
        items=numbered,
        home=home,
        rally=tuple(rally),
        cruise_mps=speed_mps,
        firmware_type=3,
        vehicle_type=2,
        geofence=Geofence(inclusion_circles=(Circle(1.0, 2.0, 3.0),)),
    )
    assert parse_plan(plan_text(plan), "p.plan") == plan
    bare = parse_waypoints(waypoints_text(plan), "w.txt")
    assert (bare.items, bare.home) == (plan.items, plan.home)


@settings(max_examples=60, deadline=None)
@given(
    st.text(max_size=200)
    | st.recursive(
        st.none() | st.booleans() | st.floats(allow_nan=False) | st.text(max_size=5),
        lambda inner: (
            st.lists(inner, max_size=3)
            | st.dictionaries(
                st.sampled_from(["mission", "items", "geoFence", "type", "params"]), inner, max_size=4
            )
        ),
    ).map(lambda value: json.dumps({"fileType": "Plan", "version": 1, "mission": value}))
)
def test_no_text_ends_in_anything_but_a_plan_or_one_clear_line(text: str) -> None:
    for parse in (parse_plan, parse_waypoints):
        problem = ""
        try:
            parse(text, "x")
        except DocumentError as error:
            problem = str(error)
        assert "\n" not in problem


def test_control_characters_of_a_file_are_visible_in_its_warnings() -> None:
    document = json.loads((PLANS / "qgroundcontrol_sample.plan").read_text())
    document["mission"]["items"][0]["aut\x7fContinue\x1b[31m"] = True
    (warning,) = parse_any(json.dumps(document), "a.plan").warnings
    assert "aut\\x7fContinue\\x1b[31m: not read" in warning
