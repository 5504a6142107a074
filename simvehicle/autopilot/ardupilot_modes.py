"""The ArduCopter modes that the simulated vehicle has (COPTER_MODE in ardupilotmega.xml), and what they need."""

from __future__ import annotations

import enum


class ArduPilotMode(enum.IntEnum):
    STABILIZE = 0
    ALT_HOLD = 2
    AUTO = 3
    GUIDED = 4
    LOITER = 5
    RTL = 6
    LAND = 9
    POSHOLD = 16
    BRAKE = 17
    SMART_RTL = 21


NEED_POSITION = frozenset(
    (
        ArduPilotMode.AUTO,
        ArduPilotMode.GUIDED,
        ArduPilotMode.LOITER,
        ArduPilotMode.RTL,
        ArduPilotMode.POSHOLD,
        ArduPilotMode.BRAKE,
        ArduPilotMode.SMART_RTL,
    )
)
ARMABLE = frozenset(
    (
        ArduPilotMode.STABILIZE,
        ArduPilotMode.ALT_HOLD,
        ArduPilotMode.GUIDED,
        ArduPilotMode.LOITER,
        ArduPilotMode.POSHOLD,
    )
)
RETURNS = frozenset((ArduPilotMode.RTL, ArduPilotMode.SMART_RTL))
STICKS = frozenset(
    (ArduPilotMode.STABILIZE, ArduPilotMode.ALT_HOLD, ArduPilotMode.LOITER, ArduPilotMode.POSHOLD)
)
