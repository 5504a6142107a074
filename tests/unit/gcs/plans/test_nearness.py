"""A plan and where the vehicle is."""

from __future__ import annotations

import pytest

from gcs.plans.nearness import FAR_M, distance_m, nearness_warnings
from mission.documents.flight_plan import Plan, PlanItem
from mission.geometry.frames import Geodetic, LocalFrame
from mission.geometry.geofence import Circle, Geofence

HERE = Geodetic(28.2724, -16.6425, 2300.0)
FRAME = LocalFrame(HERE)


def place(north_m: float) -> Geodetic:
    return FRAME.to_geodetic((north_m, 0.0, 0.0))


def item(north_m: float, command: int = 16, frame: int = 3) -> PlanItem:
    point = place(north_m)
    return PlanItem(
        command=command,
        frame=frame,
        params=(0.0, 0.0, 0.0, None, point.latitude_deg, point.longitude_deg, 20.0),
    )


def circle(north_m: float, radius_m: float) -> Geofence:
    center = place(north_m)
    return Geofence(inclusion_circles=(Circle(center.latitude_deg, center.longitude_deg, radius_m),))


@pytest.mark.parametrize("north_m", [0.0, 100.0, 0.9 * FAR_M])
def test_a_plan_of_this_place_is_nothing_to_tell_of(north_m):
    assert nearness_warnings(Plan(items=(item(50_000.0), item(north_m))), HERE) == []


def test_a_plan_of_another_place_is():
    assert nearness_warnings(Plan(items=(item(12_300.0), item(90_000.0))), HERE) == [
        "the plan is 12.3 km from the vehicle: is it the plan of this place?"
    ]
    assert "km from the vehicle" in nearness_warnings(Plan(rally=(place(5_000.0),)), HERE)[0]
    assert "km from the vehicle" in nearness_warnings(Plan(geofence=circle(9_000.0, 100.0)), HERE)[0]


def test_inside_of_a_wide_fence_every_plan_is_near():
    assert nearness_warnings(Plan(geofence=circle(9_000.0, 20_000.0)), HERE) == []


def test_a_vehicle_outside_of_its_fence_is_told_of():
    assert nearness_warnings(Plan(geofence=circle(300.0, 100.0)), HERE) == [
        "the vehicle is 200 m outside of this fence"
    ]


def test_what_is_no_place_is_not_far():
    assert (
        nearness_warnings(Plan(items=(PlanItem(command=22, frame=3, params=(0, 0, 0, None, 0, 0, 9)),)), HERE)
        == []
    )
    assert nearness_warnings(Plan(items=(item(9_000.0, frame=2),)), HERE) == []
    assert nearness_warnings(Plan(), HERE) == []


def test_distances_over_the_ground():
    assert distance_m(HERE, place(5_000.0)) == pytest.approx(5_000.0, rel=0.01)
    assert distance_m(Geodetic(0.0, 179.9), Geodetic(0.0, -179.9)) == pytest.approx(22_239.0, rel=0.01)
    assert distance_m(Geodetic(90.0, 0.0), Geodetic(-90.0, 7.0)) == pytest.approx(20_015_000.0, rel=0.01)
