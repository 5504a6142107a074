"""A vehicle without its MAVLink: body, own sensors, controller and battery in the world's air, advanced together."""

from __future__ import annotations

import numpy as np

from mission.geometry.frames import Vector3
from simvehicle.vehicle.controller import Limits, Motion, PositionController
from simvehicle.vehicle.dynamics import Battery, Multirotor
from simvehicle.vehicle.estimator import Estimator
from simvehicle.vehicle.parts import Body, MotionController, MotionEstimate, PowerSupply
from simvehicle.world.air import World

_AUTOPILOT_STREAM = 0xA0
"""Of the random numbers: the sensors' noise stays the same whatever else draws more or fewer."""


class PhysicalVehicle:
    """Deterministic; who calls it keeps the time and says what motion is wanted."""

    def __init__(
        self,
        world: World,
        body: Body,
        estimator: MotionEstimate,
        controller: MotionController,
        battery: PowerSupply,
    ) -> None:
        self.world = world
        self.body = body
        self.estimator = estimator
        self.controller = controller
        self.battery = battery
        self.wind_ned_mps: Vector3 = (0.0, 0.0, 0.0)
        """At the vehicle, as it was last looked at."""

    def look_at_wind(self, now_s: float) -> None:
        north, east, down = self.body.position
        self.wind_ned_mps = self.world.wind.wind_ned_mps((north, east, down), now_s)

    def sense(self, now_s: float, dt_s: float) -> None:
        self.estimator.step(now_s, dt_s, self.body.position, self.body.velocity)

    def move(self, dt_s: float, motion: Motion, limits: Limits) -> Vector3:
        """One step of controller and body with the motors on: the specific thrust that was wanted, m/s^2, NED."""
        body, estimator = self.body, self.estimator
        thrust = self.controller.step(dt_s, motion, estimator.position_m, estimator.velocity_mps, limits)
        yaw_rad = motion.yaw_rad
        if motion.yaw_rate_radps is not None:
            yaw_rad = body.yaw_rad + 0.5 * motion.yaw_rate_radps  # the heading loop's gain is 2 per second
        body.step(dt_s, thrust, yaw_rad, self.wind_ned_mps)
        return thrust

    def fall(self, dt_s: float) -> bool:
        """One step with the motors off; False where it lies on the ground."""
        body = self.body
        if body.on_ground and body.thrust[2] == 0.0:
            return False
        body.step(dt_s, (0.0, 0.0, 0.0), None, self.wind_ned_mps)
        return True

    @property
    def amsl_m(self) -> float:
        """True altitude above mean sea level."""
        return self.world.frame.origin.amsl_m - self.body.position[2]


def make_vehicle(
    world: World, home_ned_m: Vector3, battery: Battery, *, system: int, seed: int
) -> PhysicalVehicle:
    """A vehicle all of whose parts are simulated, at rest at home."""
    rng = np.random.default_rng([seed & 0xFFFFFFFF, system, _AUTOPILOT_STREAM])
    estimator = Estimator(world.frame, home_ned_m, rng)
    return PhysicalVehicle(world, Multirotor(home_ned_m), estimator, PositionController(), battery)
