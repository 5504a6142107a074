"""What is believed of a vehicle: whether it flies, where it is, and when it has become another one."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink import vehicle_state
from flightstack.mavlink.codec import MavlinkCodec
from flightstack.mavlink.modes import Duty, Flavour
from flightstack.mavlink.role import Role, role_of
from flightstack.mavlink.vehicle_state import VehicleState
from mission.geometry.frames import Geodetic, LocalFrame

HOME = Geodetic(-5.06, 151.3, 512.0)
FRAME = LocalFrame(Geodetic(-5.06, 151.3, 500.0))


class Vehicle:
    """A state, and the autopilot that feeds it frame by frame."""

    def __init__(self, *, autopilot: int = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA) -> None:
        self.state = VehicleState(3, 1, FRAME)
        self._autopilot = autopilot
        self._sender = MavlinkCodec(3, 1)
        self._codec = MavlinkCodec(255, 190, vehicle_state.STATES, vehicle_state.EVENTS)

    def say(self, now_s: float, message: object) -> None:
        for received in self._codec.receive(now_s, self._sender.encode(message)):
            self.state.accept(now_s, received)

    def heartbeat(self, now_s: float, *, armed: bool = True, mode: int = 4, kind: int = 2) -> None:
        base = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
        self.say(now_s, mavlink.MAVLink_heartbeat_message(kind, self._autopilot, base, mode, 4, 3))

    def position(self, now_s: float, up_m: float, *, boot_s: float = 100.0, relative_m: float = 0.0) -> None:
        self.say(
            now_s,
            mavlink.MAVLink_global_position_int_message(
                round(boot_s * 1000),
                round(HOME.latitude_deg * 1e7),
                round(HOME.longitude_deg * 1e7),
                round((HOME.amsl_m + up_m) * 1000),
                round(relative_m * 1000),
                100,
                0,
                -50,
                0,
            ),
        )

    def sinks(self, now_s: float, boot_s: float, up_m: float, down_mps: float) -> None:
        """A position with a speed downwards."""
        degrees = (round(HOME.latitude_deg * 1e7), round(HOME.longitude_deg * 1e7))
        amsl_mm, up_mm = round((HOME.amsl_m + up_m) * 1000), round(up_m * 1000)
        self.say(
            now_s,
            mavlink.MAVLink_global_position_int_message(
                round(boot_s * 1000), *degrees, amsl_mm, up_mm, 0, 0, round(down_mps * 100), 0
            ),
        )

    def home(self, now_s: float) -> None:
        degrees = (round(HOME.latitude_deg * 1e7), round(HOME.longitude_deg * 1e7))
        self.say(
            now_s,
            mavlink.MAVLink_home_position_message(
                *degrees, round(HOME.amsl_m * 1000), 0, 0, 0, [1, 0, 0, 0], 0, 0, 0
            ),
        )

    def landed(self, now_s: float, state: int) -> None:
        self.say(now_s, mavlink.MAVLink_extended_sys_state_message(0, state))


def test_a_disarmed_vehicle_does_not_fly_whatever_else_it_says() -> None:
    vehicle = Vehicle()
    vehicle.heartbeat(0.0, armed=False)
    vehicle.home(0.0)
    vehicle.position(0.0, 20.0)
    vehicle.landed(0.0, mavlink.MAV_LANDED_STATE_IN_AIR)
    assert vehicle.state.flies(0.0) is False


def test_of_an_armed_vehicle_that_says_nothing_nobody_knows() -> None:
    vehicle = Vehicle()
    vehicle.heartbeat(0.0)
    assert vehicle.state.flies(0.0) is None


@pytest.mark.parametrize(
    ("said", "flies"),
    [
        (mavlink.MAV_LANDED_STATE_ON_GROUND, False),
        (mavlink.MAV_LANDED_STATE_IN_AIR, True),
        (mavlink.MAV_LANDED_STATE_TAKEOFF, True),
        (mavlink.MAV_LANDED_STATE_LANDING, True),
        (mavlink.MAV_LANDED_STATE_UNDEFINED, None),
    ],
)
def test_its_own_word_counts_while_it_is_fresh(said: int, flies: bool | None) -> None:
    vehicle = Vehicle()
    vehicle.heartbeat(0.0)
    vehicle.landed(0.0, said)
    assert vehicle.state.flies(2.9) is flies
    assert vehicle.state.flies(3.1) is None


def test_without_a_word_the_height_over_home_tells_and_what_has_been_high_flies_until_it_is_disarmed() -> (
    None
):
    vehicle = Vehicle()
    vehicle.heartbeat(0.0)
    vehicle.home(0.0)
    vehicle.position(0.0, 0.5)
    assert vehicle.state.flies(0.0) is False
    assert vehicle.state.flies(4.0) is None, "the position is old"
    vehicle.position(5.0, 15.0)
    assert vehicle.state.flies(5.0) is True
    vehicle.position(6.0, 0.2)
    assert vehicle.state.flies(60.0) is True
    vehicle.heartbeat(61.0, armed=False)
    vehicle.heartbeat(62.0)
    vehicle.position(62.0, 0.2)
    assert vehicle.state.flies(62.0) is False


def test_while_home_is_unknown_the_autopilots_own_height_counts() -> None:
    vehicle = Vehicle()
    vehicle.heartbeat(0.0)
    vehicle.position(0.0, 0.0, relative_m=8.0)
    assert (vehicle.state.above_home_m, vehicle.state.flies(0.0)) == (8.0, True)
    vehicle.home(1.0)
    assert vehicle.state.above_home_m == pytest.approx(0.0)


def test_a_position_that_the_estimator_does_not_vouch_for_is_none() -> None:
    vehicle = Vehicle()
    vehicle.heartbeat(0.0)
    vehicle.position(0.0, 1.0)
    assert vehicle.state.position_ned_m == pytest.approx((0.0, 0.0, -13.0), abs=0.02)
    vehicle.say(1.0, mavlink.MAVLink_ekf_status_report_message(mavlink.EKF_CONST_POS_MODE, 0, 0, 0, 0, 0))
    vehicle.position(2.0, 9.0)
    assert vehicle.state.position_ned_m == pytest.approx((0.0, 0.0, -13.0), abs=0.02)
    assert vehicle.state.position_age_s(2.0) == 2.0
    vehicle.say(3.0, mavlink.MAVLink_ekf_status_report_message(mavlink.EKF_POS_HORIZ_ABS, 0, 0, 0, 0, 0))
    vehicle.position(4.0, 9.0)
    assert vehicle.state.position_ned_m == pytest.approx((0.0, 0.0, -21.0), abs=0.02)


def test_without_a_frame_there_are_no_positions_in_it() -> None:
    vehicle = Vehicle()
    vehicle.state = VehicleState(3, 1, None)
    vehicle.home(0.0)
    vehicle.position(0.0, 1.0)
    assert vehicle.state.geodetic is not None
    assert (vehicle.state.position_ned_m, vehicle.state.home_ned_m) == (None, None)


def test_a_clock_that_goes_far_back_is_another_start_and_one_that_goes_a_little_back_is_late() -> None:
    vehicle = Vehicle()
    vehicle.heartbeat(0.0)
    vehicle.home(0.0)
    vehicle.position(0.0, 5.0, boot_s=100.0)
    vehicle.position(0.1, 7.0, boot_s=99.0)
    assert vehicle.state.above_home_m == pytest.approx(5.0)
    assert vehicle.state.boots == 0
    vehicle.position(0.2, 0.0, boot_s=2.0)
    state = vehicle.state
    assert (state.boots, state.home, state.flies(0.2)) == (1, None, False)
    # What it is and whether it is armed, its heartbeats tell: a late frame must not disarm it.
    assert (state.armed, state.flavour, state.role) == (True, Flavour.ARDUPILOT, Role.AUTOPILOT)
    assert state.is_connected(0.2)


def test_the_mode_has_a_name_and_an_age() -> None:
    vehicle = Vehicle(autopilot=mavlink.MAV_AUTOPILOT_PX4)
    assert (vehicle.state.mode, vehicle.state.in_mode(Duty.HOLD)) == ("", False)
    for now_s in (1.0, 2.0):
        vehicle.heartbeat(now_s, mode=3 << 24 | 4 << 16)
    assert (vehicle.state.mode, vehicle.state.mode_since_s) == ("HOLD", 1.0)
    assert vehicle.state.in_mode(Duty.HOLD)


@pytest.mark.parametrize(
    ("kind", "autopilot", "role"),
    [
        (mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4, Role.AUTOPILOT),
        (mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, Role.GROUND),
        (mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, Role.GROUND),
        (mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID, Role.COMPANION),
        (mavlink.MAV_TYPE_GIMBAL, mavlink.MAV_AUTOPILOT_INVALID, Role.OTHER),
    ],
)
def test_what_a_component_is_its_heartbeat_says(kind: int, autopilot: int, role: Role) -> None:
    vehicle = Vehicle(autopilot=autopilot)
    vehicle.heartbeat(0.0, kind=kind)
    assert vehicle.state.role is role
    assert vehicle.state.armed is (role is Role.AUTOPILOT)


@pytest.mark.parametrize("system", [0, 3])
@pytest.mark.parametrize("component", [1, 2, 154, 156, 190, 191])
@pytest.mark.parametrize("kind", [1, 2, 10, 13, 18, 20, 26, 27, 30])
@pytest.mark.parametrize("autopilot", [0, 3, 8, 12])
def test_an_autopilot_is_component_1_of_a_known_flavour_in_something_that_flies(
    system: int, component: int, kind: int, autopilot: int
) -> None:
    beat = mavlink.MAVLink_heartbeat_message(kind, autopilot, 209, 4, 4, 3)
    is_autopilot = role_of(system, component, beat) is Role.AUTOPILOT
    assert is_autopilot == (
        system != 0 and component == 1 and autopilot in (3, 12) and kind in (1, 2, 13, 20)
    )


@pytest.mark.parametrize("kind", [mavlink.MAV_TYPE_GCS, mavlink.MAV_TYPE_ADSB, mavlink.MAV_TYPE_GENERIC])
def test_what_is_an_autopilot_stays_one_whoever_uses_its_ids(kind: int) -> None:
    vehicle = Vehicle()
    vehicle.heartbeat(0.0)
    vehicle.heartbeat(1.0, armed=False, mode=0, kind=kind)
    assert (vehicle.state.role, vehicle.state.armed, vehicle.state.mode) == (Role.AUTOPILOT, True, "GUIDED")
    assert vehicle.state.heartbeat_s == 0.0, "it is no sign of the vehicle's life"


def test_a_planes_modes_are_not_a_copters() -> None:
    vehicle = Vehicle()
    vehicle.heartbeat(0.0, mode=6, kind=mavlink.MAV_TYPE_FIXED_WING)
    assert (vehicle.state.mode, vehicle.state.in_mode(Duty.RETURN)) == ("MODE_6", False)


def test_of_several_batteries_the_first_counts_and_an_unknown_charge_is_none() -> None:
    vehicle = Vehicle()

    def battery(identity: int, percent: int) -> object:
        return mavlink.MAVLink_battery_status_message(identity, 0, 0, 0, [0] * 10, 0, 0, 0, percent)

    vehicle.say(0.0, battery(0, 70))
    vehicle.say(1.0, battery(1, 20))
    assert vehicle.state.battery_fraction == pytest.approx(0.7)
    vehicle.say(2.0, mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 11500, 0, 55, 0, 0, 0, 0, 0, 0))
    assert (vehicle.state.battery_fraction, vehicle.state.battery_voltage_v) == (0.55, 11.5)
    vehicle.say(3.0, mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 0xFFFF, 0, -1, 0, 0, 0, 0, 0, 0))
    assert (vehicle.state.battery_fraction, vehicle.state.battery_voltage_v) == (None, None)


def test_parts_of_a_text_are_put_together_and_one_without_its_end_comes_after_a_second() -> None:
    vehicle = Vehicle()
    text = "PreArm: " + "x" * 60

    def part(identity: int, number: int) -> object:
        piece = text[50 * number : 50 * number + 50]
        return mavlink.MAVLink_statustext_message(4, piece.encode(), identity, number)

    vehicle.say(0.0, part(7, 0))
    vehicle.say(0.1, part(7, 1))
    vehicle.say(0.2, part(8, 0))
    vehicle.state.flush(1.0)
    assert [told.text for told in vehicle.state.new_texts] == [text]
    vehicle.state.flush(1.3)
    assert [told.text for told in vehicle.state.new_texts] == [text, text[:50] + " [part missing]"]


def test_one_wrong_home_is_not_taken_over_and_a_second_time_it_has_moved() -> None:
    vehicle = Vehicle()
    vehicle.home(0.0)
    far = mavlink.MAVLink_home_position_message(10, 10, 0, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)
    before = vehicle.state.home
    vehicle.say(1.0, far)
    assert vehicle.state.home == before
    vehicle.say(2.0, far)
    assert vehicle.state.home == Geodetic(1e-6, 1e-6, 0.0)


def estimator_status(flags: int) -> object:
    return mavlink.MAVLink_estimator_status_message(0, flags, 0, 0, 0, 0, 0, 0, 0.3, 0.3)


@pytest.mark.parametrize(
    ("flags", "good"), [(1023, True), (895, True), (831, True), (165, False), (0, False)]
)
def test_px4s_constant_position_bit_says_nothing(flags: int, good: bool) -> None:
    """1023 is a PX4 at rest, 895 one in the air, 165 one that has no position yet."""
    vehicle = Vehicle(autopilot=mavlink.MAV_AUTOPILOT_PX4)
    vehicle.heartbeat(0.0)
    vehicle.say(0.1, estimator_status(flags))
    vehicle.position(0.2, 1.0)
    assert vehicle.state.estimator_is_good is good
    assert (vehicle.state.position_ned_m is not None) is good


@pytest.mark.parametrize(("flags", "good"), [(1023, False), (831, True), (167, False)])
def test_ardupilots_constant_position_bit_means_no_position(flags: int, good: bool) -> None:
    vehicle = Vehicle()
    vehicle.heartbeat(0.0)
    vehicle.say(0.1, mavlink.MAVLink_ekf_status_report_message(flags, 0, 0, 0, 0, 0))
    vehicle.position(0.2, 1.0)
    assert vehicle.state.estimator_is_good is good
    assert (vehicle.state.position_ned_m is not None) is good


def quick_descent(vehicle: Vehicle, hear_s: Callable[[float], float]) -> float:
    """Down at 6 m/s, braked at 4 m/s2, and hovering; heard when `hear_s` of its own time says. Returns its height."""
    up_m, down_mps = 80.0, 0.0
    for tick in range(400):
        boot_s = 100.0 + 0.1 * tick
        wanted_mps = 6.0 if tick < 100 else 0.0
        down_mps += max(-0.4, min(wanted_mps - down_mps, 0.4))
        up_m -= 0.1 * down_mps
        if tick % 10 == 0:
            vehicle.heartbeat(hear_s(boot_s))
        vehicle.sinks(hear_s(boot_s), boot_s, up_m, down_mps)
        assert vehicle.state.crash == ""
    return up_m


@pytest.mark.parametrize("speed_up", [1.0, 5.0, 20.0])
def test_a_braking_that_a_fast_simulation_squeezes_is_no_impact(speed_up: float) -> None:
    quick_descent(Vehicle(), lambda boot_s: boot_s / speed_up)


def test_a_braking_that_a_link_held_up_and_gave_out_at_once_is_no_impact() -> None:
    quick_descent(Vehicle(), lambda boot_s: 114.0 if 108.0 < boot_s < 114.0 else boot_s)


def crashed(up_m: float) -> Vehicle:
    """What is taken for a wreck, at a height."""
    vehicle = Vehicle()
    vehicle.heartbeat(0.0)
    vehicle.home(0.0)
    vehicle.sinks(0.0, 100.0, up_m, 0.0)
    vehicle.landed(0.0, mavlink.MAV_LANDED_STATE_IN_AIR)
    vehicle.state.believe_crashed("fell")
    return vehicle


def test_a_wreck_flies_no_more_unless_it_seems_to_lie_high_over_home() -> None:
    assert crashed(0.3).state.flies(1.0) is False
    high = crashed(20.0)
    assert high.state.flies(1.0) is True
    high.heartbeat(1.0, armed=False)
    assert high.state.flies(1.0) is False


def test_what_was_taken_for_a_wreck_and_flies_on_is_none() -> None:
    vehicle = crashed(20.0)
    for tick in range(1, 50):
        vehicle.sinks(0.1 * tick, 100.0 + 0.1 * tick, 20.0 - 0.05 * tick, 0.5)
    assert vehicle.state.crash == ""
    assert vehicle.state.flies(4.9) is True
