"""QGC WPL 110: row 0 is home or refused; fences and rally points in rows; fields that are none."""

from __future__ import annotations

import pathlib

import pytest

from mission.documents.plan_file import Plan, parse_any, parse_waypoints, read_plan
from mission.documents.yaml_file import DocumentError
from mission.geometry.frames import Geodetic
from mission.geometry.geofence import Circle

CASES = pathlib.Path(__file__).parents[3] / "data" / "cases"
HOME = "0 1 0 16 0 0 0 0 47.398 8.5451 480 1"


def waypoints(*rows: str) -> Plan:
    return parse_waypoints("\n".join(["QGC WPL 110", *rows]), "w.txt")


@pytest.mark.parametrize(
    "row",
    [
        HOME,
        HOME.replace("0 1 0 16", "0 0 0 16"),  # MAVProxy
        HOME.replace("0 1 0 16", "0 1 0 0"),  # Mission Planner, once
        HOME.replace("0 1 0 16", "0 1 5 16"),
        "0\t1\t0\t16\t0.000000\t0.000000\t0.000000\t0.000000\t47.398000\t8.545100\t480.000000\t1",
        HOME.replace("0 0 0 0 47", "0 0 0 nan 47"),  # no yaw
        "0 1.0 0.000000 16.0 0 0 0 0 47.398 8.5451 480 1.0",
    ],
)
def test_row_0_is_home_as_every_program_writes_it(row: str) -> None:
    assert waypoints(row).home == Geodetic(47.398, 8.5451, 480.0)


@pytest.mark.parametrize(
    "row",
    [
        "0 0 3 22 0 0 0 0 47.398 8.5451 15 1",
        "0 1 3 16 0 0 0 0 47.398 8.5451 15 1",
        "0 1 0 16 5 0 0 0 47.398 8.5451 15 1",
        "0 1 2 178 0 5 0 0 0 0 0 1",
    ],
)
def test_a_first_row_that_is_no_home_is_not_lost(row: str) -> None:
    with pytest.raises(DocumentError, match=r"w\.txt:2: row 0 is not a home position"):
        waypoints(row)


def test_mission_fence_and_rally_points_in_one_file() -> None:
    plan = read_plan(CASES / "w30_fence_and_rally.waypoints")
    assert [(item.command, item.jump_id) for item in plan.items] == [(22, 1), (16, 2)]
    assert plan.geofence is not None
    assert [len(polygon) for polygon in plan.geofence.inclusion] == [3]
    assert plan.geofence.exclusion_circles == (Circle(47.3973, 8.5450, 12.0),)
    assert plan.rally == (Geodetic(47.3979, 8.5452, 30.0),)
    assert plan.holds == ("mission", "fence", "rally")


def test_a_rally_point_over_the_sea_is_counted_from_home() -> None:
    rally = "1 0 0 5100 0 0 0 0 47.398 8.5452 510 1"
    assert waypoints(HOME, rally).rally[0].amsl_m == 30.0
    with pytest.raises(DocumentError, match=r"w\.txt:2: row 0: a rally point's altitude is over home"):
        waypoints(f"0{rally[1:]}")
    with pytest.raises(DocumentError, match="GLOBAL_TERRAIN_ALT"):
        waypoints(HOME, rally.replace("1 0 0 5100", "1 0 10 5100"))


