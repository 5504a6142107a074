"""What the agent can ask of the vehicle: each request is one small object with a step, and ends in one result.

A request never raises: what the autopilot refuses, does not answer or does not do is the result's outcome, and its
reason is in the autopilot's own words where it gave any. A request that wants the vehicle (arm, take off, take
control) ends as soon as a mode comes that it did not ask for.
"""

from __future__ import annotations

import enum
from typing import Any

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.autopilot.mode_exchange import ModeExchange
from flightstack.autopilot.telemetry import Telemetry
from flightstack.mavlink.exchanges import Answer, CommandExchange, ParameterExchange
from flightstack.mavlink.modes import Duty, Flavour
from mission.geometry.frames import Vector3

TEXTS_AFTER_S = 1.0
"""ArduPilot's reasons follow its refusal: that long is listened for them."""
WARNING = mavlink.MAV_SEVERITY_WARNING
ARMED_WITHIN_S = 3.0
"""The heartbeat tells it, at the latest the third one after the acknowledgement."""
ANSWER_S = 10.0
"""How long a request waits for an autopilot that is not connected."""
PRESS_DOWN_MPS = 0.5
STREAM_BEFORE_OFFBOARD_S = 1.0
"""PX4 takes the Offboard mode only after it has seen setpoints at 2 Hz or more for about a second."""


RENAMED = {
    "RTL_ALT": "RTL_ALT_M, in metres",
    "SYSID_THISMAV": "MAV_SYSID",
    "SYSID_MYGCS": "MAV_GCS_SYSID",
}
"""Parameters that an ArduCopter of today may know under another name only."""


class RequestKind(enum.StrEnum):
    PREPARE = "prepare"
    ARM = "arm"
    TAKEOFF = "takeoff"
    TAKE_CONTROL = "take_control"
    HOLD = "hold"
    LAND = "land"
    RETURN = "return"
    DISARM = "disarm"


class RequestOutcome(enum.StrEnum):
    SUCCEEDED = "succeeded"
    REFUSED = "refused"
    """The autopilot said no, or the request makes no sense in this state."""
    NO_ANSWER = "no_answer"
    TIMED_OUT = "timed_out"
    """Accepted, but it did not happen; or never ready within the configured time."""
    TAKEN = "taken"
    """A pilot or a failsafe took the vehicle meanwhile."""
    LAPSED = "lapsed"
    """Not asked for any more."""
    SUPERSEDED = "superseded"
    """Another request took its place."""


class RequestResult(msgspec.Struct, frozen=True):
    kind: RequestKind
    outcome: RequestOutcome
    reason: str
    """Why it failed, in one line; empty where it succeeded."""
    took_s: float


class Position(msgspec.Struct, frozen=True):
    """A point of the swarm's frame to fly to."""

    position_ned_m: Vector3
    yaw_rad: float | None = None


class VelocityRequest(msgspec.Struct, frozen=True):
    velocity_ned_mps: Vector3
    yaw_rad: float | None = None


Target = Position | VelocityRequest
PRESS_DOWN = VelocityRequest((0.0, 0.0, PRESS_DOWN_MPS))
"""What PX4 gets in Offboard on the ground: a point at the present height may read as a wish to climb."""


