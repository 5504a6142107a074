"""The agent's own vehicle: which component it listens to, and what stands against arming it."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.autopilot.telemetry import EVENTS, STATES, Telemetry
from flightstack.mavlink.codec import MavlinkCodec
from flightstack.mavlink.modes import Flavour
from mission.geometry.frames import Geodetic, LocalFrame

FRAME = LocalFrame(Geodetic(-5.06, 151.3, 500.0))


class Link:
    """Several components on one link of drone 3's agent."""

    def __init__(self, flavour: Flavour = Flavour.UNKNOWN) -> None:
        self.vehicle = Telemetry(3, FRAME, flavour)
        self._codec = MavlinkCodec(3, 191, STATES, EVENTS, only_system=3)
        self._senders: dict[tuple[int, int], MavlinkCodec] = {}

    def say(self, now_s: float, message: object, system: int = 3, component: int = 1) -> list[bool]:
        """Whether each message was our autopilot's."""
        sender = self._senders.setdefault((system, component), MavlinkCodec(system, component))
        return [
            self.vehicle.hear(now_s, heard) for heard in self._codec.receive(now_s, sender.encode(message))
        ]


def heartbeat(
    *,
    armed: bool = False,
    mode: int = 4,
    kind: int = mavlink.MAV_TYPE_QUADROTOR,
    autopilot: int = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
) -> object:
    base = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
    return mavlink.MAVLink_heartbeat_message(kind, autopilot, base, mode, 4, 3)


def test_nothing_counts_before_the_first_heartbeat_of_our_autopilot() -> None:
    link = Link()
    in_air = mavlink.MAVLink_extended_sys_state_message(0, mavlink.MAV_LANDED_STATE_IN_AIR)
    assert link.say(0.0, in_air) == [False]
    assert link.say(0.1, heartbeat()) == [True]
    assert link.say(0.2, in_air) == [True]


@pytest.mark.parametrize(
    ("kind", "autopilot"),
    [
        (mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA),
        (mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID),
        (mavlink.MAV_TYPE_CAMERA, mavlink.MAV_AUTOPILOT_INVALID),
    ],
)
def test_a_component_of_our_system_that_is_no_autopilot_is_not_the_vehicle(kind: int, autopilot: int) -> None:
    link = Link()
    assert link.say(0.0, heartbeat(kind=kind, autopilot=autopilot), component=100) == [False]
    assert not link.vehicle.is_connected(0.0)


@pytest.mark.parametrize("component", [2, 100, 154, 156, 191])
def test_another_component_is_not_our_autopilot_also_when_that_is_lost(component: int) -> None:
    link = Link()
    assert link.say(0.0, heartbeat(mode=6), component=component) == [False]
    link.say(0.5, heartbeat())
    assert link.say(1.0, heartbeat(mode=6), component=component) == [False]
    assert (link.vehicle.mode, link.vehicle.component) == ("GUIDED", 1)
    assert link.say(7.0, heartbeat(mode=6), component=component) == [False]
    assert (link.vehicle.mode, link.vehicle.component) == ("GUIDED", 1)
    assert not link.vehicle.is_connected(7.0)


@pytest.mark.parametrize(
    ("kind", "autopilot"),
    [
        (mavlink.MAV_TYPE_HEXAROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA),
        (mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4),
    ],
)
def test_another_autopilot_under_our_ids_is_told_and_taken_only_when_ours_is_lost(
    kind: int, autopilot: int
) -> None:
    link = Link()
    link.say(0.0, heartbeat(armed=True))
    assert not link.vehicle.is_contested(0.5)
    assert link.say(1.0, heartbeat(mode=6, kind=kind, autopilot=autopilot)) == [False]
    assert (link.vehicle.mode, link.vehicle.armed, link.vehicle.boots) == ("GUIDED", True, 0)
    assert link.vehicle.is_contested(2.0)
    assert not link.vehicle.is_contested(6.5)
    assert link.say(8.0, heartbeat(mode=6, kind=kind, autopilot=autopilot)) == [True]
    assert (link.vehicle.armed, link.vehicle.boots) == (False, 1)


