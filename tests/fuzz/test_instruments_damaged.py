"""Damaged captures of every instrument: no exception, no number that was not sent as one, every byte told of."""

from __future__ import annotations

import functools
import math
import pathlib
import random
from collections.abc import Callable

import mutations
import numpy as np
import pytest
from pymavlink.dialects.v20 import common
from trial import run_cases

from sensors.instruments.registry import INSTRUMENTS, make_instrument
from sensors.instruments.samples import InstrumentState, Sample
from sensors.serial.captures import decode, usual_period_s
from simvehicle.instruments import EMULATORS, Air, make_emulator

DATA = pathlib.Path(__file__).parent.parent / "data"


def capture(kind: str) -> bytes:
    """Ten seconds of an emulated instrument, asked as it is in flight."""
    emulator, instrument = make_emulator(kind, np.random.default_rng(1)), make_instrument(kind)
    emulator.receive(0.0, instrument.connected(0.0))
    said = b""
    for tick in range(100):
        said += emulator.step(0.1 * tick, Air(co2_ppm=640.0, wind_body_mps=(3.0, -4.0, 0.5)))
        emulator.receive(0.1 * tick, instrument.poll(0.1 * tick)[0])
    return said


def relayed() -> bytes:
    """A real autopilot's stream, with CO2 among it as a script on the autopilot relays it."""
    sender = common.MAVLink(None, srcSystem=1, srcComponent=1)
    stream = (DATA / "arducopter-4.6.3-conversation.tlog").read_bytes()
    values = (common.MAVLink_named_value_float_message(n, b"CO2", 431.5 + n).pack(sender) for n in range(10))
    return b"".join(stream[100 * n : 100 * n + 100] + value for n, value in enumerate(values))


def check(sample: Sample, kind: str) -> None:
    assert math.isfinite(sample.time_s)
    assert sample.quantity is INSTRUMENTS[kind].quantity
    if sample.state is not InstrumentState.MEASURING:
        assert sample.co2_ppm is None
        assert sample.wind_body_mps is None
        assert sample.reason
        assert sample.reason.isprintable(), sample.reason
        return
    assert not sample.reason
    assert (sample.co2_ppm is None) != (sample.wind_body_mps is None)
    if sample.co2_ppm is not None:
        assert 0.0 <= sample.co2_ppm <= 1_000_000.0
    if sample.wind_body_mps is not None:
        assert math.hypot(*sample.wind_body_mps) <= 80.0
    for value in (sample.pressure_pa, sample.temperature_c):
        assert value is None or math.isfinite(value)


@functools.cache
def seeds(kind: str) -> tuple[bytes, ...]:
    files = {"li850": ["s01_li850_raw.txt"], "sba5": ["s14_sba5_checksum.txt"]}.get(kind, [])
    found = [(DATA / "cases" / name).read_bytes() for name in files if (DATA / "cases" / name).exists()]
    if kind in EMULATORS:
        found.append(capture(kind)[:2000])
    if kind == "mavlink":
        found.append(relayed())
    return tuple(found)


@pytest.mark.parametrize("kind", INSTRUMENTS)
def test_a_damaged_capture(kind: str, cases: int) -> None:
    extra: tuple[Callable[[random.Random, bytes], bytes], ...] = (mutations.tags,) if kind == "li850" else ()
    mutator = mutations.Mutator(kind, seeds(kind), (*mutations.BYTES, *extra))
    period_s = usual_period_s(INSTRUMENTS[kind])

    def read(data: bytes) -> str:
        samples = list(decode(make_instrument(kind), data, period_s))
        for sample in samples:
            check(sample, kind)
        return "readings" if any(s.state is InstrumentState.MEASURING for s in samples) else "none"

    outcomes = run_cases(cases, mutator.case, read)
    assert outcomes["readings"], "damage so great that nothing is left of a capture tries little"