class Request:
    """The part that all requests share: the end, the texts, the loss of authority."""

    kind: RequestKind
    needs_vehicle = False
    """Ends when somebody takes the vehicle, and lapses when it is not asked for any more."""
    needs_answers = True
    """Waits while nothing is heard of the autopilot."""

    def __init__(self, now_s: float, vehicle: Telemetry) -> None:
        self.started_s = now_s
        self.result: RequestResult | None = None
        self.target: Target | None = None
        """What the vehicle must be told every tick while this request runs and the agent says nothing."""
        self.complaint = ""
        """What the autopilot said against it so far."""
        self._texts: list[str] = []
        self._takeovers = vehicle.authority.takeovers

    @property
    def step_name(self) -> str:
        return "running"

    def same_as(self, other: Request) -> bool:
        return self.kind is other.kind

    def is_reached(self, vehicle: Telemetry) -> bool:  # noqa: ARG002 (most cannot tell without going on)
        """Whether what was asked for is so already, although the request has not seen it yet."""
        return False

    def step(self, now_s: float, vehicle: Telemetry) -> list[Any]:
        """Go on; returns the messages to send now."""
        if self.result is not None:
            return []
        # Landing and returning go out blind when only the way back is dead; nothing else does.
        blind = not vehicle.is_connected(now_s) and self.needs_answers
        if blind or vehicle.flavour is Flavour.UNKNOWN:
            if now_s - self.started_s > self._patience_s():
                self.end(now_s, RequestOutcome.NO_ANSWER, vehicle.unready_reason(now_s))
            return []
        if self.needs_vehicle and vehicle.authority.takeovers != self._takeovers:
            self.end(now_s, RequestOutcome.TAKEN, vehicle.authority.taken_reason)
            return []
        return self._go_on(now_s, vehicle)

    def _patience_s(self) -> float:
        return ANSWER_S

    def _go_on(self, now_s: float, vehicle: Telemetry) -> list[Any]:
        raise NotImplementedError

    def end(self, now_s: float, outcome: RequestOutcome, reason: str = "") -> None:
        if self.result is None:
            self.result = RequestResult(self.kind, outcome, reason, now_s - self.started_s)

    def fail(self, now_s: float, answer: Answer, reason: str) -> None:
        """End by an exchange that was refused or not answered; the autopilot's texts say why."""
        outcome = RequestOutcome.NO_ANSWER if answer is Answer.SILENCE else RequestOutcome.REFUSED
        self.end(now_s, outcome, "; ".join(self._texts) or reason)

    def text(self, severity: int, text: str) -> None:
        if severity <= WARNING and text not in self._texts:
            self._texts.append(text)

    def acknowledge(self, now_s: float, command: int, result: int) -> None:
        """A COMMAND_ACK to us has come."""

    def parameter(self, vehicle: Telemetry, fields: Any) -> None:
        """A PARAM_VALUE with these fields has come."""

    def parameter_error(self, fields: Any) -> None:
        """A PARAM_ERROR with these fields has come."""

    def mission(self, kind: int, fields: Any) -> None:
        """A message of the mission protocol to us has come."""


class Prepare(Request):
    """Sets the configured parameters one after the other and reads them back."""

    kind = RequestKind.PREPARE

    def __init__(
        self, now_s: float, vehicle: Telemetry, parameters: dict[str, float], ready_timeout_s: float
    ) -> None:
        super().__init__(now_s, vehicle)
        self._left = [ParameterExchange(name, value) for name, value in parameters.items()]
        self._failed: list[str] = []
        self._ready_timeout_s = ready_timeout_s

    @property
    def step_name(self) -> str:
        return self._left[0].name if self._left else "done"

    def _patience_s(self) -> float:
        return self._ready_timeout_s

    def _go_on(self, now_s: float, vehicle: Telemetry) -> list[Any]:
        while self._left:
            sent = self._left[0].step(now_s, vehicle)
            if self._left[0].answer is Answer.PENDING:
                return sent
            exchange = self._left.pop(0)
            if exchange.answer is not Answer.ACCEPTED:
                renamed = RENAMED.get(exchange.name) if exchange.answer is Answer.SILENCE else None
                hint = f" (from ArduPilot 4.7 it is {renamed})" if renamed else ""
                self._failed.append(exchange.reason + hint)
        if self._failed:
            self.end(now_s, RequestOutcome.REFUSED, "parameters: " + "; ".join(self._failed))
        else:
            self.end(now_s, RequestOutcome.SUCCEEDED)
        return []

    def parameter(self, vehicle: Telemetry, fields: Any) -> None:
        if self._left:
            self._left[0].value(vehicle.flavour, fields)

    def parameter_error(self, fields: Any) -> None:
        if self._left:
            self._left[0].error(fields)


