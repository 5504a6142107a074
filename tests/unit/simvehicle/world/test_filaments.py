"""Puffs: their mass is kept, they go where they should and nowhere else, and nothing depends on who asks when."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.geometry.formation import FloatArray
from mission.geometry.frames import Geodetic
from simvehicle.world.atmosphere import co2_density_kgpm3
from simvehicle.world.configured import make_world
from simvehicle.world.fields import OPEN_GROUND, ObstacleField, WindField
from simvehicle.world.filaments import Filaments
from simvehicle.world.grid_wind import GridWind
from simvehicle.world.obstacles import Obstacles
from simvehicle.world.wind import GustyWind
from simvehicle.world.world_config import (
    AnyWindConfig,
    BoundaryLayerWindConfig,
    FilamentPlume,
    FilamentSource,
    FlatFilamentPlume,
    FlatFilamentSource,
    GridWindConfig,
    PolygonalObstacle,
    RectangularObstacle,
    ThermalsConfig,
    WindConfig,
    WorldConfig,
)
from simvehicle.world.world_problems import problems

HOME_AMSL_M = 2400.0
SOURCE = FilamentSource(north_m=5.0, east_m=-3.0, above_home_m=4.0, emission_kgps=0.5)
OTHER = FilamentSource(north_m=-20.0, east_m=8.0, above_home_m=0.0, emission_kgps=0.2, moving_north_mps=0.3)
UPRIGHT = FilamentPlume(sources=(SOURCE, OTHER), rise_mps=1.5, head_start_s=10.0, reach_m=80.0)
FLAT = FlatFilamentPlume(
    sources=(
        FlatFilamentSource(north_m=5.0, east_m=-3.0),
        FlatFilamentSource(north_m=0.0, east_m=0.0, strength=3.0),
    ),
    step_s=0.5,
    reach_m=60.0,
)
ROCKS = Obstacles(
    [
        RectangularObstacle(centre_north_m=5.0, centre_east_m=-12.0, length_north_m=6.0, length_east_m=4.0),
        PolygonalObstacle(corners_north_east_m=((-8.0, -10.0), (0.0, -18.0), (-2.0, -9.0))),
        RectangularObstacle(
            centre_north_m=15.0,
            centre_east_m=-9.0,
            length_north_m=0.3,
            length_east_m=20.0,
            top_above_home_m=6.0,
        ),
    ]
)
places_m = st.floats(-70.0, 70.0)
seconds = st.floats(0.0, 90.0)
Config = FilamentPlume | FlatFilamentPlume


def gusty(seed: int = 3, **config: Any) -> GustyWind:
    return GustyWind(WindConfig(**config), seed)


def flowing(obstacles: Obstacles | None = None, seed: int = 3) -> GridWind:
    return GridWind(GridWindConfig(speed_mps=1.5, length_m=120.0, cells=30), seed, obstacles)


def plume(
    config: Config = UPRIGHT,
    wind: WindField | None = None,
    seed: int = 7,
    obstacles: ObstacleField = OPEN_GROUND,
) -> Filaments:
    return Filaments(config, gusty() if wind is None else wind, HOME_AMSL_M, seed, obstacles)


def box(low: tuple[float, ...], high: tuple[float, ...], spacing_m: float) -> FloatArray:
    """(n, 3) middles of cubes of `spacing_m` in a box, north, east, up."""
    axes = [np.arange(a + 0.5 * spacing_m, b, spacing_m) for a, b in zip(low, high, strict=True)]
    grid = np.meshgrid(*axes, indexing="ij")
    return np.column_stack([axis.ravel() for axis in grid])


# -- mass --------------------------------------------------------------------------------------------------------


def test_the_puffs_hold_the_mass_that_was_emitted() -> None:
    """The integral of the density over the air above the ground is the emission times the time: nothing is lost at
    the ground, whatever the puffs' height."""
    source = FilamentSource(north_m=0.0, east_m=0.0, above_home_m=1.0, emission_kgps=0.5)
    config = FilamentPlume(sources=(source,), puffs_per_s=2.0, head_start_s=0.0, vertical_shaking=0.3)
    model = plume(config, gusty(speed_mps=1.0, gust_sd_mps=0.2))
    for time_s in (5.0, 20.0):
        live = model.puffs(time_s)
        assert len(live.radii_m) == round(2.0 * time_s)
        cells = box((-20.0, -40.0, 0.0), (20.0, 12.0, 20.0), 1.0)
        ppm = model.excesses_co2_ppm(cells * (1.0, 1.0, -1.0), time_s)
        mass_kg = float(ppm.sum()) * 1e-6 * co2_density_kgpm3(HOME_AMSL_M + 1.0)
        assert mass_kg == pytest.approx(0.5 * time_s, rel=2e-3)


