"""Cross-calibration side by side, and tuning by maximum likelihood."""

from __future__ import annotations

import math
import pathlib

import numpy as np
import pytest

from sensors.calibration.side_by_side import cross_calibrate, load, save
from sensors.calibration.tuning import tune_co2, tune_wind
from sensors.filters.co2_filter import Co2FilterConfig
from sensors.instruments.calibrated import Calibration
from sensors.instruments.registry import make_instrument
from sensors.instruments.samples import InstrumentState, Quantity, Sample
from sensors.instruments.sensor_error import SensorError


def co2(time_s: float, ppm: float) -> Sample:
    return Sample(time_s, "co2", InstrumentState.MEASURING, co2_ppm=ppm, quantity=Quantity.CO2)


def side_by_side(
    seconds: int, swing_ppm: float, drones: dict[str, tuple[float, float]]
) -> dict[str, list[Sample]]:
    """Recordings of drones that read scale * air + offset, each counted from its own start."""
    rng = np.random.default_rng(3)
    recordings: dict[str, list[Sample]] = {}
    for index, (name, (scale, offset_ppm)) in enumerate(drones.items()):
        start_s = 1000.0 * index
        recordings[name] = [
            co2(
                start_s + 0.1 * i,
                scale * (430.0 + swing_ppm * math.sin(0.01 * i)) + offset_ppm + float(rng.normal()),
            )
            for i in range(10 * seconds)
        ]
    return recordings


def test_offsets_are_found_in_steady_air_and_no_scale_is_invented() -> None:
    found = cross_calibrate(
        side_by_side(60, 0.0, {"a": (1.0, 0.0), "b": (1.0, 7.0), "c": (1.0, -12.0)}),
        "2024-05-01T10:00:00+00:00",
    )
    assert {name: c.scale for name, c in found.items()} == {"a": 1.0, "b": 1.0, "c": 1.0}
    assert found["b"].offset_ppm == pytest.approx(-7.0, abs=0.6)
    assert found["c"].offset_ppm == pytest.approx(12.0, abs=0.6)
    assert (found["a"].seconds, found["a"].made_at) == (60, "2024-05-01T10:00:00+00:00")
    assert found["a"].scatter_ppm < 1.0


def test_a_scale_is_found_where_the_air_swings() -> None:
    found = cross_calibrate(side_by_side(60, 200.0, {"a": (1.0, 0.0), "b": (1.1, 0.0), "c": (1.0, 3.0)}))
    assert found["b"].scale == pytest.approx(1.0 / 1.1, abs=0.01)
    corrected = found["b"].apply(co2(0.0, 1.1 * 500.0)).co2_ppm
    assert corrected == pytest.approx(500.0, abs=4.0)


def test_one_wrong_drone_does_not_move_the_others() -> None:
    found = cross_calibrate(side_by_side(45, 0.0, {"a": (1.0, 0.0), "b": (1.0, 0.5), "mad": (1.0, 400.0)}))
    assert abs(found["a"].offset_ppm) < 1.0
    assert found["mad"].offset_ppm == pytest.approx(-400.0, abs=1.5)


def test_too_little_in_common_is_refused() -> None:
    with pytest.raises(SensorError, match="only 20 s of readings in common"):
        cross_calibrate(side_by_side(20, 0.0, {"a": (1.0, 0.0), "b": (1.0, 0.0)}))
    with pytest.raises(SensorError, match="needs two drones"):
        cross_calibrate({"a": [co2(0.0, 420.0)], "b": []})


