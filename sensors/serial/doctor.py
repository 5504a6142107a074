"""Which instrument is on which port, and why the others are not heard."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Final

from sensors.instruments.framing import printable
from sensors.instruments.registry import INSTRUMENTS, InstrumentType, make_instrument
from sensors.instruments.samples import Instrument, InstrumentState, Sample
from sensors.instruments.sensor_error import SensorError
from sensors.serial.port import InstrumentPort

_OPEN_S: Final = 6.0
_TELLING: Final = (InstrumentState.MEASURING, InstrumentState.WARMING, InstrumentState.ZEROING)


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """What one port gave."""

    port: str
    type_name: str | None
    """The instrument that answers; None: none does."""
    baud: int | None
    detail: str
    """What it says, or why nobody answers."""


def serial_ports() -> list[str]:
    """The serial devices of this machine that have hardware behind them."""
    from serial.tools import list_ports

    return sorted(p.device for p in list_ports.comports() if p.hwid != "n/a")


def diagnose(
    port: str,
    types: Sequence[str] | None = None,
    listen_s: float = 2.5,
    now_s: Callable[[], float] = time.monotonic,
    pause: Callable[[float], None] = time.sleep,
) -> Diagnosis:
    """Listen and ask on one port, at every baud rate that an instrument of `types` (None: all) uses.

    Only questions that no instrument takes for a command are asked; nothing is configured or zeroed.
    """
    heard: list[str] = []
    for baud, entries in _by_baud(types):
        outcome = _try_rate(port, baud, entries, listen_s, now_s, pause)
        if isinstance(outcome, Diagnosis):
            return outcome
        heard.append(outcome)
    if not heard:
        raise SensorError("none of these types has a serial line")
    loud = [text for text in heard if not text.endswith("silent")]
    return Diagnosis(
        port, None, None, "; ".join(loud) if loud else "silent at every rate: powered, wired crosswise?"
    )


def _by_baud(types: Sequence[str] | None) -> Iterator[tuple[int, list[InstrumentType]]]:
    rates: dict[int, list[InstrumentType]] = {}
    for entry in INSTRUMENTS.values():
        if entry.baud is not None and (types is None or entry.name in types):
            rates.setdefault(entry.baud, []).append(entry)
    yield from sorted(rates.items())


def _try_rate(
    port_name: str,
    baud: int,
    entries: list[InstrumentType],
    listen_s: float,
    now_s: Callable[[], float],
    pause: Callable[[float], None],
) -> Diagnosis | str:
    """Whoever answers at this rate; or in words what was heard."""
    port = InstrumentPort(port_name, baud, now_s)
    try:
        failure = _wait_open(port, now_s, pause)
        if failure:
            return Diagnosis(port_name, None, None, failure)
        heard = b""
        # First only listen: half of the makes talk by themselves. Then ask each of the others in turn.
        askers = [e for e in entries if _asks(e)]
        for asked in (None, *askers):
            answer = _listen(
                port, entries if asked is None else [asked], asked is not None, listen_s, now_s, pause
            )
            if isinstance(answer, tuple):
                entry, sample = answer
                told = sample.reason or f"{sample.state.value}: {_value(sample)}"
                return Diagnosis(port_name, entry.name, baud, told)
            heard += answer
        return (
            f"{baud} baud: {len(heard)} bytes that no instrument sends, {printable(heard)}"
            if heard
            else f"{baud} silent"
        )
    finally:
        port.close()


def _wait_open(port: InstrumentPort, now_s: Callable[[], float], pause: Callable[[float], None]) -> str:
    begin_s = now_s()
    while now_s() - begin_s < _OPEN_S:
        port.read()
        for event in port.events():
            return "" if event.connected else event.reason
        pause(0.02)
    return f"{port.port}: cannot be opened within {_OPEN_S:.0f} s"


def _asks(entry: InstrumentType) -> bool:
    instrument = make_instrument(entry.name)
    instrument.connected(0.0)
    return bool(instrument.poll(1.0)[0])


def _listen(
    port: InstrumentPort,
    entries: list[InstrumentType],
    ask: bool,
    listen_s: float,
    now_s: Callable[[], float],
    pause: Callable[[float], None],
) -> tuple[InstrumentType, Sample] | bytes:
    """The first two messages in a row that one of these instruments understands; else what was heard."""
    instruments: dict[str, Instrument] = {e.name: make_instrument(e.name) for e in entries}
    understood = dict.fromkeys(instruments, 0)
    for instrument in instruments.values():
        instrument.connected(now_s())  # its greeting is not sent: it would configure whatever is there
    heard = b""
    begin_s = now_s()
    while now_s() - begin_s < listen_s:
        data = port.read()
        heard += data
        for entry in entries:
            instrument = instruments[entry.name]
            for sample in instrument.receive(now_s(), data):
                telling = sample.state in _TELLING or bool(sample.status)
                understood[entry.name] = understood[entry.name] + 1 if telling else 0
                if understood[entry.name] >= 2:
                    return entry, sample
            if ask:
                port.write(instrument.poll(now_s())[0])
        pause(0.02)
    return heard


def _value(sample: Sample) -> str:
    if sample.co2_ppm is not None:
        return f"{sample.co2_ppm:g} ppm"
    if sample.wind_body_mps is not None:
        return "{:.2f}, {:.2f}, {:.2f} m/s forward, right, down".format(*sample.wind_body_mps)
    return f"status {sample.status}"
