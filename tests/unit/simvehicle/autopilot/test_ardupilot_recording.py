"""The simulated ArduCopter against a real one: the ground's side of a recorded flight is played to it.

Every message that the ground sent in the recording is sent at its time; what the vehicle then says (answers, texts,
mission progress, mode changes) must be what the real ArduCopter 4.6.3 said, in the same order.
"""

from __future__ import annotations

import functools
import math
import pathlib
import re
from typing import Any, NamedTuple

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mission.geometry.frames import Geodetic, LocalFrame, Vector3
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.drone.simulated_vehicle import SimulatedVehicle
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.world.air import World
from simvehicle.world.gas import make_gas

RECORDING = pathlib.Path(__file__).parents[3] / "data" / "arducopter-4.6.3-conversation.tlog"
BEFORE_S = 0.1
"""The recording begins so long after power-up."""


class Said(NamedTuple):
    time_s: float
    what: str


class Recorded(NamedTuple):
    time_s: float
    message: Any


@functools.cache
def recording() -> list[Recorded]:
    log = mavutil.mavlink_connection(str(RECORDING), robust_parsing=True)
    found: list[Recorded] = []
    while (message := log.recv_match()) is not None:
        if message.get_type() != "BAD_DATA":
            found.append(Recorded(message._timestamp, message))
    log.close()
    start_s = found[0].time_s
    return [Recorded(time_s - start_s, message) for time_s, message in found]


def words(message: Any) -> str | None:
    """What a message says, without numbers that depend on the vehicle's weight or battery; None: not compared."""
    kind = message.get_type()
    if kind == "STATUSTEXT":
        if re.fullmatch(r"[0-9a-f]{32}", message.text):  # the real board's identity
            return None
        text = re.sub(r"\(\w+\)", "()", message.text)
        text = re.sub(r"[\d.]+(?=V used| mAh| m/s)", "#", text)
        return f"{message.severity} {text}"
    if kind == "COMMAND_ACK":
        return f"ack {message.command} {message.result}"
    if kind == "MISSION_REQUEST":
        return f"asks for {message.mission_type}/{message.seq}"
    if kind == "MISSION_ACK":
        return f"list {message.mission_type}: {message.type}"
    if kind == "MISSION_COUNT":
        return f"list {message.mission_type} has {message.count}"
    if kind == "MISSION_ITEM_INT":
        return (
            f"item {message.mission_type}/{message.seq}: {message.frame} {message.command} {message.param1:g} "
            f"{message.x} {message.y} {message.z:g}"
        )
    if kind == "MISSION_ITEM_REACHED":
        return f"reached {message.seq}"
    if kind in ("FENCE_STATUS", "LOG_ENTRY"):
        return kind
    if kind == "PARAM_VALUE" and message.param_id in ("WPNAV_SPEED", "FENCE_ENABLE", "BATT_LOW_VOLT"):
        return f"{message.param_id} {message.param_value:g}" if message.param_index == 65535 else None
    return None


class Listener:
    """Turns a vehicle's messages into what it said, mode changes and arming included."""

    def __init__(self) -> None:
        self.said: list[Said] = []
        self._state: tuple[int, bool] | None = None

    def hear(self, time_s: float, message: Any) -> None:
        if message.get_type() == "HEARTBEAT":
            state = (message.custom_mode, bool(message.base_mode & 128))
            if self._state is not None and state != self._state:
                self.said.append(Said(time_s, f"mode {state[0]} {'armed' if state[1] else 'disarmed'}"))
            self._state = state
        elif (what := words(message)) is not None:
            self.said.append(Said(time_s, what))


class RecordedWind:
    """No wind until the operator switched on 8 m/s from the south; less near the ground, as ArduPilot's simulator
    has it (the square root of the height over 60 m)."""

    def wind_ned_mps(self, position_ned_m: Vector3, time_s: float) -> Vector3:
        share = math.sqrt(min(1.0, max(0.0, -position_ned_m[2]) / 60.0))
        return (8.0 * share, 0.0, 0.0) if time_s > 75.0 else (0.0, 0.0, 0.0)