class ModeRequest(Request):
    """Hold, land or return: the autopilot's own modes. They are commands and go through whoever has the vehicle."""

    def __init__(self, now_s: float, vehicle: Telemetry, kind: RequestKind, duty: Duty) -> None:
        super().__init__(now_s, vehicle)
        self.kind = kind
        self.needs_answers = False
        self._mode = ModeExchange(duty)

    def _go_on(self, now_s: float, vehicle: Telemetry) -> list[Any]:
        if not vehicle.armed and self.kind is not RequestKind.HOLD:
            self.end(now_s, RequestOutcome.SUCCEEDED)
            return []
        sent = self._mode.step(now_s, vehicle)
        if self._mode.answer is Answer.ACCEPTED:
            self.end(now_s, RequestOutcome.SUCCEEDED)
        elif self._mode.answer is not Answer.PENDING:
            self.fail(now_s, self._mode.answer, self._mode.reason)
        return sent

    def acknowledge(self, now_s: float, command: int, result: int) -> None:
        self._mode.acknowledge(now_s, command, result)


class TakeControl(Request):
    """GUIDED, or setpoints first and then OFFBOARD."""

    kind = RequestKind.TAKE_CONTROL
    needs_vehicle = True

    def __init__(self, now_s: float, vehicle: Telemetry) -> None:
        super().__init__(now_s, vehicle)
        self._mode = ModeExchange(Duty.CONTROL)
        self._streaming_since_s: float | None = None

    @property
    def step_name(self) -> str:
        return "setpoints first" if self._is_early else "mode"

    _is_early = False

    def is_reached(self, vehicle: Telemetry) -> bool:
        return vehicle.is_ours

    def _go_on(self, now_s: float, vehicle: Telemetry) -> list[Any]:
        if vehicle.flavour is Flavour.PX4 and self.target is None:
            self.target = stay(now_s, vehicle)
            if self.target is None:
                self.end(now_s, RequestOutcome.REFUSED, "no position to hold: Offboard needs one")
                return []
            self._streaming_since_s = now_s
        since_s = self._streaming_since_s
        self._is_early = since_s is not None and now_s - since_s < STREAM_BEFORE_OFFBOARD_S
        if self._is_early and not vehicle.is_ours:
            return []
        sent = self._mode.step(now_s, vehicle)
        if self._mode.answer is Answer.ACCEPTED:
            vehicle.authority.regain()
            self.end(now_s, RequestOutcome.SUCCEEDED)
        elif self._mode.answer is not Answer.PENDING:
            self.fail(now_s, self._mode.answer, self._mode.reason)
        return sent

    def acknowledge(self, now_s: float, command: int, result: int) -> None:
        self._mode.acknowledge(now_s, command, result)


def stay(now_s: float, vehicle: Telemetry) -> Target | None:
    """The target that changes nothing: the present position in the air, a press on the ground below."""
    if not vehicle.is_airborne(now_s):
        return PRESS_DOWN
    position_ned_m = vehicle.position_ned_m
    return None if position_ned_m is None else Position(position_ned_m)


class Disarm(Request):
    """Stops the motors of a vehicle on the ground. Never forced: in the air it is refused."""

    kind = RequestKind.DISARM

    def __init__(self, now_s: float, vehicle: Telemetry) -> None:
        super().__init__(now_s, vehicle)
        self._command = CommandExchange(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (0.0,))
        self._until_s: float | None = None

    def _go_on(self, now_s: float, vehicle: Telemetry) -> list[Any]:
        if not vehicle.armed:
            self.end(now_s, RequestOutcome.SUCCEEDED)
            return []
        if vehicle.is_airborne(now_s):
            self.end(now_s, RequestOutcome.REFUSED, "the vehicle is flying: land first")
            return []
        sent = self._command.step(now_s, vehicle)
        if self._command.answer is Answer.PENDING:
            return sent
        if self._until_s is None:
            accepted = self._command.answer is Answer.ACCEPTED
            self._until_s = now_s + (ARMED_WITHIN_S if accepted else TEXTS_AFTER_S)
        elif now_s >= self._until_s:
            if self._command.answer is Answer.ACCEPTED:
                self.end(now_s, RequestOutcome.TIMED_OUT, "disarming was accepted but did not come")
            else:
                self.fail(now_s, self._command.answer, self._command.reason)
        return sent

    def acknowledge(self, now_s: float, command: int, result: int) -> None:
        self._command.acknowledge(now_s, command, result)