@pytest.mark.parametrize(
    ("kind", "autopilot", "words"),
    [
        (
            mavlink.MAV_TYPE_GROUND_ROVER,
            mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
            "vehicle type 10 (MAV_TYPE) is not",
        ),
        (mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_GENERIC, "type 0 is neither ArduPilot nor PX4"),
    ],
)
def test_what_speaks_in_the_autopilots_place_is_named(kind: int, autopilot: int, words: str) -> None:
    link = Link()
    assert link.say(0.0, heartbeat(kind=kind, autopilot=autopilot)) == [False]
    assert words in link.vehicle.unready_reason(1.0)
    assert "no heartbeat of the autopilot" in link.vehicle.unready_reason(6.0)


def test_what_has_wings_is_heard_and_not_flown() -> None:
    link = Link()
    assert link.say(0.0, heartbeat(kind=mavlink.MAV_TYPE_FIXED_WING)) == [True]
    assert "vehicle type 1 (MAV_TYPE) is not a multicopter" in link.vehicle.unready_reason(0.0)
    assert (link.vehicle.flavour, link.vehicle.mode) == (Flavour.UNKNOWN, "MODE_4")


def test_who_passes_by_does_not_explain_our_own_silence() -> None:
    link = Link()
    link.say(0.0, heartbeat())
    link.say(9.0, heartbeat(), system=9)
    assert "no heartbeat of the autopilot" in link.vehicle.unready_reason(9.0)


def test_an_autopilot_with_another_id_is_named() -> None:
    link = Link()
    link.say(0.0, heartbeat(), system=9)
    assert "system id 9, this drone is 3" in link.vehicle.unready_reason(0.0)


def test_an_armed_vehicle_of_which_nothing_tells_stands_on_the_ground() -> None:
    link = Link()
    link.say(0.0, heartbeat(armed=True))
    assert not link.vehicle.is_airborne(0.0)
    assert not link.vehicle.has_flown


def test_one_that_was_in_the_air_has_flown_until_it_is_disarmed() -> None:
    link = Link()
    link.say(0.0, heartbeat(armed=True))
    link.say(0.1, mavlink.MAVLink_extended_sys_state_message(0, mavlink.MAV_LANDED_STATE_IN_AIR))
    link.say(0.2, mavlink.MAVLink_extended_sys_state_message(0, mavlink.MAV_LANDED_STATE_ON_GROUND))
    assert not link.vehicle.is_airborne(0.2)
    assert link.vehicle.has_flown
    link.say(1.0, heartbeat())
    assert not link.vehicle.has_flown


def test_a_flavour_that_is_not_the_configured_one_is_none_that_we_can_fly() -> None:
    link = Link(Flavour.PX4)
    link.say(0.0, heartbeat())
    assert link.vehicle.flavour is Flavour.UNKNOWN
    assert "autopilot.flavour says px4, the autopilot itself ardupilot" in link.vehicle.unready_reason(0.0)


def test_wind_comes_from_where_ardupilot_says_and_goes_where_px4_says() -> None:
    link = Link()
    link.say(0.0, heartbeat())
    link.say(0.1, mavlink.MAVLink_wind_message(90.0, 5.0, 3.0))
    assert link.vehicle.new_wind is not None
    assert link.vehicle.new_wind[0] == pytest.approx((0.0, -4.0, 3.0), abs=1e-6)
    link.say(0.2, mavlink.MAVLink_wind_cov_message(0, 1.0, -2.0, 0.5, 0.3, 0.1, 500.0, 0.2, 0.0))
    assert link.vehicle.new_wind == (pytest.approx((1.0, -2.0, 0.5)), pytest.approx(0.3))
    link.vehicle.clear_news()
    link.say(0.3, mavlink.MAVLink_wind_message(0.0, 0.0, 0.0))
    assert link.vehicle.new_wind is None
