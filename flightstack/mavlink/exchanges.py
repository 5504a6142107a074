"""One question to the autopilot and its answer, repeated until it comes: a command, a parameter, a mode.

An exchange owns its time-outs but no clock: `step` is called every tick with the time and returns what to send.
A MAVLink command is sent again after 0.5 s, four times, with a growing `confirmation` (MAVLink command protocol).
"""

from __future__ import annotations

import enum
import math
import struct
from typing import Any, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.autopilot.modes import Duty, Flavour, mode_name, mode_of, set_mode_parameters
from flightstack.mavlink.telemetry import Telemetry

REPEAT_S = 0.5
REPEATS = 4
IN_PROGRESS_S = 10.0
"""How long to wait on after an answer that says that the autopilot is at it."""
MODE_CONFIRM_S = 3.0
"""The heartbeat with a new mode comes within a second or two, or three if one is lost."""

_RESULT_NAMES = {
    value: entry.name.removeprefix("MAV_RESULT_").lower().replace("_", " ")
    for value, entry in mavlink.enums["MAV_RESULT"].items()
}
_PARAM_ERRORS = {
    value: entry.name.removeprefix("MAV_PARAM_ERROR_").lower().replace("_", " ")
    for value, entry in mavlink.enums["MAV_PARAM_ERROR"].items()
}
_INTEGER_FORMATS = {
    mavlink.MAV_PARAM_TYPE_UINT8: "<Bxxx",
    mavlink.MAV_PARAM_TYPE_INT8: "<bxxx",
    mavlink.MAV_PARAM_TYPE_UINT16: "<Hxx",
    mavlink.MAV_PARAM_TYPE_INT16: "<hxx",
    mavlink.MAV_PARAM_TYPE_UINT32: "<I",
    mavlink.MAV_PARAM_TYPE_INT32: "<i",
}
SINGLE_PRECISION = 1e-6
"""Relative rounding of a 4-byte float on the wire, and of what autopilots make of it."""


class Answer(enum.Enum):
    PENDING = "pending"
    ACCEPTED = "accepted"
    REFUSED = "refused"
    SILENCE = "silence"
    """Repeated as often as the protocol says, and no answer."""


class Exchange(Protocol):
    """What the three kinds have in common."""

    answer: Answer
    reason: str

    def step(self, now_s: float, vehicle: Telemetry) -> list[Any]: ...


def command_long(
    vehicle: Telemetry, command: int, parameters: tuple[float, ...], confirmation: int = 0
) -> Any:
    """COMMAND_LONG to the autopilot; parameters that are not given are NaN for PX4 and 0 for ArduPilot."""
    unset = math.nan if vehicle.flavour is Flavour.PX4 else 0.0
    filled = (*parameters, *(unset,) * (7 - len(parameters)))
    return mavlink.MAVLink_command_long_message(
        vehicle.system, vehicle.component, command, confirmation, *filled
    )


class CommandExchange:
    """A COMMAND_LONG until its COMMAND_ACK."""

    def __init__(self, command: int, parameters: tuple[float, ...] = ()) -> None:
        self.command = command
        self.answer = Answer.PENDING
        self.reason = ""
        self._parameters = parameters
        self._sent = 0
        self._next_s = -math.inf

    def step(self, now_s: float, vehicle: Telemetry) -> list[Any]:
        if self.answer is not Answer.PENDING or now_s < self._next_s:
            return []
        if self._sent > REPEATS:
            self.answer = Answer.SILENCE
            self.reason = f"no answer to command {self.command}, sent {self._sent} times"
            return []
        message = command_long(vehicle, self.command, self._parameters, self._sent)
        self._sent += 1
        self._next_s = now_s + REPEAT_S
        return [message]

    def acknowledge(self, now_s: float, command: int, result: int) -> None:
        """A COMMAND_ACK to us has come."""
        if command != self.command or self._sent == 0 or self.answer is not Answer.PENDING:
            return
        if result == mavlink.MAV_RESULT_IN_PROGRESS:
            self._next_s = now_s + IN_PROGRESS_S
        elif result == mavlink.MAV_RESULT_ACCEPTED:
            self.answer = Answer.ACCEPTED
        else:
            self.answer = Answer.REFUSED
            self.reason = f"command {command} {_RESULT_NAMES.get(result, f'result {result}')}"


