"""Whether the vehicle goes where its agent sends it.

An autopilot has limits of its own that it keeps without a word: ArduCopter's avoidance turns every velocity along its
own fence. So what was asked for is compared with what is flown, both smoothed over the time that a vehicle takes to
follow. Wind that is too strong and a motor that fails look the same from here; somebody has to look in any case.
"""

from __future__ import annotations

import math

from flightstack.autopilot import VehicleReport
from flightstack.flight.guard import Setpoint, VelocityTarget
from flightstack.swarm.news import Note
from flightstack.swarm.wire import Severity
from mission.geometry.frames import Vector3

FOLLOWS_WITHIN_S = 1.5
"""Time constant of the smoothing: a multirotor takes one to two seconds to a new velocity."""
LEAST_MISS_MPS = 1.0
MISS_FRACTION = 0.5
"""Of the speed that is asked for: gusts, and autopilots that climb more slowly than they are asked to, miss less."""
ASTRAY_AFTER_S = 4.0
AGAIN_BELOW_S = 1.0
KEPT_AT_MOST_S = 6.0
FORGOTTEN_TWICE_AS_SLOW = 0.5
"""A drone that is pushed to and fro flies for moments as it should."""
FRESH_S = 1.0
LONGEST_STEP_S = 0.5

GROUNDED_AFTER_S = 5.0
STILL_MPS = 0.3
ASKED_MPS = 0.3
BELOW_FLOOR_M = 0.5


class Obedience:
    """`step` once a tick; `astray` and `grounded` are its findings, in words, empty while there is nothing to say."""

    def __init__(self, floor_above_home_m: float) -> None:
        self._floor_above_home_m = floor_above_home_m
        self._last_s: float | None = None
        self._asked: Vector3 = (0.0, 0.0, 0.0)
        self._flown: Vector3 = (0.0, 0.0, 0.0)
        self._missed_s = 0.0
        """For how long it has missed, less for how long it has not."""
        self._still_since_s: float | None = None
        self.astray = ""
        self.grounded = ""
        """It stands on the ground although it was told to rise."""

    def step(self, now_s: float, setpoint: Setpoint | None, vehicle: VehicleReport) -> tuple[Note, ...]:
        """What is new, to be told once. `setpoint`: this tick's, None where the vehicle is not steered."""
        before = self.astray
        ours = setpoint is not None and vehicle.mode_ours and vehicle.armed
        position, velocity, age_s = vehicle.position_ned_m, vehicle.velocity_ned_mps, vehicle.position_age_s
        if setpoint is None or not ours or position is None or velocity is None or age_s is None:
            self._forget()
        elif age_s > FRESH_S:
            self._last_s = now_s  # nothing is known of what it flies
        else:
            # A position target is one that it is at already.
            asked = setpoint.velocity_ned_mps if isinstance(setpoint, VelocityTarget) else (0.0, 0.0, 0.0)
            self._judge(now_s, asked, velocity)
            self._look_for_the_ground(now_s, -position[2], vehicle.airborne, asked, velocity)
        if self.astray and not before:
            return (Note(Severity.WARNING, "astray", self.astray),)
        if before and ours and not self.astray:
            return (Note(Severity.INFO, "astray", "goes where it is sent again"),)
        return ()

    def _forget(self) -> None:
        self._last_s = self._still_since_s = None
        self._missed_s = 0.0
        self.astray = self.grounded = ""

    def _judge(self, now_s: float, asked: Vector3, flown: Vector3) -> None:
        if self._last_s is None:
            self._last_s, self._asked, self._flown = now_s, flown, flown
        step_s = min(now_s - self._last_s, LONGEST_STEP_S)
        self._last_s = now_s
        share = step_s / (FOLLOWS_WITHIN_S + step_s)
        self._asked, self._flown = _blend(self._asked, asked, share), _blend(self._flown, flown, share)
        miss_mps = math.dist(self._asked, self._flown)
        if miss_mps > max(LEAST_MISS_MPS, MISS_FRACTION * math.hypot(*self._asked)):
            self._missed_s = min(self._missed_s + step_s, KEPT_AT_MOST_S)
        else:
            self._missed_s = max(self._missed_s - FORGOTTEN_TWICE_AS_SLOW * step_s, 0.0)
        if self._missed_s >= ASTRAY_AFTER_S and not self.astray:
            asked_for, flies = _in_words(self._asked), _in_words(self._flown)
            self.astray = f"does not go where it is sent: asked for {asked_for}, flies {flies}"
        elif self._missed_s < AGAIN_BELOW_S:
            self.astray = ""

    def _look_for_the_ground(
        self, now_s: float, above_home_m: float, airborne: bool, asked: Vector3, flown: Vector3
    ) -> None:
        """It does not move, low or landed by its own account, while it is told to go up."""
        low = above_home_m < self._floor_above_home_m - BELOW_FLOOR_M or not airborne
        still = math.hypot(*flown) < STILL_MPS
        if not (low and still and asked[2] < -ASKED_MPS):
            self._still_since_s = None
        elif self._still_since_s is None:
            self._still_since_s = now_s
        elif now_s - self._still_since_s >= GROUNDED_AFTER_S:
            self.grounded = "stands on the ground, armed, and does not rise although it is told to"


def _blend(old: Vector3, new: Vector3, share: float) -> Vector3:
    (north, east, down), (to_north, to_east, to_down) = old, new
    return (
        north + share * (to_north - north),
        east + share * (to_east - east),
        down + share * (to_down - down),
    )


def _in_words(velocity_ned_mps: Vector3) -> str:
    north_mps, east_mps, down_mps = velocity_ned_mps
    level_mps = math.hypot(north_mps, east_mps)
    if max(level_mps, abs(down_mps)) < STILL_MPS:
        return "nothing"
    if abs(down_mps) > level_mps:
        return f"{abs(down_mps):.1f} m/s {'down' if down_mps > 0.0 else 'up'}"
    towards_deg = math.degrees(math.atan2(east_mps, north_mps)) % 360.0
    return f"{level_mps:.1f} m/s towards {towards_deg:03.0f} degrees"
