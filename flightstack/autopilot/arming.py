"""The request that starts the motors: parameters, readiness, mode, command, and again where it is refused."""

from __future__ import annotations

import enum
import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.autopilot.mode_exchange import ModeExchange
from flightstack.autopilot.precautions import Precautions
from flightstack.autopilot.requests import (
    ARMED_WITHIN_S,
    PRESS_DOWN,
    STREAM_BEFORE_OFFBOARD_S,
    TEXTS_AFTER_S,
    Prepare,
    Request,
    RequestKind,
    RequestOutcome,
)
from flightstack.autopilot.telemetry import Telemetry
from flightstack.mavlink.commands import command_long
from flightstack.mavlink.exchanges import Answer, CommandExchange
from flightstack.mavlink.modes import Duty, Flavour, mode_of

ARM_AGAIN_S = 2.0
REPORT_AGAIN_S = 5.0
"""How soon PX4 is asked again what keeps it from arming, where it has not told."""


class ArmStep(enum.Enum):
    PREPARE = "prepare"
    LOOK = "look"
    READY = "ready"
    MODE = "mode"
    ARM = "arm"
    REASONS = "reasons"
    CONFIRM = "confirm"


class Arm(Request):
    """Parameters, precautions, readiness, mode, motors. A refusal is tried again until the configured time is up."""

    kind = RequestKind.ARM
    needs_vehicle = True

    def __init__(
        self,
        now_s: float,
        vehicle: Telemetry,
        prepare: Prepare | None,
        precautions: Precautions,
        ready_timeout_s: float,
    ) -> None:
        super().__init__(now_s, vehicle)
        self.precautions = precautions
        self.prepare = prepare
        """None: the parameters are as they should be."""
        self._ready_timeout_s = ready_timeout_s
        self._step = ArmStep.LOOK if prepare is None else ArmStep.PREPARE
        self._until_s = now_s + STREAM_BEFORE_OFFBOARD_S if self._needs_stream(vehicle) else -math.inf
        self._asked = False
        self._report_asked_s = -math.inf
        self._mode = ModeExchange(Duty.CONTROL)
        self._command = CommandExchange(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (1.0,))

    @property
    def step_name(self) -> str:
        return self._step.value

    def is_reached(self, vehicle: Telemetry) -> bool:
        return vehicle.armed and vehicle.is_ours

    @staticmethod
    def _needs_stream(vehicle: Telemetry) -> bool:
        """PX4 wants to have seen setpoints for a while before it takes Offboard."""
        return vehicle.flavour is not Flavour.ARDUPILOT and not (vehicle.is_ours and vehicle.armed)

    def _patience_s(self) -> float:
        return self._ready_timeout_s

    def _go_on(self, now_s: float, vehicle: Telemetry) -> list[Any]:
        if vehicle.armed:
            self._armed(now_s, vehicle)
            return []
        if now_s - self.started_s > self._ready_timeout_s:
            why = vehicle.unready_reason(now_s) or self.complaint or "the autopilot gave no reason"
            self.end(
                now_s, RequestOutcome.TIMED_OUT, f"not armed within {self._ready_timeout_s:.0f} s: {why}"
            )
            return []
        if vehicle.flavour is Flavour.PX4:
            self.target = PRESS_DOWN
        match self._step:
            case ArmStep.PREPARE:
                return self._preparing(now_s, vehicle)
            case ArmStep.LOOK:
                return self._looking(now_s, vehicle)
            case ArmStep.READY:
                if now_s >= self._until_s and not vehicle.unready_reason(now_s):
                    self._mode, self._step = ModeExchange(Duty.CONTROL), ArmStep.MODE
                    return []
                return self._asking_why(now_s, vehicle)
            case ArmStep.MODE:
                return self._choosing_mode(now_s, vehicle)
            case ArmStep.ARM:
                return self._arming(now_s, vehicle)
            case ArmStep.REASONS:
                if now_s >= self._until_s:
                    self._try_again(now_s, vehicle, self._command.reason)
            case ArmStep.CONFIRM:
                if now_s >= self._until_s:
                    self._try_again(now_s, vehicle, "arming was accepted but did not come")
        return []

    def _armed(self, now_s: float, vehicle: Telemetry) -> None:
        if vehicle.is_ours or self._asked:
            self.end(now_s, RequestOutcome.SUCCEEDED)
        else:
            self.end(now_s, RequestOutcome.REFUSED, "somebody else armed the vehicle and has it")

    def _preparing(self, now_s: float, vehicle: Telemetry) -> list[Any]:
        if self.prepare is None:
            return []
        sent = self.prepare.step(now_s, vehicle)
        result = self.prepare.result
        if result is not None and result.outcome is not RequestOutcome.SUCCEEDED:
            self.end(now_s, result.outcome, result.reason)
        elif result is not None:
            self._step = ArmStep.LOOK
        return sent

    def _looking(self, now_s: float, vehicle: Telemetry) -> list[Any]:
        sent = self.precautions.step(now_s, vehicle)
        if self.precautions.refusal:
            self.end(now_s, RequestOutcome.REFUSED, self.precautions.refusal)
        elif self.precautions.is_done(vehicle):
            self._step = ArmStep.READY
        return sent

    def _asking_why(self, now_s: float, vehicle: Telemetry, *, again: bool = False) -> list[Any]:
        """PX4 reports on its checks when they change, which may have been before we listened, and when asked."""
        known = vehicle.events.can_arm_modes is not None and not again
        if vehicle.flavour is not Flavour.PX4 or known or now_s - self._report_asked_s < REPORT_AGAIN_S:
            return []
        self._report_asked_s = now_s
        return [command_long(vehicle, mavlink.MAV_CMD_RUN_PREARM_CHECKS, ())]

    def _choosing_mode(self, now_s: float, vehicle: Telemetry) -> list[Any]:
        sent = self._mode.step(now_s, vehicle)
        if self._mode.answer is Answer.ACCEPTED:
            self._texts.clear()
            self._command = CommandExchange(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (1.0,))
            self._step = ArmStep.ARM
        elif self._mode.answer is not Answer.PENDING:
            self._try_again(now_s, vehicle, self._mode.reason)
        return sent

    def _arming(self, now_s: float, vehicle: Telemetry) -> list[Any]:
        sent = self._command.step(now_s, vehicle)
        self._asked = self._asked or bool(sent)
        match self._command.answer:
            case Answer.ACCEPTED:
                self._step, self._until_s = ArmStep.CONFIRM, now_s + ARMED_WITHIN_S
            case Answer.REFUSED | Answer.SILENCE:
                self._step, self._until_s = ArmStep.REASONS, now_s + TEXTS_AFTER_S
                return [*sent, *self._asking_why(now_s, vehicle, again=True)]
            case Answer.PENDING:
                pass
        return sent

    def _try_again(self, now_s: float, vehicle: Telemetry, reason: str) -> None:
        checks: list[str] = []
        if vehicle.flavour is Flavour.PX4:
            checks = vehicle.events.why_not_arm(mode_of(Flavour.PX4, Duty.CONTROL), streaming=True)
        texts = dict.fromkeys([*self._texts, *checks])
        self.complaint = "arming refused: " + ("; ".join(texts) or reason)
        self._texts.clear()
        self._step, self._until_s = ArmStep.READY, now_s + ARM_AGAIN_S

    def acknowledge(self, now_s: float, command: int, result: int) -> None:
        self._mode.acknowledge(now_s, command, result)
        self._command.acknowledge(now_s, command, result)

    def parameter(self, vehicle: Telemetry, fields: Any) -> None:
        if self._step is ArmStep.LOOK:
            self.precautions.parameter(vehicle, fields)
        elif self.prepare is not None:
            self.prepare.parameter(vehicle, fields)

    def parameter_error(self, fields: Any) -> None:
        if self._step is ArmStep.LOOK:
            self.precautions.parameter_error(fields)
        elif self.prepare is not None:
            self.prepare.parameter_error(fields)
