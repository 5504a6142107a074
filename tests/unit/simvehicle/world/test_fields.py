"""Every field answers everywhere, for many positions as for one, and the same whoever asks."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.geometry.frames import Geodetic
from simvehicle.trials.plume import HEIGHT_M, VENT_SD_M, WIND_MPS, plume_numbers, reading
from simvehicle.world.air import World
from simvehicle.world.configured import make_world
from simvehicle.world.fields import OPEN_GROUND
from simvehicle.world.gas_formulas import LOCUS_CUT
from simvehicle.world.world_config import (
    FilamentPlume,
    FilamentSource,
    FlatFilamentPlume,
    FlatFilamentSource,
    GaussianPlume,
    LocusGridPlume,
    Plume,
    WindConfig,
    WorldConfig,
)

AnyPlume = Plume | None
Point = tuple[float, float, float]

PLUMES: tuple[AnyPlume, ...] = (
    GaussianPlume(source_north_m=12.0, source_east_m=-7.0, source_above_home_m=HEIGHT_M, vent_sd_m=VENT_SD_M),
    GaussianPlume(source_north_m=0.0, source_east_m=0.0, source_above_home_m=0.0, vent_sd_m=0.001),
    LocusGridPlume(source_north_m=12.0, source_east_m=-7.0),
    LocusGridPlume(source_north_m=12.0, source_east_m=-7.0, perturbed=True),
    FilamentPlume(
        sources=(FilamentSource(north_m=12.0, east_m=-7.0),), rise_mps=1.0, reach_m=200.0, step_s=2.0
    ),
    FlatFilamentPlume(sources=(FlatFilamentSource(north_m=12.0, east_m=-7.0),), reach_m=200.0, step_s=2.0),
    None,
)

metres = st.floats(allow_nan=False, allow_infinity=False)
near_m = st.floats(-250.0, 250.0)
seconds = st.floats(0.0, 400.0)
seeds = st.integers(0, 2**40)


def world(plume: AnyPlume, seed: int = 1, speed_mps: float = WIND_MPS) -> World:
    """The mean wind goes to the north, as in the trials."""
    return make_world(
        WorldConfig(
            origin=Geodetic(14.38, -90.6, 2400.0),
            wind=WindConfig(speed_mps=speed_mps, from_deg=180.0),
            plume=plume,
            seed=seed,
        )
    )


@numba.njit
def _readings(plume: Any, grid: Any, places: Any, time_s: float) -> Any:
    values = np.zeros(places.shape[0])
    for i in range(places.shape[0]):
        values[i] = reading(plume, grid, places[i, 0], places[i, 1], time_s)
    return values


@pytest.mark.parametrize("plume", PLUMES)
@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(metres, metres, metres), min_size=1, max_size=5), seconds, st.booleans())
def test_no_finite_position_gives_nan(
    plume: AnyPlume, places: list[Point], time_s: float, calm: bool
) -> None:
    asked = world(plume, speed_mps=0.0 if calm else WIND_MPS)
    many = np.array(places)
    assert np.isfinite(asked.gas.excesses_co2_ppm(many, time_s)).all()
    assert np.isfinite(asked.wind.winds_ned_mps(many, time_s)).all()
    assert not np.isnan(asked.obstacles.clearances_m(many)).any()
    assert not np.isnan(asked.obstacles.ranges_m(many, np.zeros(len(many)))).any()
    assert np.isfinite(asked.risk.risks(many, time_s)).all()
    for place in places:
        air = asked.air_at(place, time_s, asked.wind.wind_ned_mps(place, time_s))
        numbers = (air.co2_ppm, *air.wind_body_mps, air.temperature_c, air.pressure_pa)
        assert all(math.isfinite(number) for number in numbers)
        assert air.co2_ppm >= 420.0


@pytest.mark.parametrize("plume", PLUMES)
@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(near_m, near_m, near_m), min_size=1, max_size=20), seconds, seeds)
def test_arrays_are_the_points(plume: AnyPlume, places: list[Point], time_s: float, seed: int) -> None:
    asked = world(plume, seed)
    one_by_one = [asked.gas.excess_co2_ppm(place, time_s) for place in places]
    assert asked.gas.excesses_co2_ppm(np.array(places), time_s).tolist() == pytest.approx(
        one_by_one, rel=1e-12, abs=1e-300
    )
    winds = [list(asked.wind.wind_ned_mps(place, time_s)) for place in places]
    assert asked.wind.winds_ned_mps(np.array(places), time_s).tolist() == winds


def test_nobody_asked_is_nobody_answered() -> None:
    for plume in PLUMES:
        asked = world(plume)
        assert asked.gas.excesses_co2_ppm(np.zeros((0, 3)), 0.0).shape == (0,)
        assert asked.wind.winds_ned_mps(np.zeros((0, 3)), 0.0).shape == (0, 3)


@pytest.mark.parametrize(
    ("plume", "name", "perturbed", "origin_m"),
    [
        (PLUMES[0], "gaussian", False, (12.0, -7.0)),
        (PLUMES[2], "locus-grid", False, (12.0, -7.0)),
        (PLUMES[3], "locus-grid", True, (12.0, -7.0)),
    ],
)
def test_a_flight_reads_what_a_trial_reads(
    plume: AnyPlume, name: Any, perturbed: bool, origin_m: tuple[float, float]
) -> None:
    """The instruments' ppm at the trials' height are the compiled readings times the peak; a trial's cut is 0."""
    asked = world(plume, seed=4)
    source = asked.gas.source_ned_m
    peak_ppm = asked.air_at(source, 0.0, (0.0, 0.0, 0.0)).co2_ppm - 420.0
    numbers, grid = plume_numbers(name, perturbed, 0.0)
    rng = np.random.default_rng(4)
    places = rng.uniform((-20.0, -15.0), (220.0, 15.0), (4000, 2))
    readings = _readings(numbers, grid, places, 3.0)
    assert 200 < np.count_nonzero(readings) < 3900
    for (north_m, east_m), value in zip(places.tolist(), readings.tolist(), strict=True):
        place = (origin_m[0] + north_m, origin_m[1] + east_m, -HEIGHT_M)
        ppm = asked.air_at(place, 3.0, (0.0, 0.0, 0.0)).co2_ppm - 420.0
        if value > 0.0:
            assert ppm == pytest.approx(value * peak_ppm, rel=1e-9)
        else:
            assert ppm < LOCUS_CUT * peak_ppm * (1.0 + 1e-9)


