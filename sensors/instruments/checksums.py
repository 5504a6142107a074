"""The two check sums that serial instruments use."""

from __future__ import annotations

import functools
import operator


def xor_checksum(data: bytes) -> int:
    """Exclusive or of all bytes, as NMEA 0183 and its relatives have it."""
    return functools.reduce(operator.xor, data, 0)


def modbus_crc(data: bytes) -> bytes:
    """CRC-16 of Modbus RTU, low byte first ("MODBUS over Serial Line", V1.02, section 6.2.2)."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ 0xA001 if crc & 1 else crc >> 1
    return crc.to_bytes(2, "little")
