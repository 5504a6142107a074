"""Recordings of instruments: the raw bytes as they came, or one JSON object for each message."""

from __future__ import annotations

import json
import pathlib
from collections.abc import Iterable, Iterator
from typing import Any, Final

import msgspec

from sensors.instruments.registry import InstrumentType
from sensors.instruments.samples import Instrument, Sample
from sensors.instruments.sensor_error import SensorError
from sensors.serial.stamped_log import stamped_lines, without_marks

_PIECE_BYTES: Final = 256


def sample_fields(sample: Sample) -> dict[str, Any]:
    """A sample as JSON shows it: state, status and reason always, values only where they are valid."""
    fields: dict[str, Any] = {
        "time_s": round(sample.time_s, 4),
        "instrument": sample.instrument,
        "state": sample.state.value,
        "status": sample.status,
        "reason": sample.reason,
    }
    if sample.quantity is not None:
        fields["quantity"] = sample.quantity.value
    for name in ("co2_ppm", "wind_sd_mps", "pressure_pa", "temperature_c", "co2_at_least_ppm"):
        value = getattr(sample, name)
        if value is not None:
            fields[name] = round(value, 6)
    for name in ("wind_body_mps", "wind_ned_mps"):
        vector = getattr(sample, name)
        if vector is not None:
            fields[name] = [round(v, 6) for v in vector]
    if not sample.wind_down_measured:
        fields["wind_down_measured"] = False
    return fields


def sample_line(sample: Sample) -> str:
    return json.dumps(sample_fields(sample), ensure_ascii=False)


def read_bytes(path: pathlib.Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise SensorError(f"{path}: cannot be read: {error.strerror or error}") from error


def decode(instrument: Instrument, data: bytes, period_s: float) -> Iterator[Sample]:
    """Every message in a recorded byte stream, with the time of the terminal program that stamped its lines. A
    stream without stamps has no times: its messages are taken `period_s` apart."""
    stamped = stamped_lines(data)
    if stamped is not None:
        for time_s, line in stamped:
            yield from instrument.receive(time_s, line)
        yield from instrument.ended(stamped[-1][0])
        return
    count = 0
    for piece in (*_pieces(without_marks(data)), None):
        now_s = count * period_s
        for sample in instrument.ended(now_s) if piece is None else instrument.receive(now_s, piece):
            yield msgspec.structs.replace(sample, time_s=count * period_s)
            count += 1


def _pieces(data: bytes) -> Iterator[bytes]:
    """The stream cut after line ends and at most `_PIECE_BYTES` long, so that messages come one by one."""
    for line in data.splitlines(keepends=True):
        for begin in range(0, len(line), _PIECE_BYTES):
            yield line[begin : begin + _PIECE_BYTES]


def usual_period_s(entry: InstrumentType) -> float:
    """Time between two messages of this type as it is usually configured."""
    return entry.co2.period_s if entry.co2 is not None else 0.2


def read_samples(path: pathlib.Path) -> list[Sample]:
    """The samples in a file of JSON lines, as `read --json` and `decode --json` print them."""
    samples = []
    for number, line in enumerate(read_bytes(path).splitlines(), start=1):
        if not line.strip():
            continue
        try:
            samples.append(msgspec.json.decode(line, type=Sample))
        except msgspec.MsgspecError as error:
            raise SensorError(f"{path}:{number}: not a sample as `read --json` prints it: {error}") from error
    if not samples:
        raise SensorError(f"{path}: there are no samples in it")
    return samples


def is_json_lines(data: bytes) -> bool:
    return data.lstrip()[:1] == b"{"


def co2_series(samples: Iterable[Sample]) -> tuple[list[float], list[float]]:
    """Times (s) and readings (ppm) of the valid CO2 samples, times rising."""
    pairs = sorted((s.time_s, s.co2_ppm) for s in samples if s.co2_ppm is not None)
    return [t for t, _ in pairs], [v for _, v in pairs]
