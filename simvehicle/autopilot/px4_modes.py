"""The PX4 modes that the simulated vehicle has, and what they need."""

from __future__ import annotations

import enum


class Mode(enum.IntEnum):
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


STICKS = frozenset((Mode.MANUAL, Mode.ALTITUDE, Mode.POSITION, Mode.STABILIZED))
NEED_POSITION = frozenset((Mode.POSITION, Mode.TAKEOFF, Mode.HOLD, Mode.MISSION, Mode.RETURN, Mode.OFFBOARD))
