"""What an ArduCopter does with the commands that it carries out in its own way. Each gives a MAV_RESULT."""

from __future__ import annotations

import math
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot.ardupilot_arming import ArduPilotArming
from simvehicle.autopilot.ardupilot_estimate import ArduPilotEstimate
from simvehicle.autopilot.ardupilot_fence import ArduPilotFence
from simvehicle.autopilot.ardupilot_mode_control import ArduPilotModeControl
from simvehicle.autopilot.ardupilot_modes import ArduPilotMode
from simvehicle.autopilot.commands import ACCEPTED, DENIED, FAILED, UNSUPPORTED, Execute, ReceivedCommand
from simvehicle.autopilot.flight import Flight
from simvehicle.autopilot.flight_commands import reposition_target
from simvehicle.autopilot.maneuvers import FlyTo, HoldPosition, TakeOff
from simvehicle.autopilot.mission_run import MissionRun

_INFO, _CRITICAL = mavlink.MAV_SEVERITY_INFO, mavlink.MAV_SEVERITY_CRITICAL


class ArduPilotCommands:
    def __init__(
        self,
        flight: Flight,
        estimate: ArduPilotEstimate,
        modes: ArduPilotModeControl,
        arming: ArduPilotArming,
        fence: ArduPilotFence,
        set_parameter: Callable[[str, float], None],
    ) -> None:
        self._flight = flight
        self._estimate = estimate
        self._modes = modes
        self._arming = arming
        self._fence = fence
        self._set_parameter = set_parameter

    def table(self) -> dict[int, Execute]:
        return {
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM: self._arm_disarm,
            mavlink.MAV_CMD_DO_SET_MODE: self._set_mode,
            mavlink.MAV_CMD_NAV_TAKEOFF: self._take_off,
            mavlink.MAV_CMD_NAV_LAND: lambda _: self._enter(ArduPilotMode.LAND),
            mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda _: self._enter(ArduPilotMode.RTL),
            mavlink.MAV_CMD_NAV_LOITER_UNLIM: lambda _: self._enter(ArduPilotMode.LOITER),
            mavlink.MAV_CMD_MISSION_START: self._mission_start,
            mavlink.MAV_CMD_DO_REPOSITION: self._reposition,
            mavlink.MAV_CMD_DO_CHANGE_SPEED: self._change_speed,
            mavlink.MAV_CMD_DO_PAUSE_CONTINUE: self._pause_continue,
            mavlink.MAV_CMD_DO_FENCE_ENABLE: self._fence_enable,
            mavlink.MAV_CMD_RUN_PREARM_CHECKS: self._prearm_checks,
            mavlink.MAV_CMD_DO_FLIGHTTERMINATION: self._terminate,
        }

    def _arm_disarm(self, command: ReceivedCommand) -> int:
        if command.params[0] == 1.0:
            forced = command.params[1] in (2989, 21196)
            return ACCEPTED if self._arming.try_to_arm(forced=forced) else FAILED
        if command.params[0] != 0.0:
            return UNSUPPORTED
        if not self._flight.landed and command.params[1] != 21196:
            return FAILED
        self._flight.disarm("Disarming motors", _INFO)
        return ACCEPTED

    def _set_mode(self, command: ReceivedCommand) -> int:
        if not command.whole(0) & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return DENIED
        return self._enter(command.whole(1))

    def _enter(self, mode: int) -> int:
        return ACCEPTED if self._modes.set_mode(mode) else FAILED

    def _take_off(self, command: ReceivedCommand) -> int:
        flight, above_m = self._flight, command.z
        climbs = math.isfinite(above_m) and above_m > flight.nav.above_home_m
        guided = self._modes.mode is ArduPilotMode.GUIDED
        if not (flight.armed and flight.landed and guided and climbs and self._estimate.position_ok):
            return FAILED
        self._modes.take_off(TakeOff(above_m))
        return ACCEPTED

    def _mission_start(self, _command: ReceivedCommand) -> int:
        modes = self._modes
        if not self._flight.armed or not modes.set_mode(ArduPilotMode.AUTO):
            return FAILED
        if not modes.mission_started:
            if not modes.auto_allowed():
                return FAILED
            modes.take_off(modes.start_mission())
        return ACCEPTED

    def _reposition(self, command: ReceivedCommand) -> int:
        if self._modes.mode is not ArduPilotMode.GUIDED and not command.whole(1) & 1:
            return DENIED
        target = reposition_target(command, self._flight)
        if target is None or not self._fence.allows(target[0], target[1]):
            return DENIED
        if not self._flight.armed or not self._modes.set_mode(ArduPilotMode.GUIDED):
            return FAILED
        yaw = command.params[3]
        given = math.isfinite(yaw) and command.frame is not None and yaw != 0.0
        speed_mps = command.params[0] if command.params[0] > 0.0 else None
        self._flight.maneuver = FlyTo(target, yaw_rad=yaw if given else None, speed_mps=speed_mps)
        return ACCEPTED

    def _change_speed(self, command: ReceivedCommand) -> int:
        kind, speed_mps = command.whole(0), command.params[1]
        flies_itself = self._modes.mode in (ArduPilotMode.AUTO, ArduPilotMode.GUIDED)
        if not flies_itself or kind not in (0, 1) or not speed_mps > 0.0:
            return FAILED
        self._modes.set_speed(speed_mps)
        return ACCEPTED

    def _pause_continue(self, command: ReceivedCommand) -> int:
        if self._modes.mode is not ArduPilotMode.AUTO or self._flight.landed:
            return FAILED
        if command.params[0] == 0.0:
            self._flight.maneuver = HoldPosition()
        elif not isinstance(self._flight.maneuver, MissionRun):
            self._flight.maneuver = self._modes.start_mission()
        return ACCEPTED

    def _fence_enable(self, command: ReceivedCommand) -> int:
        if command.params[0] not in (0.0, 1.0):
            return FAILED
        self._set_parameter("FENCE_ENABLE", command.params[0])
        return ACCEPTED

    def _prearm_checks(self, _command: ReceivedCommand) -> int:
        self._arming.tell_failures()
        return ACCEPTED

    def _terminate(self, command: ReceivedCommand) -> int:
        if command.params[0] != 1.0:
            return FAILED
        self._flight.disarm("Terminating due to GCS request", _CRITICAL)
        return ACCEPTED
