"""Flight modes of the two autopilots: their names, and which of them does what we need.

Sources: ArduPilot's `COPTER_MODE` (ardupilotmega.xml) and PX4's `px4_custom_mode.h`.
"""

from __future__ import annotations

import enum

from pymavlink.dialects.v20 import ardupilotmega as mavlink


class Flavour(enum.StrEnum):
    UNKNOWN = "unknown"
    ARDUPILOT = "ardupilot"
    PX4 = "px4"


FLAVOURS = {
    mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA: Flavour.ARDUPILOT,
    mavlink.MAV_AUTOPILOT_PX4: Flavour.PX4,
}
"""By HEARTBEAT.autopilot."""

COPTER_TYPES = frozenset(
    (
        mavlink.MAV_TYPE_QUADROTOR,
        mavlink.MAV_TYPE_COAXIAL,
        mavlink.MAV_TYPE_HELICOPTER,
        mavlink.MAV_TYPE_HEXAROTOR,
        mavlink.MAV_TYPE_OCTOROTOR,
        mavlink.MAV_TYPE_TRICOPTER,
        mavlink.MAV_TYPE_DODECAROTOR,
        mavlink.MAV_TYPE_DECAROTOR,
    )
)
"""HEARTBEAT.type of what can hover; ArduPilot numbers the modes of planes and rovers differently."""

FLYING_TYPES = COPTER_TYPES | frozenset(
    (
        mavlink.MAV_TYPE_FIXED_WING,
        mavlink.MAV_TYPE_AIRSHIP,
        mavlink.MAV_TYPE_FLAPPING_WING,
        mavlink.MAV_TYPE_VTOL_DUOROTOR,
        mavlink.MAV_TYPE_VTOL_QUADROTOR,
        mavlink.MAV_TYPE_VTOL_TILTROTOR,
        mavlink.MAV_TYPE_VTOL_RESERVED2,
        mavlink.MAV_TYPE_VTOL_RESERVED3,
        mavlink.MAV_TYPE_VTOL_RESERVED4,
        mavlink.MAV_TYPE_VTOL_RESERVED5,
        mavlink.MAV_TYPE_PARAFOIL,
        mavlink.MAV_TYPE_GENERIC_MULTIROTOR,
        mavlink.MAV_TYPE_VTOL_GYRODYNE,
    )
)
"""HEARTBEAT.type of every aircraft that an autopilot steers, in our sky whether or not we could fly it."""


class Duty(enum.Enum):
    """What we want of a mode, whatever the autopilot calls it."""

    CONTROL = "control"
    """The vehicle follows our setpoints."""
    HOLD = "hold"
    """The autopilot holds the position by itself."""
    RETURN = "return"
    LAND = "land"


_COPTER_MODES = {
    0: "STABILIZE",
    1: "ACRO",
    2: "ALT_HOLD",
    3: "AUTO",
    4: "GUIDED",
    5: "LOITER",
    6: "RTL",
    7: "CIRCLE",
    9: "LAND",
    11: "DRIFT",
    13: "SPORT",
    14: "FLIP",
    15: "AUTOTUNE",
    16: "POSHOLD",
    17: "BRAKE",
    18: "THROW",
    19: "AVOID_ADSB",
    20: "GUIDED_NOGPS",
    21: "SMART_RTL",
    22: "FLOWHOLD",
    23: "FOLLOW",
    24: "ZIGZAG",
    25: "SYSTEMID",
    26: "AUTOROTATE",
    27: "AUTO_RTL",
    28: "TURTLE",
}

