"""LI-COR LI-850 CO2/H2O gas analyser (and its relatives LI-820, LI-830 and LI-840 of the same grammar).

Serial 9600 8N1 (LI-COR support pages "LI-830 and LI-850: Configuration grammar" and "Element descriptions",
2023). The analyser streams one XML-like element for each record, names in either case, numbers as floats with
exponents:

    <li850><data><celltemp>5.1e1</celltemp><cellpres>8.3e1</cellpres><co2>4.2e2</co2>…</data></li850>

CO2 in ppm, cell temperature in C, cell pressure in kPa. Which values it sends is configured under `<rs232>`;
`<ack>` answers a command and `<error>` carries a message. The cell is heated to about 51 C; readings of a
cold cell are warm-up.
"""

from __future__ import annotations

import re
from typing import Annotated, Final

import msgspec
from msgspec import Meta

from sensors.instruments.byte_stream import StreamInstrument
from sensors.instruments.readings import co2_sample
from sensors.instruments.samples import InstrumentState, Quantity, Sample

BAUD: Final = 9600

_RECORD_LIMIT: Final = 4096
_OPEN: Final = re.compile(rb"<li8[2345]0>", re.IGNORECASE)
_CLOSE: Final = re.compile(rb"</li8[2345]0>", re.IGNORECASE)
_OPEN_BYTES: Final = len(b"<li850>")
_LEAF: Final = re.compile(r"<([a-z0-9]+)>([^<>]{0,200})</\1>")
_NUMBER: Final = re.compile(r"[+-]?\d{1,8}(?:\.\d{0,12})?(?:e[+-]?\d{1,2})?", re.ASCII)


class Li850Options(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    range_ppm: Annotated[float, Meta(gt=0.0)] = 20_000.0
    warm_cell_c: Annotated[float, Meta(ge=0.0, le=60.0)] = 48.0
    """Below this cell temperature the readings are warm-up; 0: never."""
    configure: bool = True
    """Ask for two records a second with CO2, cell temperature and pressure on connection."""


class RecordFramer:
    """Records from their opening to their closing tag; line ends mean nothing."""

    def __init__(self) -> None:
        self._buffer = b""
        self._noise = 0

    def clear(self) -> None:
        self._buffer = b""
        self._noise = 0

    def feed(self, data: bytes) -> list[bytes | None]:
        found: list[bytes | None] = []
        self._buffer += data
        while True:
            begin = _OPEN.search(self._buffer)
            if begin is None:
                keep = self._possible_beginning()
                self._drop(len(self._buffer) - keep, found)
                return found
            self._drop(begin.start(), found)
            end = _CLOSE.search(self._buffer)
            second = _OPEN.search(self._buffer, _OPEN_BYTES)
            stops = [m.end() for m in (end,) if m] + [m.start() for m in (second,) if m]
            stop = min(stops, default=len(self._buffer))
            if stop > _RECORD_LIMIT:
                found.append(None)
                self._buffer = self._buffer[_OPEN_BYTES:]
            elif not stops:
                return found
            elif end is not None and end.end() == stop:
                self._noise = 0
                found.append(self._buffer[:stop])
                self._buffer = self._buffer[stop:]
            else:
                found.append(None)  # its end was lost, and another record begins
                self._buffer = self._buffer[stop:]

    def end(self) -> list[bytes | None]:
        found: list[bytes | None] = [None] if self._noise or self._buffer.strip() else []
        self.clear()
        return found

    def _possible_beginning(self) -> int:
        """How many bytes at the end of the buffer may be the beginning of an opening tag."""
        for count in range(min(_OPEN_BYTES - 1, len(self._buffer)), 0, -1):
            tail = self._buffer[-count:].lower()
            if all(
                c in choice for c, choice in zip(tail, (b"<", b"l", b"i", b"8", b"2345", b"0"), strict=False)
            ):
                return count
        return 0

    def _drop(self, count: int, found: list[bytes | None]) -> None:
        """Bytes outside of any record; told once per 256 of them, blanks and line ends not counted."""
        for byte in self._buffer[:count]:
            if byte not in b" \t\r\n\0":
                self._noise += 1
                if self._noise == 256:
                    self._noise = 0
                    found.append(None)
        self._buffer = self._buffer[count:]


class Li850(StreamInstrument):
    def __init__(self, name: str, options: Li850Options | None = None) -> None:
        super().__init__("li850", name, Quantity.CO2, RecordFramer(), silence_s=5.0)
        self.options = options or Li850Options()

    def _greeting(self, now_s: float) -> bytes:  # noqa: ARG002
        if not self.options.configure:
            return b""
        return (
            b"<LI850><CFG><OUTRATE>0.5</OUTRATE></CFG></LI850>\n"
            b"<LI850><RS232><CO2>TRUE</CO2><CELLTEMP>TRUE</CELLTEMP><CELLPRES>TRUE</CELLPRES></RS232></LI850>\n"
        )

    def _read(self, now_s: float, frame: bytes) -> Sample | None:
        text = frame.decode("ascii", "replace").lower()
        leaves = {name: value.strip() for name, value in _LEAF.findall(text)}
        if "error" in leaves:
            return self._sample(now_s, InstrumentState.ERROR, reason=f"it says: {leaves['error'][:80]}")
        if "<data>" not in text:
            return None  # acknowledgements, configuration, version
        if "</data>" not in text or len(_LEAF.findall(text)) != len(leaves):
            return self._unknown(now_s, frame, "a damaged record")
        values = {name: _float(leaves[name]) for name in ("co2", "celltemp", "cellpres") if name in leaves}
        if None in values.values():
            return self._unknown(now_s, frame, "a damaged record")
        if "co2" not in values:
            reason = "it does not send CO2: switch it on in its RS-232 output"
            return self._sample(now_s, InstrumentState.ERROR, reason=reason)
        cell_c, pressure_kpa = values.get("celltemp"), values.get("cellpres")
        if cell_c is not None and cell_c < self.options.warm_cell_c:
            return self._sample(now_s, InstrumentState.WARMING, reason=f"warming up, cell at {cell_c:.1f} C")
        return co2_sample(
            now_s,
            self.name,
            values["co2"] or 0.0,
            range_ppm=self.options.range_ppm,
            pressure_pa=None if pressure_kpa is None else pressure_kpa * 1000.0,
            temperature_c=cell_c,
        )


def _float(text: str) -> float | None:
    return float(text) if _NUMBER.fullmatch(text) else None
