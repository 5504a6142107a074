"""The simulated PX4: Offboard and its loss, failsafes, missions, parameters byte by byte."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.dialect import EventMessage
from flightstack.mavlink.fields import layout
from flightstack.mavlink.framing import FrameFinder
from flightstack.mavlink.px4_event_table import CHECKS, REPORT_BEGIN, event_id

MakeGround = Callable[..., Any]
ACCEPTED, REJECTED, DENIED = 0, 1, 2
OFFBOARD, HOLD = (6, 0), (4, 3)
NAMES = {number: event.name for number, event in CHECKS.items()}


def events(ground: Any) -> list[Any]:
    """Every EVENT on the first link; pymavlink knows the message by its number only."""
    found = []
    for message in ground.of(f"UNKNOWN_{EventMessage.id}"):
        found += [layout(frame.kind).unpack(frame.payload) for frame in FrameFinder().find(message.data)]
    return found


def reported(ground: Any) -> list[str]:
    """The checks that fail, by the newest report."""
    checks: list[str] = []
    for event in events(ground):
        if event.id == event_id(REPORT_BEGIN):
            checks = []
        elif event.id in NAMES:
            checks.append(NAMES[event.id])
    return checks


def offboard(ground: Any) -> None:
    """At 10 m, in Offboard with setpoints that come."""
    ground.take_off()
    ground.run(1.0, each=lambda: ground.position_target(0.0, 0.0, -10.0))
    assert ground.mode(*OFFBOARD) == ACCEPTED


def test_arming_is_refused_with_one_text_and_a_report_until_it_is_ready(make_ground: MakeGround) -> None:
    ground = make_ground("px4", ready_after_s=20.0)
    ground.run(2.0)
    assert ground.command(400, 1) == REJECTED
    assert ground.texts() == ["Arming denied: Resolve system health failures first"]
    assert ground.of("HEARTBEAT")[-1].system_status == mavlink.MAV_STATE_UNINIT
    assert "check_modes_global_pos" in reported(ground)
    ground.run(20.0)
    assert "check_modes_global_pos" not in reported(ground)
    assert ground.of("HEARTBEAT")[-1].system_status == mavlink.MAV_STATE_STANDBY
    assert ground.command(400, 1) == ACCEPTED


def test_offboard_needs_a_stream_of_setpoints(make_ground: MakeGround) -> None:
    ground = make_ground("px4")
    ground.take_off()
    assert ground.mode(*OFFBOARD) == REJECTED
    ground.position_target(5.0, 0.0, -10.0)
    assert ground.mode(*OFFBOARD) == REJECTED, "one is no stream"
    ground.run(1.0, each=lambda: ground.position_target(5.0, 0.0, -10.0))
    assert ground.mode(*OFFBOARD) == ACCEPTED
    ground.run(8.0, each=lambda: ground.position_target(5.0, 0.0, -12.0))
    assert math.dist(ground.vehicle.position_ned_m, (5.0, 0.0, -12.0)) < 1.0


def test_offboard_takes_off_by_itself(make_ground: MakeGround) -> None:
    ground = make_ground("px4")
    ground.run(8.0)
    ground.run(1.0, each=lambda: ground.position_target(0.0, 0.0, -6.0))
    assert ground.mode(*OFFBOARD) == ACCEPTED
    assert ground.command(400, 1) == ACCEPTED
    ground.run(12.0, each=lambda: ground.position_target(0.0, 0.0, -6.0))
    assert ground.above_m == pytest.approx(6.0, abs=0.8)


def test_velocity_with_height_held(make_ground: MakeGround) -> None:
    ground = make_ground("px4")
    offboard(ground)
    mask = 0x0DC7 & ~4 | 32  # z as a position, x and y as velocities
    message = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 7, 1, 1, mask, 0, 0, -14.0, 3.0, 0.0, 0.0, *[0.0] * 5
    )
    ground.run(8.0, each=lambda: ground.send(message))
    assert ground.vehicle.velocity_ned_mps[0] == pytest.approx(3.0, abs=0.4)
    assert ground.above_m == pytest.approx(14.0, abs=0.6)


@pytest.mark.parametrize(
    ("action", "mode"), [(0.0, "POSITION"), (3.0, "RTL"), (4.0, "LAND"), (5.0, "HOLD"), (99.0, "POSITION")]
)
def test_offboard_loss_acts_at_once_and_is_over_with_the_next_setpoints(
    make_ground: MakeGround, action: float, mode: str
) -> None:
    ground = make_ground("px4", COM_OBL_RC_ACT=action)
    offboard(ground)
    ground.run(0.8)
    assert ground.vehicle.mode == "OFFBOARD"
    ground.run(0.6)
    assert ground.vehicle.mode == mode, "COM_FAIL_ACT_T is for other failsafes"
    assert "Failsafe activated" in ground.texts()
    ground.run(1.0)
    assert ground.of("HEARTBEAT")[-1].system_status == mavlink.MAV_STATE_CRITICAL
    ground.run(0.5, each=lambda: ground.position_target(0.0, 0.0, -10.0))
    assert ground.vehicle.mode == "OFFBOARD"


def test_without_a_remote_control_position_sinks_to_the_ground(make_ground: MakeGround) -> None:
    ground = make_ground("px4")
    offboard(ground)
    ground.run(4.0)
    assert ground.vehicle.velocity_ned_mps[2] == pytest.approx(1.0, abs=0.2)
    ground.run_until(lambda: not ground.vehicle.armed, limit_s=25.0)
    assert not ground.vehicle.airborne


def test_a_persons_mode_ends_the_failsafe(make_ground: MakeGround) -> None:
    ground = make_ground("px4", COM_OBL_RC_ACT=3.0)
    offboard(ground)
    ground.run(1.5)
    assert ground.mode(*HOLD) == ACCEPTED
    ground.run(10.0)
    assert ground.vehicle.mode == "HOLD"
    assert ground.of("HEARTBEAT")[-1].system_status == mavlink.MAV_STATE_ACTIVE


@pytest.mark.parametrize(
    ("parameters", "trouble", "mode"),
    [
        ({"NAV_DLL_ACT": 2.0}, "link", "RTL"),
        ({"COM_LOW_BAT_ACT": 3.0}, "battery", "RTL"),
        ({}, "gps", "LAND"),
    ],
)
def test_failsafes(make_ground: MakeGround, parameters: dict[str, float], trouble: str, mode: str) -> None:
    ground = make_ground("px4", **parameters)
    ground.take_off(20.0)
    if trouble == "link":
        ground.heartbeats = False
    elif trouble == "battery":
        ground.vehicle.weaken_battery()
    else:
        ground.vehicle.set_gps(False)
    ground.run(17.0)
    assert ground.vehicle.mode == mode
    names = {event_id(f"commander_failsafe_enter{kind}") for kind in ("", "_hold", "_generic")}
    assert names & {event.id for event in events(ground)}
    texts = [text for text in ground.texts() if "Failsafe activated" in text]
    assert bool(texts) == (trouble != "link"), "nobody is there to read it"


def test_fence_breach_returns_as_configured(make_ground: MakeGround) -> None:
    ground = make_ground("px4", GF_ACTION=3.0, GF_MAX_HOR_DIST=20.0)
    offboard(ground)
    ground.run(8.0, each=lambda: ground.velocity_target(4.0, 0.0, 0.0))
    ground.run(5.5)
    assert "Geofence violation: approaching or outside geofence" in ground.texts()
    assert "Failsafe activated: entering Hold for 5 seconds" in ground.texts()
    assert ground.vehicle.mode == "RTL"


def test_return_climbs_into_its_cone_and_lands(make_ground: MakeGround) -> None:
    ground = make_ground("px4", RTL_RETURN_ALT=15.0, RTL_DESCEND_ALT=8.0, MPC_LAND_SPEED=1.2)
    ground.take_off(6.0)
    assert ground.command_int(192, 6, -1, 1, 0, math.nan, -5.0597, 151.3, 6.0) == ACCEPTED
    ground.run(15.0)
    assert ground.command(20) == ACCEPTED
    highest = 0.0

    def look() -> None:
        nonlocal highest
        highest = max(highest, ground.above_m)

    ground.run_until(lambda: not ground.vehicle.armed, each=look)
    assert highest == pytest.approx(15.0, abs=0.8)
    assert math.dist(ground.vehicle.position_ned_m, (0.0, 0.0, 0.0)) < 1.5
    assert ground.texts()[-2:] == ["Landing detected", "Disarmed by landing"]


def test_integers_travel_byte_by_byte(make_ground: MakeGround) -> None:
    ground = make_ground("px4")
    ground.run(1.0)
    as_float = struct.unpack("<f", struct.pack("<i", -7))[0]
    ground.set_parameter("COM_RC_IN_MODE", as_float, kind=6)
    answer = ground.of("PARAM_VALUE")[-1]
    assert answer.param_type == 6
    assert struct.pack("<f", answer.param_value) == struct.pack("<i", -7)
    assert ground.vehicle.autopilot.parameters["COM_RC_IN_MODE"] == -7.0
    ground.set_parameter("COM_RC_IN_MODE", 3.0, kind=9)
    assert ground.vehicle.autopilot.parameters["COM_RC_IN_MODE"] == -7.0, "a type that does not fit"


def test_unknown_parameters_are_answered(make_ground: MakeGround) -> None:
    ground = make_ground("px4")
    ground.run(1.0)
    ground.send(mavlink.MAVLink_param_request_read_message(7, 1, b"NO_SUCH", -1))
    assert ground.of("PARAM_ERROR")[-1].error == mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST


def test_it_lets_nobody_else_hold_a_stick_mode(make_ground: MakeGround) -> None:
    ground = make_ground("px4")
    ground.take_off()
    assert ground.mode(3) == REJECTED, "no sticks"
    centred = mavlink.MAVLink_manual_control_message(7, 0, 0, 500, 0, 0)
    ground.run(0.5, each=lambda: ground.send(centred))
    assert ground.mode(3) == ACCEPTED
    forward = mavlink.MAVLink_manual_control_message(7, 600, 0, 500, 0, 0)
    ground.run(4.0, each=lambda: ground.send(forward))
    assert ground.vehicle.velocity_ned_mps[0] > 2.0


def test_terminating_stops_the_motors(make_ground: MakeGround) -> None:
    ground = make_ground("px4")
    ground.take_off()
    assert ground.command(185, 1) == ACCEPTED
    ground.run(5.0)
    assert not ground.vehicle.airborne
    assert not ground.vehicle.armed
