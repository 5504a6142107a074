"""From where the vehicle should go to how it must push: the autopilot's position and velocity controller."""

from __future__ import annotations

import dataclasses
import math

from mission.geometry.frames import Vector3
from simvehicle.vehicle.dynamics import GRAVITY_MPS2

_POSITION_GAIN = 1.0
"""1/s; ArduCopter's PSC_POSXY_P and PSC_POSZ_P."""
_VELOCITY_GAIN = 2.0
"""1/s; PSC_VELXY_P."""
_VELOCITY_INTEGRAL = 1.0
"""1/s^2; PSC_VELXY_I: what finds the lean that holds against the wind."""
_CLIMB_GAIN = 4.0
_CLIMB_INTEGRAL = 1.5
_BRAKING_SHARE = 0.6
"""Share of the acceleration limit that the approach to a position plans with: the rest is for errors."""


@dataclasses.dataclass(frozen=True, slots=True)
class Limits:
    """What the parameters allow the vehicle."""

    speed_mps: float
    """Towards a position."""
    most_mps: float
    """When a velocity is asked for."""
    climb_mps: float
    descent_mps: float
    acceleration_mps2: float
    climb_acceleration_mps2: float
    tilt_rad: float
    land_mps: float
    land_slow_below_m: float
    """Above home: where a landing has slowed down from `descent_mps` to `land_mps`."""
    return_speed_mps: float
    land_slows_from_m: float = 0.0
    """Above home: where it begins to; not above `land_slow_below_m`: at once."""
    crawl_mps: float = 0.0
    crawl_below_m: float = 0.0
    """Above home: the last bit goes as slowly as this."""

    def landing_mps(self, above_home_m: float) -> float:
        """How fast a landing goes down at a height."""
        if self.crawl_mps > 0.0 and above_home_m < self.crawl_below_m:
            return self.crawl_mps
        if above_home_m <= self.land_slow_below_m:
            return self.land_mps
        slowing_m = self.land_slows_from_m - self.land_slow_below_m
        if slowing_m <= 0.0 or above_home_m >= self.land_slows_from_m:
            return self.descent_mps
        share = (above_home_m - self.land_slow_below_m) / slowing_m
        return self.land_mps + share * (self.descent_mps - self.land_mps)


@dataclasses.dataclass(slots=True)
class Motion:
    """What a manoeuvre wants now, in the autopilot's local NED frame. One of each pair is given."""

    horizontal_m: tuple[float, float] | None = None
    """Position to be at, north and east."""
    horizontal_mps: tuple[float, float] | None = None
    """Velocity to fly, or with a position the velocity that the position moves with."""
    down_m: float | None = None
    down_mps: float | None = None
    yaw_rad: float | None = None
    """None: keep the heading."""
    yaw_rate_radps: float | None = None
    speed_mps: float | None = None
    """Slower or faster than the limits' speed when going to a position."""
    level: bool = False
    """No horizontal control at all: the vehicle stays level and the wind takes it along."""
    idle: bool = False
    """Motors idle on the ground."""


def approach_mps(distance: float, limit_mps: float, acceleration_mps2: float) -> float:
    """Speed towards a point `distance` away from which braking at `acceleration_mps2` ends there.

    Proportional near the point, square root of the distance further out, the two joined with equal slope.
    """
    linear_m = acceleration_mps2 / _POSITION_GAIN**2
    if distance <= linear_m:
        speed_mps = distance * _POSITION_GAIN
    else:
        speed_mps = math.sqrt(2.0 * acceleration_mps2 * (distance - linear_m / 2.0))
    return min(speed_mps, limit_mps)


