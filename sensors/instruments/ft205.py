"""FT Technologies FT205 acoustic-resonance wind sensor (and FT702, FT722, FT742 of the same protocol).

Serial 9600 8N1 as delivered, ASCII (FT Technologies, "FT205EV Wind Sensors User Manual", sections 5.5, 6.4.9
and 6.4.29). Messages are `$<id>,<fields>*<check sum>` CR LF, the check sum is the exclusive or of what stands
between $ and *; the host may write // for the identifier ("any sensor") and for the check sum ("not
checked"). `WV?` asks for the wind velocity, answered in one of three formats:

* polar `$WI,WVP=<speed m/s>,<angle>,<status>*hh`
* combined `$WI,WVC=<speed>,<angle>,<status>,<acoustic temperature>,C,<A or V>*hh`, by its text also with the
  head WVP; A or V is the temperature's status
* NMEA 0183 `$WIMWV,<angle>,R,<speed>,<unit>,<A or V>*hh`

The angle is where the wind comes from, against the sensor's datum. Status 0 is good, 1 an error, 2 overspeed.
"""

from __future__ import annotations

from typing import Annotated, Final

from msgspec import Meta

from sensors.instruments.anemometers import Mounting, towards, wind_sample
from sensors.instruments.byte_stream import Pacer, StreamInstrument
from sensors.instruments.framing import LineFramer, number
from sensors.instruments.nmea import mwv, sentence
from sensors.instruments.samples import InstrumentState, Quantity, Sample

BAUD: Final = 9600
RANGE_MPS: Final = 75.0
SD_MPS: Final = 0.27

STATUS: Final = {"1": "the sensor reports an error", "2": "overspeed: wind above its range"}
_ASK: Final = b"$//,WV?*//\r\n"


class Ft205Options(Mounting, frozen=True, forbid_unknown_fields=True, kw_only=True):
    poll_hz: Annotated[float, Meta(gt=0.0, le=10.0)] = 5.0
    """How often the wind is asked for; its own measuring rate is 10 Hz."""


class Ft205(StreamInstrument):
    def __init__(self, name: str, options: Ft205Options | None = None) -> None:
        self.options = options or Ft205Options()
        super().__init__("ft205", name, Quantity.WIND, LineFramer(), max(3.0, 3.0 / self.options.poll_hz))
        self._pacer = Pacer(1.0 / self.options.poll_hz)

    def _request(self, now_s: float) -> bytes:
        return _ASK if self._pacer.due(now_s) else b""

    def _read(self, now_s: float, frame: bytes) -> Sample | None:
        if frame.strip().endswith(b"*//"):
            return None  # our own request, through an echoing adapter
        fields = sentence(frame)
        if fields is None:
            return self._unknown(now_s, frame, "not an FT205 message, or its check sum is wrong")
        if fields[0].endswith("MWV"):
            return self._mwv(now_s, frame, fields)
        if len(fields) < 2 or fields[1].startswith("WV?"):
            return None
        head, separator, speed = fields[1].partition("=")
        if not separator or head not in ("WVP", "WVC"):
            return None  # the answer to a setting
        speed_mps, from_deg = number(speed), number(fields[2]) if len(fields) in (4, 7) else None
        if speed_mps is None or speed_mps < 0.0 or from_deg is None or not 0.0 <= from_deg < 360.0:
            return self._unknown(now_s, frame, "not an FT205 wind message")
        status = fields[3]
        if status != "0":
            reason = STATUS.get(status, f"unknown status {status}")
            return self._sample(now_s, InstrumentState.ERROR, status=status[:8], reason=reason)
        temperature_c = None
        if len(fields) == 7 and fields[5] == "C":
            # The manual's text calls A "acquiring" and its examples show A in running sensors: taken as
            # valid.
            temperature_c = number(fields[4])
        return self._wind(now_s, speed_mps, from_deg, status, temperature_c)

    def _mwv(self, now_s: float, frame: bytes, fields: list[str]) -> Sample:
        found = mwv(fields)
        if found is None:
            return self._unknown(now_s, frame, "not a wind sentence")
        if isinstance(found, str):
            return self._sample(now_s, InstrumentState.ERROR, status=fields[-1][:8], reason=found)
        return self._wind(now_s, *found, None)

    def _wind(
        self, now_s: float, speed_mps: float, from_deg: float, status: str, temperature_c: float | None
    ) -> Sample:
        return wind_sample(
            now_s,
            self.name,
            *towards(speed_mps, from_deg),
            None,
            mounting=self.options,
            sd_mps=SD_MPS,
            range_mps=RANGE_MPS,
            status=status,
            temperature_c=temperature_c,
        )