def test_the_papers_puffs_are_those_that_keep_their_mass_cut_through_their_centres() -> None:
    """Q / (sqrt(8 pi^3) r^3) is 2^(-3/2) of Q / (pi^(3/2) r^3); over the plane that is Q / (2^(3/2) pi^(1/2) r)."""
    config = FlatFilamentPlume(
        sources=(FlatFilamentSource(north_m=0.0, east_m=0.0, strength=2.0),),
        puffs_per_s=0.1,
        ppm_per_unit=3.0,
    )
    model = plume(config, gusty(speed_mps=0.0, gust_sd_mps=0.0))
    time_s = 8.0
    live = model.puffs(time_s)
    assert live.radii_m == pytest.approx([(0.3 ** (2 / 3) + 0.02 * (time_s - 5.0)) ** 1.5], rel=1e-5)
    (radius_m,), centre = live.radii_m, live.positions_ned_m[0]
    peak = 3.0 * 2.0 / (math.sqrt(8.0 * math.pi**3) * radius_m**3)
    assert model.excess_co2_ppm(tuple(centre), time_s) == pytest.approx(peak, rel=1e-5)
    assert peak == pytest.approx(3.0 * 2.0 / (math.pi**1.5 * radius_m**3) * 2.0**-1.5)
    plane = box((-3.0, -3.0, 0.0), (3.0, 3.0, 0.02), 0.02) * (1.0, 1.0, 0.0) + centre * (1.0, 1.0, 0.0)
    total = float(model.excesses_co2_ppm(plane, time_s).sum()) * 0.02**2
    assert total == pytest.approx(3.0 * 2.0 / (2.0**1.5 * math.sqrt(math.pi) * radius_m), rel=1e-4)


@pytest.mark.parametrize("away", [0.0, 0.5, 1.0, 2.0, 3.0, 3.9])
def test_one_puff_is_a_gaussian(away: float) -> None:
    """Far above the ground, at any distance; beyond four radii nothing is left."""
    source = FilamentSource(north_m=0.0, east_m=0.0, above_home_m=500.0, emission_kgps=0.5)
    config = FilamentPlume(sources=(source,), puffs_per_s=0.1, head_start_s=0.0)
    model = plume(config, gusty(speed_mps=2.0, gust_sd_mps=0.0))
    (radius_m,), (centre,) = model.puffs(9.0).radii_m, model.puffs(9.0).positions_ned_m
    kgpm3 = 5.0 / (math.pi**1.5 * radius_m**3) * math.exp(-away * away)
    place = centre + away * radius_m * np.array([2.0, -1.0, 2.0]) / 3.0
    expected_ppm = 1e6 * kgpm3 / co2_density_kgpm3(HOME_AMSL_M + 500.0)
    assert model.excess_co2_ppm(tuple(place), 9.0) == pytest.approx(expected_ppm, rel=1e-3)
    assert model.excess_co2_ppm(tuple(centre + np.array([4.01 * radius_m, 0.0, 0.0])), 9.0) == 0.0


# -- where they go -----------------------------------------------------------------------------------------------


def test_a_puff_goes_with_the_wind_and_rises_until_its_buoyancy_is_gone() -> None:
    source = FilamentSource(north_m=0.0, east_m=0.0, above_home_m=3.0)
    config = FilamentPlume(
        sources=(source,), puffs_per_s=1.0, shaking=0.0, vertical_shaking=0.0, rise_mps=2.0, rise_time_s=5.0
    )
    live = plume(config, gusty(speed_mps=3.0, from_deg=180.0, gust_sd_mps=0.0)).puffs(0.0)
    age_s = np.arange(119.5, 0.0, -1.0)  # the head start of 120 s
    assert live.positions_ned_m[:, 0] == pytest.approx(3.0 * age_s, rel=1e-4)
    assert live.positions_ned_m[:, 1] == pytest.approx(0.0 * age_s, abs=1e-3)
    assert -live.positions_ned_m[:, 2] == pytest.approx(3.0 + 10.0 * -np.expm1(-age_s / 5.0), abs=0.01)
    assert live.radii_m == pytest.approx((1.0 + 0.05 * age_s) ** 1.5, rel=1e-4)


