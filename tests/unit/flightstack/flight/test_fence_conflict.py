"""An autopilot's own fence against the agent's: what may be flown, and what is refused with its numbers."""

from __future__ import annotations

import math
import re

import msgspec
import pytest

from flightstack.autopilot import OwnFence
from flightstack.config import LimitsConfig
from flightstack.flight.fence_conflict import fence_conflict
from mission.geometry.frames import Geodetic, LocalFrame, Vector3
from mission.geometry.geofence import Circle, Geofence, LocalFence, Vertex

FRAME = LocalFrame(Geodetic(38.4040, 14.9630, 300.0))
LIMITS = LimitsConfig(ceiling_above_home_m=60.0, fence_margin_m=3.0)
HOME: Vector3 = (0.0, 0.0, 0.0)


def place(north_m: float, east_m: float) -> Vertex:
    point = FRAME.to_geodetic((north_m, east_m, 0.0))
    return point.latitude_deg, point.longitude_deg


def square(half_m: float) -> tuple[Vertex, ...]:
    return tuple(place(n * half_m, e * half_m) for n, e in ((1, 1), (1, -1), (-1, -1), (-1, 1)))


OWN = LocalFence(FRAME, Geofence(inclusion=(square(50.0),)))
"""Its corners are 70.7 m from home."""


def conflict(own: LocalFence | None = OWN, home: Vector3 = HOME, **fence: object) -> str:
    named = {
        "radius_name": "FENCE_RADIUS",
        "ceiling_name": "FENCE_ALT_MAX",
        "floor_name": "FENCE_ALT_MIN",
    }
    autopilots = msgspec.convert(named | fence, OwnFence)
    return fence_conflict(autopilots, home, own, LIMITS, FRAME)


def test_no_fence_is_in_nobodys_way() -> None:
    assert conflict() == ""
    assert conflict(own=None) == ""


def test_stock_limits_turned_on_with_the_uploaded_fence_are_in_the_way_of_a_large_survey_only() -> None:
    """FENCE_TYPE 7: a circle of 300 m and a ceiling of 100 m with it."""
    stock = {"radius_m": 300.0, "ceiling_m": 100.0, "margin_m": 2.0}
    assert conflict(**stock) == ""
    large = LocalFence(FRAME, Geofence(inclusion=(square(280.0),)))
    assert "FENCE_RADIUS 300 m around home" in conflict(own=large, **stock)


def test_a_circle_that_is_tighter_is_refused_with_the_radius_that_would_do() -> None:
    told = conflict(radius_m=30.0, margin_m=2.0)
    assert "FENCE_RADIUS 30 m around home, AVOID_ENABLE holds 2 m before it" in told
    needed = re.search(r"set FENCE_RADIUS to (\d+)", told)
    assert needed is not None
    assert float(needed[1]) >= math.hypot(47.0, 47.0) + 2.0
    assert conflict(radius_m=float(needed[1]), margin_m=2.0) == ""


def test_a_circle_is_around_where_the_drone_stands() -> None:
    assert conflict(radius_m=75.0) == ""
    assert "FENCE_RADIUS" in conflict(radius_m=75.0, home=(30.0, 0.0, 0.0))


def test_the_same_fence_uploaded_to_the_autopilot_fits() -> None:
    assert conflict(inclusions=(square(50.0),), margin_m=2.0) == ""
    assert "uploaded inclusion polygon of 4 points" in conflict(inclusions=(square(45.0),))


def test_areas_that_overlap_count_together_only_where_the_autopilot_takes_them_so() -> None:
    halves = (
        (place(60, 60), place(60, -5), place(-60, -5), place(-60, 60)),
        (place(60, 5), place(60, -60), place(-60, -60), place(-60, 5)),
    )
    assert conflict(inclusions=halves, any_inclusion=True) == ""
    assert "inclusion polygon" in conflict(inclusions=halves)


def test_an_exclusion_that_our_fence_does_not_know_is_refused() -> None:
    hole = Circle(*place(10.0, 10.0), 8.0)
    assert "uploaded exclusion circle of 8 m" in conflict(exclusions=(hole,))
    knows = LocalFence(FRAME, Geofence(inclusion=(square(50.0),), exclusion_circles=(hole,)))
    assert conflict(own=knows, exclusions=(hole,)) == ""


def test_a_drone_without_a_fence_in_its_file_does_not_fly_against_its_autopilots() -> None:
    told = conflict(own=None, radius_m=300.0)
    assert "this drone's file has no geofence" in told
    assert "FENCE_RADIUS 300 m" in told


@pytest.mark.parametrize(("ceiling_m", "home_up_m", "fits"), [(62, 0, True), (55, 0, False), (55, 6, True)])
def test_the_ceiling_counts_from_home(ceiling_m: float, home_up_m: float, fits: bool) -> None:
    told = conflict(ceiling_m=float(ceiling_m), home=(0.0, 0.0, -float(home_up_m)))
    assert (told == "") is fits
    assert fits or "lower that to 55, or set FENCE_ALT_MAX to 60" in told


def test_a_floor_above_ours_is_refused() -> None:
    assert conflict(floor_m=-10.0) == ""
    assert "raise that to 6, or lower FENCE_ALT_MIN" in conflict(floor_m=6.0)
