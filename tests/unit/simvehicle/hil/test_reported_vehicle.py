"""A vehicle that we know by its reports only; a simulated ArduCopter at the end of its link stands for a real one."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mission.geometry.frames import Geodetic
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.drone.simulated_vehicle import SimulatedVehicle
from simvehicle.hil.reported_vehicle import ReportedVehicle, UnreachableFaultError
from simvehicle.world.configured import make_world
from simvehicle.world.world_config import WorldConfig


class Watched:
    """The reporting vehicle's own link 1 is its agent's; link 0 is ours."""

    def __init__(self) -> None:
        world = make_world(WorldConfig(origin=Geodetic(-5.06, 151.3, 500.0)))
        spec = VehicleSpec(id=4, home_north_m=7.0, home_east_m=-3.0, links=("", ""))
        self.real = SimulatedVehicle(spec, world, seed=1, ready_after_s=2.0)
        self.reported = ReportedVehicle(spec.id, world.frame, spec.home_ned_m)
        self.now_s = 0.0
        self.loses = False
        """What we send does not arrive."""
        self._codec = mavlink.MAVLink(None, srcSystem=4, srcComponent=191)

    def command(self, number: int, *params: float) -> None:
        padded = [*params, *[0.0] * (7 - len(params))]
        message = mavlink.MAVLink_command_long_message(4, 1, number, 0, *padded)
        self.real.receive(1, bytes(message.pack(self._codec)))

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.02)):
            self.now_s += 0.02
            self.real.step(self.now_s)
            for link, data in self.real.drain():
                if link == 0:
                    self.reported.receive(0, data)
            self.reported.step(self.now_s)
            for link, data in self.reported.drain():
                if not self.loses:
                    self.real.receive(link, data)

    def take_off(self) -> None:
        self.run(6.0)
        self.command(176, 1, 4)
        self.command(400, 1)
        self.command(22, 0, 0, 0, 0, 0, 0, 12)
        self.run(15.0)


def test_before_it_reports_it_is_at_home_and_its_time_has_not_begun() -> None:
    watched = Watched()
    reported = watched.reported
    assert reported.position_ned_m == (7.0, -3.0, 0.0)
    assert (reported.velocity_ned_mps, reported.attitude_rad) == ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert (reported.airborne, reported.armed, reported.mode, reported.time_s) == (False, False, "", 0.0)


def test_it_is_where_it_says_in_flight() -> None:
    watched = Watched()
    watched.take_off()
    real, reported = watched.real, watched.reported
    assert reported.position_ned_m == pytest.approx(real.position_ned_m, abs=1.0)
    assert reported.attitude_rad == pytest.approx(real.attitude_rad, abs=0.05)
    assert math.dist(reported.velocity_ned_mps, real.velocity_ned_mps) < 0.3
    assert (reported.airborne, reported.armed, reported.mode) == (True, True, "GUIDED")
    assert reported.battery_fraction == pytest.approx(real.battery_fraction, abs=0.02)
    assert reported.time_s == pytest.approx(watched.now_s, abs=0.3)


def test_a_lost_gps_and_its_return_are_asked_for_until_they_are_confirmed() -> None:
    watched = Watched()
    watched.run(6.0)
    estimator = watched.real.autopilot.vehicle.estimator
    watched.loses = True
    watched.reported.set_gps(False)
    watched.run(2.5)
    assert estimator.gps
    watched.loses = False
    watched.run(1.5)
    assert not estimator.gps
    watched.reported.set_gps(True)
    watched.run(0.5)
    assert estimator.gps
    watched.real.autopilot.parameters.set("SIM_GPS_DISABLE", 1.0)
    watched.run(3.0)
    assert watched.real.autopilot.parameters["SIM_GPS_DISABLE"] == 1.0, "confirmed: not asked for again"


def test_a_weak_battery_makes_its_failsafe_act() -> None:
    watched = Watched()
    watched.real.autopilot.parameters.set("BATT_FS_LOW_ACT", 2.0)
    watched.take_off()
    watched.reported.weaken_battery()
    watched.run(14.0)
    assert watched.reported.mode == "RTL"


def test_what_does_not_reach_it_is_an_error() -> None:
    reported = Watched().reported
    with pytest.raises(UnreachableFaultError):
        reported.set_motors(False)
    with pytest.raises(UnreachableFaultError):
        reported.set_silent(True)
