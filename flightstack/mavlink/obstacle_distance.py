"""OBSTACLE_DISTANCE: what a range finder that looks around has seen, as bearings and distances.

The message's definition: https://mavlink.io/en/messages/common.html#OBSTACLE_DISTANCE. An ArduPilot passes on what a
sensor of its own system says, a PX4 sends it itself when it is asked.
"""

from __future__ import annotations

import math
from typing import Any, Final

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

_UNKNOWN: Final = 0xFFFF
_NORTH: Final = frozenset((mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_LOCAL_NED))
_NOSE: Final = frozenset((mavlink.MAV_FRAME_BODY_FRD, mavlink.MAV_FRAME_BODY_NED))


class Ranges(msgspec.Struct, frozen=True):
    """One look around."""

    beams: tuple[tuple[float, float], ...]
    """(bearing_rad from north towards east, range_m to the nearest that is within half of `width_rad` of it),
    infinite where nothing is within reach. A beam that knows nothing is not among them."""
    width_rad: float
    reach_m: float


def ranges_of(fields: Any, yaw_rad: float | None) -> Ranges | None:
    """The fields of a message as bearings; None for one that says nothing. `yaw_rad`: where the vehicle's nose
    points, None: not known.

    Index 0 is at the angle offset from north, or from the nose in a body's frame; indices go clockwise. A value of 0
    touches the sensor, 65535 is unknown or not used, and a value above the largest distance means that nothing is
    there.
    """
    width_deg = fields.increment_f if _is_usable(fields.increment_f) else float(fields.increment)
    if width_deg == 0.0 or fields.max_distance == 0:
        return None
    if fields.frame in _NORTH:
        zero_rad = 0.0
    elif fields.frame in _NOSE and yaw_rad is not None:
        zero_rad = yaw_rad
    else:
        return None
    if math.isfinite(fields.angle_offset):
        zero_rad += math.radians(fields.angle_offset)
    count = min(len(fields.distances), int(360.0 / abs(width_deg) + 0.5))
    beams = tuple(
        ((zero_rad + index * math.radians(width_deg)) % math.tau, _range_m(distance_cm, fields.max_distance))
        for index, distance_cm in enumerate(fields.distances[:count])
        if distance_cm != _UNKNOWN
    )
    return Ranges(beams, math.radians(abs(width_deg)), fields.max_distance * 0.01)


def _is_usable(increment_deg: float) -> bool:
    return math.isfinite(increment_deg) and increment_deg != 0.0


def _range_m(distance_cm: int, max_cm: int) -> float:
    return math.inf if distance_cm > max_cm else distance_cm * 0.01