def test_open_ground_has_nothing_to_hit_and_nothing_to_fear() -> None:
    places = np.array([[0.0, 0.0, -10.0], [1e5, -1e5, 5.0]])
    bare = world(None)
    assert bare.obstacles is OPEN_GROUND
    assert bare.risk is OPEN_GROUND
    assert bare.obstacles.clearances_m(places).tolist() == [math.inf, math.inf]
    assert bare.obstacles.ranges_m(places, np.array([0.0, 1.0])).tolist() == [math.inf, math.inf]
    assert bare.risk.risks(places, 0.0).tolist() == [0.0, 0.0]


@settings(max_examples=30, deadline=None)
@given(st.lists(seconds, min_size=1, max_size=8), seeds, st.data())
def test_a_world_does_not_remember_what_it_was_asked(times_s: list[float], seed: int, data: Any) -> None:
    order = data.draw(st.permutations(times_s))
    one, other = world(PLUMES[0], seed), world(PLUMES[0], seed)
    place = np.array([[30.0, 5.0, -20.0]])
    first = {
        t: (one.wind.winds_ned_mps(place, t).tolist(), one.gas.excesses_co2_ppm(place, t)[0]) for t in times_s
    }
    again = {
        t: (other.wind.winds_ned_mps(place, t).tolist(), other.gas.excesses_co2_ppm(place, t)[0])
        for t in order
    }
    assert first == again
