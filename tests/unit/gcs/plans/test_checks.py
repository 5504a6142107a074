"""Plans: what the check finds, and how they travel to each autopilot and back."""

from __future__ import annotations

import math

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightstack.mavlink.modes import Flavour
from gcs.plans.checks import check_plan
from gcs.plans.mission_items import (
    FENCE_ACTIONS,
    differences,
    fence_items,
    fence_of,
    fence_parameters,
    mission_items,
    plan_items,
    rally_items,
    rally_points,
)
from mission.documents.plan_file import Plan, PlanItem
from mission.geometry.frames import Geodetic
from mission.geometry.geofence import Circle, Geofence

HOME = Geodetic(47.0, 8.0, 500.0)
METRE_DEG = 1.0 / 111_195.0


def at(north_m: float, east_m: float) -> tuple[float, float]:
    return 47.0 + north_m * METRE_DEG, 8.0 + east_m * METRE_DEG / math.cos(math.radians(47.0))


def item(
    north_m: float, east_m: float, altitude_m: float, command: int = 16, frame: int = 3, **more
) -> PlanItem:
    latitude_deg, longitude_deg = at(north_m, east_m)
    params = (0.0, None, None, None, latitude_deg, longitude_deg, altitude_m)
    return PlanItem(command=command, frame=frame, params=params, **more)


SQUARE = (at(-100, -100), at(-100, 100), at(100, 100), at(100, -100))
GOOD = Plan(
    items=(item(0, 0, 20, command=22), item(50, 0, 20), item(50, 50, 30), item(0, 0, 0, command=21)),
    home=HOME,
    geofence=Geofence(inclusion=(SQUARE,)),
)


def test_a_good_plan():
    check = check_plan(GOOD, "good.plan")
    assert (check.errors, check.warnings) == ((), ())
    assert (check.items, check.waypoints, check.fence_areas) == (4, 4, 1)
    assert check.length_m == pytest.approx(50 + 50 + 70.7, abs=1.0)
    assert check.highest_above_home_m == 30.0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"items": (item(0, 0, 20, command=22), item(150, 0, 20))}, "item 2 is 50 m outside"),
        ({"items": (item(0, 0, 20, command=22), item(50, 0, 130))}, "over the ceiling of 120 m"),
        ({"items": (item(0, 0, 20, command=22), item(50, 0, -3))}, "under the launch"),
        ({"items": (item(0, 0, 20, command=22), item(50, 0, 630, frame=0))}, "item 2 is 130 m above home"),
        ({"home": Geodetic(*at(0, 300))}, "home position is outside"),
        ({"rally": (Geodetic(*at(0, 300)),)}, "rally point 1 is outside"),
        ({"geofence": Geofence(inclusion=((at(0, 0), at(10, 10), at(0, 10), at(10, 0)),))}, "not simple"),
        (
            {
                "geofence": Geofence(
                    inclusion=(SQUARE,), exclusion=((at(20, -5), at(20, 5), at(30, 5), at(30, -5)),)
                )
            },
            "from item 1 to item 2 leaves",
        ),
    ],
)
def test_what_must_not_be_flown(changes, words):
    check = check_plan(msgspec.structs.replace(GOOD, **changes), "bad.plan")
    assert any(words in error for error in check.errors), check.errors
    assert not check.good


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"home": None}, "no planned home"),
        ({"geofence": None}, "no geofence"),
        ({"items": (item(50, 0, 20),)}, "no take-off"),
        ({"items": (item(0, 0, 20, command=22), item(50, 0, 20, frame=10))}, "item 2: its altitude"),
        ({"items": (), "geofence": None}, "empty"),
    ],
)
def test_what_is_probably_not_meant(changes, words):
    check = check_plan(msgspec.structs.replace(GOOD, **changes), "odd.plan")
    assert any(words in warning for warning in check.warnings), check.warnings


def test_items_without_a_place_are_not_waypoints():
    here = PlanItem(command=22, frame=3, params=(0.0, None, None, None, 0.0, 0.0, 15.0))
    speed = PlanItem(command=178, frame=2, params=(1.0, 5.0, -1.0, 0.0, None, None, None))
    check = check_plan(Plan(items=(here, speed), home=HOME, geofence=GOOD.geofence), "x.plan")
    assert (check.items, check.waypoints, check.errors) == (2, 0, ())


