"""A plan as every file format is read into: mission items, geofence and rally points together."""

from __future__ import annotations

import math
from typing import Final, Literal, TypeAlias

import msgspec

from mission.geometry.frames import Geodetic, Vector3
from mission.geometry.geofence import Geofence

FRAMES: Final = {
    0: "GLOBAL",
    1: "LOCAL_NED",
    2: "MISSION",
    3: "GLOBAL_RELATIVE_ALT",
    4: "LOCAL_ENU",
    5: "GLOBAL_INT",
    6: "GLOBAL_RELATIVE_ALT_INT",
    7: "LOCAL_OFFSET_NED",
    8: "BODY_NED",
    9: "BODY_OFFSET_NED",
    10: "GLOBAL_TERRAIN_ALT",
    11: "GLOBAL_TERRAIN_ALT_INT",
    12: "BODY_FRD",
    20: "LOCAL_FRD",
    21: "LOCAL_FLU",
}
"""MAV_FRAME, https://mavlink.io/en/messages/common.html#MAV_FRAME."""
MISSION_FRAME: Final = 2
"""The frame of items without a place."""
LOCAL_NED, LOCAL_ENU = 1, 4
AMSL_FRAMES: Final = frozenset({0, 5})
RELATIVE_FRAMES: Final = frozenset({3, 6})
TERRAIN_FRAMES: Final = frozenset({10, 11})
GLOBAL_FRAMES: Final = AMSL_FRAMES | RELATIVE_FRAMES | TERRAIN_FRAMES
"""Parameters 5 and 6 are latitude and longitude in degrees, 7 an altitude in m."""
LOCAL_FRAMES: Final = frozenset({LOCAL_NED, LOCAL_ENU})
"""Parameters 5 to 7 are metres about home: north, east, down, or east, north, up."""
MOVING_FRAMES: Final = frozenset(FRAMES) - GLOBAL_FRAMES - LOCAL_FRAMES - {MISSION_FRAME}
"""Metres about wherever the vehicle is: no place that a plan could name."""

WAYPOINT, TAKEOFF, LAND = 16, 22, 21
_NEEDS_PLACE: Final = frozenset({16, 17, 18, 19, 31, 82, 94})
"""NAV_WAYPOINT, the NAV_LOITERs, NAV_SPLINE_WAYPOINT, NAV_PAYLOAD_PLACE: they go somewhere."""
_NEEDS_ALTITUDE: Final = _NEEDS_PLACE | {22, 30, 84}
"""... and the take-offs and NAV_CONTINUE_AND_CHANGE_ALT, which may be "here"."""
FARTHEST_LOCAL_M: Final = 100_000.0
LOWEST_M, HIGHEST_M = -1000.0, 20_000.0
"""Altitudes outside are nowhere that a drone flies."""
_LARGEST_COMMAND: Final = 65535
_LARGEST_FRAME: Final = 255

Parameters: TypeAlias = tuple[
    float | None, float | None, float | None, float | None, float | None, float | None, float | None
]
Part: TypeAlias = Literal["mission", "fence", "rally"]


class PlanItem(msgspec.Struct, frozen=True, kw_only=True):
    """One MAVLink mission item. None stands for NaN: "the vehicle's default"."""

    command: int
    """MAV_CMD."""
    frame: int
    """MAV_FRAME."""
    params: Parameters
    """Parameters 1 to 7; 5 and 6 are latitude_deg and longitude_deg and 7 an altitude in m in global frames."""
    auto_continue: bool = True
    jump_id: int = 0
    """The number by which DO_JUMP items of the same plan name this one."""
    altitude_mode: int | None = None
    """QGroundControl's note of how the altitude was entered; the frame is what counts."""


