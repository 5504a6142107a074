"""PP Systems SBA-5 infrared CO2 analyser.

Serial 19200 8N1, ASCII (SBA-5 CO2 Analyzer Operation Manual, version 1.06, PP Systems 2015, "Communication"
and "Error messages"; the operators' use of it in the field). The host sends single letters, and strings ended
by CR: `!` stops the continuous display, `C2` asks for two decimals, `P1` switches the pump on, `A<minutes>`
sets the time between automatic zeros, `Z` zeroes now, `M` asks for one reading. Commands are echoed and
acknowledged with OK. Three kinds of line come back, fields separated by blanks or commas:

* `M <zero counts> <counts> <ppm> <average temp C> <humidity mb> <humidity sensor temp C> <pressure mb>
  [<detector temp> <source temp>] <status>`
* `Z,<n> of <m>`: zeroing; readings are valid again after n = m.
* `W,<temp C>`: warming up.

The SBA-5+ can be set otherwise (the manual's "Measurement commands" and "Measurement string format command"):
`F<mask>` leaves fields of the reading out (128 counts, 64 average temperature, 32 both of humidity, 16 pressure, 8
both temperatures, 4 status), `J1` puts an analog voltage (mV) before the status, `@` displays readings unasked, with
a text in the place of the status, and `S,16,1` ends every line with a check sum: hexadecimal digits and a C, behind a
comma or a blank. The manual does not tell how that is made, so it is read over, not checked.
"""

from __future__ import annotations

import re
from typing import Annotated, Final

import msgspec
from msgspec import Meta

from sensors.instruments.byte_stream import Pacer, StreamInstrument
from sensors.instruments.framing import LineFramer, number
from sensors.instruments.readings import co2_sample
from sensors.instruments.samples import InstrumentState, Quantity, Sample
from sensors.instruments.sba5_measurement import Measurement, measurement

BAUD: Final = 19200

_SEPARATORS = re.compile(r"[ ,\t]+")
_ECHO = re.compile(
    r"[!@MZ?]|OK|(?:[A-LN-VX-Y] ?-?\d+(?:\.\d+)?)|E[SML]|S(?:, ?\d+(?:\.\d+)?){2}|W[01]", re.ASCII
)
_CHECK_SUM = re.compile(r"[ ,]+[0-9A-Fa-f]{2,4}C$")
_BARE_CHECK_SUM = re.compile(r"(?<=[ ,]\d{2})[ ,]+[0-9A-Fa-f]{4}$|(?<=[ ,]\d)[ ,]+[0-9A-Fa-f]{4}$", re.ASCII)
_WHOLE_FORMAT: Final = 252
_STEADY: Final = 3
"""Lines in one unusual format before its readings count: a line that lost a field looks like another format once."""
_ANSWER_S: Final = 0.5
"""An answer that takes longer is not one to the last question."""
_ZERO_LOST_S: Final = 30.0
"""A zero reports every second: after this silence about it, its last line was lost."""