@functools.cache
def simulated() -> tuple[list[Said], list[tuple[float, Vector3]]]:
    """What our vehicle says to the recorded ground, and its track (local NED, every 0.2 s)."""
    config = FleetConfig(
        origin=Geodetic(-5.06, 151.3, 500.1),
        # The real one crossed the line with its avoidance on, we do not know how (wind is likely); ours would not.
        vehicles=(VehicleSpec(id=1, links=("udpout:127.0.0.1:9",), parameters={"AVOID_ENABLE": 0.0}),),
        ready_after_s=41.5,
        seed=5,
    )
    world = World(LocalFrame(config.origin), RecordedWind(), make_gas(None, (0.0, 0.0, 0.0), 500.1))
    vehicle = SimulatedVehicle(config.vehicles[0], world, seed=5, ready_after_s=41.5)
    listener, track = Listener(), []
    codec = mavlink.MAVLink(None)
    codec.robust_parsing = True
    ground = [entry for entry in recording() if entry.message.get_srcSystem() == 255]
    vehicle.step(0.0)
    for tick in range(int(263.0 / 0.02)):
        now_s = BEFORE_S + tick * 0.02
        # What the ground sent within a tenth of a second arrives together: the vehicle's clock ticks more coarsely.
        while tick % 5 == 0 and ground and ground[0].time_s + BEFORE_S <= now_s + 0.05:
            vehicle.receive(0, bytes(ground.pop(0).message.get_msgbuf()))
        vehicle.step(now_s)
        for _, data in vehicle.drain():
            for message in codec.parse_buffer(data) or ():
                listener.hear(now_s - BEFORE_S, message)
        if tick % 10 == 0:
            track.append((now_s - BEFORE_S, vehicle.position_ned_m))
    return listener.said, track


@functools.cache
def real() -> list[Said]:
    listener = Listener()
    for time_s, message in recording():
        if message.get_srcSystem() == 1:
            listener.hear(time_s, message)
    return listener.said


ANYWHERE = ("ack 511 0", "LOG_ENTRY")

PHASES = [
    ("boot, arming too early, uploads", 0.0, 41.6),
    ("arming, take-off, position and velocity targets, refusals", 41.6, 83.3),
    ("mission", 83.3, 128.4),
    ("fence", 128.4, 176.6),
    ("brake, GPS loss", 176.6, 204.8),
    ("battery, landing", 204.8, 262.9),
]


@pytest.mark.parametrize(("name", "begin_s", "end_s"), PHASES, ids=[phase[0] for phase in PHASES])
def test_says_what_the_real_one_said(name: str, begin_s: float, end_s: float) -> None:
    """In the same order, except what falls anywhere between texts that come by themselves."""
    ours = [said.what for said in simulated()[0] if begin_s <= said.time_s < end_s]
    theirs = [said.what for said in real() if begin_s <= said.time_s < end_s]
    for what in ANYWHERE:
        assert ours.count(what) == theirs.count(what)
    assert [what for what in ours if what not in ANYWHERE] == [
        what for what in theirs if what not in ANYWHERE
    ]


def test_says_it_when_the_real_one_said_it() -> None:
    """Where no flight path comes in between: boot, answers, failsafe delays."""
    ours, theirs = simulated()[0], real()
    for what in (
        "6 EKF3 IMU0 is using GPS",
        "2 PreArm: Need Position Estimate",
        "6 EKF3 IMU0 origin set",
        "ack 22 0",
        "2 EKF3 lane switch 1",
        "2 EKF Failsafe: changed to LAND Mode",
        "2 EKF Failsafe Cleared",
        "4 Battery Failsafe",
    ):
        our_s = next(said.time_s for said in ours if said.what == what)
        their_s = next(said.time_s for said in theirs if said.what == what)
        assert our_s == pytest.approx(their_s, abs=0.5), what


def test_flies_as_the_real_one_flew() -> None:
    """Take-off, a position target, a velocity target that ends 3 s after the last one, drift without GPS."""
    track = simulated()[1]
    compared = 0
    for time_s, message in recording():
        if message.get_type() != "LOCAL_POSITION_NED" or not (42.0 < time_s < 83.0 or 180.0 < time_s < 215.0):
            continue
        ours = min(track, key=lambda sample: abs(sample[0] - time_s))[1]
        limit_m = 3.5 if time_s < 83.0 else 14.0
        assert math.dist(ours, (message.x, message.y, message.z)) < limit_m, time_s
        compared += 1
    assert compared > 50
