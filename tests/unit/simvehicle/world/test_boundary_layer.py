"""The wind over open ground has the mean, the gusts and the thermals of the models that it names."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simvehicle.world.boundary_layer import BoundaryLayerWind
from simvehicle.world.thermals import cell_m
from simvehicle.world.turbulence import Turbulence
from simvehicle.world.wind_formulas import turbulence_lengths_m, turbulence_sds_mps
from simvehicle.world.world_config import BoundaryLayerWindConfig, ThermalsConfig

FT = 0.3048
GUSTY = BoundaryLayerWindConfig(speed_mps=6.0, from_deg=250.0, roughness_m=0.05)
WARM = BoundaryLayerWindConfig(speed_mps=4.0, from_deg=200.0, gustiness=0.0, thermals=ThermalsConfig())
BOTH = BoundaryLayerWindConfig(speed_mps=5.0, from_deg=20.0, thermals=ThermalsConfig(convective_mps=2.5))
metres = st.floats(allow_nan=False, allow_infinity=False)
near_m = st.floats(-300.0, 300.0)


@functools.cache
def wind(config: BoundaryLayerWindConfig = GUSTY, seed: int = 3) -> BoundaryLayerWind:
    return BoundaryLayerWind(config, seed)


def test_the_mean_is_the_logarithmic_law() -> None:
    calm = wind(BoundaryLayerWindConfig(speed_mps=6.0, from_deg=270.0, roughness_m=0.05, gustiness=0.0))
    for up_m in (0.01, 1.0, 10.0, 40.0):
        expected = 6.0 * max(0.0, math.log(up_m / 0.05)) / math.log(10.0 / 0.05)
        assert calm.wind_ned_mps((5.0, 9.0, -up_m), 7.0) == pytest.approx((0.0, expected, 0.0), abs=1e-9)


def test_lengths_and_deviations_are_those_of_the_standard() -> None:
    """MIL-F-8785C, low altitude, worked by hand at 100 ft and at its ends."""
    along_m, up_m = turbulence_lengths_m(100.0 * FT)
    assert (along_m / FT, up_m / FT) == pytest.approx((100.0 / 0.2593**1.2, 100.0))
    level, vertical = turbulence_sds_mps(100.0 * FT, 8.0)
    assert (level, vertical) == pytest.approx((0.8 / 0.2593**0.4, 0.8))
    assert turbulence_lengths_m(2000.0) == pytest.approx((1000.0 * FT, 1000.0 * FT))
    assert turbulence_sds_mps(2000.0, 8.0) == pytest.approx((0.8, 0.8))
    assert turbulence_sds_mps(5.0 * FT, 8.0)[1] == pytest.approx(0.4)  # half of it half-way to the ground
    assert turbulence_sds_mps(-1.0, 8.0) == (0.0, 0.0)
    assert turbulence_lengths_m(-5.0) == turbulence_lengths_m(10.0 * FT)


@pytest.mark.parametrize("up_m", [3.048, 12.0, 40.0])
def test_gusts_have_the_deviations_of_their_height(up_m: float) -> None:
    """Along 50 km of the wind, at several places across it."""
    blowing = wind()
    toward = np.array(blowing.mean_ned_mps[:2]) / 6.0
    along_m, across_m = np.meshgrid(np.arange(8000) * 6.3, [0.0, 410.0, -320.0], indexing="ij")
    north_m, east_m = (along_m * toward[k] + across_m * (-toward[1], toward[0])[k] for k in range(2))
    series = blowing.winds_ned_mps(
        np.column_stack([north_m.ravel(), east_m.ravel(), np.full(north_m.size, -up_m)]), 77.0
    )
    along = series[..., 0] * toward[0] + series[..., 1] * toward[1]
    across = series[..., 1] * toward[0] - series[..., 0] * toward[1]
    wind_20ft = 6.0 * math.log(6.096 / 0.05) / math.log(10.0 / 0.05)
    level, vertical = turbulence_sds_mps(up_m, wind_20ft)
    mean = 6.0 * math.log(up_m / 0.05) / math.log(10.0 / 0.05)
    assert along.mean() == pytest.approx(mean, abs=0.06)
    assert across.mean() == pytest.approx(0.0, abs=0.06)
    assert series[..., 2].mean() == pytest.approx(0.0, abs=0.03)
    assert along.std() == pytest.approx(level, rel=0.08)
    assert across.std() == pytest.approx(level, rel=0.08)
    assert series[..., 2].std() == pytest.approx(vertical, rel=0.05)


def test_gusts_along_the_wind_have_drydens_autocorrelation() -> None:
    turbulence = Turbulence(5)
    turbulence.make(2)
    series = turbulence.series[2, :, :-1]
    along_m, up_m = turbulence_lengths_m(float(turbulence.heights_m[2]))
    spacing_m = float(turbulence.spacings_m()[2])
    for steps in (1, 4, 10, 30):
        away_m = steps * spacing_m
        expected = (
            math.exp(-away_m / along_m),
            math.exp(-away_m / along_m) * (1.0 - away_m / (2.0 * along_m)),
            math.exp(-away_m / up_m) * (1.0 - away_m / (2.0 * up_m)),
        )
        for axis in range(3):
            one = series[..., axis]
            measured = (one * np.roll(one, -steps, axis=1)).mean() / one.var()
            assert measured == pytest.approx(expected[axis], abs=0.03)


def test_gusts_drift_with_the_wind_and_fade_across_it() -> None:
    """Who is taken along by the mean wind feels one gust; who stands aside by some lengths another."""
    blowing = wind()
    up_m = float(blowing._turbulence.heights_m[1])
    speed = 6.0 * math.log(up_m / 0.05) / math.log(10.0 / 0.05)
    toward = np.array(blowing.mean_ned_mps[:2]) / 6.0
    here = blowing.wind_ned_mps((10.0, 20.0, -up_m), 50.0)
    later = blowing.wind_ned_mps(
        (10.0 + 30.0 * speed * toward[0], 20.0 + 30.0 * speed * toward[1], -up_m), 80.0
    )
    assert later == pytest.approx(here, abs=1e-6)
    lengths = turbulence_lengths_m(up_m)[0] * np.array([0.0, 0.1, 0.5, 3.0])
    beside = np.column_stack([-toward[1] * lengths, toward[0] * lengths, np.full(4, -up_m)])
    series = np.array([blowing.winds_ned_mps(beside, 2.0 * k)[:, 0] for k in range(4000)])
    near, half, far = np.corrcoef(series.T)[0, 1:]
    assert near > 0.9
    assert near > half > far
    assert abs(far) < 0.15


def test_twice_as_gusty_is_twice_the_gusts_and_calm_is_calm() -> None:
    place, quiet = (5.0, 7.0, -12.0), BoundaryLayerWindConfig(speed_mps=5.0, gustiness=0.0)
    mean = np.array(wind(quiet).wind_ned_mps(place, 9.0))
    once = np.array(wind(BoundaryLayerWindConfig(speed_mps=5.0)).wind_ned_mps(place, 9.0)) - mean
    twice = (
        np.array(wind(BoundaryLayerWindConfig(speed_mps=5.0, gustiness=2.0)).wind_ned_mps(place, 9.0)) - mean
    )
    assert np.abs(once).max() > 0.01
    assert twice == pytest.approx(2.0 * once)
    assert wind(BoundaryLayerWindConfig(speed_mps=0.0)).wind_ned_mps(place, 9.0) == pytest.approx(
        (0.0, 0.0, 0.0)
    )


def test_thermals_rise_as_allen_says_and_lose_no_air() -> None:
    warm = wind(WARM)
    side_m = 8.0 * cell_m(1000.0)
    axis_m = np.linspace(0.0, side_m, 160, endpoint=False)
    north, east = np.meshgrid(axis_m, axis_m, indexing="ij")
    for up_m in (30.0, 300.0):
        height = up_m / 1000.0
        mean = 1.5 * height ** (1.0 / 3.0) * (1.0 - 1.1 * height)
        positions = np.column_stack([north.ravel(), east.ravel(), np.full(north.size, -up_m)])
        up = np.array([-warm.winds_ned_mps(positions, 97.0 * k)[:, 2] for k in range(40)])
        assert 2.0 * mean < up.max() < 1.5 * 2.0 * mean * 1.01  # the strongest of them, in its middle
        assert up.min() > -0.5 * mean
        assert up.mean() == pytest.approx(0.0, abs=0.06 * mean)
    assert warm.wind_ned_mps((0.0, 0.0, 0.0), 5.0)[2] == 0.0
    assert warm.wind_ned_mps((0.0, 0.0, -950.0), 5.0)[2] == 0.0  # above their tops


def test_thermals_drift_with_the_wind() -> None:
    warm = wind(WARM)
    drift_n, drift_e, _ = warm.mean_ned_mps
    axis_m = np.linspace(-300.0, 300.0, 40)
    north, east = np.meshgrid(axis_m, axis_m, indexing="ij")
    positions = np.column_stack([north.ravel(), east.ravel(), np.full(north.size, -40.0)])
    here = warm.winds_ned_mps(positions, 100.0)[:, 2]
    moved = positions + np.array([drift_n * 60.0, drift_e * 60.0, 0.0])
    with_it, without_it = warm.winds_ned_mps(moved, 160.0)[:, 2], warm.winds_ned_mps(positions, 160.0)[:, 2]
    assert np.corrcoef(here, with_it)[0, 1] > 0.95
    assert np.corrcoef(here, without_it)[0, 1] < 0.6


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(metres, metres, metres), min_size=1, max_size=5), st.floats(0.0, 1e5))
def test_no_finite_position_gives_nan(places: list[tuple[float, float, float]], time_s: float) -> None:
    for config in (GUSTY, BOTH):
        assert np.isfinite(wind(config).winds_ned_mps(np.array(places), time_s)).all()
        for place in places:
            assert all(math.isfinite(one) for one in wind(config).wind_ned_mps(place, time_s))


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(near_m, near_m, near_m), min_size=1, max_size=8), st.floats(0.0, 3000.0))
def test_arrays_are_the_points_whoever_was_asked_before(
    places: list[tuple[float, float, float]], time_s: float
) -> None:
    many = wind(BOTH).winds_ned_mps(np.array(places), time_s)
    for place, row in zip(places, many.tolist(), strict=True):
        assert wind(BOTH).wind_ned_mps(place, time_s) == pytest.approx(row, rel=1e-9, abs=1e-9)


def test_a_fresh_wind_of_one_seed_is_the_same_and_of_another_not() -> None:
    place = (4.0, -9.0, -25.0)
    asked = wind(BOTH).wind_ned_mps(place, 44.0)
    fresh = BoundaryLayerWind(BOTH, 3)
    fresh.winds_ned_mps(np.array([[0.0, 0.0, -200.0]]), 900.0)
    assert fresh.wind_ned_mps(place, 44.0) == asked
    assert BoundaryLayerWind(BOTH, 4).wind_ned_mps(place, 44.0) != asked


@pytest.mark.parametrize("up_m", [3.048, 6.0, 12.0])
def test_nothing_leaps(up_m: float) -> None:
    """Along any way, up and across too, the wind is continuous."""
    blowing = wind(BOTH)
    for way in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0), (0.5, -0.5, -0.3)):
        steps = np.linspace(0.0, 60.0, 6001)[:, None]
        winds = blowing.winds_ned_mps(np.array([[3.0, 5.0, -up_m]]) + steps * np.array([way]), 200.0)
        assert np.abs(np.diff(winds, axis=0)).max() < 0.03
