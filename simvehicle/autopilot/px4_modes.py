"""The PX4 modes that the simulated vehicle has, and what they need."""

from __future__ import annotations

import enum


class Px4Mode(enum.IntEnum):
    """main << 16 | sub << 24, as HEARTBEAT.custom_mode has them (px4_custom_mode.h)."""

    MANUAL = 1 << 16
    ALTITUDE = 2 << 16
    POSITION = 3 << 16
    TAKEOFF = 4 << 16 | 2 << 24
    HOLD = 4 << 16 | 3 << 24
    MISSION = 4 << 16 | 4 << 24
    RETURN = 4 << 16 | 5 << 24
    LAND = 4 << 16 | 6 << 24
    OFFBOARD = 6 << 16
    STABILIZED = 7 << 16


STICKS = frozenset((Px4Mode.MANUAL, Px4Mode.ALTITUDE, Px4Mode.POSITION, Px4Mode.STABILIZED))
NEED_POSITION = frozenset(
    (Px4Mode.POSITION, Px4Mode.TAKEOFF, Px4Mode.HOLD, Px4Mode.MISSION, Px4Mode.RETURN, Px4Mode.OFFBOARD)
)
