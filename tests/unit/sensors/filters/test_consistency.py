"""The filters' variances are honest: normalised estimation error squared over 200 seeded flights.

The bounds are those that the mean of 200 (CO2) and 400 (two axes of wind) squares of standard normal numbers
keeps with 95 % probability.
"""

from __future__ import annotations

import numpy as np
import pytest

from simvehicle.instruments.study import fly_in_wind, fly_through_plume

SEEDS = range(200)


def test_co2_through_a_plume() -> None:
    passes = [fly_through_plume(seed) for seed in SEEDS]
    assert 0.813 <= np.mean([p.nees for p in passes]) <= 1.205
    assert np.median([p.error_ratio for p in passes]) <= 0.40
    assert np.median(np.abs([p.peak_delay_s for p in passes])) <= 0.3 + 1e-6
    assert np.median([p.raw_peak_delay_s for p in passes]) > 0.6, "or there was no lag to undo"


@pytest.mark.parametrize("anemometer", ["trisonica", None])
def test_wind(anemometer: str | None) -> None:
    flights = [fly_in_wind(seed, anemometer, duration_s=30.0) for seed in SEEDS]
    assert 0.866 <= np.mean([f.nees for f in flights]) <= 1.143
    error_mps = float(np.sqrt(np.mean([f.error_mps**2 for f in flights])))
    assert error_mps < (0.25 if anemometer else 0.55)
