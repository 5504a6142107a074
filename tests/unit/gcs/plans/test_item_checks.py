"""Items that no autopilot takes, or takes for something else than the file says."""

from __future__ import annotations

import math
import pathlib

import msgspec
import pytest

from flightstack.mavlink.modes import Flavour
from gcs.errors import GroundError
from gcs.plans.checks import check_plan
from gcs.plans.mission_items import mission_items, plan_items
from mission.documents.plan_file import Plan, PlanItem, read_plan
from mission.geometry.frames import Geodetic, LocalFrame
from mission.geometry.geofence import Circle, Geofence

CASES = pathlib.Path(__file__).parents[3] / "data" / "cases"
HOME = Geodetic(47.0, 8.0, 500.0)
TAKE_OFF = PlanItem(command=22, frame=3, params=(0.0, None, None, None, 0.0, 0.0, 20.0), jump_id=1)


def item(command: int = 16, frame: int = 3, jump_id: int = 0, **params: float | None) -> PlanItem:
    """p1 to p7; a place near home where nothing else is said."""
    values = {"p1": 0.0, "p2": 0.0, "p3": 0.0, "p4": None, "p5": 47.0001, "p6": 8.0, "p7": 20.0} | params
    one, two, three, four, five, six, seven = values.values()
    place = (one, two, three, four, five, six, seven)
    return PlanItem(command=command, frame=frame, params=place, jump_id=jump_id)


def errors(*items: PlanItem, **changes: object) -> tuple[str, ...]:
    plan = Plan(items=(TAKE_OFF, *items), home=HOME)
    return check_plan(msgspec.structs.replace(plan, **changes), "a.plan").errors


def jump(target: float | None, times: float | None = 2.0, jump_id: int = 3) -> PlanItem:
    nothing = {"p3": 0.0, "p5": 0.0, "p6": 0.0, "p7": 0.0}
    return item(177, 2, jump_id, p1=target, p2=times, **nothing)


def test_good_items_are_good() -> None:
    speed = item(178, 2, p1=1.0, p2=5.0, p3=-1.0, p5=None, p6=None, p7=None)
    assert errors(item(jump_id=2), jump(2), speed, item(frame=10), item(21, p7=0.0)) == ()


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (
            jump(77),
            "item 3 (DO_JUMP): it jumps to item 77, which is not there; the numbers (doJumpId) are 1, 2, 3",
        ),
        (jump(0), "it jumps to item 0"),
        (jump(2.5), "it jumps to item 2.5"),
        (jump(3), "item 3 (DO_JUMP): it jumps to itself"),
        (jump(2, 1.5), "it jumps 1.5 times"),
        (jump(2, -2), "parameter 2 is -2, and is -1 to 32767 times to jump"),
        (item(p1=-5.0), "parameter 1 is -5, and is 0 to 65535 seconds to wait"),
        (item(178, 2, p1=1.0, p2=300.0), "parameter 2 is 300, and is -2 to 100 m/s"),
        (jump(None), "parameter 1 is not set"),
        (item(601, 2, p1=5.0), "item 3 (DO_JUMP_TAG): it jumps to the tag 5"),
        (item(60000), "item 3 (command 60000): command 60000 does not exist in MAVLink"),
        (item(5001), "a fence command is no mission item"),
        (item(5100), "a rally command is no mission item"),
        (item(3000, 2, p1=3.0), "a command for vehicles with wings"),
        (item(frame=7), "frame LOCAL_OFFSET_NED counts from wherever the vehicle is"),
        (item(frame=8), "frame BODY_NED counts from"),
        (item(frame=2), "frame MISSION is for commands without a place"),
        (item(178, 2, p1=1.0, p2=None), "parameter 2 is not set"),
        (
            item(p2=16777217.0),
            "parameter 2 is 16777217, and MAVLink's numbers carry 24 bits: it would become 16777216",
        ),
        (item(p2=1e39), "parameter 2 is 1e+39, more than MAVLink carries"),
        (item(205, 2, p5=0.5), "parameter 5 is 0.5, and frame MISSION carries whole numbers"),
        (item(205, 2, p5=3e9, p6=0.0), "parameter 5 is 3000000000, and frame MISSION carries"),
    ],
)
def test_what_no_autopilot_takes_is_named_with_item_and_command(bad: PlanItem, words: str) -> None:
    found = errors(item(jump_id=2), bad)
    assert any(words in error for error in found), found


