"""The geofence: its checks at load and the questions that the guard asks."""

from __future__ import annotations

import math

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.documents.yaml_file import DocumentError, parse
from mission.geometry.frames import Geodetic, LocalFrame
from mission.geometry.geofence import Circle, Geofence, LocalFence, Vertex

FRAME = LocalFrame(Geodetic(47.4, 8.5, 500.0))


def at(north_m: float, east_m: float) -> Vertex:
    point = FRAME.to_geodetic((north_m, east_m, 0.0))
    return point.latitude_deg, point.longitude_deg


def polygon(*points: tuple[float, float]) -> tuple[Vertex, ...]:
    return tuple(at(*point) for point in points)


def circle(north_m: float, east_m: float, radius_m: float) -> Circle:
    return Circle(*at(north_m, east_m), radius_m)


SQUARE = polygon((-100.0, -100.0), (100.0, -100.0), (100.0, 100.0), (-100.0, 100.0))
NOTCHED = polygon((-100.0, -100.0), (100.0, -100.0), (100.0, 100.0), (0.0, 0.0), (-100.0, 100.0))


def test_contains_concave_polygon_of_either_winding() -> None:
    for vertices in (NOTCHED, NOTCHED[::-1], (*NOTCHED, NOTCHED[0])):
        fence = Geofence(inclusion=(vertices,))
        assert fence.problems() == []
        local = LocalFence(FRAME, fence)
        assert local.contains(0.0, -50.0)
        assert not local.contains(0.0, 50.0)
        assert local.contains(80.0, 70.0)


def test_clearance_is_signed_and_nearest_edge_point_lies_on_the_line() -> None:
    local = LocalFence(FRAME, Geofence(inclusion=(SQUARE,)))
    assert local.clearance_m(90.0, 0.0) == pytest.approx(10.0, abs=1e-3)
    assert local.clearance_m(115.0, 0.0) == pytest.approx(-15.0, abs=1e-3)
    assert local.nearest_edge_point(90.0, 5.0) == pytest.approx((100.0, 5.0), abs=1e-3)


def test_exclusions_are_cut_out_and_circles_err_on_the_safe_side() -> None:
    local = LocalFence(
        FRAME,
        Geofence(
            inclusion=(SQUARE,),
            exclusion=(polygon((20.0, 20.0), (40.0, 20.0), (40.0, 40.0), (20.0, 40.0)),),
            exclusion_circles=(circle(-50.0, -50.0, 30.0),),
        ),
    )
    assert not local.contains(30.0, 30.0)
    assert local.clearance_m(30.0, 30.0) == pytest.approx(-10.0, abs=1e-3)
    for degrees in range(0, 360, 7):
        angle = math.radians(degrees)
        assert not local.contains(-50.0 + 29.99 * math.cos(angle), -50.0 + 29.99 * math.sin(angle))
    inside = LocalFence(FRAME, Geofence(inclusion_circles=(circle(0.0, 0.0, 30.0),)))
    for degrees in range(0, 360, 7):
        angle = math.radians(degrees)
        assert not inside.contains(30.01 * math.cos(angle), 30.01 * math.sin(angle))


def test_no_inclusion_means_everywhere_but_the_exclusions() -> None:
    local = LocalFence(FRAME, Geofence(exclusion_circles=(circle(0.0, 0.0, 10.0),)))
    assert local.contains(5000.0, -5000.0)
    assert not local.contains(0.0, 0.0)
    assert LocalFence(FRAME, Geofence()).contains(1.0, 2.0)


def test_nearest_allowed_and_path_clear_keep_the_margin() -> None:
    local = LocalFence(FRAME, Geofence(inclusion=(SQUARE,), exclusion_circles=(circle(0.0, 0.0, 20.0),)))
    assert local.nearest_allowed(50.0, 50.0, 3.0) == (50.0, 50.0)
    assert local.nearest_allowed(130.0, 50.0, 3.0) == pytest.approx((97.0, 50.0), abs=1e-3)
    north_m, east_m = local.nearest_allowed(3.0, 0.0, 3.0)
    assert math.hypot(north_m, east_m) == pytest.approx(23.0, abs=0.05)
    assert not local.path_clear((-50.0, 0.0), (50.0, 0.0), 3.0)
    assert local.path_clear((-50.0, 30.0), (50.0, 30.0), 3.0)
    assert not local.path_clear((-50.0, 21.0), (50.0, 21.0), 3.0)
    assert local.path_clear((30.0, 30.0), (30.0, 30.0), 3.0)


