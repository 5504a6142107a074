"""The wind is a pure function of seed and time with the statistics that its configuration states."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simvehicle.world.wind import GustyWind
from simvehicle.world.world_config import WindConfig

ORIGIN = (0.0, 0.0, -10.0)


def test_steady_wind_comes_from_where_it_says() -> None:
    wind = GustyWind(WindConfig(speed_mps=4.0, from_deg=90.0, gust_sd_mps=0.0), seed=1)
    north, east, down = wind.wind_ned_mps(ORIGIN, 12.3)
    assert (north, east, down) == pytest.approx((0.0, -4.0, 0.0), abs=1e-9)


@settings(max_examples=20, deadline=None)
@given(st.lists(st.floats(0.0, 2000.0), min_size=1, max_size=8), st.integers(0, 2**31))
def test_the_order_of_questions_does_not_matter(times_s: list[float], seed: int) -> None:
    config = WindConfig()
    forward, backward = GustyWind(config, seed), GustyWind(config, seed)
    asked = [forward.wind_ned_mps(ORIGIN, t) for t in times_s]
    again = [backward.wind_ned_mps(ORIGIN, t) for t in reversed(times_s)]
    assert asked == list(reversed(again))


def test_gusts_have_their_configured_spread_and_memory() -> None:
    config = WindConfig(speed_mps=3.0, from_deg=270.0, gust_sd_mps=0.8, gust_time_s=5.0)
    wind = GustyWind(config, seed=7)
    series = np.array([wind.wind_ned_mps(ORIGIN, 0.5 * i) for i in range(40_000)])
    assert series[:, 0].mean() == pytest.approx(0.0, abs=0.06)
    assert series[:, 1].mean() == pytest.approx(3.0, abs=0.06)
    assert series[:, 0].std() == pytest.approx(0.8, rel=0.06)
    assert series[:, 2].std() == pytest.approx(0.4, rel=0.06)
    gust = series[:, 1] - series[:, 1].mean()
    correlation = float((gust[:-10] * gust[10:]).mean() / gust.var())
    assert correlation == pytest.approx(math.exp(-1.0), abs=0.06)


def test_other_seeds_other_gusts() -> None:
    config = WindConfig()
    assert GustyWind(config, 1).wind_ned_mps(ORIGIN, 3.0) != GustyWind(config, 2).wind_ned_mps(ORIGIN, 3.0)