def test_ardupilot_gets_home_first_and_zeros():
    items = mission_items(GOOD, Flavour.ARDUPILOT)
    assert [i.seq for i in items] == [0, 1, 2, 3, 4]
    assert (items[0].x, items[0].y, items[0].z) == (470000000, 80000000, 500.0)
    assert items[1].command == 22
    assert items[1].param4 == 0.0


def test_px4_gets_no_home_and_nans():
    items = mission_items(GOOD, Flavour.PX4)
    assert [i.seq for i in items] == [0, 1, 2, 3]
    assert items[0].command == 22
    assert math.isnan(items[0].param4)


@pytest.mark.parametrize(("flavour", "target"), [(Flavour.ARDUPILOT, 2.0), (Flavour.PX4, 1.0)])
def test_jumps_name_the_item_as_each_autopilot_numbers_it(flavour, target):
    jump = PlanItem(command=177, frame=2, params=(9.0, 3.0, None, None, None, None, None))
    plan = Plan(items=(item(0, 0, 20, jump_id=8), item(9, 0, 20, jump_id=9), jump))
    assert mission_items(plan, flavour)[-1].param1 == target


@pytest.mark.parametrize("flavour", [Flavour.ARDUPILOT, Flavour.PX4])
def test_missions_come_back_as_they_went(flavour):
    back, home = plan_items(mission_items(GOOD, flavour), flavour)
    assert [i.command for i in back] == [i.command for i in GOOD.items]
    for sent, read in zip(GOOD.items, back, strict=True):
        assert read.params[4:] == pytest.approx(sent.params[4:], abs=1e-7)
    assert (home is not None) == (flavour is Flavour.ARDUPILOT)


degrees = st.floats(-80, 80, allow_nan=False)
vertices = st.tuples(degrees, degrees)
polygons = st.lists(st.lists(vertices, min_size=3, max_size=8).map(tuple), max_size=3).map(tuple)
circles = st.lists(st.builds(Circle, degrees, degrees, st.floats(1, 500)), max_size=2).map(tuple)


@settings(max_examples=50, deadline=None)
@given(st.builds(Geofence, polygons, polygons, circles, circles))
def test_fences_come_back_as_they_went(fence):
    items = fence_items(fence)
    assert [i.seq for i in items] == list(range(len(items)))
    back = fence_of(items)
    assert back == fence_of(fence_items(back)) if back else not items
    assert differences(items, fence_items(back) if back else []) == []


def test_an_incomplete_fence_is_not_taken_for_one():
    with pytest.raises(ValueError, match="not complete"):
        fence_of(fence_items(Geofence(inclusion=(SQUARE,)))[:3])


def test_rally_points_come_back_as_they_went():
    points = (Geodetic(47.0, 8.0, 25.0),)
    assert rally_points(rally_items(points))[0].amsl_m == 25.0


def test_differences_tolerate_rounding_and_nothing_else():
    sent = fence_items(Geofence(inclusion=(SQUARE,)))
    rounded = [msgspec.structs.replace(i, x=i.x + 3, y=i.y - 3) for i in sent]
    assert differences(sent, rounded) == []
    moved = [msgspec.structs.replace(sent[0], x=sent[0].x + 1000), *sent[1:]]
    assert "item 0 is at another place" in differences(sent, moved)[0]
    assert "3 items instead of 4" in differences(sent, sent[:3])[0]


def test_an_ardupilot_fence_needs_its_switches_and_keeps_other_bits():
    fence = Geofence(inclusion=(SQUARE,))
    wanted = fence_parameters(fence, FENCE_ACTIONS["rtl"], Flavour.ARDUPILOT, {"FENCE_TYPE": 3.0})
    assert wanted == {"FENCE_TYPE": 7.0, "FENCE_ACTION": 1.0, "FENCE_ENABLE": 1.0}
    assert list(wanted)[-1] == "FENCE_ENABLE", "armed last, when it is complete"
    two = Geofence(inclusion=(SQUARE, SQUARE))
    union = fence_parameters(two, FENCE_ACTIONS["rtl"], Flavour.ARDUPILOT, {"FENCE_OPTIONS": 1.0})
    assert union["FENCE_OPTIONS"] == 3.0
    assert fence_parameters(fence, FENCE_ACTIONS["land"], Flavour.PX4, {}) == {"GF_ACTION": 5.0}
