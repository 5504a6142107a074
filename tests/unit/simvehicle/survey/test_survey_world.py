"""A survey's file says what wind blows and what stands in it; what cannot be is told in one line that says where."""

from __future__ import annotations

import pathlib

import msgspec
import pytest

from mission.documents.yaml_file import DocumentError, parse
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.fleet.fleet_problems import problems
from simvehicle.survey.draft import draft, in_process
from simvehicle.survey.launch import text_of
from simvehicle.survey.survey_file import Survey, parse_survey
from simvehicle.world.configured import make_world
from simvehicle.world.grid_wind import GridWind
from simvehicle.world.obstacles import Obstacles
from simvehicle.world.wind import GustyWind
from simvehicle.world.world_config import (
    BoundaryLayerWindConfig,
    GridWindConfig,
    PolygonalObstacle,
    RectangularObstacle,
    ThermalsConfig,
    WindConfig,
)

PAGE = pathlib.Path(__file__).parents[4] / "docs" / "simulate.md"
BLOCK = "{type: rectangle, centre_north_m: 40, centre_east_m: 0, length_north_m: 8, length_east_m: 8}"
RING = (
    "[[70,-20], [110,-20], [110,30], [70,30], [70,29], [109,29], [109,-19], [71,-19], [71,28.5], [70,28.5]]"
)
"""A wall around the source, with a gap of half a metre."""


def text(
    *, wind: str = "", obstacles: str = BLOCK, source: str = "80, source_east_m: 5", more: str = ""
) -> str:
    return f"""name: valley
origin: {{latitude_deg: -5.06, longitude_deg: 151.3, amsl_m: 500}}
launch_line: {{count: 3}}
plume: {{type: gaussian, source_north_m: {source}}}
obstacles: [{obstacles}]
{f"wind: {wind}" if wind else ""}
{more}"""


def survey(written: str) -> Survey:
    return parse_survey(written, "valley.yaml")


@pytest.mark.parametrize(
    ("written", "read"),
    [
        ("", WindConfig()),
        ("{speed_mps: 2}", WindConfig(speed_mps=2.0)),
        ("{type: uniform, gust_sd_mps: 1}", WindConfig(gust_sd_mps=1.0)),
        ("{type: grid, regime: turbulent}", GridWindConfig(regime="turbulent")),
        ("{type: boundary-layer, thermals: {}}", BoundaryLayerWindConfig(thermals=ThermalsConfig())),
    ],
)
def test_a_wind_without_a_type_is_uniform(written: str, read: object) -> None:
    assert survey(text(wind=written)).config.wind == read


def test_a_file_makes_its_world_and_so_does_what_the_fleet_is_given() -> None:
    polygon = "{type: polygon, corners_north_east_m: [[60, 10], [70, 10], [65, 20]], top_above_home_m: 15}"
    flown = survey(text(wind="{type: grid, speed_mps: 2}", obstacles=f"{BLOCK}, {polygon}"))
    assert flown.config.obstacles == (
        RectangularObstacle(centre_north_m=40.0, centre_east_m=0.0, length_north_m=8.0, length_east_m=8.0),
        PolygonalObstacle(
            corners_north_east_m=((60.0, 10.0), (70.0, 10.0), (65.0, 20.0)), top_above_home_m=15.0
        ),
    )
    fleet = draft(flown, in_process(flown)).fleet
    again = parse(text_of(msgspec.to_builtins(fleet)), FleetConfig, "fleet.yaml")
    assert again == fleet
    world = make_world(again)
    assert isinstance(world.obstacles, Obstacles)
    assert isinstance(world.wind, GridWind)
    assert world.wind.wind_ned_mps((40.0, 0.0, -10.0), 3.0) == (0.0, 0.0, 0.0)
    assert isinstance(make_world(survey(text()).config).wind, GustyWind)


