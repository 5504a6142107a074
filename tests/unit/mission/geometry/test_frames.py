"""The swarm's local frame against the library for geodesy, and its own inverse."""

from __future__ import annotations

import math

import pymap3d
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mission.geometry.frames import Geodetic, LocalFrame, Vector3, wind_from

ORIGINS = st.builds(Geodetic, st.floats(-90.0, 90.0), st.floats(-180.0, 180.0), st.floats(-400.0, 6000.0))
NEAR = st.tuples(st.floats(-30_000.0, 30_000.0), st.floats(-30_000.0, 30_000.0), st.floats(-5000.0, 5000.0))


def apart_m(a: Geodetic, b: tuple[float, float, float]) -> float:
    """Between two points on the earth that are a few metres apart at most."""
    radius_m = 6.37e6
    north_m = math.radians(a.latitude_deg - b[0]) * radius_m
    turned_rad = math.radians(math.remainder(a.longitude_deg - b[1], 360.0))
    east_m = turned_rad * radius_m * math.cos(math.radians(a.latitude_deg))
    return math.hypot(north_m, east_m, a.amsl_m - b[2])


@given(ORIGINS, NEAR)
@example(Geodetic(0.0, 180.0), (0.0, 100.0, 0.0))  # across the date line
@example(Geodetic(89.9999, 0.0), (100.0, 0.0, 0.0))  # over the pole
def test_a_point_lies_where_the_library_says(origin: Geodetic, position_ned_m: Vector3) -> None:
    frame, at = LocalFrame(origin), (origin.latitude_deg, origin.longitude_deg, origin.amsl_m)
    point = frame.to_geodetic(position_ned_m)
    assert apart_m(point, pymap3d.ned2geodetic(*position_ned_m, *at)) < 1e-5
    exact = pymap3d.geodetic2ned(point.latitude_deg, point.longitude_deg, point.amsl_m, *at)
    assert math.dist(frame.to_ned(point), exact) < 1e-6


@given(ORIGINS, NEAR)
def test_there_and_back(origin: Geodetic, position_ned_m: Vector3) -> None:
    frame = LocalFrame(origin)
    assert math.dist(frame.to_ned(frame.to_geodetic(position_ned_m)), position_ned_m) < 1e-5


def test_far_above_the_earth_the_closed_form_still_holds() -> None:
    frame = LocalFrame(Geodetic(45.0, 7.0))
    assert frame.to_ned(frame.to_geodetic((0.0, 0.0, -100_000.0)))[2] == pytest.approx(-100_000.0, abs=1e-3)


def test_a_position_that_is_not_a_number_is_refused() -> None:
    frame = LocalFrame(Geodetic(45.0, 7.0))
    with pytest.raises(ValueError, match="latitude nan"):
        frame.to_geodetic((math.nan, 0.0, 0.0))


def test_frames_of_one_origin_know_each_other() -> None:
    one, same = LocalFrame(Geodetic(45.0, 7.0, 100.0)), LocalFrame(Geodetic(45.0, 7.0, 100.0))
    assert one.identity == same.identity
    assert one.identity != LocalFrame(Geodetic(45.0, 7.001, 100.0)).identity


def test_a_north_wind_blows_south() -> None:
    assert wind_from(3.0, 0.0) == pytest.approx((-3.0, 0.0, 0.0))
    assert wind_from(3.0, 270.0) == pytest.approx((0.0, 3.0, 0.0))