def test_the_ground_holds_them_up() -> None:
    source = FilamentSource(north_m=0.0, east_m=0.0)
    config = FilamentPlume(sources=(source,), puffs_per_s=20.0, vertical_shaking=1.0)
    live = plume(config).puffs(20.0)
    assert -live.positions_ned_m[:, 2].max() >= 0.0
    model = plume(config)
    assert model.excess_co2_ppm((0.0, 0.0, 0.0), 20.0) > 0.0
    assert model.excess_co2_ppm((0.0, 0.0, 0.01), 20.0) == 0.0


def test_a_moving_source_leaves_its_puffs_behind() -> None:
    source = FilamentSource(north_m=10.0, east_m=0.0, moving_north_mps=2.0, moving_east_mps=-1.0)
    config = FilamentPlume(sources=(source,), puffs_per_s=1.0, shaking=0.0, head_start_s=0.0)
    model = plume(config, gusty(speed_mps=0.0, gust_sd_mps=0.0))
    born_s = np.arange(0.5, 30.0, 1.0)
    assert model.puffs(30.0).positions_ned_m[:, 0] == pytest.approx(10.0 + 2.0 * born_s, abs=1e-3)
    assert model.puffs(30.0).positions_ned_m[:, 1] == pytest.approx(-born_s, abs=1e-3)
    assert model.sources_ned_m(30.0).tolist() == [[70.0, -30.0, 0.0]]
    assert model.source_ned_m == (10.0, 0.0, 0.0)


def test_the_mean_of_a_turbulent_plume_is_the_gaussian_of_its_spread() -> None:
    """A uniform wind with gusts, over 6,000 s: the mean section 60 m downwind carries what is emitted, and has the
    spread s^2 t + 2 sv^2 T^2 (t/T - 1 + exp(-t/T)) + r(t)^2/2 of shaking, gusts (Taylor 1921) and the puffs' width.
    """
    gust_sd_mps, gust_s, speed_mps, away_m = 0.25, 2.0, 3.0, 60.0
    source = FilamentSource(north_m=0.0, east_m=0.0, above_home_m=100.0, emission_kgps=1.0)
    config = FilamentPlume(
        sources=(source,), shaking=0.4, vertical_shaking=0.4, reach_m=85.0, puffs_per_s=4.0
    )
    wind = gusty(speed_mps=speed_mps, from_deg=270.0, gust_sd_mps=gust_sd_mps, gust_time_s=gust_s)
    model = plume(config, wind)
    north, up = np.meshgrid(np.arange(-24.0, 24.1, 2.0), np.arange(76.0, 124.1, 2.0), indexing="ij")
    places = np.column_stack([north.ravel(), np.full(north.size, away_m), -up.ravel()])
    sections = [model.excesses_co2_ppm(places, time_s) for time_s in np.arange(0.0, 6000.0, 2.0)]
    mean = np.mean(sections, axis=0).reshape(north.shape)
    flux_kgps = 4.0 * mean.sum() * 1e-6 * co2_density_kgpm3(HOME_AMSL_M + 100.0) * speed_mps
    assert flux_kgps == pytest.approx(1.0, rel=0.02)
    t = away_m / speed_mps
    taylor = 2.0 * gust_s**2 * (t / gust_s - 1.0 + math.exp(-t / gust_s))
    still = 0.4**2 * t + 0.5 * (1.0 + 0.05 * t) ** 3
    north_m2, up_m2 = still + gust_sd_mps**2 * taylor, still + (0.5 * gust_sd_mps) ** 2 * taylor
    assert (mean * north**2).sum() / mean.sum() == pytest.approx(north_m2, rel=0.05)
    assert (mean * (up - 100.0) ** 2).sum() / mean.sum() == pytest.approx(up_m2, rel=0.05)
    gaussian = np.exp(-0.5 * (north**2 / north_m2 + (up - 100.0) ** 2 / up_m2))

    def off(section: FloatArray) -> float:
        """The largest error, as a share of the peak."""
        return float(np.abs(section / section.sum() * gaussian.sum() - gaussian).max())

    assert off(mean) < 0.05
    assert off(np.mean(sections[:100], axis=0).reshape(north.shape)) > 3.0 * off(mean)


