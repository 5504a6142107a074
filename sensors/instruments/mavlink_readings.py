"""CO2 readings that the autopilot relays as MAVLink NAMED_VALUE_FLOAT (MAVLink common message 251).

An instrument behind the autopilot, read by a script there, has no serial line of ours: its readings arrive on
the autopilot's link, and the agent hands their values over. For recordings, the byte stream of the link
itself can be read too (a `.tlog` included: what is between the frames is skipped).
"""

from __future__ import annotations

from typing import Annotated, Any, Final

import msgspec
from msgspec import Meta

from sensors.instruments.readings import co2_sample
from sensors.instruments.samples import InstrumentState, Quantity, Sample

_SILENCE_S: Final = 3.0


class MavlinkOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    value: Annotated[str, Meta(max_length=10)] = "CO2"
    """Name in the messages, at most ten characters, upper or lower case."""
    range_ppm: Annotated[float, Meta(gt=0.0)] = 100_000.0


class MavlinkReadings:
    """The instrument whose readings come in NAMED_VALUE_FLOAT messages."""

    kind = "mavlink"

    def __init__(self, name: str, options: MavlinkOptions | None = None) -> None:
        self.name = name
        self.options = options or MavlinkOptions()
        self._parser: Any = None
        self._heard_s: float | None = None

    def connected(self, now_s: float) -> bytes:
        self._heard_s, self._parser = now_s, None
        return b""

    def disconnected(self, now_s: float, reason: str) -> list[Sample]:
        self._heard_s = self._parser = None
        return [self._without_value(now_s, InstrumentState.SILENT, reason)]

    def reading(self, now_s: float, value_ppm: float) -> Sample:
        """One value that the autopilot relayed, checked like any other reading."""
        self._heard_s = now_s
        return co2_sample(now_s, self.name, value_ppm, range_ppm=self.options.range_ppm)

    def receive(self, now_s: float, data: bytes) -> list[Sample]:
        if self._parser is None:
            # Imported late: the dialect is large, and only recordings are read this way.
            from pymavlink.dialects.v20 import common

            self._parser = common.MAVLink(None)
            self._parser.robust_parsing = True
        return [
            self.reading(now_s, float(message.value))
            for message in self._parser.parse_buffer(data) or []
            if message.get_type() == "NAMED_VALUE_FLOAT" and self._is_ours(message.name)
        ]

    def ended(self, now_s: float) -> list[Sample]:  # noqa: ARG002 (half a frame says nothing)
        return []

    def poll(self, now_s: float) -> tuple[bytes, list[Sample]]:
        if self._heard_s is None or 0.0 <= now_s - self._heard_s < _SILENCE_S:
            return b"", []
        reason = f"the autopilot has not relayed {self.options.value} for {_SILENCE_S:.0f} s"
        self._heard_s = now_s
        return b"", [self._without_value(now_s, InstrumentState.SILENT, reason)]

    def _is_ours(self, name: str | bytes) -> bool:
        text = name.decode("ascii", "replace") if isinstance(name, bytes) else name
        return text.rstrip("\0").casefold() == self.options.value.casefold()

    def _without_value(self, now_s: float, state: InstrumentState, reason: str) -> Sample:
        return Sample(now_s, self.name, state, reason=reason, quantity=Quantity.CO2)