def test_calibrations_are_kept_in_a_file_and_applied_by_an_option(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "calibration.json"
    save(
        path,
        {"drone 3": Calibration(offset_ppm=-7.0, scale=1.02, seconds=60, made_at="2024-05-01T10:00:00Z")},
    )
    kept = load(path)["drone 3"]
    assert kept.made_at == "2024-05-01T10:00:00Z"
    line = b"M 50885 48094 500.00 55.0 0.0 0.0 829 55.0 55.0 00\r\n"
    options = {"calibration": {"offset_ppm": -7.0, "scale": 1.02, "made_at": "2024-05-01T10:00:00Z"}}
    instrument = make_instrument("sba5", "co2", options)
    assert instrument.receive(0.0, line)[0].co2_ppm == pytest.approx(503.0)
    assert instrument.receive(0.0, b"W,50.0\r\n")[0].state is InstrumentState.WARMING
    low = make_instrument("sba5", "co2", {"calibration": {"offset_ppm": -600.0}}).receive(0.0, line)[0]
    assert (low.state, low.co2_ppm) == (InstrumentState.ERROR, None)
    path.write_text('{"drone 3": {"scale": 40}}')
    with pytest.raises(SensorError, match="not a calibration file"):
        load(path)
    with pytest.raises(SensorError, match="cannot be read"):
        load(tmp_path / "none.json")


def hood(lag_s: float, noise_ppm: float) -> list[Sample]:
    """A minute with a hood of rich air put over the inlet and lifted again."""
    rng = np.random.default_rng(8)
    cell_ppm, samples = 420.0, []
    for i in range(3000):
        time_s = 0.02 * i
        air_ppm = 820.0 if 20.0 < time_s < 32.0 or 40.0 < time_s < 48.0 else 420.0
        cell_ppm += (air_ppm - cell_ppm) * -math.expm1(-0.02 / lag_s)
        if i % 5 == 4:
            spread_ppm = math.hypot(noise_ppm, 0.002 * cell_ppm)
            samples.append(co2(time_s, round(cell_ppm + spread_ppm * float(rng.normal()), 2)))
    return samples


def test_lag_and_noise_are_found_from_a_step() -> None:
    shares: list[float] = []
    found = tune_co2(hood(lag_s=2.4, noise_ppm=1.6), Co2FilterConfig(), shares.append)
    assert found.lag_s.value == pytest.approx(2.4, rel=0.2)
    assert found.noise_ppm.value == pytest.approx(1.6, rel=0.12)
    assert found.lag_s.known
    assert found.log_likelihood > found.before
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_too_short_a_recording_is_refused() -> None:
    with pytest.raises(SensorError, match="5 valid CO2 readings are too few"):
        tune_co2([co2(0.1 * i, 420.0) for i in range(5)], Co2FilterConfig())
    with pytest.raises(SensorError, match="0 valid wind readings are too few"):
        tune_wind([])


def test_gusts_and_noise_of_an_anemometer_are_told_apart() -> None:
    rng = np.random.default_rng(4)
    decay = math.exp(-0.2 / 4.0)
    gust = np.zeros(2)
    samples = []
    for i in range(3000):
        gust = decay * gust + math.sqrt(1.0 - decay * decay) * 0.8 * rng.normal(size=2)
        north, east = (np.array((4.0, -1.0)) + gust + 0.2 * rng.normal(size=2)).tolist()
        samples.append(
            Sample(
                0.2 * i,
                "mast",
                InstrumentState.MEASURING,
                wind_body_mps=(north, east, 0.0),
                quantity=Quantity.WIND,
            )
        )
    found = tune_wind(samples)
    assert found.noise_mps.value == pytest.approx(0.2, rel=0.2)
    assert found.gust_sd_mps.value == pytest.approx(0.8, rel=0.25)
    assert found.gust_time_s.value == pytest.approx(4.0, rel=0.4)


@pytest.mark.parametrize("data", [b'{"drone-1": {"sc\x83ale": 1.0}}', b'{"\xc2\x86": 1}', b"[" * 100_000])
def test_a_file_that_is_no_calibration_is_named_in_one_line_that_can_be_shown(
    tmp_path: pathlib.Path, data: bytes
) -> None:
    path = tmp_path / "calibrations.json"
    path.write_bytes(data)
    with pytest.raises(SensorError, match=r"calibrations.json: not a calibration file") as caught:
        load(path)
    assert str(caught.value).isprintable()
