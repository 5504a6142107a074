"""What the ground station's tests are made of: states of agents, and frames of autopilots as bytes."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import msgspec
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.config import SwarmConfig
from flightstack.mavlink import vehicle_state
from flightstack.mavlink.codec import MavlinkCodec
from flightstack.swarm import topics
from flightstack.swarm.topics import Received, Topic
from flightstack.swarm.wire import DroneState, Phase, TableState
from gcs.fleet.view import FleetView
from gcs.station_config import GroundConfig, MavlinkConfig
from mission.geometry.frames import Geodetic, LocalFrame
from mission.tree.slot_registers import SlotRegister

ORIGIN = Geodetic(28.2724, -16.6425, 2300.0)
FRAME = LocalFrame(ORIGIN)
_NUMBERS = itertools.count(1)
"""Of messages that do not say theirs: nobody tells one twice."""


@pytest.fixture
def frame() -> LocalFrame:
    return FRAME


class SpeakingAutopilot:
    """A vehicle's autopilot as a source of bytes. ArduPilot unless told otherwise."""

    def __init__(self, system: int, *, px4: bool = False) -> None:
        self.mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
        self.px4 = px4
        self.armed = True
        self.mode = 6 << 16 if px4 else 4
        self.status = mavlink.MAV_STATE_ACTIVE
        self.landed_state = mavlink.MAV_LANDED_STATE_IN_AIR
        self.north_m, self.east_m, self.up_m = 10.0, 20.0, 12.0
        self.home_north_m = 0.0
        self.battery_percent = 80

    def frame(self, message: Any) -> bytes:
        data = bytes(message.pack(self.mav))
        self.mav.seq = (self.mav.seq + 1) % 256
        return data

    def heartbeat(self) -> bytes:
        autopilot = mavlink.MAV_AUTOPILOT_PX4 if self.px4 else mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
        base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (128 if self.armed else 0)
        return self.frame(
            mavlink.MAVLink_heartbeat_message(
                mavlink.MAV_TYPE_QUADROTOR, autopilot, base, self.mode, self.status, 3
            )
        )

    def position(self) -> bytes:
        point = FRAME.to_geodetic((self.north_m, self.east_m, -self.up_m))
        return self.frame(
            mavlink.MAVLink_global_position_int_message(
                0,
                round(point.latitude_deg * 1e7),
                round(point.longitude_deg * 1e7),
                round(point.amsl_m * 1e3),
                round(self.up_m * 1e3),
                100,
                -50,
                0,
                9000,
            )
        )

    def extended(self) -> bytes:
        return self.frame(mavlink.MAVLink_extended_sys_state_message(0, self.landed_state))

    def system_status(self) -> bytes:
        return self.frame(
            mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 12000, 100, self.battery_percent, 0, 0, 0, 0, 0, 0)
        )

    def home(self) -> bytes:
        point = FRAME.to_geodetic((self.home_north_m, 0.0, 0.0))
        return self.frame(
            mavlink.MAVLink_home_position_message(
                round(point.latitude_deg * 1e7),
                round(point.longitude_deg * 1e7),
                round(point.amsl_m * 1e3),
                0,
                0,
                0,
                [1, 0, 0, 0],
                0,
                0,
                0,
            )
        )

    def everything(self) -> bytes:
        return self.heartbeat() + self.position() + self.extended() + self.system_status() + self.home()


@pytest.fixture
def autopilot() -> Callable[..., SpeakingAutopilot]:
    return SpeakingAutopilot


def make_state(drone: int, **changes: Any) -> DroneState:
    state = DroneState(
        sender=drone,
        incarnation=100 + drone,
        sequence=1,
        frame=FRAME.identity,
        phase=Phase.SEARCHING,
        position_ned_m=(10.0, 20.0, -12.0),
        velocity_ned_mps=(1.0, 0.0, 0.0),
        heading_rad=0.0,
        home_ned_m=(0.0, 0.0, 0.0),
        armed=True,
        airborne=True,
        mode="GUIDED",
        battery_fraction=0.8,
        co2_ppm=450.0,
        excess_co2_ppm=None,
        wind=None,
        epoch=1,
        slot=drone - 1,
        parent=None,
        healing=False,
        tracking_best_ppm=None,
    )
    return msgspec.structs.replace(state, **changes)


def make_table(drone: int, members: tuple[int, ...], *, epoch: int = 1, **changes: Any) -> TableState:
    """`members` hold the slots from the first, each claimed for the `epoch`th time."""
    table = TableState(
        sender=drone,
        incarnation=100 + drone,
        sequence=next(_NUMBERS),
        frame=FRAME.identity,
        survey="survey",
        slots=tuple((slot, SlotRegister(epoch, member)) for slot, member in enumerate(members)),
        members=(),
        absent=(),
    )
    return msgspec.structs.replace(table, **changes)


@pytest.fixture
def state() -> Callable[..., DroneState]:
    return make_state


@pytest.fixture
def table() -> Callable[..., TableState]:
    return make_table


def received(message: msgspec.Struct, sender: str | None = None) -> Received:
    """A message as the network hands it over."""
    topic = _topic(message)
    name = sender if sender is not None else str(message.sender)  # type: ignore[attr-defined]
    return Received(topic, name, topic.codec.encode(message))


def _topic(message: msgspec.Struct) -> Topic:
    return next(topic for topic in topics.TOPICS.values() if topic.codec.kind is type(message))


@pytest.fixture
def on_air() -> Callable[..., Received]:
    return received


class TalkingFleet:
    """A fleet view with agents that keep talking; a test silences whom it likes."""

    def __init__(self, members: tuple[int, ...] = (1, 2, 3)) -> None:
        self.view = FleetView(members, FRAME, 0.0)
        self.talking: dict[int, dict[str, Any]] = {member: {} for member in members}
        self.tables: dict[int, TableState] = {}
        self.flying: dict[int, SpeakingAutopilot] = {}
        self.beside: Callable[[], bytes] | None = None
        """What others say on the link."""
        self._codec = MavlinkCodec(255, 190, vehicle_state.STATES, vehicle_state.EVENTS)
        self._sequence = 0

    def tick(self, now_s: float) -> FleetView:
        self._sequence += 1
        for drone, changes in self.talking.items():
            self.view.receive_peer(now_s, received(make_state(drone, sequence=self._sequence, **changes)))
            if drone in self.tables:
                self.view.receive_peer(now_s, received(self.tables[drone]))
        said = [vehicle.everything() for vehicle in self.flying.values()]
        said += [self.beside()] if self.beside is not None else []
        for message in self._codec.receive(now_s, b"".join(said)):
            self.view.receive_mavlink(now_s, 0, message)
        return self.view


@pytest.fixture
def fleet() -> Callable[..., TalkingFleet]:
    return TalkingFleet


@pytest.fixture
def ground_config() -> GroundConfig:
    return GroundConfig(
        swarm=SwarmConfig(name="test", members=(1, 2, 3)),
        origin=ORIGIN,
        mavlink=MavlinkConfig(links=("udpin:127.0.0.1:0",)),
    )