_PX4_MAIN_AUTO = 4
_PX4_MODES = {
    (1, 0): "MANUAL",
    (2, 0): "ALTITUDE",
    (3, 0): "POSITION",
    (3, 1): "ORBIT",
    (3, 2): "POSITION_SLOW",
    (4, 1): "READY",
    (4, 2): "TAKEOFF",
    (4, 3): "HOLD",
    (4, 4): "MISSION",
    (4, 5): "RTL",
    (4, 6): "LAND",
    (4, 8): "FOLLOW",
    (4, 9): "PRECISION_LAND",
    (5, 0): "ACRO",
    (6, 0): "OFFBOARD",
    (7, 0): "STABILIZED",
    (10, 0): "TERMINATION",
}
"""By (main mode, sub mode)."""

_WAYS_DOWN: dict[Flavour, dict[str, Duty]] = {
    Flavour.ARDUPILOT: {
        "RTL": Duty.RETURN,
        "SMART_RTL": Duty.RETURN,
        "AUTO_RTL": Duty.RETURN,
        "LAND": Duty.LAND,
    },
    Flavour.PX4: {"RTL": Duty.RETURN, "LAND": Duty.LAND, "PRECISION_LAND": Duty.LAND},
}
"""The modes in which an autopilot brings its vehicle to the ground by itself; PX4's blind descent shows as LAND."""

_PX4_BITS = {
    (1, 0): 0,
    (2, 0): 1,
    (3, 0): 2,
    (4, 4): 3,
    (4, 3): 4,
    (4, 5): 5,
    (3, 2): 6,
    (5, 0): 10,
    (10, 0): 13,
    (6, 0): 14,
    (7, 0): 15,
    (4, 2): 17,
    (4, 6): 18,
    (4, 8): 19,
    (4, 9): 20,
    (3, 1): 21,
}
"""PX4's own numbers of its modes (navigation states), by (main mode, sub mode)."""

_DUTIES: dict[Flavour, dict[Duty, int]] = {
    Flavour.ARDUPILOT: {Duty.CONTROL: 4, Duty.HOLD: 17, Duty.RETURN: 6, Duty.LAND: 9},
    Flavour.PX4: {
        Duty.CONTROL: 6 << 16,
        Duty.HOLD: 3 << 24 | _PX4_MAIN_AUTO << 16,
        Duty.RETURN: 5 << 24 | _PX4_MAIN_AUTO << 16,
        Duty.LAND: 6 << 24 | _PX4_MAIN_AUTO << 16,
    },
}


def mode_of(flavour: Flavour, duty: Duty) -> int:
    """HEARTBEAT.custom_mode of the mode that does `duty`."""
    return _DUTIES[flavour][duty]


def mode_name(flavour: Flavour, custom_mode: int) -> str:
    """The autopilot's own word for a HEARTBEAT.custom_mode, "MODE_99" for one that is not in the tables."""
    if flavour is Flavour.ARDUPILOT:
        name = _COPTER_MODES.get(custom_mode)
    elif flavour is Flavour.PX4:
        main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24
        name = _PX4_MODES.get((main, sub)) or _PX4_MODES.get((main, 0))
    else:
        name = None
    return name or f"MODE_{custom_mode}"


def way_down(flavour: Flavour, custom_mode: int) -> Duty | None:
    """How the autopilot brings the vehicle to the ground in this mode, by RETURN or LAND; None where it does not."""
    return _WAYS_DOWN.get(flavour, {}).get(mode_name(flavour, custom_mode))


def px4_mode_bit(custom_mode: int) -> int:
    """The bit that stands for a PX4 HEARTBEAT.custom_mode in its events; 0 for a mode that is not in the tables."""
    number = _PX4_BITS.get((custom_mode >> 16 & 0xFF, custom_mode >> 24))
    return 0 if number is None else 1 << number


def set_mode_parameters(flavour: Flavour, custom_mode: int) -> tuple[float, float, float]:
    """Parameters 1 to 3 of MAV_CMD_DO_SET_MODE: ArduPilot takes the number, PX4 its main and sub mode apart."""
    custom = float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
    if flavour is Flavour.PX4:
        return custom, float(custom_mode >> 16 & 0xFF), float(custom_mode >> 24)
    return custom, float(custom_mode), 0.0
