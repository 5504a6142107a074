"""What PX4 does with the commands that it carries out in its own way. Each gives a MAV_RESULT."""

from __future__ import annotations

import math
import struct

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.dialect import AvailableModesMessage
from simvehicle.autopilot.commands import (
    ACCEPTED,
    DENIED,
    REJECTED,
    UNSUPPORTED,
    Execute,
    ReceivedCommand,
)
from simvehicle.autopilot.flight import Flight
from simvehicle.autopilot.flight_commands import reposition_target
from simvehicle.autopilot.maneuvers import FlyTo
from simvehicle.autopilot.mission_progress import MissionProgress
from simvehicle.autopilot.parameters import Parameters
from simvehicle.autopilot.px4_arming import Px4Arming
from simvehicle.autopilot.px4_failsafes import Px4Failsafes
from simvehicle.autopilot.px4_mode_control import Px4ModeControl
from simvehicle.autopilot.px4_modes import AVAILABLE, Px4Mode
from simvehicle.autopilot.px4_report import Px4Report
from simvehicle.autopilot.px4_voice import Px4Voice

_INFO, _CRITICAL = mavlink.MAV_SEVERITY_INFO, mavlink.MAV_SEVERITY_CRITICAL


class Px4Commands:
    def __init__(
        self,
        flight: Flight,
        parameters: Parameters,
        voice: Px4Voice,
        progress: MissionProgress,
        modes: Px4ModeControl,
        failsafes: Px4Failsafes,
        arming: Px4Arming,
        report: Px4Report,
    ) -> None:
        self._flight = flight
        self._parameters = parameters
        self._voice = voice
        self._progress = progress
        self._modes = modes
        self._failsafes = failsafes
        self._arming = arming
        self._report = report

    def table(self) -> dict[int, Execute]:
        return {
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM: self._arm_disarm,
            mavlink.MAV_CMD_DO_SET_MODE: self._set_mode,
            mavlink.MAV_CMD_NAV_TAKEOFF: self._take_off,
            mavlink.MAV_CMD_NAV_LAND: self._land,
            mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: self._return,
            mavlink.MAV_CMD_NAV_LOITER_UNLIM: lambda _: self.enter(Px4Mode.HOLD),
            mavlink.MAV_CMD_MISSION_START: self._mission_start,
            mavlink.MAV_CMD_DO_REPOSITION: self._reposition,
            mavlink.MAV_CMD_DO_CHANGE_SPEED: self._change_speed,
            mavlink.MAV_CMD_DO_PAUSE_CONTINUE: self._pause_continue,
            mavlink.MAV_CMD_RUN_PREARM_CHECKS: self._prearm_checks,
            mavlink.MAV_CMD_DO_FLIGHTTERMINATION: self._terminate,
        }

    def enter(self, mode: Px4Mode) -> int:
        return self._modes.user_mode(mode, self._failsafes.user_chose)

    def _arm_disarm(self, command: ReceivedCommand) -> int:
        forced = command.params[1] == 21196
        if command.params[0] == 1.0:
            return self._arming.arm(forced=forced)
        if command.params[0] != 0.0:
            return UNSUPPORTED
        if not self._flight.landed and not forced:
            denied = "Disarming denied: not landed"
            self._voice.tell("commander_disarm_denied_not_landed", _CRITICAL, text=denied)
            return REJECTED
        self._arming.disarm()
        return ACCEPTED

    def _set_mode(self, command: ReceivedCommand) -> int:
        if not command.whole(0) & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return DENIED
        try:
            mode = Px4Mode(command.whole(1) << 16 | command.whole(2) << 24)
        except ValueError:
            return ACCEPTED if not self._flight.armed else REJECTED
        return self.enter(mode)

    def _land(self, _command: ReceivedCommand) -> int:
        text = "Landing at current position"
        self._voice.tell("commander_landing_current_pos", _INFO, text=text)
        return self.enter(Px4Mode.LAND)

    def _return(self, _command: ReceivedCommand) -> int:
        result = self.enter(Px4Mode.RETURN)
        if result == ACCEPTED:
            self._voice.tell("commander_rtl", _INFO, text="Returning to launch")
        return result

    def _take_off(self, command: ReceivedCommand) -> int:
        if math.isfinite(command.z) and command.z != 0.0:
            home = self._flight.home
            if home is None:
                return REJECTED
            self._modes.take_off_above_m = command.z - home.amsl_m
        else:
            self._modes.take_off_above_m = None
            above_m = self._parameters["MIS_TAKEOFF_ALT"]
            text = f"Using default takeoff altitude: {above_m:.1f} m"
            told = struct.pack("<f", above_m)
            self._voice.tell("navigator_takeoff_default_alt", _INFO, told, text=text)
        return self.enter(Px4Mode.TAKEOFF)

    def _mission_start(self, _command: ReceivedCommand) -> int:
        if not self._progress.can_fly:
            text = "Mission start denied! No valid mission"
            self._voice.tell("commander_mission_start_denied_no_mission", _CRITICAL, text=text)
            return REJECTED
        if not self._flight.armed and self._arming.arm(forced=False) != ACCEPTED:
            return REJECTED
        result = self.enter(Px4Mode.MISSION)
        if result == ACCEPTED:
            self._voice.tell("mission_execute", _INFO, text="Executing Mission")
        return result

    def _reposition(self, command: ReceivedCommand) -> int:
        if not command.whole(1) & 1 and self._modes.mode is not Px4Mode.HOLD:
            return DENIED
        target = reposition_target(command, self._flight)
        if target is None:
            return DENIED
        if not self._flight.armed:
            return REJECTED
        result = self.enter(Px4Mode.HOLD)
        if result == ACCEPTED:
            yaw = command.params[3]
            speed_mps = command.params[0] if command.params[0] > 0.0 else None
            yaw_rad = yaw if math.isfinite(yaw) else None
            self._flight.maneuver = FlyTo(target, yaw_rad=yaw_rad, speed_mps=speed_mps)
        return result

    def _change_speed(self, command: ReceivedCommand) -> int:
        if not command.params[1] > 0.0:
            return DENIED
        self._modes.set_speed(command.params[1])
        return ACCEPTED

    def _pause_continue(self, command: ReceivedCommand) -> int:
        return self.enter(Px4Mode.HOLD if command.params[0] == 0.0 else Px4Mode.MISSION)

    def _prearm_checks(self, _command: ReceivedCommand) -> int:
        if self._flight.armed:
            return REJECTED
        self._report.now(self._flight.now_s)
        return ACCEPTED

    def _terminate(self, command: ReceivedCommand) -> int:
        if command.params[0] > 0.5:
            self._flight.disarm("Flight terminated", _CRITICAL)
        return ACCEPTED


def available_modes(wanted: int) -> list[AvailableModesMessage]:
    """One of its modes by its place, or all of them (0 and what is no number)."""
    return [
        AvailableModesMessage(
            number_modes=len(AVAILABLE),
            mode_index=index,
            standard_mode=standard,
            custom_mode=custom,
            properties=properties,
            mode_name=name.encode(),
        )
        for index, (standard, custom, properties, name) in enumerate(AVAILABLE, 1)
        if wanted in (index, 0, -1)
    ]
