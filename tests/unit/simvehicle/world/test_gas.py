"""Plumes: mass is conserved, the maximum is where it is said to be, and the two forms agree."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simvehicle.world.atmosphere import air_density_kgpm3
from simvehicle.world.gas import CleanAir, Gaussian, LocusGrid, make_gas
from simvehicle.world.gas_formulas import locus_grid
from simvehicle.world.wind import GustyWind
from simvehicle.world.world_config import GaussianPlume, LocusGridPlume, WindConfig

WEST_WIND = (0.0, 3.0, 0.0)
CONFIG = GaussianPlume(
    source_north_m=40.0, source_east_m=-80.0, source_above_home_m=10.0, emission_kgps=5.0, vent_sd_m=7.0
)
metres = st.floats(-400.0, 400.0)


def plume() -> Gaussian:
    return Gaussian(CONFIG, WEST_WIND, 0.0)


def test_as_much_co2_passes_every_section_as_the_vent_emits() -> None:
    model = plume()
    up_m = np.arange(0.25, 150.0, 0.5)
    across_m = np.arange(-200.0, 200.0, 0.5)
    for downwind_m in (0.0, 60.0, 200.0):
        north_m, height_m = np.meshgrid(40.0 + across_m, up_m)
        places = np.stack([north_m, np.full_like(north_m, -80.0 + downwind_m), -height_m], axis=-1)
        section = float(model.excesses_co2_ppm(places.reshape(-1, 3), 0.0).sum())
        flux_kgps = section * 0.25 * 1e-6 * (44.0095 / 28.9647) * air_density_kgpm3(10.0) * 3.0
        assert flux_kgps == pytest.approx(5.0, rel=0.01)


@settings(max_examples=60, deadline=None)
@given(metres, metres)
def test_nowhere_at_survey_altitude_is_stronger_than_the_source(north_m: float, east_m: float) -> None:
    model = plume()
    assert model.source_ned_m == pytest.approx((40.0, -80.0, -10.0))
    peak_ppm = model.excess_co2_ppm(model.source_ned_m, 0.0)
    assert model.excess_co2_ppm((north_m, east_m, -10.0), 0.0) <= peak_ppm


@settings(max_examples=60, deadline=None)
@given(metres, metres, st.floats(0.0, 80.0))
def test_scalar_and_array_agree(north_m: float, east_m: float, up_m: float) -> None:
    for model in (plume(), LocusGrid(LocusGridPlume(source_north_m=3.0, source_east_m=5.0)), CleanAir()):
        one = model.excess_co2_ppm((north_m, east_m, -up_m), 1.0)
        many = model.excesses_co2_ppm(np.array([[0.0, 0.0, 0.0], [north_m, east_m, -up_m]]), 1.0)
        assert many.shape == (2,)
        assert float(many[1]) == pytest.approx(one, rel=1e-12, abs=1e-15)
        assert one >= 0.0


@settings(max_examples=60, deadline=None)
@given(metres, metres)
def test_the_field_is_smooth(north_m: float, east_m: float) -> None:
    model, step_m = plume(), 0.01
    here = model.excess_co2_ppm((north_m, east_m, -10.0), 0.0)
    there = model.excess_co2_ppm((north_m + step_m, east_m + step_m, -10.0), 0.0)
    peak_ppm = model.excess_co2_ppm(model.source_ned_m, 0.0)
    assert abs(here - there) <= peak_ppm / CONFIG.vent_sd_m * step_m * 2.0


def test_it_lies_downwind_with_a_short_upwind_tail() -> None:
    model = plume()
    assert model.excess_co2_ppm((40.0, 120.0, -10.0), 0.0) > 100.0
    assert model.excess_co2_ppm((40.0, -90.0, -10.0), 0.0) > 0.0
    assert model.excess_co2_ppm((40.0, -130.0, -10.0), 0.0) == 0.0


def test_a_plume_much_wider_than_it_is_high_peaks_downwind() -> None:
    wide = Gaussian(
        GaussianPlume(source_north_m=0.0, source_east_m=0.0, source_above_home_m=10.0, vent_sd_m=9.0),
        WEST_WIND,
        0.0,
    )
    best = wide.excess_co2_ppm(wide.source_ned_m, 0.0)
    assert all(wide.excess_co2_ppm((0.0, 0.5 * i, -10.0), 0.0) <= best for i in range(400))


def test_ppm_of_a_known_plume() -> None:
    """1 kg/s in 1 m/s through a Gaussian section of 10 m by 10 m far above the ground, at sea level."""
    config = GaussianPlume(source_north_m=0.0, source_east_m=0.0, source_above_home_m=100.0, vent_sd_m=10.0)
    expected_ppm = 1e6 / (2.0 * math.pi * 100.0) / (air_density_kgpm3(100.0) * 44.0095 / 28.9647)
    assert Gaussian(config, (1.0, 0.0, 0.0), 0.0).excess_co2_ppm((0.0, 0.0, -100.0), 0.0) == pytest.approx(
        expected_ppm
    )


def test_calm_air_gives_numbers() -> None:
    assert math.isfinite(Gaussian(CONFIG, (0.0, 0.0, 0.0), 3000.0).excess_co2_ppm((40.0, -80.0, -10.0), 0.0))


def test_standard_atmosphere() -> None:
    assert air_density_kgpm3(0.0) == pytest.approx(1.225)
    assert air_density_kgpm3(3000.0) == pytest.approx(0.9093, abs=0.001)


@pytest.mark.parametrize("perturbed", [False, True])
def test_locus_grid_as_the_paper_ran_it(perturbed: bool) -> None:
    grid = locus_grid(perturbed)
    assert grid.shape == (2000, 400)
    assert grid.max() == 1.0
    assert grid[grid > 0.0].min() >= 0.005
    model = make_gas(
        LocusGridPlume(source_north_m=10.0, source_east_m=20.0, perturbed=perturbed, peak_ppm=500.0),
        GustyWind(WindConfig(), 1),
        0.0,
    )
    assert model.excess_co2_ppm(model.source_ned_m, 0.0) == 500.0
    if not perturbed:
        assert model.source_ned_m[0] == pytest.approx(11.4, abs=0.06)
        assert model.source_ned_m[1] == pytest.approx(20.0, abs=0.06)
    assert model.excess_co2_ppm((9.9, 20.0, -10.0), 0.0) == 0.0


def test_clean_air_has_no_source() -> None:
    clean = make_gas(None, GustyWind(WindConfig(), 1), 0.0)
    assert math.isnan(clean.source_ned_m[0])
    assert clean.excesses_co2_ppm(np.zeros((4, 3)), 10.0).tolist() == [0.0] * 4
