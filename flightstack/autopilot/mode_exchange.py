"""Asking the agent's autopilot for a mode until its heartbeat shows it."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.autopilot.telemetry import Telemetry
from flightstack.mavlink.exchanges import REPEAT_S, Answer, CommandExchange
from flightstack.mavlink.modes import Duty, Flavour, mode_name, mode_of, set_mode_parameters

MODE_CONFIRM_S = 3.0
"""The heartbeat with a new mode comes within a second or two, or three if one is lost."""


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
