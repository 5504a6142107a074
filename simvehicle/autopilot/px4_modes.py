"""The PX4 modes that the simulated vehicle has, what they need, and all that a PX4 says that it has."""

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
CANNOT_ARM = frozenset((Px4Mode.RETURN, Px4Mode.LAND))
"""Nobody takes off in these, and none of them is gone back to after a landing."""
NAVIGATION_STATES = {
    Px4Mode.MANUAL: 0,
    Px4Mode.ALTITUDE: 1,
    Px4Mode.POSITION: 2,
    Px4Mode.MISSION: 3,
    Px4Mode.HOLD: 4,
    Px4Mode.RETURN: 5,
    Px4Mode.OFFBOARD: 14,
    Px4Mode.STABILIZED: 15,
    Px4Mode.TAKEOFF: 17,
    Px4Mode.LAND: 18,
}
"""PX4's own numbers of its modes."""

AVAILABLE = (
    (0, 65536, 1, "Manual"),
    (4, 131072, 0, ""),
    (1, 196608, 0, ""),
    (6, 67371008, 1, ""),
    (0, 50593792, 1, "Hold"),
    (5, 84148224, 1, ""),
    (0, 33751040, 1, "Position Slow"),
    (0, 327680, 1, "Acro"),
    (0, 655360, 3, "Termination"),
    (0, 393216, 1, "Offboard"),
    (0, 458752, 1, "Stabilized"),
    (8, 33816576, 1, ""),
    (7, 100925440, 1, ""),
    (0, 134479872, 1, "Follow Target"),
    (0, 151257088, 1, "Precision Landing"),
    (2, 16973824, 1, ""),
    (0, 168034304, 1, "VTOL Takeoff"),
    *((0, (11 + place) << 24 | 4 << 16, 2, "(Mode not available)") for place in range(8)),
)
"""AVAILABLE_MODES as recorded: standard mode, custom mode, properties, name (none where the standard has one)."""
