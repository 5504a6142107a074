"""Values of parameters: what a vehicle's own type takes, and how MAVLink carries it in its one float field.

https://mavlink.io/en/services/parameter.html: PX4 sends the bytes of an integer in the float's place, ArduPilot a
float of the same value, so that of ArduPilot's integers only 24 bits arrive.
"""

from __future__ import annotations

import math
import struct
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.modes import Flavour


class IntegerType(NamedTuple):
    name: str
    layout: str
    """As `struct` writes it, with what fills the float's four bytes."""
    least: int
    most: int


INTEGER_TYPES: Final = {
    mavlink.MAV_PARAM_TYPE_UINT8: IntegerType("uint8", "<Bxxx", 0, 2**8 - 1),
    mavlink.MAV_PARAM_TYPE_INT8: IntegerType("int8", "<bxxx", -(2**7), 2**7 - 1),
    mavlink.MAV_PARAM_TYPE_UINT16: IntegerType("uint16", "<Hxx", 0, 2**16 - 1),
    mavlink.MAV_PARAM_TYPE_INT16: IntegerType("int16", "<hxx", -(2**15), 2**15 - 1),
    mavlink.MAV_PARAM_TYPE_UINT32: IntegerType("uint32", "<I", 0, 2**32 - 1),
    mavlink.MAV_PARAM_TYPE_INT32: IntegerType("int32", "<i", -(2**31), 2**31 - 1),
}
"""By MAV_PARAM_TYPE. All others are numbers with a fraction."""
SINGLE_PRECISION: Final = 1e-6
"""Relative rounding of a 4-byte float on the wire, and of what autopilots make of it."""


class ParameterValue(NamedTuple):
    value: float
    kind: int
    """MAV_PARAM_TYPE."""


def encode(flavour: Flavour, kind: int, value: float) -> float:
    """The float field for a value without `value_problem`."""
    integer = INTEGER_TYPES.get(kind)
    if flavour is Flavour.PX4 and integer is not None:
        (as_float,) = struct.unpack("<f", struct.pack(integer.layout, int(value)))
        return float(as_float)
    return value


def decode(flavour: Flavour, kind: int, value: float) -> float:
    """What a float field means."""
    integer = INTEGER_TYPES.get(kind)
    if flavour is Flavour.PX4 and integer is not None:
        (number,) = struct.unpack(integer.layout, struct.pack("<f", value))
        return float(number)
    return value


def is_same(kind: int, value: float, other: float) -> bool:
    """Whether a parameter of this type has the same value in both cases, but for the wire's rounding."""
    if kind in INTEGER_TYPES:
        return value == other
    return math.isclose(value, other, rel_tol=SINGLE_PRECISION, abs_tol=1e-7)


def value_problem(flavour: Flavour, kind: int, value: float) -> str | None:
    """Why a parameter of this type cannot be set to `value`, to stand behind its name; None where it can."""
    if not math.isfinite(value):
        return f"cannot be {value}"
    integer = INTEGER_TYPES.get(kind)
    if integer is not None:
        if value != math.floor(value):
            return f"is an integer ({integer.name}) and cannot be {number_text(value)}"
        if not integer.least <= value <= integer.most:
            return f"cannot be {value:.0f}: it is within {integer.least} to {integer.most} ({integer.name})"
        if flavour is Flavour.PX4:
            arrives = decode(flavour, kind, encode(flavour, kind, value)) == value
            # Bytes that are a signalling NaN are changed by every processor that touches them.
            return None if arrives else f"cannot be {value:.0f}: as a float its bytes do not survive the way"
    try:
        carried = single(value)
    except OverflowError:
        return f"cannot be {value:g}: a float of 4 bytes ends at 3.4e38"
    if value and not carried:
        return f"cannot be {value:g}: a float of 4 bytes does not tell that from 0"
    if value == math.floor(value) and carried != value:
        return f"cannot be {value:.0f}: it travels as a float, which carries 24 bits, and would become {carried:.0f}"
    return None


def single(value: float) -> float:
    """The nearest 4-byte float; OverflowError beyond the largest."""
    (rounded,) = struct.unpack("<f", struct.pack("<f", value))
    return float(rounded)


def number_text(value: float) -> str:
    """The shortest text that is read back as the same 4-byte float, and whole numbers in full."""
    if value == math.floor(value) and abs(value) < 1e15:
        return f"{value:.0f}"
    for digits in range(1, 10):
        text = f"{value:.{digits}g}"
        try:
            if single(float(text)) == single(value):
                return text
        except OverflowError:
            break
    return repr(value)
