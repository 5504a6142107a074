"""One question to an autopilot and its answer, repeated until it comes: a command, a parameter.

An exchange owns its time-outs but no clock: `step` is called every tick with the time and returns what to send.
A MAVLink command is sent again after 0.5 s, four times, with a growing `confirmation` (MAVLink command protocol).
"""

from __future__ import annotations

import enum
import math
import struct
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.commands import command_long, result_name
from flightstack.mavlink.modes import Flavour
from flightstack.mavlink.vehicle_state import VehicleState

REPEAT_S = 0.5
REPEATS = 4
IN_PROGRESS_S = 10.0
"""How long to wait on after an answer that says that the autopilot is at it."""

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


class CommandExchange:
    """A COMMAND_LONG until its COMMAND_ACK."""

    def __init__(self, command: int, parameters: tuple[float, ...] = ()) -> None:
        self.command = command
        self.answer = Answer.PENDING
        self.reason = ""
        self._parameters = parameters
        self._sent = 0
        self._next_s = -math.inf

    def step(self, now_s: float, vehicle: VehicleState) -> list[Any]:
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
            self.reason = f"command {command} {result_name(result)}"


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

    def step(self, now_s: float, vehicle: VehicleState) -> list[Any]:
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

    def value(self, flavour: Flavour, fields: Any) -> None:
        """A PARAM_VALUE with these fields has come."""
        if fields.param_id != self.name or self.answer is not Answer.PENDING:
            return
        kind: int = fields.param_type
        self._found = _decode(flavour, kind, fields.param_value)
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

    def error(self, fields: Any) -> None:
        """A PARAM_ERROR with these fields has come."""
        if fields.param_id == self.name and self.answer is Answer.PENDING:
            told = _PARAM_ERRORS.get(fields.error, f"error {fields.error}")
            self.answer, self.reason = Answer.REFUSED, f"{self.name}: {told}"

    def _give_up(self) -> None:
        if self._found is None:
            self.answer = Answer.SILENCE
            self.reason = f"{self.name} does not answer: does this autopilot have it?"
        else:
            self.answer = Answer.REFUSED
            self.reason = f"{self.name} stays {self._found:g}, it should be {self._value:g}"


class ParameterReading:
    """Asks for parameters by name, all at once, until each has come or was asked for often enough."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self.values: dict[str, float] = {}
        self._open = list(names)
        self._sent = 0
        self._next_s = -math.inf

    @property
    def done(self) -> bool:
        return not self._open or self._sent > REPEATS

    @property
    def missing(self) -> tuple[str, ...]:
        """What has not come."""
        return tuple(self._open)

    def step(self, now_s: float, vehicle: VehicleState) -> list[Any]:
        if self.done or now_s < self._next_s:
            return []
        self._sent += 1
        self._next_s = now_s + REPEAT_S
        if self._sent > REPEATS:
            return []
        target = vehicle.system, vehicle.component
        return [
            mavlink.MAVLink_param_request_read_message(*target, name.encode("ascii"), -1)
            for name in self._open
        ]

    def value(self, flavour: Flavour, fields: Any) -> None:
        """A PARAM_VALUE with these fields has come."""
        if fields.param_id in self._open:
            self._open.remove(fields.param_id)
            self.values[fields.param_id] = _decode(flavour, fields.param_type, fields.param_value)

    def error(self, fields: Any) -> None:
        """A PARAM_ERROR with these fields has come: this autopilot does not have it."""
        if fields.param_id in self._open:
            self._open.remove(fields.param_id)


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
