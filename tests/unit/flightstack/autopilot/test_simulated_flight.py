"""The session flies the simulated vehicles, which know nothing of it: both flavours, in one process, on one clock."""

from __future__ import annotations

import pathlib

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.autopilot import AutopilotSession, TakenBy
from flightstack.config import AutopilotConfig
from flightstack.config_file import load
from flightstack.mavlink.codec import MavlinkCodec
from mission.geometry.frames import Geodetic, LocalFrame
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.drone.simulated_vehicle import SimulatedVehicle
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.world.configured import make_world
from simvehicle.world.world_config import GaussianPlume

EXAMPLE = pathlib.Path(__file__).parents[4] / "examples" / "drone_px4.yaml"
ORIGIN = Geodetic(-5.06, 151.3, 500.0)
TICK_S = 0.1
PHYSICS_STEPS = 4
FLAVOURS = ("ardupilot", "px4")
OURS = {"ardupilot": "GUIDED", "px4": "OFFBOARD"}


class Flight:
    def __init__(
        self,
        flavour: str,
        clock_rate: float = 1.0,
        parameters: dict[str, float] | None = None,
        timeout_s: float = 60.0,
    ):
        """`clock_rate`: seconds of the vehicle's clock that pass in one of ours. `parameters`: what the drone's file
        sets, by default what keeps a PX4 safe."""
        self.clock_rate = clock_rate
        spec = VehicleSpec(id=3, flavour=flavour, home_north_m=5.0, links=("udpout:127.0.0.1:1",))
        plume = GaussianPlume(source_north_m=100.0, source_east_m=0.0)
        fleet = FleetConfig(origin=ORIGIN, vehicles=(spec,), plume=plume, ready_after_s=20.0)
        self.vehicle = SimulatedVehicle(spec, make_world(fleet), seed=1, ready_after_s=20.0)
        if parameters is None:
            parameters = {"COM_OBL_RC_ACT": 3.0, "RTL_CONE_ANG": 0.0} if flavour == "px4" else {}
        config = AutopilotConfig(link="unused", parameters=parameters, ready_timeout_s=timeout_s)
        self.session = AutopilotSession(3, LocalFrame(ORIGIN), config)
        self.ticks = 0
        self.down = b""
        self.modes: list[str] = []
        self.texts: list[str] = []

    @property
    def report(self):
        return self.session.report

    def tick(self, ask=None) -> None:
        self.ticks += 1
        now_s = self.ticks * TICK_S
        self.session.receive(now_s, self.down)
        if self.report.mode and self.report.mode not in self.modes[-1:]:
            self.modes.append(self.report.mode)
        self.texts += [text.text for text in self.report.new_texts]
        if ask is not None:
            ask()
        self.vehicle.receive(0, self.session.step(now_s))
        for step in range(1, PHYSICS_STEPS + 1):
            self.vehicle.step(self.clock_rate * (now_s - TICK_S + step * TICK_S / PHYSICS_STEPS))
        self.down = b"".join(frame for _, frame in self.vehicle.drain())

    def stand_still(self, seconds: float) -> None:
        """The vehicle goes on, and this computer does nothing."""
        for _ in range(round(seconds / TICK_S)):
            self.ticks += 1
            self.vehicle.step(self.ticks * TICK_S)
        self.down += b"".join(frame for _, frame in self.vehicle.drain())

    def until(self, done, ask=None, limit_s: float = 60.0) -> Flight:
        for _ in range(round(limit_s / TICK_S)):
            if done(self.report):
                return self
            self.tick(ask)
        raise AssertionError(f"not within {limit_s} s: {self.report}")

    def run(self, seconds: float, ask=None) -> Flight:
        for _ in range(round(seconds / TICK_S)):
            self.tick(ask)
        return self

    def take_off(self, above_home_m: float = 15.0) -> Flight:
        """As the agent does it."""
        session = self.session
        self.until(lambda r: r.ready)
        self.until(lambda r: r.mode_ours, session.take_control)
        self.until(lambda r: r.armed, session.arm)
        return self.until(
            lambda r: r.airborne and r.position_ned_m[2] < 1.0 - above_home_m,
            lambda: session.takeoff(above_home_m),
        )