def test_old_and_far_puffs_are_gone() -> None:
    source = FilamentSource(north_m=0.0, east_m=0.0)
    calm = FilamentPlume(sources=(source,), puffs_per_s=4.0, lifetime_s=30.0)
    assert len(plume(calm, gusty(speed_mps=0.0, gust_sd_mps=0.0)).puffs(200.0).radii_m) == pytest.approx(
        120, abs=1
    )
    windy = FilamentPlume(sources=(source,), puffs_per_s=4.0, reach_m=60.0)
    live = plume(windy, gusty(speed_mps=3.0, gust_sd_mps=0.0)).puffs(200.0)
    assert len(live.radii_m) == pytest.approx(80, abs=2)
    assert np.abs(live.positions_ned_m[:, :2]).max() <= 60.0


def test_shaken_puffs_spread_as_a_random_walk() -> None:
    """Standard deviation `shaking` t^1/2 on each axis, whatever the step; no correlation between axes and puffs."""
    source = FilamentSource(north_m=0.0, east_m=0.0, above_home_m=200.0)
    for step_s in (0.1, 0.4):
        config = FilamentPlume(
            sources=(source,), puffs_per_s=100.0, shaking=0.6, vertical_shaking=0.3, step_s=step_s
        )
        live = plume(config, gusty(speed_mps=0.0, gust_sd_mps=0.0)).puffs(0.0)
        age_s = np.arange(len(live.radii_m), 0.0, -1.0) / 100.0
        z = live.positions_ned_m / (np.array([0.6, 0.6, 0.3]) * np.sqrt(age_s)[:, None])
        z[:, 2] += 200.0 / (0.3 * np.sqrt(age_s))
        z = z[: -len(z) // 10]  # the first steps' noise is not yet that of a walk
        assert z.mean(axis=0) == pytest.approx([0.0] * 3, abs=0.04)
        assert z.std(axis=0) == pytest.approx([1.0] * 3, abs=0.03)
        assert np.corrcoef(z.T) == pytest.approx(np.eye(3), abs=0.05)
        assert np.corrcoef(z[:-1, 0], z[1:, 0])[0, 1] == pytest.approx(0.0, abs=0.05)


# -- obstacles ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("config", [UPRIGHT, FLAT], ids=["upright", "flat"])
@pytest.mark.parametrize("flows", [True, False])
def test_no_puff_is_in_an_obstacle_and_no_gas(config: Config, flows: bool) -> None:
    """Neither where the wind flows around them nor where it blows right at them."""
    wind: WindField = flowing(ROCKS) if flows else gusty(speed_mps=2.0)
    model = plume(config, wind, obstacles=ROCKS)
    inside = box((2.5, -13.5, 0.0), (7.5, -10.5, 5.0), 0.5) * (1.0, 1.0, -1.0)
    for time_s in np.arange(0.0, 120.0, 1.3).tolist():
        live = model.puffs(time_s)
        assert ROCKS.clearances_m(live.positions_ned_m).min(initial=math.inf) > 0.0
        assert model.excesses_co2_ppm(inside, time_s).max() == 0.0
    beside = box((7.6, -16.0, 0.0), (9.0, -9.0, 3.0), 0.5) * (1.0, 1.0, -1.0)
    assert model.excesses_co2_ppm(beside, 100.0).max() > 0.0


def test_a_source_that_moves_through_a_rock_releases_nothing_there() -> None:
    source = FilamentSource(north_m=5.0, east_m=-30.0, moving_east_mps=2.0)
    config = FilamentPlume(sources=(source,), puffs_per_s=5.0, head_start_s=0.0)
    model = plume(config, gusty(speed_mps=0.0, gust_sd_mps=0.0), obstacles=ROCKS)
    live = model.puffs(20.0)
    born_m = -30.0 + 2.0 * (0.1 + 0.2 * np.arange(100))
    outside = (born_m < -14.0) | (born_m > -10.0)
    assert len(live.radii_m) == np.count_nonzero(outside) == 90
    assert ROCKS.clearances_m(live.positions_ned_m).min() > 0.0


def test_a_long_thin_wall_is_not_jumped_over() -> None:
    """The wall is thinner than the step that the wind makes; what is behind it came around its ends or over it."""
    wall = RectangularObstacle(
        centre_north_m=0.0, centre_east_m=-10.0, length_north_m=400.0, length_east_m=0.2
    )
    source = FilamentSource(north_m=0.0, east_m=0.0)
    config = FilamentPlume(sources=(source,), puffs_per_s=10.0, step_s=1.0, reach_m=100.0)
    live = plume(config, gusty(speed_mps=6.0), obstacles=Obstacles([wall])).puffs(30.0)
    assert len(live.radii_m) > 1000
    assert live.positions_ned_m[:, 1].min() > -10.0


# -- who asks, and when ------------------------------------------------------------------------------------------


@settings(max_examples=8, deadline=None)
@given(st.lists(seconds, min_size=2, max_size=4), st.integers(0, 2**40), st.data())
def test_the_order_of_questions_does_not_matter(times_s: list[float], seed: int, data: Any) -> None:
    order = data.draw(st.permutations(times_s))
    flat = data.draw(st.booleans())
    one, other = (plume(FLAT if flat else UPRIGHT, flowing(), seed) for _ in range(2))
    place = (3.0, -20.0, -6.0)
    assert {t: one.excess_co2_ppm(place, t) for t in times_s} == {
        t: other.excess_co2_ppm(place, t) for t in order
    }


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.tuples(places_m, places_m, st.floats(-30.0, 5.0)), min_size=1, max_size=300),
    seconds,
    st.sampled_from([UPRIGHT, FLAT]),
    st.booleans(),
)
def test_points_arrays_and_grids_are_the_same_bits(
    places: list[tuple[float, float, float]], time_s: float, config: Config, rocks: bool
) -> None:
    model = plume(config, obstacles=ROCKS if rocks else OPEN_GROUND)
    many = np.array(places)
    one_by_one = [model.excess_co2_ppm(place, time_s) for place in places]
    assert model.excesses_co2_ppm(many, time_s).tolist() == one_by_one
    norths, easts = np.linspace(-40.0, 41.0, 37), np.linspace(-55.0, 20.0, 29)
    nodes = np.stack([*np.meshgrid(norths, easts, indexing="ij"), np.full((37, 29), many[0, 2])], axis=-1)
    grid = np.full((37, 29), np.nan, np.float32)
    model.grid_excesses_co2_ppm(norths, easts, float(many[0, 2]), time_s, grid)
    assert grid.ravel().tolist() == model.excesses_co2_ppm(nodes.reshape(-1, 3), time_s).tolist()