@pytest.mark.parametrize(
    ("changes", "field", "problem"),
    [
        (
            {"wind": "{type: girt}"},
            "wind.type",
            "Invalid value 'girt'; write uniform or grid or boundary-layer",
        ),
        ({"wind": "{type: boundary-layer, thermals: {life_s: 1}}"}, "wind.thermals.life_s", ">= 60"),
        ({"wind": "{cells: 9}"}, "wind.cells", "unknown key"),
        ({"wind": "{type: grid, regime: calm}"}, "wind.regime", "write laminar or transitional or turbulent"),
        ({"wind": "{type: grid, step_s: 1}"}, "wind.step_s", "would diverge .* steps up to 0.163 s hold"),
        (
            {"wind": "{type: grid, cells: 1000}"},
            "wind.cells",
            "the wind's solver would update .* fewer cells",
        ),
        ({"wind": "{type: grid, length_m: 100}"}, "plume", "30 m outside the wind's square"),
        (
            {"obstacles": BLOCK.replace("rectangle", "circle")},
            "obstacles[0].type",
            "write rectangle or polygon",
        ),
        ({"obstacles": BLOCK.replace("8}", "-8}")}, "obstacles[0].length_east_m", "> 0"),
        (
            {
                "obstacles": f"{BLOCK}, {{type: polygon, corners_north_east_m: [[0, 9], [9, 9], [9, 0], [9, 5]]}}"
            },
            "obstacles[1]",
            "its sides must not meet",
        ),
        ({"source": "41, source_east_m: 2"}, "plume", r"source is inside obstacles\[0\]"),
        ({"obstacles": BLOCK.replace("_m: 40", "_m: 0")}, "launch_line", "drone 2's launch point is inside"),
        ({"obstacles": BLOCK.replace("_m: 40", "_m: 4.5")}, "launch_line", "is 0.5 m from an obstacle"),
        (
            {"obstacles": f"{{type: polygon, corners_north_east_m: {RING}}}"},
            "plume",
            "no way of 2 m .* from the launch points to the source",
        ),
        (
            {"obstacles": f"{{type: polygon, corners_north_east_m: {RING.replace('28.5', '28.95')}}}"},
            "plume",
            "the source is shut in: no way between the obstacles leads out",
        ),
        (
            {"obstacles": f"{{type: polygon, top_above_home_m: 70, corners_north_east_m: {RING}}}"},
            "plume",
            "no way of 2 m .* below the ceiling .* from the launch points to the source",
        ),
    ],
)
def test_what_cannot_be_is_told_with_its_place(changes: dict[str, str], field: str, problem: str) -> None:
    with pytest.raises(DocumentError, match=problem) as caught:
        survey(text(**changes))
    message = str(caught.value)
    assert caught.value.field == field
    assert caught.value.line is not None
    assert "\n" not in message


def test_a_wall_that_ends_below_the_ceiling_or_has_a_gap_shuts_nobody_in() -> None:
    survey(text(obstacles=f"{{type: polygon, top_above_home_m: 30, corners_north_east_m: {RING}}}"))
    survey(text(obstacles=f"{{type: polygon, corners_north_east_m: {RING.replace('28.5', '20')}}}"))


def test_a_wall_across_the_fence_shuts_the_launch_points_off() -> None:
    """Around its ends there would be a way, but the fence is there."""
    wall = "{type: rectangle, centre_north_m: 40, centre_east_m: 0, length_north_m: 2, length_east_m: 400}"
    fence = "geofence: {inclusion_circles: [{latitude_deg: -5.06, longitude_deg: 151.3, radius_m: 150}]}"
    survey(text(obstacles=wall))
    with pytest.raises(DocumentError, match="inside the fence, leads from the launch points to the source"):
        survey(text(obstacles=wall, more=fence))


def test_a_source_outside_the_fence_is_warned_of_and_one_on_top_of_a_rock_is_none_inside_it() -> None:
    fence = "geofence: {inclusion_circles: [{latitude_deg: -5.06, longitude_deg: 151.3, radius_m: 60}]}"
    assert "its source lies outside the geofence" in survey(text(more=fence)).warnings[0]
    rock = BLOCK.replace("}", ", top_above_home_m: 9}")
    survey(text(obstacles=rock, source="41, source_east_m: 2"))  # 10 m above home
    with pytest.raises(DocumentError, match="inside"):
        survey(text(obstacles=rock, source="41, source_above_home_m: 8, source_east_m: 2"))


def test_a_fleet_with_such_a_world_is_refused_too() -> None:
    flown = survey(text())
    fleet = draft(flown, in_process(flown)).fleet
    assert list(problems(fleet)) == []
    bad = msgspec.structs.replace(fleet, wind=GridWindConfig(step_s=9.0))
    assert [error.field for error in problems(bad)] == ["wind.step_s"]


def test_obstacles_around_the_whole_grid_leave_no_air_in() -> None:
    sides = ", ".join(
        f"{{type: rectangle, centre_north_m: {north}, centre_east_m: {east}, length_north_m: {long}, "
        f"length_east_m: {wide}}}"
        for north, east, long, wide in (
            (100, 0, 4, 204),
            (-100, 0, 4, 204),
            (0, 100, 204, 4),
            (0, -100, 204, 4),
        )
    )
    with pytest.raises(DocumentError, match="cover the whole edge of the wind's grid"):
        survey(text(wind="{type: grid}", obstacles=sides))


@pytest.mark.parametrize(
    "section",
    [GridWindConfig, BoundaryLayerWindConfig, ThermalsConfig, RectangularObstacle, PolygonalObstacle],
)
def test_every_key_of_the_world_is_explained(section: type[msgspec.Struct]) -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert [name for name in section.__struct_fields__ if f"`{name}" not in page] == []