@pytest.mark.parametrize("clock_rate", [0.8, 1.0, 1.25])
@pytest.mark.parametrize("flavour", FLAVOURS)
def test_take_off_position_velocity_land(flavour, clock_rate):
    """Also where the clocks differ far more than crystals do, as with a simulated autopilot on a busy machine."""
    flight = Flight(flavour, clock_rate).take_off()
    assert flight.ticks * TICK_S > 20.0 / clock_rate  # it was not ready before

    flight.run(15.0, lambda: flight.session.target_position((25.0, 10.0, -15.0)))
    assert flight.vehicle.position_ned_m == pytest.approx((25.0, 10.0, -15.0), abs=1.0)
    assert flight.report.position_ned_m == pytest.approx(flight.vehicle.position_ned_m, abs=1.0)

    flight.run(5.0, lambda: flight.session.target_velocity((0.0, 2.0, 0.0)))
    assert flight.vehicle.velocity_ned_mps == pytest.approx((0.0, 2.0, 0.0), abs=0.5)
    assert flight.report.velocity_ned_mps == pytest.approx((0.0, 2.0, 0.0), abs=0.5)

    flight.until(lambda r: not r.mode_ours, flight.session.land)
    flight.until(lambda r: not r.armed)
    assert not flight.report.airborne
    assert flight.vehicle.position_ned_m[2] == pytest.approx(0.0, abs=0.3)
    # Nothing but what we asked for: no failsafe on the way, and nobody else's mode. On the ground PX4 shows what was
    # before the landing.
    landed = [OURS[flavour], "LAND"] + ["OFFBOARD"] * (flavour == "px4")
    assert flight.modes[-len(landed) :] == landed
    assert flight.report.taken_by is TakenBy.NOBODY


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_it_returns_home_when_told(flavour):
    flight = Flight(flavour).take_off()
    flight.run(10.0, lambda: flight.session.target_position((25.0, 10.0, -15.0)))
    flight.until(lambda r: r.mode == "RTL", flight.session.rtl)
    flight.until(lambda r: not r.armed, limit_s=120.0)
    assert flight.vehicle.position_ned_m == pytest.approx((5.0, 0.0, 0.0), abs=2.0)
    assert flight.report.taken_by is TakenBy.NOBODY


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_lost_gps_takes_the_vehicle_from_us(flavour):
    flight = Flight(flavour).take_off()
    flight.vehicle.set_gps(working=False)
    hold = (5.0, 0.0, -15.0)
    flight.until(
        lambda r: r.taken_by is not TakenBy.NOBODY, lambda: flight.session.target_position(hold), limit_s=40.0
    )
    assert flight.report.taken_by is TakenBy.AUTOPILOT
    assert flight.report.failsafe
    assert not flight.report.mode_ours


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_an_agent_that_dies_leaves_a_vehicle_that_does_not_fly_on(flavour):
    flight = Flight(flavour).take_off()
    flight.run(3.0, lambda: flight.session.target_velocity((3.0, 0.0, 0.0)))
    north_m = flight.vehicle.position_ned_m[0]
    for _ in range(200):  # the vehicle alone: nothing comes to it any more
        flight.ticks += 1
        flight.vehicle.step(flight.ticks * TICK_S)
        flight.vehicle.drain()
    assert flight.vehicle.velocity_ned_mps[0] == pytest.approx(0.0, abs=1.5)
    assert flight.vehicle.position_ned_m[0] < north_m + 20.0


def test_a_px4_that_would_sink_without_its_companion_is_not_armed():
    flight = Flight("px4", parameters={})
    flight.until(lambda r: bool(flight.session.problem), flight.session.arm)
    assert (
        "COM_OBL_RC_ACT is 0 (Position: without a remote control it sinks to the ground"
        in flight.session.problem
    )
    assert "autopilot.parameters" in flight.session.problem
    assert not flight.report.armed


def test_a_px4_that_returns_is_armed_and_its_cone_is_told():
    flight = Flight("px4", parameters={"COM_OBL_RC_ACT": 3.0})
    flight.until(lambda r: r.armed, flight.session.arm)
    assert any(note.startswith("RTL_CONE_ANG is 45") for note in flight.report.notes)


def test_a_px4_that_flies_on_for_long_without_its_companion_is_told():
    flight = Flight("px4", parameters={"COM_OBL_RC_ACT": 3.0, "RTL_CONE_ANG": 0.0})
    flight.vehicle.autopilot.parameters.set("COM_OF_LOSS_T", 30.0)
    flight.until(lambda r: r.armed, flight.session.arm)
    (note,) = flight.report.notes
    assert note.startswith("COM_OF_LOSS_T is 30: for so many seconds it flies on if this computer fails")


def test_what_the_drones_file_says_of_a_lost_computer_is_what_its_operator_wants():
    flight = Flight("px4", parameters={"COM_OBL_RC_ACT": 5.0, "RTL_CONE_ANG": 0.0})
    flight.until(lambda r: r.armed, flight.session.arm)
    assert flight.vehicle.autopilot.parameters["COM_OBL_RC_ACT"] == 5.0
    assert flight.report.notes == ()


