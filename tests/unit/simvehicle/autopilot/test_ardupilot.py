"""The simulated ArduCopter: rules and failsafes that the recording does not show."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot.fences import Area

MakeGround = Callable[..., Any]
GUIDED, AUTO, LOITER, RTL, LAND, BRAKE, STABILIZE = 4, 3, 5, 6, 9, 17, 0
ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED = 0, 1, 2, 3, 4


def test_takes_off_only_armed_in_guided_and_upwards(make_ground: MakeGround) -> None:
    ground = make_ground("ardupilot")
    ground.run(8.0)
    assert ground.command(22, 0, 0, 0, 0, 0, 0, 10) == FAILED
    assert ground.command(400, 1) == ACCEPTED
    assert ground.command(22, 0, 0, 0, 0, 0, 0, 10) == FAILED, "not in STABILIZE"
    assert ground.mode(GUIDED) == ACCEPTED
    assert ground.command(22, 0, 0, 0, 0, 0, 0, -3) == FAILED
    assert ground.command(22, 0, 0, 0, 0, 0, 0, 10) == ACCEPTED


def test_a_target_before_takeoff_moves_nothing_and_it_disarms_by_itself(make_ground: MakeGround) -> None:
    ground = make_ground("ardupilot")
    ground.run(8.0)
    ground.mode(GUIDED)
    ground.command(400, 1)
    ground.run(9.0, each=lambda: ground.position_target(10.0, 0.0, -10.0))
    assert ground.vehicle.armed
    assert not ground.vehicle.airborne
    ground.run(2.0)
    assert not ground.vehicle.armed
    assert ground.texts()[-1] == "Disarming motors"


def test_unknown_modes_and_modes_without_the_custom_flag_are_refused(make_ground: MakeGround) -> None:
    ground = make_ground("ardupilot")
    ground.run(8.0)
    assert ground.mode(99) == FAILED
    assert ground.command(176, 0, GUIDED) == DENIED
    assert ground.vehicle.mode == "STABILIZE"


def test_body_velocities_turn_with_the_heading(make_ground: MakeGround) -> None:
    ground = make_ground("ardupilot")
    ground.take_off()
    ground.run(5.0, each=lambda: ground.velocity_target(0.0, 3.0, 0.0))  # turns to face east
    ground.run(3.0, each=lambda: ground.velocity_target(2.0, 0.0, 0.0, frame=mavlink.MAV_FRAME_BODY_NED))
    north, east, _ = ground.vehicle.velocity_ned_mps
    assert east == pytest.approx(2.0, abs=0.4)
    assert abs(north) < 0.5


def test_global_targets_in_both_altitude_frames(make_ground: MakeGround) -> None:
    ground = make_ground("ardupilot")
    ground.take_off()
    for frame, altitude_m in (
        (mavlink.MAV_FRAME_GLOBAL_INT, 520.0),
        (mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, 15.0),
    ):
        message = mavlink.MAVLink_set_position_target_global_int_message(
            0, 7, 1, frame, 0x0DF8, -50598000, 1513000000, altitude_m, *[0.0] * 8
        )
        ground.send(message)
        ground.run(15.0)
        assert ground.vehicle.position_ned_m[0] == pytest.approx(22.1, abs=1.0)
        assert ground.above_m == pytest.approx(20.0 if altitude_m > 100 else 15.0, abs=1.0)


def test_reposition_wants_guided_or_the_flag(make_ground: MakeGround) -> None:
    ground = make_ground("ardupilot")
    ground.take_off()
    ground.mode(LOITER)
    assert ground.command_int(192, 6, -1, 0, 0, 0, -5.0599, 151.3, 12.0) == DENIED
    assert ground.command_int(192, 6, -1, 1, 0, 0, -5.0599, 151.3, 12.0) == ACCEPTED
    assert ground.vehicle.mode == "GUIDED"
    ground.run(15.0)
    assert ground.vehicle.position_ned_m[0] == pytest.approx(11.1, abs=1.0)


def test_rtl_climbs_first_and_ends_disarmed_at_home(make_ground: MakeGround) -> None:
    ground = make_ground("ardupilot", RTL_ALT=2000.0, RTL_LOIT_TIME=1000.0, LAND_SPEED=100.0)
    ground.take_off(8.0)
    ground.position_target(40.0, -30.0, -8.0)
    ground.run(20.0)
    assert ground.command(20) == ACCEPTED
    ground.run(4.0)
    assert math.dist(ground.vehicle.position_ned_m[:2], (40.0, -30.0)) < 2.0
    ground.run_until(lambda: ground.above_m > 19.0, 20.0)
    ground.run_until(lambda: not ground.vehicle.armed)
    assert math.dist(ground.vehicle.position_ned_m, (0.0, 0.0, 0.0)) < 1.5
    assert ground.command(400, 1) == FAILED, "RTL is no mode to arm in"


def test_ground_station_loss_counts_only_the_named_system(make_ground: MakeGround) -> None:
    ground = make_ground("ardupilot", FS_GCS_ENABLE=1.0)
    ground.take_off()
    ground.position_target(30.0, 0.0, -10.0)
    ground.run(10.0)
    ground.heartbeats = False
    other = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)
    ground.run(4.0, each=lambda: ground.send(other, sender=(7, 191)))
    assert ground.vehicle.mode == "GUIDED"
    ground.run(2.0, each=lambda: ground.send(other, sender=(7, 191)))
    assert ground.vehicle.mode == "RTL"
    assert "GCS Failsafe" in ground.texts()
    ground.heartbeats = True
    ground.run(2.0)
    assert "GCS Failsafe Cleared" in ground.texts()
    assert ground.vehicle.mode == "RTL", "the pilot has to take it back"


def test_no_ground_station_was_ever_there(make_ground: MakeGround) -> None:
    ground = make_ground("ardupilot", FS_GCS_ENABLE=1.0)
    ground.heartbeats = False
    ground.take_off()
    ground.run(10.0)
    assert ground.vehicle.mode == "GUIDED"


def test_weak_battery_acts_as_configured(make_ground: MakeGround) -> None:
    ground = make_ground("ardupilot", BATT_FS_LOW_ACT=2.0)
    ground.take_off()
    ground.vehicle.weaken_battery()
    ground.run(9.0)
    assert ground.vehicle.mode == "GUIDED"
    ground.run(2.0)
    assert ground.vehicle.mode == "RTL"
    assert ground.of("HEARTBEAT")[-1].system_status == mavlink.MAV_STATE_CRITICAL


def test_the_pilots_switch_ends_guided(make_ground: MakeGround) -> None:
    ground = make_ground("ardupilot")
    ground.take_off()

    def override(mode_us: int, sender: tuple[int, int] | None = None) -> None:
        message = mavlink.MAVLink_rc_channels_override_message(7, 1, 1500, 1500, 1500, 1500, mode_us, 0, 0, 0)
        ground.send(message, sender=sender)

    override(1700, sender=(9, 1))
    assert ground.vehicle.mode == "GUIDED", "only SYSID_MYGCS holds the sticks"
    override(1700)  # position 5: LOITER
    assert ground.vehicle.mode == "LOITER"
    ground.run(2.0, each=lambda: ground.velocity_target(3.0, 0.0, 0.0))
    assert math.hypot(*ground.vehicle.velocity_ned_mps) < 0.3
    message = mavlink.MAVLink_rc_channels_override_message(7, 1, 1500, 1200, 1500, 1500, 0, 0, 0, 0)
    ground.run(3.0, each=lambda: ground.send(message))
    assert ground.vehicle.velocity_ned_mps[0] > 2.0, "stick forward"
    ground.run(8.0)
    assert math.hypot(*ground.vehicle.velocity_ned_mps) < 0.3, "the override runs out after three seconds"


def test_fence_refuses_destinations_and_is_flown_out_of_only_by_velocity(make_ground: MakeGround) -> None:
    ground = make_ground("ardupilot", FENCE_ENABLE=1.0, FENCE_TYPE=2.0, FENCE_RADIUS=30.0, AVOID_ENABLE=0.0)
    ground.take_off()
    ground.position_target(50.0, 0.0, -10.0)
    ground.run(5.0)
    assert ground.vehicle.position_ned_m[0] < 2.0
    ground.run_until(lambda: ground.vehicle.mode == "RTL", each=lambda: ground.velocity_target(5.0, 0.0, 0.0))
    assert "Circle fence breached" in ground.texts()
    assert ground.of("FENCE_STATUS")[-1].breach_type == mavlink.FENCE_BREACH_BOUNDARY
    ground.run_until(lambda: not ground.vehicle.armed)
    assert "Fence breach cleared" in ground.texts()


@pytest.mark.parametrize("kind", ["circle", "polygon"])
@pytest.mark.parametrize("behave", [0.0, 1.0], ids=["slides", "stops"])
def test_stock_avoidance_keeps_velocity_targets_inside_without_a_word(
    make_ground: MakeGround, kind: str, behave: float
) -> None:
    circle = kind == "circle"
    ground = make_ground(
        "ardupilot",
        wind_mps=0.0,
        FENCE_ENABLE=1.0,
        FENCE_TYPE=2.0 if circle else 4.0,
        FENCE_RADIUS=40.0,
        AVOID_BEHAVE=behave,
    )
    square = ((40.0, 40.0), (40.0, -40.0), (-40.0, -40.0), (-40.0, 40.0))
    ground.vehicle.autopilot.fence.areas = (Area(inclusion=True, vertices_m=square),)
    ground.take_off()
    ground.run(25.0, each=lambda: ground.velocity_target(4.0, 1.0, 0.0))
    north_m, east_m, _ = ground.vehicle.position_ned_m
    from_home_m = math.hypot(north_m, east_m) if circle else north_m
    assert 36.5 < from_home_m < 38.6, "two metres from the line: FENCE_MARGIN"
    assert ground.vehicle.mode == "GUIDED"
    assert not any("ence breach" in text for text in ground.texts())
    assert (east_m > 15.0) is (behave == 0.0 and not circle), (
        "along a circle it comes to rest where it was sent out"
    )


def test_one_that_falls_flat_stays_armed_and_believes_that_it_flies(make_ground: MakeGround) -> None:
    ground = make_ground("ardupilot")
    ground.take_off()
    ground.vehicle.set_motors(False)
    ground.run(20.0)
    assert not ground.vehicle.airborne
    assert ground.vehicle.armed
    assert "Potential Thrust Loss (1)" in ground.texts()
    assert not any(text.startswith("Crash") for text in ground.texts())


def test_one_that_falls_on_its_back_disarms_and_does_not_arm_again(make_ground: MakeGround) -> None:
    ground = make_ground("ardupilot")
    ground.take_off()
    ground.vehicle.set_turned_over(True)
    ground.run(6.0)
    assert not ground.vehicle.armed
    assert any(text.startswith("Crash: Disarming") for text in ground.texts())
    ground.mode(GUIDED)
    assert ground.command(400, 1) == FAILED


def test_disarming_in_the_air_needs_force(make_ground: MakeGround) -> None:
    ground = make_ground("ardupilot")
    ground.take_off()
    assert ground.command(400, 0) == FAILED
    assert ground.vehicle.armed
    assert ground.command(400, 0, 21196) == ACCEPTED
    assert not ground.vehicle.armed
    ground.run(5.0)
    assert not ground.vehicle.airborne


def test_wind_is_told_only_with_drag_parameters(make_ground: MakeGround) -> None:
    for drag, expected in ((0.0, 0.0), (0.2, 6.0)):
        ground = make_ground("ardupilot", wind_mps=6.0, EK3_DRAG_MCOEF=drag)
        ground.command(511, 168, 1e6)
        ground.take_off()
        ground.run(15.0)
        wind = ground.of("WIND")[-1]
        assert wind.speed == pytest.approx(expected, abs=0.7)
        if drag:
            assert abs(wind.direction) == pytest.approx(180.0, abs=10.0), "where it comes from"


def test_home_follows_the_vehicle_until_it_is_armed(make_ground: MakeGround) -> None:
    ground = make_ground("ardupilot", ready_after_s=20.0)
    ground.run(5.0)
    assert ground.command(512, 242) == ACCEPTED
    assert not ground.of("HOME_POSITION"), "not known yet"
    ground.run(20.0)
    (first,) = ground.of("HOME_POSITION")
    assert first.latitude == pytest.approx(-50600000, abs=60)
    assert first.altitude == pytest.approx(500_000, abs=800)
