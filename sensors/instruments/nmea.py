"""The NMEA 0183 envelope and its MWV sentence, which several anemometers speak."""

from __future__ import annotations

import re
from typing import Final

from sensors.instruments.anemometers import MPS_PER_UNIT
from sensors.instruments.checksums import xor_checksum
from sensors.instruments.framing import number

_ENVELOPE: Final = re.compile(rb"\$([^$*]*)\*([0-9A-Fa-f]{2})")


def sentence(frame: bytes) -> list[str] | None:
    """The comma-separated fields between $ and *, if the check sum is right; None otherwise."""
    # What was on the line before the last $ is no part of it.
    found = _ENVELOPE.fullmatch(frame[max(frame.rfind(b"$"), 0) :].strip())
    if found is None or xor_checksum(found[1]) != int(found[2], 16):
        return None
    return found[1].decode("ascii", "replace").split(",")


def mwv(fields: list[str]) -> tuple[float, float, str] | str | None:
    """Speed (m/s), direction that the wind comes from relative to the mark (degrees) and status of an MWV
    sentence.

    A text is the reason why a well-formed sentence gives no value; None means that it is not well formed.
    Without wind the direction is left out; it is 0 here.
    """
    if len(fields) != 6 or not fields[0].endswith("MWV"):
        return None
    _, angle, reference, speed, unit, status = fields
    speed_in_unit = number(speed)
    from_deg = number(angle) if angle else 0.0
    if reference == "T":
        return "gives the wind against true north: set its reference to relative"
    if reference != "R" or unit not in MPS_PER_UNIT:
        return None
    if status not in ("A", "00"):
        return f"status {status}: void"
    if speed_in_unit is None or from_deg is None or not 0.0 <= from_deg <= 360.0 or speed_in_unit < 0.0:
        return None
    return speed_in_unit * MPS_PER_UNIT[unit], from_deg, status
