"""What an ArduCopter does with the commands that it carries out in its own way. Each gives a MAV_RESULT."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot.ardupilot_modes import ArduPilotMode
from simvehicle.autopilot.commands import ACCEPTED, DENIED, FAILED, UNSUPPORTED, ReceivedCommand
from simvehicle.autopilot.maneuvers import FlyTo, HoldPosition, TakeOff
from simvehicle.autopilot.mission_run import MissionRun

if TYPE_CHECKING:
    from simvehicle.autopilot.ardupilot import ArduPilot

_CRITICAL = mavlink.MAV_SEVERITY_CRITICAL


def arm_disarm(a: ArduPilot, command: ReceivedCommand) -> int:
    if command.params[0] == 1.0:
        return ACCEPTED if a.safety.try_to_arm(forced=command.params[1] in (2989, 21196)) else FAILED
    if command.params[0] != 0.0:
        return UNSUPPORTED
    if not a.landed and command.params[1] != 21196:
        return FAILED
    a.disarm("Disarming motors")
    return ACCEPTED


def set_mode(a: ArduPilot, command: ReceivedCommand) -> int:
    if not command.whole(0) & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
        return DENIED
    return ACCEPTED if a.set_mode(command.whole(1)) else FAILED


def mode_command(a: ArduPilot, mode: ArduPilotMode) -> int:
    return ACCEPTED if a.set_mode(mode) else FAILED


def take_off(a: ArduPilot, command: ReceivedCommand) -> int:
    above_m = command.z
    climbs = math.isfinite(above_m) and above_m > a.nav.above_home_m
    if not (a.armed and a.landed and a.mode is ArduPilotMode.GUIDED and climbs and a.position_ok):
        return FAILED
    take_off_spool(a)
    a.maneuver = TakeOff(above_m)
    return ACCEPTED


def take_off_spool(a: ArduPilot) -> None:
    """The motors spin up: as recorded, 3.7 s from arming to lift-off."""
    a.nav.spool_s = max(a.armed_s + 2.0, a.now_s or 0.0) + 1.2


def mission_start(a: ArduPilot, _command: ReceivedCommand) -> int:
    if not a.armed or not a.set_mode(ArduPilotMode.AUTO):
        return FAILED
    if not a.mission_started:
        if not a.auto_allowed():
            return FAILED
        take_off_spool(a)
        a.maneuver = a.start_mission()
    return ACCEPTED


def reposition(a: ArduPilot, command: ReceivedCommand) -> int:
    if a.mode is not ArduPilotMode.GUIDED and not command.whole(1) & 1:
        return DENIED
    target = a.commands.target(command)
    if target is None or not a.allows(target[0], target[1]):
        return DENIED
    if not a.armed or not a.set_mode(ArduPilotMode.GUIDED):
        return FAILED
    yaw = command.params[3]
    given = math.isfinite(yaw) and command.frame is not None and yaw != 0.0
    speed_mps = command.params[0] if command.params[0] > 0.0 else None
    a.maneuver = FlyTo(target, yaw_rad=yaw if given else None, speed_mps=speed_mps)
    return ACCEPTED


def change_speed(a: ArduPilot, command: ReceivedCommand) -> int:
    kind, speed_mps = command.whole(0), command.params[1]
    if a.mode not in (ArduPilotMode.AUTO, ArduPilotMode.GUIDED) or kind not in (0, 1) or not speed_mps > 0.0:
        return FAILED
    a.set_speed(speed_mps)
    return ACCEPTED


def pause_continue(a: ArduPilot, command: ReceivedCommand) -> int:
    if a.mode is not ArduPilotMode.AUTO or a.landed:
        return FAILED
    if command.params[0] == 0.0:
        a.maneuver = HoldPosition()
    elif not isinstance(a.maneuver, MissionRun):
        a.maneuver = a.start_mission()
    return ACCEPTED


def fence_enable(a: ArduPilot, command: ReceivedCommand) -> int:
    if command.params[0] not in (0.0, 1.0):
        return FAILED
    a.set_parameter("FENCE_ENABLE", command.params[0])
    return ACCEPTED


def prearm_checks(a: ArduPilot, _command: ReceivedCommand) -> int:
    for text in a.safety.failures():
        a.say(_CRITICAL, f"PreArm: {text}")
    return ACCEPTED


def terminate(a: ArduPilot, command: ReceivedCommand) -> int:
    if command.params[0] != 1.0:
        return FAILED
    a.disarm("Terminating due to GCS request", _CRITICAL)
    return ACCEPTED


COMMANDS: dict[int, Callable[[ArduPilot, ReceivedCommand], int]] = {
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM: arm_disarm,
    mavlink.MAV_CMD_DO_SET_MODE: set_mode,
    mavlink.MAV_CMD_NAV_TAKEOFF: take_off,
    mavlink.MAV_CMD_NAV_LAND: lambda a, _: mode_command(a, ArduPilotMode.LAND),
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda a, _: mode_command(a, ArduPilotMode.RTL),
    mavlink.MAV_CMD_NAV_LOITER_UNLIM: lambda a, _: mode_command(a, ArduPilotMode.LOITER),
    mavlink.MAV_CMD_MISSION_START: mission_start,
    mavlink.MAV_CMD_DO_REPOSITION: reposition,
    mavlink.MAV_CMD_DO_CHANGE_SPEED: change_speed,
    mavlink.MAV_CMD_DO_PAUSE_CONTINUE: pause_continue,
    mavlink.MAV_CMD_DO_FENCE_ENABLE: fence_enable,
    mavlink.MAV_CMD_RUN_PREARM_CHECKS: prearm_checks,
    mavlink.MAV_CMD_DO_FLIGHTTERMINATION: terminate,
}
