"""What the agent wants the vehicle to do now, as MAVLink set-point messages.

Positions go out as latitude, longitude and altitude: the local frame of the autopilot has an origin of its own.
Velocities need no origin. The type masks are those that MAVSDK uses against both autopilots (a set bit: ignore).
"""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.autopilot.telemetry import Telemetry
from flightstack.mavlink.modes import Flavour
from mission.geometry.frames import LocalFrame, Vector3

POSITION_MASK = 0x9F8
VELOCITY_MASK = 0x9C7
IGNORE_YAW = mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE


def _mask_and_yaw(mask: int, yaw_rad: float | None) -> tuple[int, float]:
    if yaw_rad is None:
        return mask | IGNORE_YAW, 0.0
    return mask, math.remainder(yaw_rad, math.tau)


def position_setpoint(
    now_s: float, vehicle: Telemetry, frame: LocalFrame, position_ned_m: Vector3, yaw_rad: float | None
) -> Any:
    """SET_POSITION_TARGET_GLOBAL_INT for a point of the swarm's frame.

    ArduPilot gets the altitude over its own home, found through heights above mean sea level. Where home is unknown,
    and for PX4 always, it is the height above mean sea level itself: PX4 misreads an altitude over home when its home
    is not at the height of its estimator's origin, by twice the difference (mavlink_receiver.cpp).
    """
    point = frame.to_geodetic(position_ned_m)
    if vehicle.home is None or vehicle.flavour is Flavour.PX4:
        coordinates, altitude_m = mavlink.MAV_FRAME_GLOBAL_INT, point.amsl_m
    else:
        coordinates = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
        altitude_m = point.amsl_m - vehicle.home.amsl_m
    mask, yaw = _mask_and_yaw(POSITION_MASK, yaw_rad)
    return mavlink.MAVLink_set_position_target_global_int_message(
        _time_ms(now_s),
        vehicle.system,
        vehicle.component,
        coordinates,
        mask,
        round(point.latitude_deg * 1e7),
        round(point.longitude_deg * 1e7),
        altitude_m,
        *(0.0,) * 6,
        yaw,
        0.0,
    )


def velocity_setpoint(
    now_s: float, vehicle: Telemetry, velocity_ned_mps: Vector3, yaw_rad: float | None
) -> Any:
    """SET_POSITION_TARGET_LOCAL_NED with a velocity only."""
    mask, yaw = _mask_and_yaw(VELOCITY_MASK, yaw_rad)
    return mavlink.MAVLink_set_position_target_local_ned_message(
        _time_ms(now_s),
        vehicle.system,
        vehicle.component,
        mavlink.MAV_FRAME_LOCAL_NED,
        mask,
        *(0.0,) * 3,
        *velocity_ned_mps,
        *(0.0,) * 3,
        yaw,
        0.0,
    )


def _time_ms(now_s: float) -> int:
    return int(now_s * 1000.0) & 0xFFFFFFFF
