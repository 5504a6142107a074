"""SET_POSITION_TARGET_LOCAL_NED and _GLOBAL_INT: frames and type masks turned into a motion.

https://mavlink.io/en/messages/common.html#POSITION_TARGET_TYPEMASK
"""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mission.geometry.frames import Geodetic, Vector3
from simvehicle.autopilot.maneuvers import Navigation
from simvehicle.vehicle.controller import Motion
from simvehicle.vehicle.parts import MotionEstimate

_YAW_IGNORE = mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE
_YAW_RATE_IGNORE = mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE
_HORIZONTAL_M, _DOWN_M, _ALL_M = 0b000011, 0b000100, 0b000111
_HORIZONTAL_MPS, _DOWN_MPS, _ALL_MPS = 0b011000, 0b100000, 0b111000
"""Bits of the type mask that ignore a position's and a velocity's axes."""
_BODY = (mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_BODY_OFFSET_NED, mavlink.MAV_FRAME_BODY_FRD)
_OFFSET = (mavlink.MAV_FRAME_LOCAL_OFFSET_NED, mavlink.MAV_FRAME_BODY_OFFSET_NED)
_LOCAL = (mavlink.MAV_FRAME_LOCAL_NED, *_OFFSET, *_BODY)
_AMSL = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT)
_RELATIVE = (
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT,
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT,
)
"""The ground is flat here: above terrain is above home."""


def position_of(message: Any, nav: Navigation, estimator: MotionEstimate) -> Vector3 | None:
    """The target position in the local frame; None for a frame that is not supported."""
    frame = message.coordinate_frame
    if message.get_type() == "SET_POSITION_TARGET_GLOBAL_INT":
        return global_position(
            frame, message.lat_int / 1e7, message.lon_int / 1e7, message.alt, nav, estimator
        )
    if frame not in _LOCAL:
        return None
    offset = (message.x, message.y, message.z)
    if frame in _BODY:
        offset = turned(offset, nav.yaw_rad)
    if frame in _OFFSET or frame in _BODY:
        return (
            nav.position_m[0] + offset[0],
            nav.position_m[1] + offset[1],
            nav.position_m[2] + offset[2],
        )
    return offset


def global_position(
    frame: int,
    latitude_deg: float,
    longitude_deg: float,
    altitude_m: float,
    nav: Navigation,
    estimator: MotionEstimate,
) -> Vector3 | None:
    """A point in one of the global frames; None where it is no point or the frame is not supported."""
    if not (abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0 and math.isfinite(altitude_m)):
        return None
    if frame in _AMSL:
        return estimator.local(Geodetic(latitude_deg, longitude_deg, altitude_m))
    if frame in _RELATIVE:
        north, east, _ = estimator.local(
            Geodetic(latitude_deg, longitude_deg, estimator.geodetic(nav.home_m).amsl_m)
        )
        return north, east, nav.home_m[2] - altitude_m
    return None


def motion_of(message: Any, nav: Navigation, estimator: MotionEstimate, *, per_axis: bool) -> Motion | None:
    """What a setpoint wants; None where the frame or a number is not usable.

    With `per_axis` (PX4) height and horizontal may be given as position or velocity apart; otherwise (ArduPilot) one
    ignored axis ignores all three.
    """
    mask = message.type_mask
    if not per_axis:
        mask |= (_ALL_M if mask & _ALL_M else 0) | (_ALL_MPS if mask & _ALL_MPS else 0)
    motion = Motion(horizontal_mps=(0.0, 0.0), down_mps=0.0)
    if mask & _ALL_MPS != _ALL_MPS:
        velocity = message.vx, message.vy, message.vz
        if message.coordinate_frame in _BODY:
            velocity = turned(velocity, nav.yaw_rad)
        if not math.isfinite(velocity[0] + velocity[1] + velocity[2]):
            return None
        if not mask & _HORIZONTAL_MPS:
            motion.horizontal_mps = velocity[0], velocity[1]
        if not mask & _DOWN_MPS:
            motion.down_mps = velocity[2]
    if mask & _ALL_M != _ALL_M:
        position = position_of(message, nav, estimator)
        if position is None or not all(
            math.isfinite(position[axis]) for axis in (0, 1, 2) if not mask & 1 << axis
        ):
            return None
        if not mask & _HORIZONTAL_M:
            motion.horizontal_m = position[0], position[1]
        if not mask & _DOWN_M:
            motion.down_m = position[2]
    if not mask & _YAW_IGNORE and math.isfinite(message.yaw):
        body = nav.yaw_rad if message.coordinate_frame in _BODY else 0.0
        motion.yaw_rad = message.yaw + body
    elif not mask & _YAW_RATE_IGNORE and math.isfinite(message.yaw_rate):
        motion.yaw_rate_radps = message.yaw_rate
    return motion


def turned(vector: Vector3, yaw_rad: float) -> Vector3:
    """A vector in the heading frame (forward, right, down) in NED."""
    cos_yaw, sin_yaw = math.cos(yaw_rad), math.sin(yaw_rad)
    return (
        vector[0] * cos_yaw - vector[1] * sin_yaw,
        vector[0] * sin_yaw + vector[1] * cos_yaw,
        vector[2],
    )
