"""Obstacles as the guard asks of them."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.documents.yaml_file import DocumentError, parse
from mission.geometry.frames import Geodetic, LocalFrame
from mission.geometry.geofence import Geofence, LocalFence
from mission.geometry.known_obstacles import KnownObstacle, LocalObstacles

FRAME = LocalFrame(Geodetic(47.4, 8.5, 500.0))
BOX = ((10.0, -5.0), (10.0, 5.0), (20.0, 5.0), (20.0, -5.0))
LOW = KnownObstacle(corners_north_east_m=BOX, top_above_home_m=8.0)
TALL = KnownObstacle(corners_north_east_m=((-20.0, 0.0), (-30.0, 10.0), (-30.0, -10.0)))
L_SHAPE = KnownObstacle(
    corners_north_east_m=((0.0, 20.0), (0.0, 40.0), (5.0, 40.0), (5.0, 25.0), (30.0, 25.0), (30.0, 20.0))
)
STANDING = LocalObstacles(FRAME, (LOW, TALL), 3.0)


def test_corners_may_be_geographic() -> None:
    places = (FRAME.to_geodetic((north_m, east_m, 0.0)) for north_m, east_m in BOX)
    corners = tuple((place.latitude_deg, place.longitude_deg) for place in places)
    outline = KnownObstacle(corners=corners).outline(FRAME)
    for corner, expected in zip(outline, BOX, strict=True):
        assert corner == pytest.approx(expected, abs=0.01)


def test_how_far_it_is_to_the_nearest() -> None:
    assert STANDING.clearance_m((0.0, 0.0, -5.0)) == pytest.approx(10.0)
    assert STANDING.clearance_m((15.0, 0.0, -5.0)) == pytest.approx(-3.0), "the top is nearer than the sides"
    assert STANDING.clearance_m((15.0, 0.0, -12.0)) == pytest.approx(4.0)
    assert STANDING.clearance_m((7.0, 0.0, -12.0)) == pytest.approx(5.0), "above it and beside it"
    assert STANDING.clearance_m((-29.0, 0.0, -900.0)) == pytest.approx(-1.0), "nothing flies over it"
    assert LocalObstacles(FRAME, (), 3.0).clearance_m((0.0, 0.0, 0.0)) == math.inf


def test_what_is_a_wall_depends_on_the_height() -> None:
    assert not STANDING.is_free(8.0, 0.0, 10.9)
    assert STANDING.is_free(8.0, 0.0, 11.1)
    assert not STANDING.is_free(-19.0, 0.0, 500.0)
    assert STANDING.beside_walls_m(0.0, 0.0, 5.0) == pytest.approx(10.0)
    assert STANDING.beside_walls_m(0.0, 0.0, 12.0) == pytest.approx(20.0)
    assert STANDING.beside_walls_m(15.0, 0.0, 5.0) == 0.0


@settings(max_examples=200, deadline=None)
@given(north_m=st.floats(-40.0, 40.0), east_m=st.floats(-20.0, 50.0), reach_m=st.floats(0.0, 20.0))
def test_what_is_beside_is_what_is_within_reach(north_m: float, east_m: float, reach_m: float) -> None:
    standing = LocalObstacles(FRAME, (LOW, TALL, L_SHAPE), 3.0)
    everything = standing.beside((0.0, 0.0, -5.0), math.inf)
    assert len(everything) == 3
    near = standing.beside((north_m, east_m, -5.0), reach_m)
    every = LocalObstacles(FRAME, (LOW, TALL, L_SHAPE), 3.0).beside((north_m, east_m, -5.0), math.inf)
    assert near == [one for one in every if one.aside_m <= reach_m]
    for one in near:
        assert math.hypot(*one.towards) == pytest.approx(1.0)
        ahead = (north_m + 1e-3 * one.towards[0], east_m + 1e-3 * one.towards[1], -5.0)
        assert min(abs(b.aside_m - one.aside_m) for b in standing.beside(ahead, math.inf)) < 1.1e-3


def test_the_nearest_free_place() -> None:
    assert STANDING.nearest_free((0.0, 0.0), 5.0, 0.8, None, 3.0) == (0.0, 0.0)
    assert STANDING.nearest_free((11.0, 0.0), 5.0, 0.8, None, 3.0) == pytest.approx((6.2, 0.0))
    assert STANDING.nearest_free((11.0, 0.0), 12.0, 0.8, None, 3.0) == (11.0, 0.0), "over it"
    corners = ((9.0, -50.0), (50.0, -50.0), (50.0, 50.0), (9.0, 50.0))
    places = (FRAME.to_geodetic((north_m, east_m, 0.0)) for north_m, east_m in corners)
    outline = tuple((place.latitude_deg, place.longitude_deg) for place in places)
    fence = LocalFence(FRAME, Geofence(inclusion=(outline,)))
    inside = STANDING.nearest_free((12.0, 0.0), 5.0, 0.8, fence, 3.0)
    assert fence.keeps(*inside, 2.9)
    assert STANDING.is_free(*inside, 5.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{}", "one of them"),
        ("{corners: [[47.4, 8.5], [47.5, 8.5], [47.5, 8.6]], corners_north_east_m: [[0, 0]]}", "one of them"),
        ("{corners_north_east_m: [[0, 0], [1, 0], [0, 0]]}", "2 different corners"),
        ("{corners_north_east_m: [[0, 0], [9, 9], [0, 9], [9, 0]]}", "its sides cross or touch each other"),
        ("{corners_north_east_m: [[0, 0], [1, 0], [2, 0]]}", "not simple"),
        ("{corners_north_east_m: [[0, 0], [1e9, 0], [0, 1]]}", "probably a wrong number"),
        ("{corners: [[47.4, 8.5], [47.4, -8.5], [47.5, 8.5]]}", "probably a wrong number"),
    ],
)  # fmt: skip
def test_what_is_no_obstacle(text: str, words: str) -> None:
    obstacle = parse(text, KnownObstacle, "x")
    assert words in obstacle.problem(FRAME)
    with pytest.raises(ValueError, match=words):
        LocalObstacles(FRAME, (obstacle,), 3.0)


def test_no_number_is_refused() -> None:
    assert "not finite" in KnownObstacle(
        corners_north_east_m=((0.0, 0.0), (math.nan, 0.0), (0.0, 1.0))
    ).problem(FRAME)


def test_a_misspelt_key_is_refused() -> None:
    with pytest.raises(DocumentError, match="top_m"):
        parse("{corners_north_east_m: [[0, 0], [1, 0], [0, 1]], top_m: 3}", KnownObstacle, "x")
