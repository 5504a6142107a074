"""What a vehicle can be doing: each manoeuvre turns the estimated state into the motion wanted now.

Pure: no messages and no parameters in here. Positions are in the autopilot's local NED frame.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from typing import Protocol

from mission.geometry.frames import Vector3
from simvehicle.vehicle.controller import Limits, Motion

_STOPPED_MPS = 0.4
_FACE_TRAVEL_M = 2.0
_FACE_TRAVEL_MPS = 0.8


@dataclasses.dataclass(slots=True)
class Navigation:
    """What a manoeuvre may know."""

    now_s: float
    position_m: Vector3
    velocity_mps: Vector3
    yaw_rad: float
    airborne: bool
    home_m: Vector3
    """Down of home is that of the ground there."""
    limits: Limits
    spool_s: float
    """When the motors are up to speed and may lift off."""

    @property
    def above_home_m(self) -> float:
        return self.home_m[2] - self.position_m[2]


class Maneuver(Protocol):
    finished: bool

    def step(self, nav: Navigation) -> Motion: ...


class Idle:
    """Disarmed, or armed on the ground and waiting."""

    finished = False

    def step(self, nav: Navigation) -> Motion:  # noqa: ARG002 - the protocol's signature
        return Motion(idle=True)


class HoldPosition:
    """Stop, then stay. On the ground: motors idle."""

    finished = False

    def __init__(self, at_m: Vector3 | None = None, yaw_rad: float | None = None) -> None:
        self._at_m = at_m
        self._yaw_rad = yaw_rad

    def step(self, nav: Navigation) -> Motion:
        if not nav.airborne:
            self._at_m = None
            return Motion(idle=True)
        if self._at_m is None:
            if math.dist(nav.velocity_mps, (0.0, 0.0, 0.0)) > _STOPPED_MPS:
                return Motion(horizontal_mps=(0.0, 0.0), down_mps=0.0, yaw_rad=self._yaw_rad)
            self._at_m = nav.position_m
        return Motion(
            horizontal_m=(self._at_m[0], self._at_m[1]), down_m=self._at_m[2], yaw_rad=self._yaw_rad
        )


class Level:
    """Height is held, the horizontal is left to the wind (a pilot's angle modes with centred sticks)."""

    finished = False

    def __init__(self) -> None:
        self._down_m: float | None = None

    def step(self, nav: Navigation) -> Motion:
        if not nav.airborne:
            return Motion(idle=True)
        if self._down_m is None:
            self._down_m = nav.position_m[2]
        return Motion(level=True, down_m=self._down_m)


class TakeOff:
    """Straight up from where it stands. `finished` at the height."""

    def __init__(self, above_home_m: float, *, within_m: float = 0.1, climb_mps: float | None = None) -> None:
        """`within_m` of the height it is over. `climb_mps`: slower than the limits' climb."""
        self.above_home_m = above_home_m
        self._within_m = within_m
        self._climb_mps = climb_mps
        self._at_m: tuple[float, float] | None = None
        self.finished = False

    def step(self, nav: Navigation) -> Motion:
        if self._at_m is None:
            self._at_m = nav.position_m[0], nav.position_m[1]
        if nav.now_s < nav.spool_s and not nav.airborne:
            self._at_m = nav.position_m[0], nav.position_m[1]
            return Motion(idle=True)
        off_m = self.above_home_m - nav.above_home_m
        self.finished = nav.airborne and abs(off_m) < self._within_m and abs(nav.velocity_mps[2]) < 0.5
        if self._climb_mps is not None and off_m > self._within_m:
            return Motion(horizontal_m=self._at_m, down_mps=-min(self._climb_mps, max(off_m, 0.3)))
        return Motion(horizontal_m=self._at_m, down_m=nav.home_m[2] - self.above_home_m)


class FlyTo:
    """Fly to a position and stay there. `finished` within `arrival_m` of it."""

    def __init__(
        self,
        position_m: Vector3,
        *,
        velocity_mps: Vector3 | None = None,
        yaw_rad: float | None = None,
        face_travel: bool = True,
        speed_mps: float | None = None,
        arrival_m: float = 2.0,
    ) -> None:
        self.position_m = position_m
        self._velocity_mps = velocity_mps
        self._yaw_rad = yaw_rad
        self._face_travel = face_travel and yaw_rad is None
        self._speed_mps = speed_mps
        self._arrival_m = arrival_m
        self.finished = False

    def step(self, nav: Navigation) -> Motion:
        if not nav.airborne:
            return Motion(idle=True)
        north_m, east_m = self.position_m[0] - nav.position_m[0], self.position_m[1] - nav.position_m[1]
        if self._face_travel and math.hypot(north_m, east_m) > _FACE_TRAVEL_M:
            self._yaw_rad = math.atan2(east_m, north_m)
        off_m = math.dist(self.position_m, nav.position_m)
        self.finished = off_m < self._arrival_m
        velocity = self._velocity_mps
        return Motion(
            horizontal_m=(self.position_m[0], self.position_m[1]),
            down_m=self.position_m[2],
            horizontal_mps=None if velocity is None else (velocity[0], velocity[1]),
            down_mps=None if velocity is None else velocity[2],
            yaw_rad=self._yaw_rad,
            speed_mps=self._speed_mps,
        )


class Follow:
    """Setpoints streamed from outside; what is None in `motion` pairs is left at rest."""

    finished = False

    def __init__(self, motion: Motion, given_s: float, *, face_travel: bool, lifts_off: bool) -> None:
        self.motion = motion
        self.given_s = given_s
        self._face_travel = face_travel
        self._lifts_off = lifts_off
        """PX4 takes off when an Offboard setpoint lies above it; ArduPilot stays on the ground."""

    def renewed(self, motion: Motion, given_s: float, *, face_travel: bool) -> None:
        if motion.yaw_rad is None:
            motion.yaw_rad = self.motion.yaw_rad
        self.motion, self.given_s, self._face_travel = motion, given_s, face_travel

    def step(self, nav: Navigation) -> Motion:
        motion = self.motion
        if not nav.airborne:
            upwards = (motion.down_m is not None and motion.down_m < nav.position_m[2] - 0.3) or (
                motion.down_mps is not None and motion.down_mps < -0.1
            )
            if not (self._lifts_off and upwards) or nav.now_s < nav.spool_s:
                return Motion(idle=True)
        velocity = motion.horizontal_mps
        if self._face_travel and velocity is not None and math.hypot(*velocity) > _FACE_TRAVEL_MPS:
            motion.yaw_rad = math.atan2(velocity[1], velocity[0])
        return motion


class Land:
    """Down where it is. Without a position the wind takes it along."""

    def __init__(
        self, *, with_position: bool = True, at_m: tuple[float, float] | None = None, pause_s: float = 0.0
    ) -> None:
        self._with_position = with_position
        self._at_m = at_m
        self._pause_s = pause_s
        """Stay up so long first: a person may still take over."""
        self._begin_s: float | None = None
        self.finished = False

    def step(self, nav: Navigation) -> Motion:
        if not nav.airborne:
            self.finished = True
            return Motion(idle=True)
        self._begin_s = nav.now_s if self._begin_s is None else self._begin_s
        down_mps = nav.limits.landing_mps(nav.above_home_m)
        if nav.now_s - self._begin_s < self._pause_s:
            down_mps = 0.0
        if not self._with_position:
            return Motion(level=True, down_mps=down_mps)
        if self._at_m is None:
            if math.hypot(nav.velocity_mps[0], nav.velocity_mps[1]) > _STOPPED_MPS:
                return Motion(horizontal_mps=(0.0, 0.0), down_mps=down_mps)
            self._at_m = nav.position_m[0], nav.position_m[1]
        return Motion(horizontal_m=self._at_m, down_mps=down_mps)


class Sink:
    """Down where it is, at a steady speed: a pilot's mode with nobody at the sticks."""

    finished = False

    def __init__(self, down_mps: float, *, level: bool) -> None:
        self._down_mps = down_mps
        self._level = level

    def step(self, nav: Navigation) -> Motion:
        if not nav.airborne:
            return Motion(idle=True)
        if self._level:
            return Motion(level=True, down_mps=self._down_mps)
        return Motion(horizontal_mps=(0.0, 0.0), down_mps=self._down_mps)


class ReturnStep(enum.Enum):
    CLIMB = "climb"
    TRAVEL = "travel"
    LOITER = "loiter"
    DESCEND = "descend"


class Return:
    """Stop and climb, fly to the return point, wait, descend and land there."""

    def __init__(
        self, to_m: Vector3, *, travel_down_m: float, loiter_s: float, loiter_down_m: float | None = None
    ) -> None:
        self._to_m = to_m[0], to_m[1]
        self.travel_down_m = travel_down_m
        self._loiter_s = loiter_s
        self._loiter_down_m = travel_down_m if loiter_down_m is None else loiter_down_m
        """PX4 goes down to RTL_DESCEND_ALT before it waits."""
        self._waiting_since_s: float | None = None
        self._climb_at_m: tuple[float, float] | None = None
        self._land = Land(at_m=self._to_m)
        self.now = ReturnStep.CLIMB
        self.finished = False

    @property
    def landing(self) -> bool:
        return self.now is ReturnStep.DESCEND

    def step(self, nav: Navigation) -> Motion:
        if not nav.airborne:
            self.finished = True
            return Motion(idle=True)
        if self.now is ReturnStep.CLIMB:
            return self._climb(nav)
        if self.now is ReturnStep.TRAVEL:
            off_m = math.dist(self._to_m, nav.position_m[:2])
            if off_m < 0.6 and math.hypot(nav.velocity_mps[0], nav.velocity_mps[1]) < 1.0:
                self.now = ReturnStep.LOITER
            return self._motion(self.travel_down_m, nav)
        if self.now is ReturnStep.LOITER:
            motion = self._motion(self._loiter_down_m, nav)
            if self._waiting_since_s is None and abs(nav.position_m[2] - self._loiter_down_m) < 0.5:
                self._waiting_since_s = nav.now_s
            waited = self._waiting_since_s is not None and (
                nav.now_s - self._waiting_since_s >= self._loiter_s
            )
            if waited:
                self.now = ReturnStep.DESCEND
            return motion
        motion = self._land.step(nav)
        self.finished = self._land.finished
        return motion

    def _climb(self, nav: Navigation) -> Motion:
        if nav.position_m[2] - self.travel_down_m < 0.5:
            self.now = ReturnStep.TRAVEL
        if self._climb_at_m is None:
            if math.hypot(nav.velocity_mps[0], nav.velocity_mps[1]) > _STOPPED_MPS:
                return Motion(horizontal_mps=(0.0, 0.0), down_m=self.travel_down_m)
            self._climb_at_m = nav.position_m[0], nav.position_m[1]
        return Motion(horizontal_m=self._climb_at_m, down_m=self.travel_down_m)

    def _motion(self, down_m: float, nav: Navigation) -> Motion:
        return Motion(horizontal_m=self._to_m, down_m=down_m, speed_mps=nav.limits.return_speed_mps)


class Sticks:
    """A pilot's sticks, each -1 to 1: forward, right, up, clockwise. Centred: the vehicle stops."""

    finished = False

    def __init__(self, *, level: bool) -> None:
        self.forward = self.right = self.up = self.clockwise = 0.0
        self._level = level
        self._hold: HoldPosition | Level = Level() if level else HoldPosition()

    def step(self, nav: Navigation) -> Motion:
        moved = max(abs(self.forward), abs(self.right), abs(self.up), abs(self.clockwise)) > 0.05
        if not moved or (not nav.airborne and self.up <= 0.05):
            return self._hold.step(nav)
        self._hold = Level() if self._level else HoldPosition()
        ahead, right = 5.0 * self.forward, 5.0 * self.right
        cos_yaw, sin_yaw = math.cos(nav.yaw_rad), math.sin(nav.yaw_rad)
        up_mps = self.up * (nav.limits.climb_mps if self.up > 0.0 else nav.limits.descent_mps)
        return Motion(
            horizontal_mps=(ahead * cos_yaw - right * sin_yaw, ahead * sin_yaw + right * cos_yaw),
            down_mps=-up_mps,
            yaw_rad=nav.yaw_rad + self.clockwise if abs(self.clockwise) > 0.05 else None,
        )
