"""Gas Sensing Solutions CozIR and SprintIR infrared CO2 sensors.

Serial 9600 8N1, ASCII (GSS, "GSS Sensor User's Manual: COZIR, SprintIR, MISIR and MinIR Sensors", rev. I,
August 2015; "SprintIR-W" data sheet, rev. 4.2, 2020). A line of output is one or more fields, each a letter,
a blank and five digits: `Z` CO2 after the sensor's digital filter, `z` CO2 unfiltered, `H` humidity in tenths
of a percent, `T` temperature in tenths of a degree plus 1000. CO2 is in counts: `.` asks for the multiplier
that makes them ppm (1, 10 or 100, by the range). `K 1` streams (twice a second; the SprintIR 20 times), `K 2`
answers when asked, `M <mask>` chooses the fields (4: Z, 2: z), `A <n>` sets the digital filter. `?` answers a
command that is none; `Y` and a power-up are answered with date, version and serial number.
"""

from __future__ import annotations

import re
from typing import Annotated, Final

import msgspec
from msgspec import Meta

from sensors.instruments.byte_stream import StreamInstrument
from sensors.instruments.framing import LineFramer
from sensors.instruments.readings import co2_sample
from sensors.instruments.samples import InstrumentState, Quantity, Sample

BAUD: Final = 9600

_FIELD: Final = r"(?:[Zz] +\d{5}|[A-Ya-y.@] +\d{1,5})"
"""CO2 has always five digits: with fewer, some were lost on the line, and the number is another one."""
_FIELDS: Final = re.compile(rf"{_FIELD}(?: +{_FIELD})*", re.ASCII)
_VERSION: Final = re.compile(r"Y,.+|B +\d{5}(?: +\d{5})*", re.ASCII)
_MEASURED: Final = frozenset("HTLDdlhVv")
"""Fields of an output line that are readings, but none of CO2."""
_MULTIPLIERS: Final = (1, 10, 100)
_ANSWER_S: Final = 2.0


class GssOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    multiplier: Annotated[int, Meta(ge=1, le=100)] | None = None
    """ppm per count; None: as the sensor itself says, which is asked on connection."""
    unfiltered: bool = False
    """Take `z`, the reading before the sensor's own filter: noisier, and without the filter's lag."""
    digital_filter: Annotated[int, Meta(ge=1, le=65535)] | None = None
    """Set the sensor's own filter on connection; None: leave it as it is."""
    range_ppm: Annotated[float, Meta(gt=0.0)] | None = None
    """The unit's range as ordered; None: 10,000 ppm (CozIR) or 200,000 ppm (SprintIR)."""


class Gss(StreamInstrument):
    def __init__(
        self, kind: str, name: str, options: GssOptions | None, usual_multiplier: int, range_ppm: float
    ) -> None:
        super().__init__(kind, name, Quantity.CO2, LineFramer(), silence_s=3.0)
        self.options = options or GssOptions()
        self._multiplier = self.options.multiplier or usual_multiplier
        self._range_ppm = self.options.range_ppm or range_ppm
        self._asked_s: float | None = None
        self._told = self.options.multiplier is not None
        self._conflict = ""

    def _greeting(self, now_s: float) -> bytes:
        self._asked_s = now_s
        self._told = self.options.multiplier is not None
        commands = [".", f"M {2 if self.options.unfiltered else 4}", "K 1"]
        if self.options.digital_filter is not None:
            commands.insert(1, f"A {self.options.digital_filter}")
        return "".join(f"{c}\r\n" for c in commands).encode()

    def _read(self, now_s: float, frame: bytes) -> Sample | None:
        text = frame.decode("ascii", "replace").strip()
        if text == "?":
            return self._sample(now_s, InstrumentState.ERROR, reason="it did not understand a command")
        if _VERSION.fullmatch(text):
            return None
        if not _FIELDS.fullmatch(text):
            return self._unknown(now_s, frame, "not a GSS message")
        parts = text.split()
        fields = dict(zip(parts[::2], (int(p) for p in parts[1::2]), strict=True))
        if len(fields) * 2 != len(parts):
            return self._unknown(now_s, frame, "a field stands twice")
        if "." in fields:
            self._learn_multiplier(fields["."])
            return None
        reading = fields.get("z" if self.options.unfiltered else "Z", fields.get("Z", fields.get("z")))
        if reading is None and _MEASURED & fields.keys():
            reason = "its output has no CO2: M 4 (or M 2, unfiltered) switches it on"
            return self._sample(now_s, InstrumentState.ERROR, reason=reason)
        if reading is None:
            return None  # acknowledgement of a command
        return self._reading(now_s, reading, fields)

    def _learn_multiplier(self, said: int) -> None:
        configured = self.options.multiplier
        self._conflict = ""
        if said not in _MULTIPLIERS:
            self._conflict = f"the sensor claims a multiplier of {said}; known are 1, 10 and 100"
        elif configured is not None and configured != said:
            self._conflict = (
                f"the sensor's multiplier is {said}, configured is {configured}: remove the option"
            )
        else:
            self._multiplier, self._told = said, True

    def _reading(self, now_s: float, counts: int, fields: dict[str, int]) -> Sample:
        if self._conflict:
            return self._sample(now_s, InstrumentState.ERROR, reason=self._conflict)
        if not self._told and self._asked_s is not None:
            # On a line, nothing is guessed: a wrong multiplier is a reading wrong by ten.
            if now_s - self._asked_s < _ANSWER_S:
                return self._sample(now_s, InstrumentState.WARMING, reason="asking for the multiplier")
            reason = "does not tell its multiplier: set the option multiplier"
            return self._sample(now_s, InstrumentState.ERROR, reason=reason)
        temperature = fields.get("T")
        return co2_sample(
            now_s,
            self.name,
            float(counts * self._multiplier),
            range_ppm=self._range_ppm,
            temperature_c=None if temperature is None else (temperature - 1000) / 10.0,
        )


def cozir(name: str, options: GssOptions | None = None) -> Gss:
    return Gss("cozir", name, options, usual_multiplier=1, range_ppm=10_000.0)


def sprintir(name: str, options: GssOptions | None = None) -> Gss:
    return Gss("sprintir", name, options, usual_multiplier=10, range_ppm=200_000.0)
