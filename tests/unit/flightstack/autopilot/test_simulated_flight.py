"""The session flies the simulated vehicles, which know nothing of it: both flavours, in one process, on one clock."""

from __future__ import annotations

import pytest

from flightstack.autopilot import AutopilotSession, TakenBy
from flightstack.config import AutopilotConfig
from mission.geometry.frames import Geodetic, LocalFrame
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.drone.simulated_vehicle import SimulatedVehicle
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.world.configured import make_world
from simvehicle.world.world_config import GaussianPlume

ORIGIN = Geodetic(-5.06, 151.3, 500.0)
TICK_S = 0.1
PHYSICS_STEPS = 4
FLAVOURS = ("ardupilot", "px4")
OURS = {"ardupilot": "GUIDED", "px4": "OFFBOARD"}


class Flight:
    def __init__(self, flavour: str, clock_rate: float = 1.0):
        """`clock_rate`: seconds of the vehicle's clock that pass in one of ours."""
        self.clock_rate = clock_rate
        spec = VehicleSpec(id=3, flavour=flavour, home_north_m=5.0, links=("udpout:127.0.0.1:1",))
        plume = GaussianPlume(source_north_m=100.0, source_east_m=0.0)
        fleet = FleetConfig(origin=ORIGIN, vehicles=(spec,), plume=plume, ready_after_s=20.0)
        self.vehicle = SimulatedVehicle(spec, make_world(fleet), seed=1, ready_after_s=20.0)
        parameters = {"COM_OBL_RC_ACT": 3.0, "RTL_CONE_ANG": 0.0} if flavour == "px4" else {}
        config = AutopilotConfig(link="unused", parameters=parameters)
        self.session = AutopilotSession(3, LocalFrame(ORIGIN), config)
        self.ticks = 0
        self.down = b""
        self.modes: list[str] = []

    @property
    def report(self):
        return self.session.report

    def tick(self, ask=None) -> None:
        self.ticks += 1
        now_s = self.ticks * TICK_S
        self.session.receive(now_s, self.down)
        if self.report.mode and self.report.mode not in self.modes[-1:]:
            self.modes.append(self.report.mode)
        if ask is not None:
            ask()
        self.vehicle.receive(0, self.session.step(now_s))
        for step in range(1, PHYSICS_STEPS + 1):
            self.vehicle.step(self.clock_rate * (now_s - TICK_S + step * TICK_S / PHYSICS_STEPS))
        self.down = b"".join(frame for _, frame in self.vehicle.drain())

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
