"""Emulated instruments: lag, noise, rounding, range, warm-up and zeroing, as the real ones have them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sensors.instruments.checksums import modbus_crc
from sensors.instruments.registry import make_instrument
from sensors.instruments.samples import InstrumentState, Sample
from sensors.instruments.sensor_error import SensorError
from simvehicle.instruments import Air, make_emulator


def converse(kind: str, seconds: float, air_at: object = None, **options: object) -> list[Sample]:
    """An agent's side and an emulator's, ten times a second."""
    emulator, instrument = make_emulator(kind, np.random.default_rng(1), **options), make_instrument(kind)
    emulator.receive(0.0, instrument.connected(0.0))
    samples: list[Sample] = []
    for tick in range(round(10 * seconds)):
        now_s = 0.1 * tick
        air = air_at(now_s) if callable(air_at) else Air()
        samples += instrument.receive(now_s, emulator.step(now_s, air))
        request, late = instrument.poll(now_s)
        emulator.receive(now_s, request)
        samples += late
    return samples


def states(samples: list[Sample]) -> list[InstrumentState]:
    """States in their order, repetitions left out."""
    found: list[InstrumentState] = []
    for sample in samples:
        if not found or found[-1] is not sample.state:
            found.append(sample.state)
    return found


def test_sba5_warms_up_zeroes_itself_and_once_more_as_the_operators_do() -> None:
    samples = converse("sba5", 220.0, warm_up_s=10.0)
    warming, zeroing, measuring = InstrumentState.WARMING, InstrumentState.ZEROING, InstrumentState.MEASURING
    assert states(samples) == [warming, zeroing, measuring, zeroing, measuring]
    assert len([s for s in samples if s.state is zeroing]) >= 50


def test_sba5_zeroes_on_its_schedule() -> None:
    emulator = make_emulator("sba5", np.random.default_rng(1))
    emulator.receive(0.0, b"!A1\r")
    said = b"".join(emulator.step(float(second), Air()) for second in range(100))
    assert said.startswith(b"A1\r\nOK\r\n")
    assert said.count(b" of 25\r\n") == 25


@pytest.mark.parametrize(("kind", "lag_s"), [("sba5", 1.5), ("li850", 1.5), ("sprintir", 0.5)])
def test_the_reading_trails_a_step_by_its_lag(kind: str, lag_s: float) -> None:
    step = 8000.0
    samples = converse(kind, 30.0, lambda now_s: Air(co2_ppm=420.0 + (step if now_s >= 10.0 else 0.0)))
    at_lag = [s.co2_ppm for s in samples if s.co2_ppm is not None and abs(s.time_s - 10.0 - lag_s) <= 0.3]
    expected = 420.0 + step * (1.0 - math.exp(-1.0))
    assert min(at_lag) - 0.25 * step < expected < max(at_lag) + 0.25 * step
    last = [s.co2_ppm for s in samples if s.co2_ppm is not None][-1]
    assert last == pytest.approx(420.0 + step, rel=0.03)


@pytest.mark.parametrize("kind", ["sba5", "k30", "cozir", "li850"])
def test_the_end_of_the_range_is_told(kind: str) -> None:
    options = {"lag_s": 0.1} | ({"range_ppm": 100_000.0} if kind == "sba5" else {})
    samples = converse(kind, 20.0, lambda _: Air(co2_ppm=500_000.0), **options)
    assert samples[-1].state is InstrumentState.ERROR
    assert samples[-1].co2_at_least_ppm is not None


def test_k30_warms_up_and_repeats_itself_between_measurements() -> None:
    samples = converse("k30", 20.0, warm_up_s=8.0)
    assert states(samples) == [InstrumentState.ERROR, InstrumentState.MEASURING]
    emulator = make_emulator("k30", np.random.default_rng(1))
    request = bytes.fromhex("FE0400000004E5C6")
    said = []
    for tick in range(10):
        emulator.receive(0.1 * tick, request)
        said.append(emulator.step(0.1 * tick, Air()))
    assert len(set(said)) == 1
    read_holding = bytes.fromhex("FE0300000001")
    emulator.receive(1.0, read_holding + modbus_crc(read_holding))
    assert emulator.step(1.0, Air())[:3] == bytes.fromhex("FE8301"), "a function that it does not have"


def test_li850_warms_its_cell() -> None:
    assert states(converse("li850", 30.0, warm_up_s=15.0)) == [
        InstrumentState.WARMING,
        InstrumentState.MEASURING,
    ]


def test_cozir_answers_commands_and_polls() -> None:
    emulator = make_emulator("cozir", np.random.default_rng(1))
    emulator.step(0.0, Air())
    emulator.receive(0.0, b"K 2\r\nwhat?\r\n.\r\nM 2\r\nZ\r\n")
    said = emulator.step(0.1, Air())
    assert said.startswith(b" K 00002\r\n?\r\n . 00001\r\n M 00002\r\n z 00")
    assert b"Z" not in said


def test_noise_and_offset_differ_by_seed_and_repeat_with_it() -> None:
    def said(seed: int) -> bytes:
        emulator = make_emulator("li850", np.random.default_rng(seed))
        return b"".join(emulator.step(float(t), Air()) for t in range(5))

    assert said(1) == said(1)
    assert said(1) != said(2)


def test_a_turned_mast_is_undone_by_the_same_option() -> None:
    emulator = make_emulator(
        "trisonica", np.random.default_rng(1), mount_yaw_deg=120.0, sd_mps=0.01, bias_mps=0.0
    )
    instrument = make_instrument("trisonica", "mast", {"mount_yaw_deg": 120.0})
    samples = instrument.receive(0.0, emulator.step(0.0, Air(wind_body_mps=(3.0, -4.0, 0.5))))
    assert samples[0].wind_body_mps == pytest.approx((3.0, -4.0, 0.5), abs=0.06)


def test_unknown_types_and_options_are_refused() -> None:
    with pytest.raises(SensorError, match="unknown instrument type"):
        make_emulator("nose", np.random.default_rng(1))
    with pytest.raises(SensorError, match="no line of its own"):
        make_emulator("mavlink", np.random.default_rng(1))
    with pytest.raises(SensorError, match=r"unknown field `warmup`.*warm_up_s"):
        make_emulator("sba5", np.random.default_rng(1), warmup=3.0)
