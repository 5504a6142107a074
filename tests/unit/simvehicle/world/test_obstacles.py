"""Obstacles are where their outlines say, for one place as for many, and what cannot be one is told."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from simvehicle.world.obstacles import Obstacles
from simvehicle.world.world_config import Obstacle, PolygonalObstacle, RectangularObstacle

BLOCK = RectangularObstacle(centre_north_m=20.0, centre_east_m=-5.0, length_north_m=4.0, length_east_m=10.0)
ROCK = PolygonalObstacle(
    corners_north_east_m=((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (5.0, 3.0), (0.0, 10.0)),
    top_above_home_m=12.0,
)
"""Open to the east: concave."""
BOTH = Obstacles((BLOCK, ROCK))

near_m = st.floats(-40.0, 40.0)
bearings_rad = st.floats(-10.0, 10.0)
metres = st.floats(allow_nan=False, allow_infinity=False)


def shape(obstacle: Obstacle) -> shapely.Polygon:
    return shapely.Polygon(obstacle.outline())


@settings(max_examples=200, deadline=None)
@given(near_m, near_m)
def test_clearance_is_the_distance_to_the_outline(north_m: float, east_m: float) -> None:
    point = shapely.Point(north_m, east_m)
    signed_m = [
        (-1.0 if one.contains(point) else 1.0) * one.exterior.distance(point)
        for one in (shape(BLOCK), shape(ROCK))
    ]
    place = (north_m, east_m, -1.0)
    assert BOTH.clearance_m(place) == pytest.approx(min(signed_m), abs=1e-6)
    assume(abs(min(signed_m)) > 1e-9)
    assert BOTH.stand_at(place) == BOTH.stand_at_all(np.array([place]))[0] == (min(signed_m) < 0.0)


@settings(max_examples=200, deadline=None)
@given(near_m, near_m, bearings_rad)
def test_a_beam_ends_at_the_first_wall(north_m: float, east_m: float, bearing_rad: float) -> None:
    far = (north_m + 500.0 * math.cos(bearing_rad), east_m + 500.0 * math.sin(bearing_rad))
    beam = shapely.LineString([(north_m, east_m), far])
    walls = shapely.union_all([shape(BLOCK).exterior, shape(ROCK).exterior])
    assume(walls.distance(shapely.Point(north_m, east_m)) > 1e-6)
    met = beam.intersection(walls)
    measured_m = BOTH.range_m((north_m, east_m, -1.0), bearing_rad)
    if met.is_empty:
        # It may graze a corner, which is met within rounding.
        assert measured_m == math.inf or shapely.Point(
            north_m + measured_m * math.cos(bearing_rad), east_m + measured_m * math.sin(bearing_rad)
        ).distance(walls) == pytest.approx(0.0, abs=1e-6)
    else:
        assert measured_m == pytest.approx(met.distance(shapely.Point(north_m, east_m)), abs=1e-5)


def test_over_its_top_an_obstacle_is_cleared_and_not_met() -> None:
    over = (2.0, 2.0, -15.0)
    assert BOTH.clearance_m(over) == pytest.approx(3.0)
    assert BOTH.range_m((-5.0, 2.0, -15.0), 0.0) == math.inf
    assert not BOTH.stand_at(over)
    assert BOTH.stand_at((2.0, 2.0, -11.0))
    assert BOTH.range_m((-5.0, 2.0, -11.0), 0.0) == pytest.approx(5.0)
    assert BOTH.clearance_m((20.0, -5.0, -1000.0)) == pytest.approx(-2.0)  # nothing flies over the other
    assert BOTH.clearance_m((13.0, 5.0, -16.0)) == pytest.approx(5.0)  # 3 m aside and 4 m above


def test_no_beam_slips_through_a_corner() -> None:
    ranges_m = [
        BOTH.range_m((0.0, 0.0, -1.0), math.atan2(-10.0, 18.0 + share * 1e-12)) for share in range(50)
    ]
    assert max(ranges_m) < 30.0


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(metres, metres, metres, metres), min_size=1, max_size=5))
def test_arrays_are_the_points_and_never_nan(places: list[tuple[float, float, float, float]]) -> None:
    positions = np.array([place[:3] for place in places])
    bearings = np.array([place[3] for place in places])
    clearances = BOTH.clearances_m(positions)
    ranges = BOTH.ranges_m(positions, bearings)
    assert not np.isnan(clearances).any()
    assert not np.isnan(ranges).any()
    for k, (north_m, east_m, down_m, bearing_rad) in enumerate(places):
        assert BOTH.clearance_m((north_m, east_m, down_m)) == pytest.approx(clearances[k], rel=1e-12)
        assert BOTH.range_m((north_m, east_m, down_m), bearing_rad) == pytest.approx(ranges[k], rel=1e-9)


def test_some_of_them() -> None:
    assert BOTH.count == 2
    assert BOTH.taller_than(12.0).tops_m.tolist() == [math.inf]
    assert BOTH.near((-3.0, -4.0), 5.0).tops_m.tolist() == [12.0]
    assert BOTH.near((-3.0, -4.0), 4.9).count == 0
    assert Obstacles(()).clearance_m((0.0, 0.0, 0.0)) == math.inf
    assert Obstacles(()).clearances_m(np.zeros((2, 3))).tolist() == [math.inf, math.inf]


@pytest.mark.parametrize(
    ("corners", "problem"),
    [
        (((0.0, 0.0), (1.0, 1.0), (1.0, 0.0), (0.0, 1.0)), "its sides must not meet"),
        (((0.0, 0.0), (0.0, 0.0), (1.0, 0.0), (0.0, 1.0)), "a corner twice in a row"),
        (((0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.0, 0.0)), "a corner twice in a row"),
        (((0.0, 0.0), (1.0, 0.0), (2.0, 0.0)), "sides must not meet|covers no ground"),
        (((0.0, 0.0), (1.0, 0.0), (math.nan, 1.0)), "not a finite number"),
        (((0.0, 0.0), (1.0, 0.0)), "has 2 corners"),
    ],
)
def test_what_is_no_outline_is_told(corners: tuple[tuple[float, float], ...], problem: str) -> None:
    with pytest.raises(ValueError, match=f"obstacle 1 .*{problem}"):
        Obstacles((BLOCK, PolygonalObstacle(corners_north_east_m=corners)))
