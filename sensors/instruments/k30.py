"""Senseair K30 infrared CO2 sensor over Modbus RTU.

Serial 9600 8N1, any-sensor address 0xFE (Senseair, "Modbus on CO2 Engine K30": input registers 1 to 4 are the
meter's status, alarm status, output status and the CO2 reading; CO2Meter application note AN-102 "K30 serial
communication guide" for the older function 0x44, which reads the CO2 value from RAM). One request reads the
four registers at once: FE 04 00 00 00 04 E5 C6. The sensor measures every 2 s (the fast-response variant
twice a second) and never speaks unasked.
"""

from __future__ import annotations

from typing import Annotated, Final

import msgspec
from msgspec import Meta

from sensors.instruments.byte_stream import Pacer, StreamInstrument
from sensors.instruments.checksums import modbus_crc
from sensors.instruments.readings import co2_sample
from sensors.instruments.samples import InstrumentState, Quantity, Sample

BAUD: Final = 9600

_READ_INPUT: Final = 0x04
_READ_RAM: Final = 0x44
_REQUEST: Final = bytes((0xFE, _READ_INPUT, 0, 0, 0, 4))
_REQUEST_BYTES: Final = 8
_EXCEPTION_BYTES: Final = 5
_NOISE_BYTES: Final = 64

STATUS: Final = {
    0x01: "fatal error",
    0x02: "offset regulation error",
    0x04: "algorithm error",
    0x08: "output error",
    0x10: "self-diagnostics error",
    0x20: "out of range",
    0x40: "memory error",
}
"""Bits of the meter status (input register 1); any of them makes the reading invalid."""

EXCEPTIONS: Final = {1: "illegal function", 2: "illegal address", 3: "illegal value", 4: "device failure"}


class K30Options(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    poll_s: Annotated[float, Meta(ge=0.1, le=60.0)] = 2.0
    """Time between requests; 0.5 for the fast-response variant."""
    multiplier: Annotated[int, Meta(ge=1, le=100)] = 1
    """ppm per count: 10 for the variants with a range in percent."""
    range_ppm: Annotated[float, Meta(gt=0.0)] = 10_000.0


class ModbusFramer:
    """Replies to "read input registers" and "read RAM", exceptions, and our own echoed requests, by their
    CRC."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._noise = 0

    def clear(self) -> None:
        self._buffer.clear()
        self._noise = 0

    def feed(self, data: bytes) -> list[bytes | None]:
        self._buffer += data
        return self._cut(at_end=False)

    def end(self) -> list[bytes | None]:
        found = self._cut(at_end=True)
        if self._noise:
            found.append(None)
        self.clear()
        return found

    def _cut(self, at_end: bool) -> list[bytes | None]:
        found: list[bytes | None] = []
        while self._buffer:
            length, complete = self._frame_length()
            if not (complete or at_end):
                break
            if length:
                if self._noise:
                    found.append(None)
                self._noise = 0
                found.append(bytes(self._buffer[:length]))
                del self._buffer[:length]
                continue
            del self._buffer[:1]
            self._noise += 1
            if self._noise >= _NOISE_BYTES:
                self._noise = 0
                found.append(None)
        return found

    def _frame_length(self) -> tuple[int, bool]:
        """Length of the frame that the buffer begins with (0: none begins here), and whether that is
        certain."""
        buffer = self._buffer
        if len(buffer) < 3:
            may_begin = len(buffer) < 2 or buffer[1] & 0x7F in (_READ_INPUT, _READ_RAM)
            return 0, not may_begin
        function, count = buffer[1], buffer[2]
        lengths = []
        if function in (_READ_INPUT, _READ_RAM):
            lengths.append(_REQUEST_BYTES if function == _READ_INPUT else 7)
            if count in (2, 4, 6, 8):
                lengths.append(5 + count)
        elif function in (_READ_INPUT | 0x80, _READ_RAM | 0x80):
            lengths.append(_EXCEPTION_BYTES)
        for length in sorted(lengths):
            frame = bytes(buffer[:length])
            if len(frame) == length and modbus_crc(frame[:-2]) == frame[-2:]:
                return length, True
        return 0, all(len(buffer) >= length for length in lengths)


class K30(StreamInstrument):
    def __init__(self, name: str, options: K30Options | None = None) -> None:
        self.options = options or K30Options()
        super().__init__("k30", name, Quantity.CO2, ModbusFramer(), max(3.0, 3.0 * self.options.poll_s))
        self._pacer = Pacer(self.options.poll_s)

    def _request(self, now_s: float) -> bytes:
        return _REQUEST + modbus_crc(_REQUEST) if self._pacer.due(now_s) else b""

    def _noise(self, now_s: float) -> Sample:
        reason = "bytes that are no Modbus reply: wrong baud rate, or another device?"
        return self._sample(now_s, InstrumentState.ERROR, reason=reason)

    def _read(self, now_s: float, frame: bytes) -> Sample | None:
        function, count = frame[1], frame[2]
        if function & 0x80:
            reason = f"refused: {EXCEPTIONS.get(count, f'exception {count}')}"
            return self._sample(now_s, InstrumentState.ERROR, status=f"0x{count:02X}", reason=reason)
        if len(frame) != 5 + count:
            return None  # a request: another master, or our own through an echoing adapter
        words = [int.from_bytes(frame[i : i + 2], "big") for i in range(3, 3 + count, 2)]
        status = ""
        if len(words) == 4:
            status = f"0x{words[0]:04X}"
            if words[0]:
                faults = [text for bit, text in STATUS.items() if words[0] & bit]
                reason = ", ".join(faults) or f"unknown status {status}"
                return self._sample(now_s, InstrumentState.ERROR, status=status, reason=reason)
        elif len(words) != 1:
            return self._unknown(now_s, frame, f"{len(words)} registers, which nobody here asked for")
        counts = words[-1] - 0x10000 if words[-1] & 0x8000 else words[-1]  # 16 bits, signed
        return co2_sample(
            now_s,
            self.name,
            float(counts * self.options.multiplier),
            range_ppm=self.options.range_ppm,
            status=status,
        )