class PositionController:
    """Cascade position -> velocity -> acceleration -> thrust vector, with limits and a wind-finding integral."""

    __slots__ = ("_climb_integral", "_integral", "_reference")

    def __init__(self) -> None:
        self._integral = [0.0, 0.0]
        self._climb_integral = 0.0
        self._reference = [0.0, 0.0, 0.0]
        """The velocity that is asked for now: follows what is wanted no faster than the acceleration limits."""

    def reset(self, velocity_ned_mps: Vector3 = (0.0, 0.0, 0.0)) -> None:
        self._integral = [0.0, 0.0]
        self._climb_integral = 0.0
        self._reference = list(velocity_ned_mps)

    def step(
        self, dt_s: float, motion: Motion, position_m: Vector3, velocity_mps: Vector3, limits: Limits
    ) -> Vector3:
        """The specific thrust wanted, m/s^2, NED."""
        if motion.idle:
            self.reset()
            return 0.0, 0.0, -0.1 * GRAVITY_MPS2
        # Height first: what is left of the tilt limit depends on how much of the thrust has to point up.
        down = self._vertical(dt_s, motion, position_m, velocity_mps, limits) - GRAVITY_MPS2
        most_mps2 = -down * math.tan(limits.tilt_rad)
        north, east = self._horizontal(dt_s, motion, position_m, velocity_mps, limits, most_mps2)
        return north, east, down

    def _horizontal(
        self,
        dt_s: float,
        motion: Motion,
        position_m: Vector3,
        velocity_mps: Vector3,
        limits: Limits,
        most_mps2: float,
    ) -> tuple[float, float]:
        if motion.level:
            self._integral = [0.0, 0.0]
            self._reference[0], self._reference[1] = velocity_mps[0], velocity_mps[1]
            return 0.0, 0.0
        wanted = self._wanted_horizontal(motion, position_m, limits)
        reference, integral = self._reference, self._integral
        change_n, change_e = wanted[0] - reference[0], wanted[1] - reference[1]
        change = math.hypot(change_n, change_e)
        most = limits.acceleration_mps2 * dt_s
        if change > most:
            change_n, change_e = change_n * most / change, change_e * most / change
        reference[0] += change_n
        reference[1] += change_e
        error_n, error_e = reference[0] - velocity_mps[0], reference[1] - velocity_mps[1]
        north = change_n / dt_s + _VELOCITY_GAIN * error_n + integral[0]
        east = change_e / dt_s + _VELOCITY_GAIN * error_e + integral[1]
        size = math.hypot(north, east)
        if size > most_mps2:  # no winding up against the tilt limit
            return north * most_mps2 / size, east * most_mps2 / size
        integral[0] += _VELOCITY_INTEGRAL * error_n * dt_s
        integral[1] += _VELOCITY_INTEGRAL * error_e * dt_s
        return north, east

    @staticmethod
    def _wanted_horizontal(motion: Motion, position_m: Vector3, limits: Limits) -> tuple[float, float]:
        north, east = motion.horizontal_mps or (0.0, 0.0)
        limit_mps = limits.speed_mps if motion.speed_mps is None else motion.speed_mps
        if motion.horizontal_m is None:
            limit_mps = limits.most_mps
        if motion.horizontal_m is not None:
            off_n, off_e = motion.horizontal_m[0] - position_m[0], motion.horizontal_m[1] - position_m[1]
            distance_m = math.hypot(off_n, off_e)
            if distance_m > 1e-6:
                speed = approach_mps(distance_m, limit_mps, _BRAKING_SHARE * limits.acceleration_mps2)
                north += off_n / distance_m * speed
                east += off_e / distance_m * speed
        size = math.hypot(north, east)
        if size > limit_mps:
            north, east = north * limit_mps / size, east * limit_mps / size
        return north, east

    def _vertical(
        self, dt_s: float, motion: Motion, position_m: Vector3, velocity_mps: Vector3, limits: Limits
    ) -> float:
        wanted = motion.down_mps or 0.0
        acceleration = limits.climb_acceleration_mps2
        if motion.down_m is not None:
            off_m = motion.down_m - position_m[2]
            limit_mps = limits.descent_mps if off_m > 0.0 else limits.climb_mps
            wanted += math.copysign(approach_mps(abs(off_m), limit_mps, _BRAKING_SHARE * acceleration), off_m)
        wanted = max(-limits.climb_mps, min(limits.descent_mps, wanted))
        change = max(-acceleration * dt_s, min(acceleration * dt_s, wanted - self._reference[2]))
        self._reference[2] += change
        error = self._reference[2] - velocity_mps[2]
        down = change / dt_s + _CLIMB_GAIN * error + self._climb_integral
        if -GRAVITY_MPS2 < down < 0.9 * GRAVITY_MPS2:
            self._climb_integral += _CLIMB_INTEGRAL * error * dt_s
            return down
        return max(-GRAVITY_MPS2, min(0.9 * GRAVITY_MPS2, down))
