"""The ArduCopter modes that the simulated vehicle has (COPTER_MODE in ardupilotmega.xml), and what they need."""

from __future__ import annotations

import enum


class Mode(enum.IntEnum):
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
    (Mode.AUTO, Mode.GUIDED, Mode.LOITER, Mode.RTL, Mode.POSHOLD, Mode.BRAKE, Mode.SMART_RTL)
)
ARMABLE = frozenset((Mode.STABILIZE, Mode.ALT_HOLD, Mode.GUIDED, Mode.LOITER, Mode.POSHOLD))
RETURNS = frozenset((Mode.RTL, Mode.SMART_RTL))
STICKS = frozenset((Mode.STABILIZE, Mode.ALT_HOLD, Mode.LOITER, Mode.POSHOLD))
