"""A simulated autopilot with a signing key, seen by pymavlink's own signing."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.signing import STAMPS_PER_S, Signing, stamp_at
from mission.geometry.frames import Geodetic
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.drone.simulated_vehicle import SimulatedVehicle
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.world.configured import make_world

KEY, OTHER = bytes(range(100, 132)), bytes(range(200, 232))
NOW = stamp_at(1_790_000_000.0)
USB, RADIO = 0, 1
FORCE = 21196


class KeyedVehicle:
    """Id 3, with a cable at its USB port and a radio."""

    def __init__(self, flavour: str, key: bytes | None) -> None:
        spec = VehicleSpec(id=3, flavour=flavour, links=("udpin:a:1", "udpin:b:1"), usb_links=(USB,))  # type: ignore[arg-type]
        world = make_world(FleetConfig(origin=Geodetic(-5.06, 151.3, 500.0), vehicles=(spec,)))
        signing = None if key is None else Signing(key, NOW)
        self.simulated = SimulatedVehicle(spec, world, seed=1, ready_after_s=2.0, signing=signing)
        self.now_s = 0.0
        self.run(1.0)

    def run(self, seconds: float) -> dict[int, bytes]:
        said = {USB: b"", RADIO: b""}
        for _ in range(round(seconds / 0.1)):
            self.now_s += 0.1
            self.simulated.step(self.now_s)
            for link, data in self.simulated.drain():
                said[link] += data
        return said

    def obeys(self, peer: Any, link: int) -> bool:
        """Whether it answers a request, in words that the peer understands."""
        request = mavlink.MAVLink_command_long_message(3, 1, 512, 0, 148, 0, 0, 0, 0, 0, 0)
        self.simulated.receive(link, bytes(request.pack(peer)))
        return any(message.get_type() == "COMMAND_ACK" for message in heard(peer, self.run(0.2)[link]))

    def setup(self, peer: Any, link: int, key: bytes, stamp: int) -> None:
        message = mavlink.MAVLink_setup_signing_message(3, 1, list(key), stamp)
        self.simulated.receive(link, bytes(message.pack(peer)))
        self.run(0.2)

    def arm(self, peer: Any, link: int) -> None:
        arm = mavlink.MAVLink_command_long_message(3, 1, 400, 0, 1, FORCE, 0, 0, 0, 0, 0)
        self.simulated.receive(link, bytes(arm.pack(peer)))
        self.run(0.2)


def ground(key: bytes | None = None, stamp: int = NOW + STAMPS_PER_S, system: int = 255) -> Any:
    mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=190)
    mav.robust_parsing = True
    mav.signing.link_id = 7
    if key is not None:
        mav.signing.secret_key = key
        mav.signing.timestamp = stamp
        mav.signing.sign_outgoing = True
    return mav


def heard(peer: Any, data: bytes) -> list[Any]:
    """What it believes of what it knows."""
    return [
        message for message in peer.parse_buffer(data) or () if message.get_msgId() in mavlink.mavlink_map
    ]


@pytest.fixture(params=["ardupilot", "px4"])
def flavour(request) -> str:
    return request.param


def test_all_that_it_says_is_signed_with_its_key(flavour):
    vehicle = KeyedVehicle(flavour, KEY)
    said = vehicle.run(2.0)
    for link in (USB, RADIO):
        words = heard(ground(KEY), said[link])
        assert "HEARTBEAT" in {message.get_type() for message in words}
        assert all(message.get_signed() for message in words)
        assert heard(ground(OTHER), said[link]) == []


def test_it_obeys_its_key_and_at_its_usb_port_everybody(flavour):
    vehicle = KeyedVehicle(flavour, KEY)
    assert vehicle.obeys(ground(KEY), RADIO)
    assert not vehicle.obeys(ground(), RADIO)
    assert not vehicle.obeys(ground(OTHER), RADIO)
    assert vehicle.obeys(ground(), USB)


def test_what_was_recorded_moves_it_no_second_time(flavour):
    vehicle, recorder = KeyedVehicle(flavour, KEY), ground(KEY)
    vehicle.run(5.0)
    arm = mavlink.MAVLink_command_long_message(3, 1, 400, 0, 1, FORCE, 0, 0, 0, 0, 0)
    disarm = mavlink.MAVLink_command_long_message(3, 1, 400, 0, 0, FORCE, 0, 0, 0, 0, 0)
    recorded = bytes(arm.pack(recorder))
    armed = []
    for data in (recorded, bytes(disarm.pack(recorder)), recorded):
        vehicle.simulated.receive(RADIO, data)
        vehicle.run(0.2)
        armed.append(vehicle.simulated.armed)
    assert armed == [True, False, False]


def test_a_key_is_given_changed_and_taken_away(flavour):
    vehicle = KeyedVehicle(flavour, None)
    assert vehicle.obeys(ground(), RADIO)
    vehicle.setup(ground(), USB, KEY, NOW)
    assert not vehicle.obeys(ground(), RADIO)
    assert vehicle.obeys(ground(KEY), RADIO)
    vehicle.setup(ground(), RADIO, OTHER, NOW)
    assert vehicle.obeys(ground(KEY, NOW + 2 * STAMPS_PER_S), RADIO)
    vehicle.setup(ground(KEY, NOW + 3 * STAMPS_PER_S), RADIO, OTHER, NOW)
    assert vehicle.obeys(ground(OTHER), RADIO)
    vehicle.setup(ground(OTHER, NOW + 2 * STAMPS_PER_S), RADIO, bytes(32), 0)
    assert vehicle.obeys(ground(), RADIO)


def test_no_key_is_set_on_an_armed_vehicle():
    vehicle = KeyedVehicle("ardupilot", None)
    vehicle.run(5.0)
    vehicle.arm(ground(), USB)
    assert vehicle.simulated.armed
    vehicle.setup(ground(), USB, KEY, NOW)
    assert vehicle.obeys(ground(), RADIO)


def test_the_key_goes_to_nobody_else():
    """One that is meant for the whole vehicle would be handed on to its other links."""
    vehicle, companion = KeyedVehicle("ardupilot", None), ground(system=3)
    beat = mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 0, 3)
    vehicle.simulated.receive(RADIO, bytes(beat.pack(companion)))
    message = mavlink.MAVLink_setup_signing_message(3, 0, list(KEY), NOW)
    vehicle.simulated.receive(USB, bytes(message.pack(ground())))
    assert KEY not in vehicle.run(1.0)[RADIO]


def test_it_follows_the_time_of_who_has_its_key():
    vehicle, later = KeyedVehicle("ardupilot", KEY), NOW + 3600 * STAMPS_PER_S
    assert vehicle.obeys(ground(KEY, later), RADIO)
    (first, *_) = heard(ground(KEY), vehicle.run(1.5)[RADIO])
    assert int.from_bytes(first.get_msgbuf()[-12:-6], "little") > later
