"""Vehicles from MAVLink: who counts as one, and what is believed."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink import vehicle_state
from flightstack.mavlink.codec import MavlinkCodec
from flightstack.mavlink.vehicle_state import Role
from gcs.fleet.vehicles import Source, Vehicles


def station() -> MavlinkCodec:
    return MavlinkCodec(255, 190, vehicle_state.STATES, vehicle_state.EVENTS)


def feed(vehicles: Vehicles, now_s: float, data: bytes, link: int = 0) -> None:
    for message in station().receive(now_s, data):
        vehicles.receive(now_s, link, message)


def heartbeat(system: int, component: int, kind: int, autopilot: int, base: int, mode: int) -> bytes:
    mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    return bytes(mavlink.MAVLink_heartbeat_message(kind, autopilot, base, mode, 4, 3).pack(mav))


def test_reads_an_autopilot(frame, autopilot):
    vehicles = Vehicles(frame)
    feed(vehicles, 5.0, autopilot(3).everything())
    vehicle = vehicles.autopilot(3)
    assert vehicle is not None
    assert (vehicle.mode, vehicle.armed, vehicle.airborne(5.0)) == ("GUIDED", True, True)
    assert vehicle.position_ned_m == pytest.approx((10.0, 20.0, -12.0), abs=0.05)
    assert vehicle.velocity_ned_mps == pytest.approx((1.0, -0.5, 0.0))
    assert vehicle.home_ned_m == pytest.approx((0.0, 0.0, 0.0), abs=0.02)
    assert vehicle.battery_fraction == pytest.approx(0.8)
    assert vehicle.age_s(6.5) == pytest.approx(1.5)


def test_px4_modes_have_their_names(frame, autopilot):
    vehicles = Vehicles(frame)
    px4 = autopilot(3, px4=True)
    feed(vehicles, 0.0, px4.heartbeat())
    assert vehicles.autopilot(3).mode == "OFFBOARD"
    px4.mode = 5 << 24 | 4 << 16
    feed(vehicles, 1.0, px4.heartbeat())
    assert vehicles.autopilot(3).mode == "RTL"
    assert vehicles.autopilot(3).mode_since_s == 1.0


def test_heartbeats_of_companions_and_ground_stations_are_not_the_vehicle(frame, autopilot):
    vehicles = Vehicles(frame)
    feed(vehicles, 0.0, autopilot(3).heartbeat())
    companion = heartbeat(3, 191, mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID, 0, 9)
    # Even one that shares the vehicle's system id and claims an autopilot.
    ground = heartbeat(3, 190, mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 128, 6)
    feed(vehicles, 0.5, companion + ground)
    assert vehicles.autopilot(3).mode == "GUIDED"
    assert vehicles.components[Source(0, 3, 191)].role is Role.COMPANION
    assert vehicles.components[Source(0, 3, 190)].role is Role.GROUND
    assert vehicles.systems() == {3}
    assert vehicles.companion_age_s(3, 2.5) == pytest.approx(2.0)
    assert math.isinf(vehicles.companion_age_s(4, 2.5))


@pytest.mark.parametrize(
    "kind",
    [
        "ping0",
        "ping8",
        "gimbal0",
        "gimbal3",
        "camera",
        "companion",
        "copter154",
        "generic1",
        "rover1",
        "gcs1",
    ],
)
def test_what_else_is_on_the_link_is_never_the_vehicle(frame, autopilot, neighbours, kind):
    """Heard first, later, and alone while the vehicle is silent."""
    vehicles = Vehicles(frame)
    feed(vehicles, 0.0, neighbours.heartbeat(kind))
    assert vehicles.autopilot(1) is None
    feed(vehicles, 1.0, autopilot(1).everything())
    for second in range(2, 20):
        said = neighbours.heartbeat(kind) if kind.endswith("1") else neighbours.talkative(kind)
        feed(vehicles, float(second), said)
    vehicle = vehicles.autopilot(1)
    assert (vehicle.mode, vehicle.armed, vehicle.airborne(19.0)) == ("GUIDED", True, True)
    assert vehicle.position_ned_m == pytest.approx((10.0, 20.0, -12.0), abs=0.05)
    assert vehicle.age_s(19.0) == pytest.approx(18.0)
    assert vehicles.systems() == {1}


def test_only_the_agents_own_component_tells_that_the_agent_lives(frame):
    vehicles = Vehicles(frame)
    other = heartbeat(3, 192, mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID, 0, 0)
    feed(vehicles, 0.0, other)
    assert math.isinf(vehicles.companion_age_s(3, 0.0))


def test_made_up_sources_do_not_fill_the_memory_nor_drive_the_vehicles_out(frame, autopilot):
    vehicles = Vehicles(frame)
    feed(vehicles, 0.0, autopilot(3).heartbeat())
    for number in range(2000):
        text = mavlink.MAVLink_statustext_message(4, b"x", 0, 0)
        sender = mavlink.MAVLink(None, srcSystem=number // 250 + 4, srcComponent=number % 250)
        feed(vehicles, 1.0, bytes(text.pack(sender)))
    assert len(vehicles.components) <= 512
    assert vehicles.autopilot(3) is not None


def test_state_is_kept_by_link_and_the_fresher_link_speaks(frame, autopilot):
    vehicles = Vehicles(frame)
    one, other = autopilot(3), autopilot(3)
    other.mode = 6
    feed(vehicles, 0.0, one.heartbeat(), link=0)
    feed(vehicles, 1.0, other.heartbeat(), link=1)
    assert vehicles.autopilot(3).mode == "RTL"
    feed(vehicles, 2.0, one.heartbeat(), link=0)
    assert vehicles.autopilot(3).mode == "GUIDED"


def test_two_vehicles_on_one_link_are_not_mixed(frame, autopilot):
    vehicles = Vehicles(frame)
    one, two = autopilot(1), autopilot(2)
    two.mode, two.armed = 9, False
    feed(vehicles, 0.0, one.everything() + two.everything())
    assert (vehicles.autopilot(1).mode, vehicles.autopilot(2).mode) == ("GUIDED", "LAND")
    assert (vehicles.autopilot(1).armed, vehicles.autopilot(2).armed) == (True, False)


def test_airborne_falls_back_to_height_and_then_to_caution(frame, autopilot):
    vehicles = Vehicles(frame)
    vehicle = autopilot(3)
    feed(vehicles, 0.0, vehicle.heartbeat())
    assert vehicles.autopilot(3).airborne(0.0), "armed and nothing else known"
    vehicle.up_m = 0.2
    feed(vehicles, 1.0, vehicle.position())
    assert not vehicles.autopilot(3).airborne(1.0)
    feed(vehicles, 1.0, vehicle.extended())
    assert vehicles.autopilot(3).airborne(1.0), "the autopilot's own word counts most"
    vehicle.armed = False
    feed(vehicles, 2.0, vehicle.heartbeat())
    assert not vehicles.autopilot(3).airborne(2.0)


def test_a_position_without_a_fix_is_none(frame):
    vehicles = Vehicles(frame)
    mav = mavlink.MAVLink(None, srcSystem=3, srcComponent=1)
    empty = mavlink.MAVLink_global_position_int_message(0, 0, 0, 0, 0, 0, 0, 0, 0).pack(mav)
    feed(vehicles, 0.0, bytes(empty))
    assert vehicles.components[Source(0, 3, 1)].position_ned_m is None


def test_long_status_texts_are_put_together(frame):
    vehicles = Vehicles(frame)
    mav = mavlink.MAVLink(None, srcSystem=3, srcComponent=1)
    text = "PreArm: " + "x" * 60
    for sequence, start in enumerate((0, 50)):
        message = mavlink.MAVLink_statustext_message(4, text[start : start + 50].encode(), 7, sequence)
        feed(vehicles, 0.0, bytes(message.pack(mav)))
    (report,) = vehicles.components[Source(0, 3, 1)].take_texts()
    assert report.text == text


@settings(max_examples=50, deadline=None)
@given(st.binary(max_size=300), st.integers(1, 40))
def test_garbage_and_any_chunking_do_no_harm(garbage, size):
    from mission.geometry.frames import Geodetic, LocalFrame

    vehicles = Vehicles(LocalFrame(Geodetic(0.0, 0.0)))
    codec = station()
    good = heartbeat(3, 1, mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 0, 4)
    # Zeros long enough for the longest frame that the garbage may seem to have begun.
    data = garbage + b"\x00" * 300 + good * 3
    for start in range(0, len(data), size):
        for message in codec.receive(0.0, data[start : start + size]):
            vehicles.receive(0.0, 0, message)
    assert vehicles.autopilot(3) is not None