def vertex(row: int, latitude: float, *, of: float = 3, command: int = 5001) -> str:
    return f"{row} 0 3 {command} {of} 0 0 0 {latitude} {8.5 + 0.01 * (row % 2)} 0 1"


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (
            [vertex(0, 47.1), vertex(1, 47.2)],
            "w.txt:2: row 0: the fence polygon that begins here says 3 vertices",
        ),
        (
            [vertex(0, 47.1), vertex(1, 47.2), vertex(2, 47.3, command=5002)],
            "w.txt:4: row 2: the polygon of 3",
        ),
        ([vertex(0, 47.1), vertex(1, 47.2, of=4), vertex(2, 47.3)], "w.txt:3: row 1: the polygon of 3"),
        (
            [vertex(0, 47.1, of=2), vertex(1, 47.2, of=2)],
            "how many vertices its polygon has, 3 to 65535; here it is 2",
        ),
        ([vertex(0, 47.1, of=float("nan"))], "here it is NaN"),
        ([vertex(0, 47.1, of=3.5)], "here it is 3.5"),
        ([vertex(0, 47.1, of=0, command=5003)], "a fence circle's radius"),
        ([vertex(0, 47.1, of=-9, command=5004)], "a fence circle's radius"),
        ([vertex(0, 47.1, of=1e9, command=5003)], "a fence circle's radius"),
        (["0 0 2 5003 50 0 0 0 0 0 0 1"], "in a global frame"),
        ([HOME, "1 0 3 16 0 0 0 0 47.3984 8.5455 nan 1"], "w.txt:3: the altitude is missing (null or NaN)"),
        ([HOME, "1 0 3 16 0 0 0 0 nan 8.5455 20 1"], "w.txt:3: the latitude is missing"),
        ([HOME, "1 0 3 16 0 0 0 0 nan nan 20 1"], "w.txt:3: latitude and longitude are missing"),
        ([HOME, "1 0 3 16 0 0 0 0 47 8 1e9 1"], "w.txt:3: altitude 1e+09 m"),
        ([HOME, "1 0 3 16 0 0 0 0 47 8 1e999 1"], "infinite"),
        ([HOME, "1 0 3 16 0 0 0 0 47 8 -inf 1"], "infinite"),
        ([HOME, "1 0 3 16 1_0 0 0 0 47 8 20 1"], "w.txt:3: a field is not a number: '1_0'"),
        ([HOME, "1 0 3 16 0 0 0 0 47,5 8 20 1"], "w.txt:3: a field is not a number: '47,5'; write 47.5"),
        ([HOME, "1 0 3 16 0x5 0 0 0 47 8 20 1"], "a field is not a number"),
        ([HOME, "1 0 3 16 \u0665 0 0 0 47 8 20 1"], "a field is not a number"),
        ([HOME, "1 0 3 16.5 0 0 0 0 47 8 20 1"], "a field is not a number: '16.5' where a whole one belongs"),
        ([HOME, "1 0 3 16 0 0 0 0 47 8 20 yes"], "where a whole one belongs"),
        ([HOME, "1 0 3 16 0 0 0 0 47 8 20 2"], "field 12 (autocontinue) is 0 or 1, not 2"),
        ([HOME, "1 7 3 16 0 0 0 0 47 8 20 1"], "field 2 (current) is 0 or 1, not 7"),
        ([HOME, "1 0 19 16 0 0 0 0 47 8 20 1"], "frame 19 is no frame of MAVLink"),
        ([HOME, "1 0 3 70000 0 0 0 0 47 8 20 1"], "command 70000"),
        ([HOME, "1 0 3 -1 0 0 0 0 47 8 20 1"], "command -1"),
        ([HOME, "1 0 1 16 0 0 0 0 nan 8 -20 1"], "x is missing"),
        ([HOME, "1 0 1 16 0 0 0 0 1e7 8 -20 1"], "km from home"),
        ([HOME, HOME], "row 0 where row 1 was expected"),
        (["0 1 0 16 0 0 0 0 nan nan nan 1"], "w.txt:2"),
    ],
)
def test_a_field_that_is_none_is_refused_with_its_line(rows: list[str], words: str) -> None:
    with pytest.raises(DocumentError) as caught:
        waypoints(*rows)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_point_to_return_to_is_told() -> None:
    rows = ["0 0 3 5000 0 0 0 0 47.1 8.5 0 1", *(vertex(1 + i, 47.1 + 0.01 * i * i) for i in range(3))]
    plan = waypoints(*rows)
    assert plan.geofence is not None
    assert "row 0: a point to return to" in plan.warnings[0]


def test_terrain_frames_and_take_offs_from_here_are_kept() -> None:
    plan = waypoints(HOME, "1 0 3 22 0 0 0 0 0 0 20 1", "2 0 10 16 0 0 0 0 47.3984 8.5455 25 1")
    assert [(item.frame, item.params[6]) for item in plan.items] == [(3, 20.0), (10, 25.0)]


@pytest.mark.parametrize("start", ["# written by hand\nQGC WPL 110\n", "\n QGC  WPL\t110 \r\n"])
def test_comments_and_spaces_before_the_first_row(start: str) -> None:
    assert parse_any(start + "0 1 0 16 0 0 0 0 47.398 8.5451 480 1\n", "a.txt").home is not None


@pytest.mark.parametrize("version", ["QGC WPL 100", "qgc wpl 110", "QGC WPL"])
def test_another_version_is_named(version: str) -> None:
    with pytest.raises(
        DocumentError, match=rf"a\.txt:2: the first line must be 'QGC WPL 110', not '{version}'"
    ):
        parse_any(f"#\n{version}\n0 1 0 16 0 0 0 0 47.398 8.5451 480 1\n", "a.txt")
