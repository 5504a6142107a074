"""Gill WindSonic two-axis ultrasonic anemometer.

Serial 9600 8N1 as delivered, streams 1 to 4 messages a second (Gill Instruments, "WindSonic User Manual",
document 1405-PS-0019, issue 28, sections 9.1 to 9.5 and 11.5). Three formats, told apart here by themselves:

* polar `<STX>Q,229,002.74,M,00,<ETX>16`: node, direction that the wind comes from (left out below 0.05 m/s),
  speed, unit, status, check sum (exclusive or of the bytes between STX and ETX);
* U, V `<STX>Q,+001.59,-002.74,M,00,<ETX>3A`: U positive for a wind from the south mark (towards north), V
  positive for a wind from the east mark (towards west);
* NMEA `$WIMWV,120,R,002.10,M,A*hh` or $IIMWV, with A or V, or the status code, at the end.

Tunnel mode (`<STX>Q,001.59,1,M,00,<ETX>`: speed along U, and its sign as 1 or 0) measures one axis only. When it
starts it tells its name, its version and the check sums of its memories.
"""

from __future__ import annotations

import re
from typing import Final

from sensors.instruments.anemometers import MPS_PER_UNIT, Mounting, towards, wind_sample
from sensors.instruments.byte_stream import StreamInstrument
from sensors.instruments.checksums import xor_checksum
from sensors.instruments.framing import LineFramer, number
from sensors.instruments.nmea import mwv, sentence
from sensors.instruments.samples import InstrumentState, Quantity, Sample

BAUD: Final = 9600
RANGE_MPS: Final = 60.0
SD_MPS: Final = 0.15

STATUS: Final = {
    "01": "axis 1 (U) failed: blocked?",
    "02": "axis 2 (V) failed: blocked?",
    "04": "both axes failed: blocked?",
    "08": "its settings' memory is damaged",
    "09": "its program's memory is damaged",
    "10": "signal weak: readings could be in error",
}
_START: Final = re.compile(
    r"WINDSONIC.*|\d{4}-\d{3}-\d{2}|RS\d{3}.*|FIRMWARE:.*|CHECKSUM \w+:? .*|CHECKSUM \w+:.*", re.ASCII
)
_GILL: Final = re.compile(rb"\x02([^\x02\x03]*)\x03([0-9A-Fa-f]{2})")


class WindSonic(StreamInstrument):
    def __init__(self, name: str, options: Mounting | None = None) -> None:
        super().__init__("windsonic", name, Quantity.WIND, LineFramer(), silence_s=4.0)
        self.options = options or Mounting()

    def _read(self, now_s: float, frame: bytes) -> Sample | None:
        if b"$" in frame:
            return self._nmea(now_s, frame)
        text = frame.decode("ascii", "replace").strip()
        if _START.fullmatch(text):
            return self._unknown(now_s, frame, "its memory is damaged") if "FAIL" in text else None
        if text.startswith("CONFIGURATION MODE"):
            reason = "it is in its configuration mode: send Q and a line end, or switch it off and on"
            return self._sample(now_s, InstrumentState.ERROR, reason=reason)
        # What was on the line before the last STX is no part of it.
        found = _GILL.fullmatch(frame[max(frame.rfind(b"\x02"), 0) :].strip())
        if found is None or xor_checksum(found[1]) != int(found[2], 16):
            return self._unknown(now_s, frame, "not a WindSonic message, or its check sum is wrong")
        fields = found[1].decode("ascii", "replace").split(",")
        if len(fields) == 6 and fields[2] in ("0", "1") and "." in fields[1]:
            reason = "tunnel mode measures one axis only: set its message format to M2"
            return self._sample(now_s, InstrumentState.ERROR, reason=reason)
        if len(fields) != 6 or fields[5] or fields[3] not in MPS_PER_UNIT:
            return self._unknown(now_s, frame, "not a WindSonic message")
        _, first, second, unit, status, _ = fields
        if status not in ("00", "A"):
            reason = STATUS.get(status, f"status {status}")
            return self._sample(now_s, InstrumentState.ERROR, status=status[:8], reason=reason)
        vector = _vector(first, second, MPS_PER_UNIT[unit])
        if vector is None:
            return self._unknown(now_s, frame, "not a WindSonic message")
        return self._wind(now_s, vector, status)

    def _nmea(self, now_s: float, text: bytes) -> Sample | None:
        fields = sentence(text)
        if fields is not None and not fields[0].endswith("MWV"):
            return None  # another device's sentence, or another quantity
        found = mwv(fields) if fields is not None else None
        if found is None or fields is None:
            return self._unknown(now_s, text, "not a WindSonic message, or its check sum is wrong")
        if isinstance(found, str):
            reason = STATUS.get(fields[-1], found)
            return self._sample(now_s, InstrumentState.ERROR, status=fields[-1][:8], reason=reason)
        speed_mps, from_deg, status = found
        return self._wind(now_s, towards(speed_mps, from_deg), status)

    def _wind(self, now_s: float, vector: tuple[float, float], status: str) -> Sample:
        return wind_sample(
            now_s,
            self.name,
            *vector,
            None,
            mounting=self.options,
            sd_mps=SD_MPS,
            range_mps=RANGE_MPS,
            status=status,
        )


def _vector(first: str, second: str, mps: float) -> tuple[float, float] | None:
    """North and east components (m/s) of a polar or a U, V message's two numbers."""
    b = number(second)
    if b is None:
        return None
    if first[:1] in ("+", "-"):
        a = number(first)
        return None if a is None or second[:1] not in ("+", "-") else (a * mps, -b * mps)
    from_deg = number(first) if first else 0.0
    if from_deg is None or not 0.0 <= from_deg <= 360.0 or b < 0.0 or (not first and b > 0.1):
        return None
    return towards(b * mps, from_deg)