def test_a_margin_that_nothing_keeps_leads_to_the_middle() -> None:
    local = LocalFence(FRAME, Geofence(inclusion=(SQUARE,)))
    north_m, east_m = local.nearest_allowed(300.0, 300.0, 150.0)
    assert local.clearance_m(north_m, east_m) > 99.0


@settings(max_examples=60, deadline=None)
@given(
    st.floats(-300.0, 300.0),
    st.floats(-300.0, 300.0),
    st.sampled_from([0.0, 3.0, 10.0]),
)
def test_nearest_allowed_is_allowed_and_no_farther_than_needed(
    north_m: float, east_m: float, margin_m: float
) -> None:
    local = LocalFence(FRAME, Geofence(inclusion=(NOTCHED,), exclusion_circles=(circle(0.0, -50.0, 15.0),)))
    near = local.nearest_allowed(north_m, east_m, margin_m)
    assert local.clearance_m(*near) >= margin_m * 0.999 - 1e-6
    moved_m = math.dist(near, (north_m, east_m))
    if local.clearance_m(north_m, east_m) >= margin_m:
        assert moved_m <= 1e-6
    else:
        assert moved_m >= (margin_m - local.clearance_m(north_m, east_m)) * 0.999 - 1e-6
    edge = local.nearest_edge_point(north_m, east_m)
    assert math.dist(edge, (north_m, east_m)) == pytest.approx(
        abs(local.clearance_m(north_m, east_m)), abs=1e-6
    )


@pytest.mark.parametrize(
    ("fence", "words"),
    [
        (
            Geofence(inclusion=(polygon((0, 0), (10, 10), (10, 0), (0, 10)),)),
            "inclusion polygon 0 is not simple",
        ),
        (
            Geofence(inclusion=(SQUARE, polygon((0, 0), (10, 10)))),
            "inclusion polygon 1 has 2 different vertices",
        ),
        (Geofence(exclusion=((),)), "exclusion polygon 0 has 0 different vertices"),
        (Geofence(inclusion=(polygon((0, 0), (10, 0), (20, 0)),)), "has no area"),
        (
            Geofence(inclusion=(SQUARE,), exclusion_circles=(circle(0, 0, 300),)),
            "exclusion areas cover its inclusion",
        ),
        (Geofence(inclusion=(((47.0, 8.0), (47.0, -8.0), (47.1, 8.0)),)), "wrong sign"),
        (Geofence(inclusion=(((math.nan, 8.0), (47.0, 8.0), (47.1, 8.1)),)), "finite"),
        (Geofence(inclusion=(((47.0, 8.0), (47.0, 10.0), (48.0, 9.0)),)), "km wide"),
    ],
)
def test_what_cannot_be_is_named(fence: Geofence, words: str) -> None:
    (problem,) = fence.problems()
    assert words in problem
    with pytest.raises(ValueError, match=words.split()[0]):
        LocalFence(FRAME, fence)


def test_yaml_with_an_impossible_latitude_names_the_field() -> None:
    with pytest.raises(DocumentError, match=r"inclusion\[0\]\[1\]"):
        parse("inclusion:\n - [[47, 8], [97, 8], [47, 9]]\n", Geofence, "fence.yaml")


def test_a_fence_survives_encoding() -> None:
    fence = Geofence(inclusion=(SQUARE,), exclusion_circles=(circle(0.0, 0.0, 5.0),))
    assert msgspec.json.decode(msgspec.json.encode(fence), type=Geofence) == fence


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.floats(-130.0, 130.0), st.floats(-130.0, 130.0)), min_size=2, max_size=12),
    st.floats(-30.0, 40.0),
)
def test_what_was_measured_a_little_way_off_answers_as_a_measurement_would(
    way: list[tuple[float, float]], least_m: float
) -> None:
    flown = LocalFence(FRAME, Geofence(inclusion=(NOTCHED,), exclusion_circles=(circle(0.0, -50.0, 15.0),)))
    for point in way:
        fresh = LocalFence(
            FRAME, Geofence(inclusion=(NOTCHED,), exclusion_circles=(circle(0.0, -50.0, 15.0),))
        )
        clearance_m = fresh.clearance_m(*point)
        if abs(clearance_m - least_m) > 1e-5:
            assert flown.keeps(*point, least_m) == (clearance_m > least_m)
        assert fresh.clearance_m(*point) == clearance_m == flown.clearance_m(*point)
