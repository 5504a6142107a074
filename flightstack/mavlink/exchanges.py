"""One question to an autopilot and its answer, repeated until it comes: a command, a parameter.

An exchange owns its time-outs but no clock: `step` is called every tick with the time and returns what to send.
A MAVLink command is sent again after 0.5 s, four times, with a growing `confirmation` (MAVLink command protocol).
"""

from __future__ import annotations

import enum
import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.commands import command_long, result_name
from flightstack.mavlink.modes import Flavour
from flightstack.mavlink.parameter_values import decode, encode, is_same, number_text, value_problem
from flightstack.mavlink.vehicle_state import VehicleState

REPEAT_S = 0.5
REPEATS = 4
_SETS = 3
"""How often a parameter is set that answers with another value each time."""
IN_PROGRESS_S = 10.0
"""How long to wait on after an answer that says that the autopilot is at it."""

_PARAM_ERRORS = {
    value: entry.name.removeprefix("MAV_PARAM_ERROR_").lower().replace("_", " ")
    for value, entry in mavlink.enums["MAV_PARAM_ERROR"].items()
}


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


class ParameterQuery:
    """Reads one parameter."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.answer = Answer.PENDING
        self.reason = ""
        self.kind: int | None = None
        """MAV_PARAM_TYPE, as the vehicle declares it."""
        self.found = math.nan
        self._sent = 0
        self._next_s = -math.inf

    def step(self, now_s: float, vehicle: VehicleState) -> list[Any]:
        if self.answer is not Answer.PENDING or now_s < self._next_s:
            return []
        if self._sent > REPEATS:
            self.answer = Answer.SILENCE
            self.reason = f"{self.name} does not answer: does this autopilot have it?"
            return []
        self._sent += 1
        self._next_s = now_s + REPEAT_S
        return [_request(vehicle, self.name)]

    def value(self, flavour: Flavour, fields: Any) -> None:
        """A PARAM_VALUE with these fields has come."""
        if fields.param_id == self.name and self.answer is Answer.PENDING:
            self.kind = fields.param_type
            self.found = decode(flavour, fields.param_type, fields.param_value)
            self.answer = Answer.ACCEPTED

    def error(self, fields: Any) -> None:
        """A PARAM_ERROR with these fields has come."""
        if fields.param_id == self.name and self.answer is Answer.PENDING:
            self.answer, self.reason = Answer.REFUSED, f"{self.name}: {_error(fields)}"


class _Stage(enum.Enum):
    """What a `ParameterExchange` waits for."""

    READ = "read"
    """Which type it has, and whether it has the value already."""
    SET = "set"
    CONFIRM = "confirm"
    """The answer told another value: ArduPilot may tell a default in the value's place."""


class ParameterExchange:
    """Sets one parameter and reads it back; one that has its value already is not written again.

    A value that the vehicle's own type does not take is never sent. Which type an answer to PARAM_SET has does not
    matter: ArduPilot tells integers of a group that are set to their default as REAL32.
    """

    def __init__(self, name: str, value: float) -> None:
        self.name = name
        self.answer = Answer.PENDING
        self.reason = ""
        self.is_impossible = False
        """Refused by ourselves, before anything was sent."""
        self.written = False
        """Whether it had to be set."""
        self.kind: int | None = None
        """MAV_PARAM_TYPE, as the vehicle declares it."""
        self.found: float | None = None
        """What the vehicle told last."""
        self._value = value
        self._step = _Stage.READ
        self._sets = 0
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
        if self._step is not _Stage.SET or self.kind is None:
            return [_request(vehicle, self.name)]
        self._sets += 1
        self.written = True
        value = encode(vehicle.flavour, self.kind, self._value)
        name = self.name.encode("ascii", "replace")
        return [mavlink.MAVLink_param_set_message(vehicle.system, vehicle.component, name, value, self.kind)]

    def value(self, flavour: Flavour, fields: Any) -> None:
        """A PARAM_VALUE with these fields has come."""
        if fields.param_id != self.name or self.answer is not Answer.PENDING:
            return
        self.found = decode(flavour, fields.param_type, fields.param_value)
        if self.kind is None:
            self.kind = int(fields.param_type)
            problem = value_problem(flavour, self.kind, self._value)
            if problem is not None:
                self.is_impossible = True
                self._refuse(f"{self.name} {problem}; it stays {number_text(self.found)}")
                return
        if is_same(self.kind, self.found, self._value):
            self.answer = Answer.ACCEPTED
        elif self._step is not _Stage.CONFIRM:
            self._go_to(_Stage.SET if self._step is _Stage.READ else _Stage.CONFIRM)
        elif self._sets < _SETS:
            self._go_to(_Stage.SET)  # the answer may have been older than our setting, which may be lost
        else:
            self._give_up()

    def error(self, fields: Any) -> None:
        """A PARAM_ERROR with these fields has come."""
        if fields.param_id == self.name and self.answer is Answer.PENDING:
            stays = "" if self.found is None else f"; it stays {number_text(self.found)}"
            self._refuse(f"{self.name}: {_error(fields)}{stays}")

    def _go_to(self, step: _Stage) -> None:
        self._step, self._sent, self._next_s = step, 0, -math.inf

    def _refuse(self, reason: str) -> None:
        self.answer, self.reason = Answer.REFUSED, reason

    def _give_up(self) -> None:
        if self.found is None:
            self.answer = Answer.SILENCE
            self.reason = f"{self.name} does not answer: does this autopilot have it?"
        else:
            found, wanted = number_text(self.found), number_text(self._value)
            self._refuse(f"{self.name} is {found} now, it should be {wanted}")


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
        return [_request(vehicle, name) for name in self._open]

    def value(self, flavour: Flavour, fields: Any) -> None:
        """A PARAM_VALUE with these fields has come."""
        if fields.param_id in self._open:
            self._open.remove(fields.param_id)
            self.values[fields.param_id] = decode(flavour, fields.param_type, fields.param_value)

    def error(self, fields: Any) -> None:
        """A PARAM_ERROR with these fields has come: this autopilot does not have it."""
        if fields.param_id in self._open:
            self._open.remove(fields.param_id)


def _request(vehicle: VehicleState, name: str) -> Any:
    by_name = -1
    return mavlink.MAVLink_param_request_read_message(
        vehicle.system, vehicle.component, name.encode("ascii", "replace"), by_name
    )


def _error(fields: Any) -> str:
    text: str = _PARAM_ERRORS.get(fields.error, f"error {fields.error}")
    return text
