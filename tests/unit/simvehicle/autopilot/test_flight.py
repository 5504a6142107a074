"""What a vehicle is doing, apart from any message; and parts of it that are replaced, as a bridge does."""

from __future__ import annotations

import numpy as np
import pytest

from mission.geometry.frames import Geodetic, Vector3
from simvehicle.autopilot import ardupilot_parameters
from simvehicle.autopilot.flight import TICK_S, Flight
from simvehicle.autopilot.maneuvers import HoldPosition, Idle, Return, TakeOff
from simvehicle.autopilot.mission_progress import MissionProgress, MissionStyle
from simvehicle.autopilot.mission_run import MissionRun, Told
from simvehicle.autopilot.missions import MISSION, StoredItem, empty_lists
from simvehicle.autopilot.parameters import Parameters
from simvehicle.vehicle.controller import Limits, Motion, PositionController
from simvehicle.vehicle.dynamics import GRAVITY_MPS2, Battery, Multirotor
from simvehicle.vehicle.estimator import Estimator
from simvehicle.vehicle.vehicle import PhysicalVehicle, make_vehicle
from simvehicle.world.configured import make_world
from simvehicle.world.world_config import WindConfig, WorldConfig

WORLD = make_world(WorldConfig(origin=Geodetic(-5.06, 151.3, 500.0), wind=WindConfig(speed_mps=0.0)))


def limits() -> Limits:
    return ardupilot_parameters.limits(Parameters("ardupilot", {}))


class Flown:
    def __init__(self, vehicle: PhysicalVehicle | None = None) -> None:
        self.said: list[str] = []
        vehicle = vehicle or make_vehicle(WORLD, (0.0, 0.0, 0.0), Battery(10_000.0), system=1, seed=1)
        self.flight = Flight(vehicle, limits(), 1.0, lambda _severity, text: self.said.append(text))
        self.flight.power_up(0.0)
        self.landed: list[float] = []
        self.ticks = 0

    def run(self, seconds: float) -> None:
        flight = self.flight
        for _ in range(round(seconds / TICK_S)):
            self.ticks += 1
            flight.sense(self.ticks * TICK_S)
            wanted = flight.move()
            flight.take_impact_mps()
            if wanted is not None and flight.settle(wanted):
                self.landed.append(flight.now_s)
            flight.use_power()

    def take_off(self, above_m: float = 8.0) -> None:
        self.run(0.1)
        self.flight.arm()
        self.flight.maneuver = TakeOff(above_m)
        self.run(12.0)


def test_it_takes_off_lands_and_is_sure_of_it_only_after_a_while() -> None:
    flown = Flown()
    flown.take_off()
    flight = flown.flight
    assert flight.above_home_m == pytest.approx(8.0, abs=0.5)
    assert not flight.landed
    flight.maneuver = Return((0.0, 0.0, 0.0), travel_down_m=-8.0, loiter_s=0.0)
    flown.run(30.0)
    assert len(flown.landed) == 1
    assert flight.landed
    assert flight.is_landing


def test_disarming_ends_what_it_does_and_tells_everybody_in_turn() -> None:
    flown = Flown()
    flight = flown.flight
    told: list[str] = []
    flight.after_disarming += [lambda: told.append("modes"), lambda: told.append("failsafes")]
    flight.disarm("not armed", 6)
    assert (told, flown.said) == ([], [])
    flown.run(0.1)
    flight.arm()
    flight.maneuver = HoldPosition()
    flight.disarm("enough", 6)
    assert (told, flown.said) == (["modes", "failsafes"], ["enough"])
    assert isinstance(flight.maneuver, Idle)
    assert flight.motion.idle


def test_without_motors_it_falls_and_touches_the_ground() -> None:
    flown = Flown()
    flown.take_off()
    flown.flight.disarm("motors off", 2)
    vehicle = flown.flight.vehicle
    flown.run(0.5)
    assert vehicle.body.velocity[2] > 3.0
    impacts = []
    for _ in range(200):
        flown.ticks += 1
        flown.flight.sense(flown.ticks * TICK_S)
        flown.flight.move()
        impacts.append(flown.flight.take_impact_mps())
    (impact,) = [speed for speed in impacts if speed is not None]
    assert impact > 8.0


def item(command: int, x: int = 0, z: float = 10.0) -> StoredItem:
    return StoredItem(3, command, 0.0, 0.0, 0.0, 0.0, x, x, z)


def test_a_mission_that_is_replaced_while_it_is_flown_is_flown_on_as_the_new_one() -> None:
    flown = Flown()
    flight = flown.flight
    flight.set_origin()
    lists = empty_lists()
    lists[MISSION] = [item(22), item(19)]

    def back() -> Return:
        return Return((0.0, 0.0, 0.0), travel_down_m=-10.0, loiter_s=0.0)

    progress = MissionProgress(flight, lists, MissionStyle(first=0, arrival_m=lambda: 2.0, back=back))
    flown.run(0.1)
    flight.arm()
    flight.maneuver = progress.start()
    flown.run(1.0)
    assert progress.take_told() == [(Told.STARTED, 0)]
    assert not progress.set_current(5)
    renewed = [item(22), item(16, x=500), item(20)]
    progress.replaced(renewed)
    lists[MISSION] = renewed
    assert isinstance(flight.maneuver, MissionRun)
    assert progress.set_current(2)
    flown.run(0.1)
    assert progress.take_told() == [(Told.STARTED, 2)]
    assert (progress.next, progress.total) == (2, 3)


class WiredBody(Multirotor):
    """A body that is moved by something else: it takes the thrust that is wanted and gives a position."""

    def __init__(self) -> None:
        super().__init__((0.0, 0.0, -20.0))
        self.on_ground = False
        self.wanted: list[Vector3] = []

    def step(
        self, dt_s: float, wanted_thrust_mps2: Vector3, wanted_yaw_rad: float | None, wind_ned_mps: Vector3
    ) -> None:
        self.wanted.append(wanted_thrust_mps2)
        self.position[0] += 0.1


class PushingController:
    """Always wants the same, whatever is asked for."""

    def reset(self) -> None:
        """Nothing is kept."""

    def step(
        self, dt_s: float, motion: Motion, position_m: Vector3, velocity_mps: Vector3, limits: Limits
    ) -> Vector3:
        return 1.0, 2.0, -GRAVITY_MPS2


def test_body_and_controller_may_be_others() -> None:
    body = WiredBody()
    estimator = Estimator(WORLD.frame, (0.0, 0.0, -20.0), np.random.default_rng(1))
    flown = Flown(PhysicalVehicle(WORLD, body, estimator, PushingController(), Battery(10_000.0)))
    flown.run(0.1)
    flown.flight.arm()
    flown.flight.maneuver = HoldPosition()
    flown.run(1.0)
    assert set(body.wanted) >= {(1.0, 2.0, -GRAVITY_MPS2)}
    assert flown.flight.nav.position_m[0] == pytest.approx(body.position[0], abs=1.0)
    wired = Flown(PhysicalVehicle(WORLD, WiredBody(), estimator, PositionController(), Battery(10_000.0)))
    wired.run(0.1)
    assert wired.flight.nav.position_m != (0.0, 0.0, 0.0)
