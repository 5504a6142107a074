"""What every instrument promises, whatever its make: `sensors.instruments.samples.Instrument`."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sensors.instruments.registry import INSTRUMENTS, make_instrument
from sensors.instruments.samples import Instrument, InstrumentState, Quantity, Sample
from simvehicle.instruments import EMULATORS, Air, make_emulator

AIR = Air(co2_ppm=642.0, wind_body_mps=(3.0, -4.0, 0.5))
FRAGMENTS = (
    b"M 50885 48094 500.96 55.0 0.0 0.0 829 55.0 55.0 00\r\n",
    b"Z,1 of 25\r\n",
    b"Z,25 of 25\r\n",
    b"W,50.0\r\n",
    bytes.fromhex("FE0408000000000000038896"),
    bytes.fromhex("FE040203880000"),
    b" Z 00450 z 00448\r\n",
    b" . 00010\r\n",
    b"<li850><data><celltemp>5.1e1</celltemp><co2>4.2e2</co2></data></li850>",
    b"</li850><LI8",
    b"S 05.02 S2 05.00 D 217 U 03.01 V 03.99 W 00.50\r\n",
    b"$WI,WVP=020.0,045,0*73\r\n",
    b"\x02Q,229,002.74,M,00,\x0316\r\n",
    b"$WIMWV,045,R,020.0,M,A*3D\r\n",
    b"\r",
    b"\n",
    b"\xfd\x12\x00\x00",
    b"nan inf -1e9",
)

streams = st.lists(
    st.one_of(st.binary(max_size=40), st.sampled_from(FRAGMENTS), st.just(b"\x55" * 600)), max_size=8
).map(b"".join)


def check(sample: Sample, instrument: Instrument) -> None:
    """No sample is ever without a meaning."""
    assert sample.instrument == instrument.name
    assert sample.quantity is INSTRUMENTS[instrument.kind].quantity
    values = (sample.co2_ppm, sample.wind_body_mps, sample.wind_ned_mps)
    if sample.state is not InstrumentState.MEASURING:
        assert values == (None, None, None)
        assert sample.reason
        return
    assert not sample.reason
    assert sum(v is not None for v in values) == 1
    if sample.co2_ppm is not None:
        assert 0.0 <= sample.co2_ppm <= 1_000_000.0
    if sample.wind_body_mps is not None:
        assert all(math.isfinite(v) for v in sample.wind_body_mps)
        assert math.hypot(*sample.wind_body_mps) <= 80.0
        assert sample.wind_sd_mps is not None
        assert sample.wind_sd_mps > 0.0


@pytest.mark.parametrize("kind", INSTRUMENTS)
@settings(max_examples=60, deadline=None)
@given(stream=streams, cuts=st.lists(st.integers(0, 2000), max_size=6))
def test_any_bytes_in_any_chunking(kind: str, stream: bytes, cuts: list[int]) -> None:
    whole, pieces = make_instrument(kind), make_instrument(kind)
    expected = whole.receive(1.0, stream) + whole.ended(1.0)
    edges = [0, *sorted(min(c, len(stream)) for c in cuts), len(stream)]
    found = [s for a, b in itertools.pairwise(edges) for s in pieces.receive(1.0, stream[a:b])]
    found += pieces.ended(1.0)
    assert found == expected
    for sample in found:
        check(sample, pieces)


@pytest.mark.parametrize("kind", INSTRUMENTS)
@settings(max_examples=30, deadline=None)
@given(times=st.lists(st.floats(-1e3, 1e6), min_size=1, max_size=12))
def test_clock_jumps_do_no_harm(kind: str, times: list[float]) -> None:
    instrument = make_instrument(kind)
    instrument.connected(0.0)
    for now_s in times:
        instrument.receive(now_s, b"W,50.0\r\nZ,1 of 25\r\n Z 00450\r\n")
        _, late = instrument.poll(now_s)
        for sample in late:
            check(sample, instrument)


@pytest.mark.parametrize("kind", INSTRUMENTS)
def test_unplugging_is_a_state_with_a_reason(kind: str) -> None:
    instrument = make_instrument(kind, "mine")
    (sample,) = instrument.disconnected(4.0, "unplugged")
    assert (sample.time_s, sample.state, sample.reason) == (4.0, InstrumentState.SILENT, "unplugged")
    assert instrument.poll(100.0) == (b"", []), "a closed port is neither asked nor missed"


@pytest.mark.parametrize("kind", INSTRUMENTS)
def test_plugging_in_forgets_half_a_message(kind: str) -> None:
    instrument = make_instrument(kind)
    instrument.receive(0.0, b"M 50885 48094 5")
    instrument.connected(1.0)
    samples = instrument.receive(1.0, b"00.96 55.0 0.0 0.0 829 55.0 55.0 00\r\n")
    assert all(s.state is not InstrumentState.MEASURING for s in samples)


@pytest.mark.parametrize("kind", EMULATORS)
def test_emulator_and_protocol_understand_each_other(kind: str) -> None:
    """A minute on the line: nothing but readings, near the truth, and silence is told when the line goes
    quiet."""
    emulator, instrument = make_emulator(kind, np.random.default_rng(5)), make_instrument(kind)
    emulator.receive(0.0, instrument.connected(0.0))
    samples: list[Sample] = []
    for tick in range(600):
        now_s = 0.1 * tick
        samples += instrument.receive(now_s, emulator.step(now_s, AIR))
        request, late = instrument.poll(now_s)
        emulator.receive(now_s, request)
        samples += late
    assert len(samples) > 25
    for sample in samples:
        check(sample, instrument)
    measured = [s for s in samples if s.state is InstrumentState.MEASURING]
    assert len(measured) >= len(samples) - 2, "at most the multiplier was waited for"
    if INSTRUMENTS[kind].quantity is Quantity.CO2:
        mean_ppm = float(np.mean([s.co2_ppm for s in measured]))
        assert mean_ppm == pytest.approx(642.0, abs=25.0)
    else:
        forward, right, _ = np.mean([s.wind_body_mps for s in measured], axis=0)
        assert (forward, right) == pytest.approx((3.0, -4.0), abs=0.5)
    quiet = [s for tick in range(600, 1000) for s in instrument.poll(0.1 * tick)[1]]
    assert quiet[0].state is InstrumentState.SILENT
