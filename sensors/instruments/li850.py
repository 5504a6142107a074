"""LI-COR LI-850 CO2/H2O gas analyser (and its relatives LI-820, LI-830 and LI-840 of the same grammar).

Serial 9600 8N1 (LI-COR support pages "LI-830 and LI-850: Configuration grammar" and "Element descriptions",
2023). The analyser streams one XML-like element for each record, names in either case, numbers as floats with
exponents:

    <li850><data><celltemp>5.1e1</celltemp><cellpres>8.3e1</cellpres><co2>4.2e2</co2>…</data></li850>

CO2 in ppm, cell temperature in C, cell pressure in kPa. Which values it sends is configured under `<rs232>`;
`<ack>` answers a command and `<error>` carries a message. With RAW on, `<raw>` holds the detectors' counts: two
numbers (LI-820), or elements with the names of the readings (LI-830 to LI-850). With STRIP on there are values
without their names, which on connection is switched off, as ECHO is. The cell is heated to about 51 C; readings of
a cold cell are warm-up.
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
_PIECE: Final = re.compile(r"<(/?)([a-z0-9_]+)>|([^<>]+)|(.)", re.DOTALL)
_STRIPPED: Final = re.compile(rb"[-+0-9.eE,; \t\r\n]+")
_NUMBER: Final = re.compile(r"[+-]?\d{1,8}(?:\.\d{0,12})?(?:e[+-]?\d{1,2})?", re.ASCII)


class Li850Options(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    range_ppm: Annotated[float, Meta(gt=0.0)] = 20_000.0
    warm_cell_c: Annotated[float, Meta(ge=0.0, le=60.0)] = 48.0
    """Below this cell temperature the readings are warm-up; 0: never."""
    configure: bool = True
    """Ask for two records a second with CO2, cell temperature and pressure on connection."""


class RecordFramer:
    """Records from their opening to their closing tag; line ends mean nothing. What is outside of any record comes in
    pieces of 256 bytes, blanks and line ends not counted."""

    def __init__(self) -> None:
        self._buffer = b""
        self._noise = 0
        self._outside = bytearray()

    def clear(self) -> None:
        self._buffer = b""
        self._forget()

    def _forget(self) -> None:
        self._noise = 0
        self._outside.clear()

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
                self._forget()
                found.append(self._buffer[:stop])
                self._buffer = self._buffer[stop:]
            else:
                found.append(None)  # its end was lost, and another record begins
                self._buffer = self._buffer[stop:]

    def end(self) -> list[bytes | None]:
        outside = bytes(self._outside + self._buffer)
        found: list[bytes | None] = (
            [None if _OPEN.match(outside) else outside] if outside.strip(b" \t\r\n\0") else []
        )
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
        for byte in self._buffer[:count]:
            if byte in b" \t\r\n\0":
                if self._outside[-1:] != b" ":
                    self._outside += b" "
                continue
            self._outside.append(byte)
            self._noise += 1
            if self._noise == 256:
                found.append(bytes(self._outside))
                self._forget()
        self._buffer = self._buffer[count:]


class Li850(StreamInstrument):
    def __init__(self, name: str, options: Li850Options | None = None) -> None:
        super().__init__("li850", name, Quantity.CO2, RecordFramer(), silence_s=5.0)
        self.options = options or Li850Options()
        self._model = "LI850"
        self._greeted = self._model

    def _greeting(self, now_s: float) -> bytes:  # noqa: ARG002
        self._greeted = self._model
        if not self.options.configure:
            return b""
        # One record a setting: what a model does not know refuses the whole record.
        settings = (
            "<CFG><OUTRATE>0.5</OUTRATE></CFG>",
            "<RS232><CO2>TRUE</CO2><CELLTEMP>TRUE</CELLTEMP><CELLPRES>TRUE</CELLPRES></RS232>",
            "<RS232><STRIP>FALSE</STRIP></RS232>",
            "<RS232><ECHO>FALSE</ECHO></RS232>",
        )
        return "".join(f"<{self._model}>{setting}</{self._model}>\n" for setting in settings).encode()

    def _request(self, now_s: float) -> bytes:
        """Each model answers to its own name only."""
        return b"" if self._model == self._greeted else self._greeting(now_s)

    def _read(self, now_s: float, frame: bytes) -> Sample | None:
        if not _OPEN.match(frame):
            if not _STRIPPED.fullmatch(frame):
                return self._noise(now_s)
            reason = "it sends values without their names: switch its STRIP off (<RS232><STRIP>FALSE</STRIP></RS232>)"
            return self._sample(now_s, InstrumentState.ERROR, reason=reason)
        text = frame.decode("ascii", "replace").lower()
        leaves = _leaves(text)
        if leaves is None:
            if "<data>" not in text and "<error>" not in text:
                return None  # a setting
            return self._unknown(now_s, frame, "a damaged record")
        error = next((said for path, said in leaves.items() if path[-1] == "error" and said), "")
        if error:
            return self._sample(now_s, InstrumentState.ERROR, reason=f"it says: {error[:80]}")
        model = text[1 : _OPEN_BYTES - 1].upper()
        data = {path[2]: said for path, said in leaves.items() if path[1:2] == ("data",) and len(path) == 3}
        if not data:
            return None  # acknowledgements, configuration, version, a question by somebody else
        self._model = model
        values = {name: _float(data[name]) for name in ("co2", "celltemp", "cellpres") if name in data}
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


def _leaves(text: str) -> dict[tuple[str, ...], str] | None:
    """The texts of a record's innermost elements by the names of all elements around them; None if it is damaged."""
    open_: list[str] = []
    leaves: dict[tuple[str, ...], str] = {}
    said: str | None = None
    """What stands behind the last opening tag; None behind a closing one."""
    for closing, name, words, stray in _PIECE.findall(text):
        if stray:
            return None
        if words:
            if said is not None:
                said = words.strip()
            elif words.strip():
                return None  # text between elements
        elif not closing:
            if said:
                return None
            open_.append(name)
            said = ""
        else:
            path = tuple(open_)
            if not path or path[-1] != name or path in leaves:
                return None
            if said is not None:
                leaves[path] = said
            open_.pop()
            said = None
    return None if open_ else leaves


def _float(text: str) -> float | None:
    return float(text) if _NUMBER.fullmatch(text) else None