def test_a_number_of_two_items_cannot_be_jumped_to() -> None:
    found = errors(item(jump_id=2), item(jump_id=2), jump(2))
    assert found == ("2 items have the number 2 (doJumpId), to which an item jumps; number them anew",)


def test_jumps_that_lead_to_each_other_are_named() -> None:
    found = errors(item(jump_id=2), jump(4, jump_id=3), jump(3, jump_id=4))
    assert [error.partition(": ")[2].partition(",")[0] for error in found] == [
        "it jumps to item 4",
        "it jumps to item 3",
    ]
    assert errors(item(jump_id=2), jump(4, jump_id=3), jump(2, jump_id=4)) == ()


def test_a_tag_that_is_set_can_be_jumped_to() -> None:
    assert errors(item(600, 2, p1=5.0, p5=0.0, p6=0.0), item(), item(601, 2, p1=5.0, p5=0.0, p6=0.0)) == ()


@pytest.mark.parametrize(
    ("kind", "name"), [(1, "fixed wing"), (10, "ground rover"), (12, "submarine"), (20, "vtol")]
)
def test_a_plan_for_another_class_of_vehicle_is_refused(kind: int, name: str) -> None:
    (found,) = errors(item(), vehicle_type=kind)
    assert name in found
    assert "multicopters" in found


@pytest.mark.parametrize("kind", [None, 0, 2, 13, 14])
def test_a_plan_for_a_copter_is_not(kind: int | None) -> None:
    assert errors(item(), vehicle_type=kind) == ()


# --- local frames ---

FENCE = Geofence(inclusion_circles=(Circle(47.0, 8.0, 100.0),))


@pytest.mark.parametrize(
    ("frame", "place"),
    [(1, {"p5": 60.0, "p6": -30.0, "p7": -25.0}), (4, {"p5": -30.0, "p6": 60.0, "p7": 25.0})],
)
def test_local_frames_are_metres_about_home(frame: int, place: dict[str, float]) -> None:
    plan = Plan(items=(TAKE_OFF, item(frame=frame, **place)), home=HOME, geofence=FENCE)
    check = check_plan(plan, "a.plan")
    assert check.errors == ()
    assert "metres about home" in check.warnings[0]
    assert check.highest_above_home_m == 25.0
    sent = mission_items(plan, Flavour.ARDUPILOT)[-1]
    assert (sent.frame, sent.z) == (3, 25.0)
    north_m, east_m, _ = LocalFrame(HOME).to_ned(Geodetic(sent.x * 1e-7, sent.y * 1e-7, HOME.amsl_m + 25.0))
    assert (north_m, east_m) == pytest.approx((60.0, -30.0), abs=0.02)


def test_metres_outside_the_fence_are_outside() -> None:
    (found,) = errors(item(frame=1, p5=150.0, p6=0.0, p7=-20.0), geofence=FENCE)
    assert found == "item 2 is 50 m outside the geofence"


def test_metres_about_no_home_are_nowhere() -> None:
    plan = Plan(items=(item(frame=1, p5=1.0, p6=2.0, p7=-3.0),))
    assert any("says no home" in error for error in check_plan(plan, "a.plan").errors)
    with pytest.raises(GroundError, match="says no home"):
        mission_items(plan, Flavour.PX4)


# --- the rest of a plan ---


def test_a_broken_fence_is_not_also_no_fence() -> None:
    for file, words in (("p05_fence2pts.plan", "2 different vertices"), ("p06_bowtie.plan", "sides cross")):
        check = check_plan(read_plan(CASES / file), file)
        assert [words in error for error in check.errors] == [True]
        assert check.warnings == ()