def test_a_px4_tells_what_it_waits_for_and_why_it_refuses():
    flight = Flight("px4", timeout_s=40.0)
    flight.until(lambda r: r.connected).run(5.0)
    assert "estimator has no absolute position yet" in flight.report.ready_reason
    flight.until(lambda r: r.ready)
    flight.vehicle.set_motors(working=False)
    flight.until(lambda r: bool(flight.session.problem), flight.session.arm)
    assert flight.session.problem == "not armed within 40 s: Motor failure detected"


def test_an_agent_that_joins_late_asks_a_px4_why_it_is_not_ready():
    flight = Flight("px4")
    flight.vehicle.set_motors(working=False)
    flight.stand_still(25.0)
    flight.down = b""  # its report was sent then, to nobody
    flight.until(lambda r: r.connected)
    flight.until(lambda r: r.ready_reason == "Motor failure detected", flight.session.arm)


@pytest.mark.parametrize("still_s", [1.5, 2.6, 4.2])
def test_a_pause_of_our_own_is_told_and_no_pilots_doing(still_s):
    flight = Flight("px4").take_off()
    ahead = lambda: flight.session.target_velocity((1.0, 0.0, 0.0))  # noqa: E731
    flight.run(3.0, ahead)
    flight.stand_still(still_s)
    flight.session.receive(flight.ticks * TICK_S, flight.down)
    flight.down = b""
    assert flight.report.stood_still_s == pytest.approx(still_s, abs=0.15)
    flight.texts += [text.text for text in flight.report.new_texts]
    ahead()
    flight.vehicle.receive(0, flight.session.step(flight.ticks * TICK_S))
    flight.run(6.0, ahead)
    assert "Failsafe activated: switching to Return (No offboard signal)" in flight.texts
    assert flight.report.taken_by is TakenBy.NOBODY
    assert flight.report.mode_ours
    assert flight.vehicle.mode == "OFFBOARD"
    assert flight.report.stood_still_s == 0.0
    assert flight.vehicle.velocity_ned_mps[0] == pytest.approx(1.0, abs=0.3)


def test_setpoints_that_do_not_arrive_are_the_autopilots_failsafe():
    flight = Flight("px4").take_off()
    hold = flight.report.position_ned_m
    receive = flight.vehicle.receive
    flight.vehicle.receive = lambda link, data: None
    flight.run(8.0, lambda: flight.session.target_position(hold))
    flight.vehicle.receive = receive
    assert flight.report.taken_by is TakenBy.AUTOPILOT
    assert "No offboard signal" in flight.report.taken_reason
    assert flight.vehicle.mode == "RTL"


def test_a_lost_position_is_told_as_that():
    flight = Flight("px4").take_off()
    flight.vehicle.set_gps(working=False)
    hold = flight.report.position_ned_m
    flight.until(lambda r: r.taken_by is not TakenBy.NOBODY, lambda: flight.session.target_position(hold))
    assert flight.report.taken_by is TakenBy.AUTOPILOT
    assert "blind descent (No valid position estimate" in flight.report.taken_reason
    flight.run(2.0)
    assert "No offboard signal" not in flight.texts


def test_the_example_of_a_px4_drone_makes_it_safe():
    config = load(EXAMPLE)
    assert config.autopilot.flavour == "px4"
    flight = Flight("px4", parameters=config.autopilot.parameters)
    flight.until(lambda r: r.armed, flight.session.arm)
    for name, value in config.autopilot.parameters.items():
        assert flight.vehicle.autopilot.parameters[name] == value
    assert flight.report.notes == ()


def test_a_text_that_was_lost_on_the_way_is_fetched():
    flight = Flight("px4").take_off()
    drain = flight.vehicle.drain
    lost = []

    def drain_without_events():
        frames = drain()
        lost.extend(data for _, data in frames if data[7] | data[8] << 8 == 410)
        return [(link, data) for link, data in frames if data not in lost]

    flight.vehicle.drain = drain_without_events
    flight.session.land()
    flight.run(3.0)
    flight.vehicle.drain = drain
    assert lost
    assert "Landing at current position" not in flight.texts
    flight.run(6.0)
    assert "Landing at current position" in flight.texts


def test_a_vehicle_that_signs_is_told_of_where_there_is_no_key():
    flight = Flight("ardupilot")
    assert flight.vehicle.autopilot.signing_key is None
    for _ in range(30):
        flight.tick()
    assert not any("signs" in note for note in flight.report.notes)
    key = mavlink.MAVLink_setup_signing_message(3, 1, list(range(32)), 5)
    flight.vehicle.receive(0, MavlinkCodec(255, 190).encode(key))
    for _ in range(30):
        flight.tick()
    assert flight.report.connected
    assert "autopilot signs what it says, and may obey nobody without its key: set autopilot.signing_key" in (
        flight.report.notes
    )