class Sba5Options(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    poll_hz: Annotated[float, Meta(gt=0.0, le=20.0)] = 10.0
    """How often a reading is asked for."""
    range_ppm: Annotated[float, Meta(gt=0.0)] = 100_000.0
    """The unit's range as ordered (1,000 to 100,000 ppm); readings at its end are saturated."""
    pump: bool = True
    zero_interval_min: Annotated[int, Meta(ge=0, le=9999)] = 120
    """Time between automatic zeros in flight; 0: never."""
    warm_zeros: Annotated[int, Meta(ge=0, le=10)] = 2
    """Zeros after a warm-up before its first reading counts, as the operators do it."""
    warm_zero_interval_min: Annotated[int, Meta(ge=1, le=60)] = 2
    """Time between those first zeros."""
    zero_at_start: bool = False
    """Zero on the first connection although the instrument is warm; it is blind for half a minute then."""


class Sba5(StreamInstrument):
    """The SBA-5's protocol. It asks for readings, and zeroes after a warm-up and then on a schedule."""

    def __init__(self, name: str, options: Sba5Options | None = None) -> None:
        super().__init__("sba5", name, Quantity.CO2, LineFramer(), silence_s=2.0)
        self.options = options or Sba5Options()
        self._pacer = Pacer(1.0 / self.options.poll_hz)
        self._asked_s: float | None = None
        self._state = InstrumentState.MEASURING
        self._zero_progress = ""
        self._zero_s = 0.0
        self._zeros_owed = 0
        self._zero_running = False
        self._zero_next_s = 0.0
        self._zero_at_start = self.options.zero_at_start
        self._unusual: tuple[bool, ...] = ()
        self._unusual_lines = 0
        self._ask_whole = False

    def _greeting(self, now_s: float) -> bytes:
        self._unusual, self._unusual_lines, self._ask_whole = (), 0, False
        self._zero_progress = ""
        if self._zero_at_start:
            self._zero_at_start = False
            self._zeros_owed, self._zero_next_s = max(1, self._zeros_owed), now_s
        pump = b"P1\r" if self.options.pump else b"P0\r"
        return b"!C2\r" + pump + f"A{self.options.zero_interval_min}\r".encode()

    def _request(self, now_s: float) -> bytes:
        if self._zeros_owed and not self._zero_running and self._state is not InstrumentState.WARMING:
            if now_s >= self._zero_next_s:
                self._zero_running, self._zero_s = True, now_s
                return b"Z"
        elif self._zero_running and now_s - self._zero_s > _ZERO_LOST_S:
            self._zero_running = False  # it never answered: ask again
        if self._ask_whole:
            self._ask_whole = False
            return f"F{_WHOLE_FORMAT}\r".encode()
        # While it warms or zeroes, readings are of no use: once a second keeps the line known to be alive.
        idle = self._state in (InstrumentState.WARMING, InstrumentState.ZEROING)
        if not self._pacer.due(now_s, 1.0 if idle else None):
            return b""
        self._asked_s = now_s
        return b"M"

    def _read(self, now_s: float, frame: bytes) -> Sample | None:
        text = _CHECK_SUM.sub("", frame.decode("ascii", "replace").strip("\0 \t"))
        if text.startswith("M"):
            text = _BARE_CHECK_SUM.sub("", text)
        fields = [f for f in _SEPARATORS.split(text) if f]
        if not fields or _ECHO.fullmatch(text):
            return None
        head, rest = fields[0], fields[1:]
        sample = None
        if head == "M":
            sample = self._measured(now_s, frame, rest)
        elif head == "Z":
            sample = self._zeroing(now_s, rest)
        elif head == "W":
            sample = self._warming(now_s, rest)
        if sample is None:
            return self._unknown(now_s, frame, "not an SBA-5 message")
        self._state = sample.state
        return sample

    def _warming(self, now_s: float, fields: list[str]) -> Sample | None:
        temperature_c = number(fields[0]) if len(fields) == 1 else None
        if temperature_c is None:
            return None
        self._zeros_owed, self._zero_running, self._zero_next_s = self.options.warm_zeros, False, now_s
        return self._sample(now_s, InstrumentState.WARMING, reason=f"warming up, {temperature_c:.1f} C")

    def _zeroing(self, now_s: float, fields: list[str]) -> Sample | None:
        if len(fields) != 3 or fields[1] != "of" or not (fields[0].isdecimal() and fields[2].isdecimal()):
            return None
        step, steps = int(fields[0][:6]), int(fields[2][:6])
        if not 0 <= step <= steps or not steps:
            return None
        self._zero_progress = f"zeroing {step} of {steps}" if step < steps else ""
        self._zero_s = now_s
        if step < steps:
            self._zero_running = True
        elif self._zero_running:
            self._zero_running = False
            self._zeros_owed = max(0, self._zeros_owed - 1)
            self._zero_next_s = now_s + 60.0 * self.options.warm_zero_interval_min
        return self._sample(now_s, InstrumentState.ZEROING, reason=f"zeroing {step} of {steps}")

    def _measured(self, now_s: float, frame: bytes, fields: list[str]) -> Sample | None:
        line = measurement(fields)
        if line is None:
            return None
        if not line.usual:
            unsteady = self._unsteady(now_s, frame, line)
            if unsteady is not None:
                return unsteady
        elif not line.plausible:
            # A line that lost some of its fields on the wire still has numbers, but in the wrong places.
            return self._unknown(now_s, frame, "implausible reading")
        else:
            self._unusual_lines = 0
        status, fault = line.status, line.fault
        if fault:
            return self._sample(now_s, InstrumentState.ERROR, status=status, reason=fault)
        if self._zero_progress and 0.0 <= now_s - self._zero_s < _ZERO_LOST_S:
            return self._sample(now_s, InstrumentState.ZEROING, status=status, reason=self._zero_progress)
        self._zero_progress = ""
        # It measures when it is asked; that its answer is read a tick later is no lag of the air.
        asked_s = self._asked_s
        made_s = asked_s if asked_s is not None and 0.0 <= now_s - asked_s < _ANSWER_S else now_s
        return co2_sample(
            made_s,
            self.name,
            line.ppm,
            range_ppm=self.options.range_ppm,
            status=status,
            pressure_pa=None if line.pressure_mb is None else line.pressure_mb * 100.0,
            temperature_c=line.temperature_c,
        )

    def _unsteady(self, now_s: float, frame: bytes, line: Measurement) -> Sample | None:
        """Why a line in another format is no reading yet; None once the format is known to be meant."""
        if line.form != self._unusual:
            self._unusual, self._unusual_lines = line.form, 0
            self._ask_whole = True
        self._unusual_lines += 1
        if not line.plausible or self._unusual_lines < _STEADY:
            what = f"some fields are missing, by its format (F{_WHOLE_FORMAT} sends all) or lost"
            return self._unknown(now_s, frame, what)
        return None