def test_what_the_reader_did_not_take_over_is_told_with_the_check() -> None:
    check = check_plan(read_plan(CASES / "w07_oldfence.txt"), "w07")
    assert check.good
    assert check.fence_areas == 1
    assert check.warnings == (
        "line 1: the point to return to at this fence is not taken over: copters have none",
    )


def test_a_place_on_the_other_side_of_the_world_is_a_slip() -> None:
    assert any("km from the planned home position" in error for error in errors(item(p5=8.0, p6=47.0)))
    assert any("rally point 1 is" in error for error in errors(item(), rally=(Geodetic(-47.0, 8.0, 30.0),)))


def test_rally_points_and_take_offs_have_altitudes_too() -> None:
    assert errors(item(), rally=(Geodetic(47.0, 8.0, 300.0),)) == (
        "rally point 1 is 300 m above home, over the ceiling of 120 m",
    )
    assert "under the launch" in errors(item(), rally=(Geodetic(47.0, 8.0, 0.0),))[0]
    high = PlanItem(command=22, frame=3, params=(0.0, None, None, None, 0.0, 0.0, 500.0))
    assert "under the launch" in errors(msgspec.structs.replace(high, params=(*high.params[:6], 0.0)))[0]
    assert errors(high) == ("item 2 is 500 m above home, over the ceiling of 120 m",)


def test_an_inclusion_inside_another_is_probably_an_exclusion() -> None:
    outer = ((46.99, 7.99), (46.99, 8.01), (47.01, 8.01), (47.01, 7.99))
    inner = ((46.999, 7.999), (46.999, 8.001), (47.001, 8.001))
    plan = Plan(items=(TAKE_OFF,), home=HOME, geofence=Geofence(inclusion=(outer, inner)))
    assert "inclusion polygon 1 lies within inclusion polygon 0" in check_plan(plan, "a.plan").warnings[0]
    apart = Geofence(inclusion=(outer, tuple((a + 0.1, b) for a, b in inner)))
    assert check_plan(msgspec.structs.replace(plan, geofence=apart), "a.plan").warnings == ()


def test_a_polygon_that_ardupilot_cannot_count_is_told() -> None:
    ring = tuple((47.0 + math.sin(i / 50.0) / 100, 8.0 + math.cos(i / 50.0) / 100) for i in range(300))
    check = check_plan(Plan(home=HOME, geofence=Geofence(inclusion=(ring,))), "a.plan")
    assert check.warnings == ("a geofence polygon of 300 vertices: ArduPilot takes 255; draw it simpler",)


def test_a_waypoint_at_0_0_means_two_things() -> None:
    check = check_plan(Plan(items=(TAKE_OFF, item(p5=0.0, p6=0.0)), home=HOME), "a.plan")
    assert next(w for w in check.warnings if "0, 0" in w).startswith("item 2 (NAV_WAYPOINT): it is at 0, 0")


def test_home_at_0_0_is_none() -> None:
    check = check_plan(Plan(items=(TAKE_OFF, item()), home=Geodetic(0.0, 0.0)), "a.plan")
    assert check.errors == ()
    assert any("stands for none" in warning for warning in check.warnings)


@pytest.mark.parametrize("flavour", [Flavour.ARDUPILOT, Flavour.PX4])
def test_exactly_one_item_of_an_upload_is_the_current_one(flavour: Flavour) -> None:
    for plan in (Plan(items=(TAKE_OFF, item()), home=HOME), read_plan(CASES / "p22_sharededge.plan")):
        items = mission_items(plan, flavour)
        assert sum(one.current for one in items) == int(bool(items))


def test_parameters_5_and_6_are_scaled_as_their_frame_says() -> None:
    mount = item(205, 2, p5=7.0, p6=-3.0, p7=2.0)
    (sent,) = mission_items(Plan(items=(mount,)), Flavour.PX4)
    assert (sent.x, sent.y, math.isnan(sent.param4)) == (7, -3, True)
    (back,), _ = plan_items([sent], Flavour.PX4)
    assert back.params == mount.params
