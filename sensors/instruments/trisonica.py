"""LI-COR (Anemoment) TriSonica Mini, LI-550: a three-dimensional ultrasonic anemometer made for drones.

Serial 115200 8N1, streams 5 lines a second as delivered, up to 10 Hz and more (LI-COR support pages "LI-550:
Communicating with the anemometer", 2023; Anemoment "TriSonica Mini User Manual", April 2019 and July 2022). A
line is a run of tags and values in any order, as many as are switched on:

    S 00.08 S2 00.07 D 245 DV 033 U 00.06 V 00.03 W 00.05 T 21.22 H 17.92 P 0994.70 PI 011.4 RO 009.8

S is the speed in three dimensions, S2 the horizontal one, D the direction that the wind comes from relative
to the N mark; U, V, W are where the air goes towards the instrument's east, north and up (the line above
shows it: from 245 degrees is to the east-north-east). T in C, P in hPa. Firmware has had U and V with the
other sign: where D is sent, it decides.
"""

from __future__ import annotations

import math
import re
from typing import Final

from sensors.instruments.anemometers import Mounting, towards, wind_sample
from sensors.instruments.byte_stream import StreamInstrument
from sensors.instruments.framing import LineFramer, number
from sensors.instruments.samples import Quantity, Sample

BAUD: Final = 115_200
RANGE_MPS: Final = 50.0
SD_MPS: Final = 0.15

_VOID: Final = -99.0
"""What stands where it could not measure: -99.x."""
_TAG: Final = re.compile(r"[A-Z][A-Z0-9]{0,4}", re.ASCII)
_DIRECTION_FROM_MPS: Final = 0.5
"""Below this speed the direction's rounding and noise say nothing about the vector's sign."""


class Trisonica(StreamInstrument):
    def __init__(self, name: str, options: Mounting | None = None) -> None:
        super().__init__("trisonica", name, Quantity.WIND, LineFramer(), silence_s=3.0)
        self.options = options or Mounting()

    def _read(self, now_s: float, frame: bytes) -> Sample | None:
        words = frame.decode("ascii", "replace").replace(",", " ").split()
        tags = words[::2]
        values = [number(w) for w in words[1::2]]
        well_formed = (
            len(words) % 2 == 0 and len(set(tags)) == len(tags) and all(_TAG.fullmatch(t) for t in tags)
        )
        if words and all(number(w) is not None for w in words):
            return self._unknown(now_s, frame, "values without their tags: switch its tags on")
        if not well_formed or None in values:
            return self._unknown(now_s, frame, "not a TriSonica line")
        fields = {t: v for t, v in zip(tags, values, strict=True) if v is not None}
        vector = self._vector(fields)
        if isinstance(vector, str):
            return self._unknown(now_s, frame, vector)
        pressure_hpa, temperature_c = fields.get("P"), fields.get("T")
        return wind_sample(
            now_s,
            self.name,
            *vector,
            mounting=self.options,
            sd_mps=SD_MPS,
            range_mps=RANGE_MPS,
            pressure_pa=pressure_hpa * 100.0
            if pressure_hpa is not None and 300 <= pressure_hpa <= 1200
            else None,
            temperature_c=temperature_c if temperature_c is not None and -60 <= temperature_c <= 90 else None,
        )

    def _vector(self, fields: dict[str, float]) -> tuple[float, float, float | None] | str:
        """North, east and up components, or why there are none."""
        void = [t for t in ("S", "S2", "D", "U", "V", "W") if fields.get(t, 0.0) <= _VOID]
        if void:
            return f"no valid measurement ({' '.join(void)})"
        east, north, up = fields.get("U"), fields.get("V"), fields.get("W")
        flat_mps, speed_mps, from_deg = fields.get("S2"), fields.get("S"), fields.get("D")
        if from_deg is not None and not 0.0 <= from_deg <= 360.0:
            return "impossible direction"
        if min(flat_mps or 0.0, speed_mps or 0.0) < 0.0:
            return "negative speed"
        if east is None or north is None:
            horizontal_mps = flat_mps if flat_mps is not None else speed_mps
            if horizontal_mps is None or from_deg is None:
                return "neither U and V nor a speed with D: switch them on"
            return (*towards(horizontal_mps, from_deg), up)
        horizontal_mps = math.hypot(east, north)
        # The line has no check sum; the same wind said twice does for one.
        if flat_mps is not None and abs(flat_mps - horizontal_mps) > 0.1 + 0.03 * horizontal_mps:
            return "its speed and its vector disagree"
        if speed_mps is not None and up is not None:
            size_mps = math.hypot(horizontal_mps, up)
            if abs(speed_mps - size_mps) > 0.1 + 0.03 * size_mps and abs(speed_mps - horizontal_mps) > 0.1:
                return "its speed and its vector disagree"
        if from_deg is not None and horizontal_mps > _DIRECTION_FROM_MPS:
            to_north, to_east = towards(1.0, from_deg)
            along = (to_north * north + to_east * east) / horizontal_mps
            if abs(along) < math.cos(math.radians(20.0)):
                return "its direction and its vector disagree"
            if along < 0.0:
                north, east = -north, -east
        return north, east, up