class Plan(msgspec.Struct, frozen=True, kw_only=True):
    items: tuple[PlanItem, ...] = ()
    home: Geodetic | None = None
    geofence: Geofence | None = None
    rally: tuple[Geodetic, ...] = ()
    """Rally points. Their `amsl_m` holds what the file holds: metres above home."""
    cruise_mps: float | None = None
    hover_mps: float | None = None
    firmware_type: int | None = None
    """MAV_AUTOPILOT."""
    vehicle_type: int | None = None
    """MAV_TYPE."""
    holds: tuple[Part, ...] = ("mission", "fence", "rally")
    """What the file speaks of. What it speaks of and leaves empty is empty (a .plan without a fence says "no
    fence"); of the rest it says nothing (a KML file knows no missions)."""
    warnings: tuple[str, ...] = ()
    """What stands in the file and was not taken over, one sentence each, to be told to whoever gave the file."""


def local_ned_m(item: PlanItem) -> Vector3:
    """Metres north, east and down of home, of an item in a local frame."""
    x_m, y_m, z_m = (value or 0.0 for value in item.params[4:])
    return (y_m, x_m, -z_m) if item.frame == LOCAL_ENU else (x_m, y_m, z_m)


def item_problem(item: PlanItem) -> str | None:
    """What cannot be in an item whatever vehicle flies it, and how to mend it; None for a good one."""
    if not 0 <= item.command <= _LARGEST_COMMAND:
        return f"command {item.command} is more than a mission item carries (0 to {_LARGEST_COMMAND})"
    if item.frame not in FRAMES:
        known = "no frame of MAVLink" if 0 <= item.frame <= _LARGEST_FRAME else "not within 0 to 255"
        return f"frame {item.frame} is {known}; 3 is latitude, longitude and altitude over home"
    if any(value is not None and math.isinf(value) for value in item.params):
        return "a parameter is infinite"
    if item.frame in GLOBAL_FRAMES:
        return _global_problem(item)
    if item.frame in LOCAL_FRAMES:
        return _local_problem(item)
    return None


def altitude_problem(altitude_m: float) -> str | None:
    """What is wrong with an altitude over the sea or over home."""
    if LOWEST_M <= altitude_m <= HIGHEST_M:
        return None
    return f"altitude {altitude_m:g} m is not within {LOWEST_M:g} to {HIGHEST_M:g} m"


def place(latitude_deg: float, longitude_deg: float, altitude_m: float) -> Geodetic:
    """A home position or rally point; ValueError for what is nowhere that a drone flies."""
    problem = altitude_problem(altitude_m)
    if problem:
        raise ValueError(problem)
    return Geodetic(latitude_deg, longitude_deg, altitude_m)


def _global_problem(item: PlanItem) -> str | None:
    latitude_deg, longitude_deg, altitude_m = item.params[4:]
    if latitude_deg is not None and abs(latitude_deg) > 90.0:
        return f"latitude {latitude_deg} is not within -90 to 90 degrees"
    if longitude_deg is not None and abs(longitude_deg) > 180.0:
        return f"longitude {longitude_deg} is not within -180 to 180 degrees"
    problem = None if altitude_m is None else altitude_problem(altitude_m)
    if problem:
        return problem
    if (latitude_deg is None) != (longitude_deg is None):
        missing = "latitude" if latitude_deg is None else "longitude"
        return f"the {missing} is missing (null or NaN); write both or neither"
    if latitude_deg is None and item.command in _NEEDS_PLACE:
        return (
            "latitude and longitude are missing (null or NaN); this command needs a place: write the numbers"
        )
    # (0, 0) is "here", as both autopilots understand it.
    placed = bool(latitude_deg or longitude_deg)
    if altitude_m is None and (placed or item.command in _NEEDS_ALTITUDE):
        return "the altitude is missing (null or NaN); write the number of metres"
    return None


def _local_problem(item: PlanItem) -> str | None:
    for name, value, farthest_m in zip(
        "xyz", item.params[4:], (FARTHEST_LOCAL_M, FARTHEST_LOCAL_M, HIGHEST_M), strict=True
    ):
        if value is None:
            return f"{name} is missing (null or NaN); in frame {FRAMES[item.frame]} it is a number of metres"
        if abs(value) > farthest_m:
            return f"{name} of {value:g} m is more than {farthest_m / 1000.0:g} km from home"
    return None
