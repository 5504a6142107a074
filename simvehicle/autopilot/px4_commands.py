"""What PX4 does with the commands that it carries out in its own way. Each gives a MAV_RESULT."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot.commands import ACCEPTED, DENIED, REJECTED, UNSUPPORTED, ReceivedCommand
from simvehicle.autopilot.maneuvers import FlyTo
from simvehicle.autopilot.missions import MISSION
from simvehicle.autopilot.px4_modes import Px4Mode

if TYPE_CHECKING:
    from simvehicle.autopilot.px4 import Px4

_INFO, _CRITICAL = mavlink.MAV_SEVERITY_INFO, mavlink.MAV_SEVERITY_CRITICAL


def arm_disarm(a: Px4, command: ReceivedCommand) -> int:
    forced = command.params[1] == 21196
    if command.params[0] == 1.0:
        return arm(a, forced=forced)
    if command.params[0] != 0.0:
        return UNSUPPORTED
    if not a.landed and not forced:
        a.say(_CRITICAL, "Disarming denied: not landed")
        return REJECTED
    a.disarm("Disarmed by external command")
    return ACCEPTED


def arm(a: Px4, *, forced: bool) -> int:
    if a.armed:
        return ACCEPTED
    reasons = [] if forced else a.safety.failures()
    if reasons:
        a.say(_CRITICAL, "Arming denied: Resolve system health failures first")
        for reason in reasons:
            a.say(_CRITICAL, f"Preflight Fail: {reason}")
        return REJECTED
    a.say(_INFO, "Armed by external command")
    a.arm()
    return ACCEPTED


def set_mode(a: Px4, command: ReceivedCommand) -> int:
    if not command.whole(0) & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
        return DENIED
    try:
        mode = Px4Mode(command.whole(1) << 16 | command.whole(2) << 24)
    except ValueError:
        return DENIED
    return a.user_mode(mode)


def take_off(a: Px4, command: ReceivedCommand) -> int:
    if math.isfinite(command.z) and command.z != 0.0:
        home = a.home
        if home is None:
            return REJECTED
        a.take_off_above_m = command.z - home.amsl_m
    else:
        a.take_off_above_m = None
        a.say(_INFO, f"Using default takeoff altitude: {a.parameters['MIS_TAKEOFF_ALT']:.2f} m")
    return a.user_mode(Px4Mode.TAKEOFF)


def mission_start(a: Px4, _command: ReceivedCommand) -> int:
    if not a.missions.lists[MISSION]:
        return DENIED
    if not a.armed and arm(a, forced=False) != ACCEPTED:
        return REJECTED
    return a.user_mode(Px4Mode.MISSION)


def reposition(a: Px4, command: ReceivedCommand) -> int:
    if not command.whole(1) & 1 and a.mode is not Px4Mode.HOLD:
        return DENIED
    target = a.commands.target(command)
    if target is None:
        return DENIED
    if not a.armed:
        return REJECTED
    result = a.user_mode(Px4Mode.HOLD)
    if result == ACCEPTED:
        yaw = command.params[3]
        speed_mps = command.params[0] if command.params[0] > 0.0 else None
        yaw_rad = yaw if math.isfinite(yaw) else None
        a.maneuver = FlyTo(target, yaw_rad=yaw_rad, speed_mps=speed_mps)
    return result


def change_speed(a: Px4, command: ReceivedCommand) -> int:
    if not command.params[1] > 0.0:
        return DENIED
    a.set_speed(command.params[1])
    return ACCEPTED


def pause_continue(a: Px4, command: ReceivedCommand) -> int:
    return a.user_mode(Px4Mode.HOLD if command.params[0] == 0.0 else Px4Mode.MISSION)


def prearm_checks(a: Px4, _command: ReceivedCommand) -> int:
    for reason in a.safety.failures():
        a.say(_CRITICAL, f"Preflight Fail: {reason}")
    return ACCEPTED


def terminate(a: Px4, command: ReceivedCommand) -> int:
    if command.params[0] > 0.5:
        a.disarm("Flight terminated", _CRITICAL)
    return ACCEPTED


COMMANDS: dict[int, Callable[[Px4, ReceivedCommand], int]] = {
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM: arm_disarm,
    mavlink.MAV_CMD_DO_SET_MODE: set_mode,
    mavlink.MAV_CMD_NAV_TAKEOFF: take_off,
    mavlink.MAV_CMD_NAV_LAND: lambda a, _: a.user_mode(Px4Mode.LAND),
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda a, _: a.user_mode(Px4Mode.RETURN),
    mavlink.MAV_CMD_NAV_LOITER_UNLIM: lambda a, _: a.user_mode(Px4Mode.HOLD),
    mavlink.MAV_CMD_MISSION_START: mission_start,
    mavlink.MAV_CMD_DO_REPOSITION: reposition,
    mavlink.MAV_CMD_DO_CHANGE_SPEED: change_speed,
    mavlink.MAV_CMD_DO_PAUSE_CONTINUE: pause_continue,
    mavlink.MAV_CMD_RUN_PREARM_CHECKS: prearm_checks,
    mavlink.MAV_CMD_DO_FLIGHTTERMINATION: terminate,
}