def test_other_seeds_other_plumes_and_equal_ones_equal() -> None:
    def positions(seed: int) -> list[Any]:
        return list(plume(UPRIGHT, gusty(), seed).puffs(20.0).positions_ned_m.ravel())

    assert positions(1) == positions(1)
    assert positions(1) != positions(2)


def test_a_frame_is_the_state_itself_however_its_time_is_written() -> None:
    model = plume(UPRIGHT)
    for index in range(60):
        asked = model.excess_co2_ppm((4.0, -12.0, -5.0), index * 0.2)
        assert model.excess_co2_ppm((4.0, -12.0, -5.0), sum([0.2] * index)) == asked


def test_it_changes_steadily_between_its_steps() -> None:
    """No jump of more than a puff's release between two questions at 100 Hz."""
    model = plume(UPRIGHT)
    series = [model.excess_co2_ppm((5.0, -30.0, -10.0), 20.0 + 0.01 * i) for i in range(2000)]
    assert max(series) > 50.0
    assert np.abs(np.diff(series)).max() < 0.05 * max(series)


@pytest.mark.parametrize(
    "wind",
    [
        BoundaryLayerWindConfig(thermals=ThermalsConfig()),
        GridWindConfig(length_m=200.0, roughness_m=0.1),
        GridWindConfig(length_m=200.0, regime="turbulent"),
        WindConfig(speed_mps=0.0),
    ],
)  # fmt: skip
def test_every_wind_carries_puffs(wind: AnyWindConfig) -> None:
    """Between rocks, one of which they fly over; two worlds of one file are one, however often they are asked."""
    tower = RectangularObstacle(
        centre_north_m=20.0, centre_east_m=-20.0, length_north_m=9.0, length_east_m=9.0, top_above_home_m=8.0
    )
    wall = RectangularObstacle(
        centre_north_m=-20.0, centre_east_m=-20.0, length_north_m=9.0, length_east_m=9.0
    )
    config = WorldConfig(
        origin=Geodetic(14.38, -90.6, HOME_AMSL_M),
        wind=wind,
        plume=UPRIGHT,
        obstacles=(tower, wall),
        seed=2**40 + 1,
    )
    often, once = make_world(config), make_world(config)
    for time_s in np.arange(0.0, 30.0, 0.7).tolist():
        assert math.isfinite(often.co2_ppm((5.0, -10.0, -6.0), time_s))
    assert isinstance(often.gas, Filaments)
    assert isinstance(once.gas, Filaments)
    found, expected = often.gas.puffs(40.0), once.gas.puffs(40.0)
    assert len(expected.radii_m) > 40
    assert np.isfinite(expected.positions_ned_m).all()
    assert np.array_equal(found.positions_ned_m, expected.positions_ned_m)
    assert once.obstacles.clearances_m(expected.positions_ned_m).min() > 0.0


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * 3), min_size=1, max_size=4),
    st.floats(0.0, 20.0),
    st.floats(0.0, 30.0),
    st.floats(0.05, 2.0),
    st.booleans(),
)
def test_no_question_has_nan_for_an_answer(
    places: list[tuple[float, float, float]], time_s: float, speed_mps: float, step_s: float, flat: bool
) -> None:
    common: dict[str, Any] = {"puffs_per_s": 5.0, "step_s": step_s, "head_start_s": 3.0, "growth": 0.0}
    config: Config = (
        FlatFilamentPlume(sources=(FlatFilamentSource(north_m=0.0, east_m=0.0),), **common)
        if flat
        else FilamentPlume(sources=(FilamentSource(north_m=0.0, east_m=0.0),), rise_mps=50.0, **common)
    )
    model = plume(config, gusty(speed_mps=speed_mps, gust_sd_mps=3.0), obstacles=ROCKS)
    many = np.array([*places, *model.puffs(time_s).positions_ned_m.tolist()])
    excesses = model.excesses_co2_ppm(many, time_s)
    assert np.isfinite(excesses).all()
    assert (excesses >= 0.0).all()
    assert all(math.isfinite(model.excess_co2_ppm(place, time_s)) for place in places)


