"""The request that brings an armed vehicle up to its height."""

from __future__ import annotations

import enum
import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.autopilot.requests import TEXTS_AFTER_S, Position, Request, RequestKind, RequestOutcome
from flightstack.autopilot.telemetry import Telemetry
from flightstack.mavlink.exchanges import Answer, CommandExchange
from flightstack.mavlink.modes import Flavour
from mission.geometry.frames import LocalFrame, Vector3

LIFT_OFF_S = 15.0
"""Motors take seconds to spin up; ArduCopter disarms by itself after 10 s on the ground."""
CLIMB_STALLED_S = 15.0
CLIMB_PROGRESS_M = 0.3
TAKEOFF_TOLERANCE_M = 1.0
LEAST_CLIMB_M = 0.5


class TakeoffStep(enum.Enum):
    COMMAND = "command"
    REASONS = "reasons"
    CLIMB = "climb"


class Takeoff(Request):
    """Up to a height over the origin of the swarm's frame, where the vehicle stands.

    ArduPilot climbs by itself after NAV_TAKEOFF in GUIDED and takes no targets before it is up. PX4 climbs in
    Offboard towards a point above: the mode stays ours, so that a pilot's takeover is seen as in flight, nothing
    is written to MIS_TAKEOFF_ALT, and PX4's own Offboard failsafe acts if this computer dies on the way up.
    """

    kind = RequestKind.TAKEOFF
    needs_vehicle = True

    def __init__(self, now_s: float, vehicle: Telemetry, frame: LocalFrame, above_home_m: float) -> None:
        super().__init__(now_s, vehicle)
        self.above_home_m = above_home_m
        self._frame = frame
        self._step = TakeoffStep.COMMAND
        self._command: CommandExchange | None = None
        self._until_s = math.inf
        self._best_m = -math.inf
        self._best_s = now_s

    @property
    def step_name(self) -> str:
        return self._step.value

    def same_as(self, other: Request) -> bool:
        return isinstance(other, Takeoff) and other.above_home_m == self.above_home_m

    def _go_on(self, now_s: float, vehicle: Telemetry) -> list[Any]:
        position_ned_m = vehicle.position_ned_m
        if not vehicle.armed:
            why = "disarmed while taking off" if self._command is not None else "not armed"
            self.end(now_s, RequestOutcome.REFUSED, "; ".join((why, *self._texts)))
        elif not vehicle.is_ours:
            self.end(now_s, RequestOutcome.REFUSED, "the vehicle is not in our mode: take control first")
        elif position_ned_m is None:
            self.end(now_s, RequestOutcome.REFUSED, "no position")
        elif self._is_up(now_s, vehicle, position_ned_m):
            self.end(now_s, RequestOutcome.SUCCEEDED)
        elif self._step is TakeoffStep.COMMAND:
            return self._lifting_off(now_s, vehicle, position_ned_m)
        elif self._step is TakeoffStep.REASONS:
            # ArduCopter refuses a repeated take-off while it carries out the first one.
            if vehicle.has_flown:
                self._begin_climb(now_s, vehicle, position_ned_m)
            elif now_s >= self._until_s and self._command is not None:
                self.fail(now_s, self._command.answer, self._command.reason)
        else:
            self._climbing(now_s, vehicle, position_ned_m)
        return []

    def _is_up(self, now_s: float, vehicle: Telemetry, position_ned_m: Vector3) -> bool:
        tolerance_m = min(TAKEOFF_TOLERANCE_M, 0.3 * self.above_home_m)
        return vehicle.is_airborne(now_s) and -position_ned_m[2] > self.above_home_m - tolerance_m

    def _lifting_off(self, now_s: float, vehicle: Telemetry, position_ned_m: Vector3) -> list[Any]:
        point_ned_m = (position_ned_m[0], position_ned_m[1], -self.above_home_m)
        if vehicle.is_airborne(now_s):
            self._begin_climb(now_s, vehicle, point_ned_m)
            return []
        if vehicle.home is None:
            self.end(now_s, RequestOutcome.REFUSED, "home is not set: its altitude is not known")
            return []
        climb_m = self._frame.to_geodetic(point_ned_m).amsl_m - vehicle.home.amsl_m
        if climb_m < LEAST_CLIMB_M:
            self.end(
                now_s,
                RequestOutcome.REFUSED,
                f"{self.above_home_m:.1f} m over the swarm's origin is {climb_m:.1f} m over this drone's home: "
                "raise formation.above_home_m or correct origin.amsl_m",
            )
            return []
        if vehicle.flavour is Flavour.PX4:
            self._begin_climb(now_s, vehicle, point_ned_m)
            return []
        if self._command is None:
            unset = (0.0,) * 6
            self._command = CommandExchange(mavlink.MAV_CMD_NAV_TAKEOFF, (*unset, climb_m))
        sent = self._command.step(now_s, vehicle)
        if self._command.answer is Answer.ACCEPTED:
            self._begin_climb(now_s, vehicle, point_ned_m)
        elif self._command.answer is not Answer.PENDING:
            self._step, self._until_s = TakeoffStep.REASONS, now_s + TEXTS_AFTER_S
        return sent

    def _begin_climb(self, now_s: float, vehicle: Telemetry, point_ned_m: Vector3) -> None:
        if vehicle.flavour is Flavour.PX4:
            self.target = Position(point_ned_m)
        self._step = TakeoffStep.CLIMB
        self._best_s = now_s

    def _climbing(self, now_s: float, vehicle: Telemetry, position_ned_m: Vector3) -> None:
        height_m = -position_ned_m[2]
        if height_m > self._best_m + CLIMB_PROGRESS_M:
            self._best_m, self._best_s = height_m, now_s
        patience_s = CLIMB_STALLED_S if vehicle.has_flown else LIFT_OFF_S
        if now_s - self._best_s > patience_s:
            state = f"stopped at {height_m:.1f} m" if vehicle.has_flown else "it did not lift off"
            self.end(now_s, RequestOutcome.TIMED_OUT, "; ".join((f"take-off: {state}", *self._texts)))

    def acknowledge(self, now_s: float, command: int, result: int) -> None:
        if self._command is not None:
            self._command.acknowledge(now_s, command, result)