class ParameterExchange:
    """Sets one parameter and reads it back; one that has its value already is not written again."""

    def __init__(self, name: str, value: float) -> None:
        self.name = name
        self.answer = Answer.PENDING
        self.reason = ""
        self._value = value
        self._type: int | None = None
        self._found: float | None = None
        self._sent = 0
        self._next_s = -math.inf

    def step(self, now_s: float, vehicle: Telemetry) -> list[Any]:
        if self.answer is not Answer.PENDING or now_s < self._next_s:
            return []
        if self._sent > REPEATS:
            self._give_up()
            return []
        self._sent += 1
        self._next_s = now_s + REPEAT_S
        name = self.name.encode("ascii", "replace")
        if self._type is None:
            return [mavlink.MAVLink_param_request_read_message(vehicle.system, vehicle.component, name, -1)]
        value = _encode(vehicle.flavour, self._type, self._value)
        return [mavlink.MAVLink_param_set_message(vehicle.system, vehicle.component, name, value, self._type)]

    def value(self, flavour: Flavour, message: Any) -> None:
        """A PARAM_VALUE has come."""
        if message.param_id != self.name or self.answer is not Answer.PENDING:
            return
        kind: int = message.param_type
        self._found = _decode(flavour, kind, message.param_value)
        if kind in _INTEGER_FORMATS and not _fits(kind, self._value):
            self.answer, self.reason = (
                Answer.REFUSED,
                f"{self.name} is an integer and cannot be {self._value:g}",
            )
        elif math.isclose(self._found, self._value, rel_tol=SINGLE_PRECISION, abs_tol=1e-7):
            self.answer = Answer.ACCEPTED
        elif self._type is None:
            self._type = kind
            self._sent, self._next_s = 0, -math.inf

    def error(self, message: Any) -> None:
        """A PARAM_ERROR has come."""
        if message.param_id == self.name and self.answer is Answer.PENDING:
            told = _PARAM_ERRORS.get(message.error, f"error {message.error}")
            self.answer, self.reason = Answer.REFUSED, f"{self.name}: {told}"

    def _give_up(self) -> None:
        if self._found is None:
            self.answer = Answer.SILENCE
            self.reason = f"{self.name} does not answer: does this autopilot have it?"
        else:
            self.answer = Answer.REFUSED
            self.reason = f"{self.name} stays {self._found:g}, it should be {self._value:g}"


def _fits(kind: int, value: float) -> bool:
    if value != math.floor(value):
        return False
    try:
        struct.pack(_INTEGER_FORMATS[kind], int(value))
    except struct.error:
        return False
    return True


def _encode(flavour: Flavour, kind: int, value: float) -> float:
    """PX4 sends the bytes of integers in the float's place, ArduPilot a float of the same value."""
    if flavour is Flavour.PX4 and kind in _INTEGER_FORMATS:
        (as_float,) = struct.unpack("<f", struct.pack(_INTEGER_FORMATS[kind], int(value)))
        return float(as_float)
    return value


def _decode(flavour: Flavour, kind: int, value: float) -> float:
    if flavour is Flavour.PX4 and kind in _INTEGER_FORMATS:
        (number,) = struct.unpack(_INTEGER_FORMATS[kind], struct.pack("<f", value))
        return float(number)
    return value


class ModeExchange:
    """Asks for the mode that does a duty until the heartbeat shows it: an acknowledgement alone proves nothing."""

    ROUNDS = 3

    def __init__(self, duty: Duty) -> None:
        self.duty = duty
        self.answer = Answer.PENDING
        self.reason = ""
        self._round = 0
        self._command: CommandExchange | None = None
        self._wait_until_s: float | None = None

    def step(self, now_s: float, vehicle: Telemetry) -> list[Any]:
        if self.answer is not Answer.PENDING:
            return []
        mode = mode_of(vehicle.flavour, self.duty)
        if vehicle.custom_mode == mode:
            self.answer = Answer.ACCEPTED
            return []
        if self._command is None:
            self._command = self._ask(vehicle.flavour, mode)
        sent = self._command.step(now_s, vehicle)
        if sent:
            vehicle.authority.expect(now_s, mode)
        answer = self._command.answer
        if answer is Answer.PENDING:
            return sent
        if self._wait_until_s is None:
            # Also after silence or a refusal: an answer may be lost or belong to an earlier request.
            patience_s = MODE_CONFIRM_S if answer is Answer.ACCEPTED else REPEAT_S
            self._wait_until_s = now_s + patience_s
        elif now_s >= self._wait_until_s:
            self._next_round(vehicle.flavour, mode)
        return sent

    def acknowledge(self, now_s: float, command: int, result: int) -> None:
        if self._command is not None:
            self._command.acknowledge(now_s, command, result)

    def _ask(self, flavour: Flavour, mode: int) -> CommandExchange:
        """Landing and returning have commands of their own; the second round asks the other way."""
        first = self._round % 2 == 0
        if self.duty is Duty.LAND and first:
            return CommandExchange(mavlink.MAV_CMD_NAV_LAND)
        if self.duty is Duty.RETURN and not first:
            return CommandExchange(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
        return CommandExchange(mavlink.MAV_CMD_DO_SET_MODE, set_mode_parameters(flavour, mode))

    def _next_round(self, flavour: Flavour, mode: int) -> None:
        command, self._command, self._wait_until_s = self._command, None, None
        self._round += 1
        if self._round < self.ROUNDS or command is None:
            return
        name = mode_name(flavour, mode)
        if command.answer is Answer.ACCEPTED:
            self.answer, self.reason = Answer.REFUSED, f"mode {name} was accepted but did not come"
        else:
            self.answer, self.reason = command.answer, f"mode {name}: {command.reason}"