# -- in a world --------------------------------------------------------------------------------------------------


def test_a_flights_instruments_smell_it() -> None:
    config = WorldConfig(origin=Geodetic(14.38, -90.6, HOME_AMSL_M), plume=UPRIGHT, seed=7)
    world = make_world(config)
    expected = plume(UPRIGHT, GustyWind(WindConfig(), 7), 7)
    for place in expected.puffs(33.33).positions_ned_m[::7].tolist():
        air = world.air_at(place, 33.33, (0.0, 0.0, 0.0))
        assert air.co2_ppm == 420.0 + expected.excess_co2_ppm(place, 33.33)
        assert air.co2_ppm > 421.0
    assert world.gas.source_ned_m == (5.0, -3.0, -4.0)


@pytest.mark.parametrize(
    ("changes", "field", "problem"),
    [
        ({"puffs_per_s": 1e5}, "plume.puffs_per_s", "120,000,000 puffs would be in the air, and 2,000,000"),
        ({"initial_radius_m": 0.05}, "plume.initial_radius_m", "2.45e+08 ppm at its centre, more than pure CO2"),
        ({"sources": (FilamentSource(north_m=5.0, east_m=-12.0),)}, "plume.sources[0]", "is inside obstacles[0]"),
        ({"sources": (SOURCE, FilamentSource(north_m=61.0, east_m=0.0))}, "plume.sources[1]", "1 m outside"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("flat", [False, True])
def test_plumes_that_cannot_be(changes: dict[str, Any], field: str, problem: str, flat: bool) -> None:
    values: dict[str, Any] = {"sources": (SOURCE, OTHER), "lifetime_s": 600.0} | changes
    if flat:
        sources = tuple(
            FlatFilamentSource(north_m=one.north_m, east_m=one.east_m) for one in values["sources"]
        )
        values["sources"] = sources
    config = WorldConfig(
        origin=Geodetic(14.38, -90.6, HOME_AMSL_M),
        wind=GridWindConfig(length_m=120.0, cells=30),
        plume=FlatFilamentPlume(**values) if flat else FilamentPlume(**values),
        obstacles=(
            RectangularObstacle(
                centre_north_m=5.0, centre_east_m=-12.0, length_north_m=6.0, length_east_m=4.0
            ),
        ),
    )
    found = [(where, what) for where, what in problems(config) if problem in what]
    assert [where for where, _ in found] == ([] if flat and "ppm" in problem else [field])
