"""The flowing wind has the statistics of its configuration, goes around obstacles and never diverges."""

from __future__ import annotations

import functools
import math
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simvehicle.world.grid_wind import GridWind, fastest_mps, stable_step_s
from simvehicle.world.obstacles import Obstacles
from simvehicle.world.world_config import GridWindConfig, PolygonalObstacle, RectangularObstacle

BLOCK = RectangularObstacle(centre_north_m=10.0, centre_east_m=5.0, length_north_m=16.0, length_east_m=12.0)
LOW_WALL = PolygonalObstacle(
    corners_north_east_m=((-40.0, -30.0), (-20.0, -10.0), (-20.0, -9.0), (-41.0, -30.0)), top_above_home_m=8.0
)
SMALL = GridWindConfig(speed_mps=3.0, from_deg=250.0, length_m=120.0, cells=24)
metres = st.floats(allow_nan=False, allow_infinity=False)
inside_m = st.floats(-59.0, 59.0)


@functools.cache
def wind(config: GridWindConfig = SMALL, seed: int = 4, *, standing: bool = True) -> GridWind:
    return GridWind(config, seed, Obstacles((BLOCK, LOW_WALL)) if standing else None)


@settings(max_examples=15, deadline=None)
@given(st.lists(st.floats(0.0, 200.0), min_size=1, max_size=6), st.integers(0, 2**40))
def test_the_order_of_questions_does_not_matter(times_s: list[float], seed: int) -> None:
    config = GridWindConfig(speed_mps=2.0, length_m=60.0, cells=8)
    one, other = GridWind(config, seed), GridWind(config, seed)
    place = (7.0, -3.0, -5.0)
    asked = [one.wind_ned_mps(place, t) for t in times_s]
    again = [other.wind_ned_mps(place, t) for t in reversed(times_s)]
    assert asked == list(reversed(again))


def test_other_seeds_are_other_winds() -> None:
    place = (-10.0, 20.0, -5.0)
    assert wind(seed=1).wind_ned_mps(place, 9.0) != wind(seed=2).wind_ned_mps(place, 9.0)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(metres, metres, metres), min_size=1, max_size=5), st.floats(0.0, 20.0))
def test_no_finite_position_gives_nan(places: list[tuple[float, float, float]], time_s: float) -> None:
    config = GridWindConfig(speed_mps=3.0, length_m=120.0, cells=24, roughness_m=0.05)
    asked = wind(config)
    many = asked.winds_ned_mps(np.array(places), time_s)
    assert np.isfinite(many).all()
    assert [list(asked.wind_ned_mps(place, time_s)) for place in places] == [
        pytest.approx(row, rel=1e-9, abs=1e-12) for row in many.tolist()
    ]


@settings(max_examples=60, deadline=None)
@given(inside_m, inside_m, st.floats(0.0, 30.0), st.floats(0.0, 20.0))
def test_there_is_no_flow_inside_obstacles(north_m: float, east_m: float, up_m: float, time_s: float) -> None:
    asked = wind()
    place = (north_m, east_m, -up_m)
    one, many = asked.wind_ned_mps(place, time_s), asked.winds_ned_mps(np.array([place]), time_s)
    assert many[0].tolist() == pytest.approx(one)
    if asked.obstacles.clearance_m(place) < 0.0:
        assert one == (0.0, 0.0, 0.0)
    else:
        # Beside it the air may stand still for half a cell, and nowhere else.
        aside_m = asked.obstacles.taller_than(up_m).clearance_m(place)
        assert one != (0.0, 0.0, 0.0) or aside_m <= 1.5 * asked.spacing_m


def test_above_its_top_the_air_flows_as_if_an_obstacle_were_not_there() -> None:
    around, open_air = wind(), wind(standing=False)
    block = GridWind(SMALL, 4, Obstacles((BLOCK,)))
    behind = (-25.0, -15.0)
    assert around.wind_ned_mps((*behind, -9.0), 7.0) == block.wind_ned_mps((*behind, -9.0), 7.0)
    assert around.wind_ned_mps((*behind, -7.0), 7.0) != block.wind_ned_mps((*behind, -7.0), 7.0)
    assert block.wind_ned_mps((*behind, -9.0), 7.0) != open_air.wind_ned_mps((*behind, -9.0), 7.0)


def test_nothing_flows_through_walls_thinner_than_a_cell() -> None:
    """Four slanting walls of 10 cm around a yard in cells of 5 m: outside it blows, inside it does not."""
    corners = ((-45.0, 3.0), (5.0, -40.0), (43.0, 4.0), (-2.0, 44.0))
    walls = []
    for (n0, e0), (n1, e1) in zip(corners, (*corners[1:], corners[0]), strict=True):
        along = math.hypot(n1 - n0, e1 - e0)
        off_n, off_e = -0.1 * (e1 - e0) / along, 0.1 * (n1 - n0) / along
        walls.append(
            PolygonalObstacle(
                corners_north_east_m=((n0, e0), (n1, e1), (n1 + off_n, e1 + off_e), (n0 + off_n, e0 + off_e))
            )
        )
    asked = GridWind(msgspec.structs.replace(SMALL, diffusivity_m2ps=15.0), 4, Obstacles(walls))
    for time_s in (200.0, 300.0):  # what was in the yard at first has come to rest
        north, east = asked.grid_mps(time_s)
        assert math.hypot(north[12, 12], east[12, 12]) < 1e-6
        assert np.hypot(north, east)[9:16, 9:16].max() < 1e-5
        assert np.hypot(north, east)[2, 2] > 0.5


def test_the_corners_are_coloured_noise_about_steady_winds() -> None:
    config = GridWindConfig(
        speed_mps=2.0, from_deg=270.0, length_m=60.0, cells=4, noise_bandwidth_radps=0.5, noise_damping=0.5,
        corner_noise=0.3,
    )  # fmt: skip
    asked = GridWind(config, seed=3)
    series = np.array([asked.corners_mps(0.5 * k).ravel() for k in range(20_000)])
    assert series.std(axis=0).mean() == pytest.approx(0.6, rel=0.05)
    noise = series - series.mean(axis=0)
    shared = np.corrcoef(noise.T) - np.eye(8)
    assert np.abs(shared).max() < 0.15  # corners and axes are independent
    # x'' + 2 d b x' + b^2 x = white noise with d < 1 (Farrell et al. 2002).
    b, d = 0.5, 0.5
    swing = b * math.sqrt(1.0 - d * d)
    for lag in (2, 8, 16):
        t = 0.5 * lag
        expected = math.exp(-d * b * t) * (
            math.cos(swing * t) + d / math.sqrt(1.0 - d * d) * math.sin(swing * t)
        )
        measured = (noise[:-lag] * noise[lag:]).mean() / noise.var()
        assert measured == pytest.approx(expected, abs=0.06)


def test_steady_corners_have_the_configured_spread() -> None:
    config = GridWindConfig(speed_mps=2.0, from_deg=180.0, cells=4, corner_spread=0.5, corner_noise=0.0)
    steady = np.array([GridWind(config, seed).corners_mps(0.0) for seed in range(120)])
    assert steady[:, 0].mean() == pytest.approx(2.0, abs=0.1)
    assert steady[:, 1].mean() == pytest.approx(0.0, abs=0.1)
    assert steady.std(axis=0).mean() == pytest.approx(1.0, rel=0.05)


@pytest.mark.parametrize(
    "changes",
    [
        {"regime": "laminar"},
        {"regime": "transitional"},
        {"regime": "turbulent"},
        {"diffusivity_m2ps": 0.01},
        {"diffusivity_m2ps": 100.0},
        {"corner_spread": 5.0, "corner_noise": 5.0, "noise_bandwidth_radps": 2.0},
    ],
)
@pytest.mark.parametrize("longest", [False, True])
def test_no_component_leaves_the_range_of_the_edges(changes: dict[str, Any], longest: bool) -> None:
    """The solver makes no wind of its own, however long it runs, up to the longest step that it takes."""
    config = GridWindConfig(speed_mps=3.0, length_m=60.0, cells=16, **changes)
    if longest:
        config = msgspec.structs.replace(config, step_s=stable_step_s(config))
    asked = GridWind(config, 4, Obstacles((BLOCK,)))
    begin_s = -asked._spin_up * asked.step_s
    past = [asked.corners_mps(begin_s + k * asked.step_s) for k in range(asked._spin_up + 2000)]
    corners = np.array(past).reshape(-1, 2, 4)
    lowest, highest = corners.min(axis=(0, 2)), corners.max(axis=(0, 2))
    for index in range(0, 2000, 7):
        flow = asked.grid_mps(index * asked.step_s).reshape(2, -1)
        assert (flow.min(axis=1) >= np.minimum(lowest, 0.0) - 1e-9).all()
        assert (flow.max(axis=1) <= np.maximum(highest, 0.0) + 1e-9).all()
        assert np.abs(flow).max() <= fastest_mps(config) + 1e-9


@pytest.mark.parametrize(("regime", "spread", "noise"), [("laminar", 0.15, 0.1), ("turbulent", 1.0, 0.6)])
def test_regimes_are_those_of_the_papers(regime: Any, spread: float, noise: float) -> None:
    config = GridWindConfig(speed_mps=2.0, regime=regime)
    assert (config.spread_mps, config.noise_mps) == (2.0 * spread, 2.0 * noise)
    own = GridWindConfig(speed_mps=2.0, regime=regime, corner_noise=0.0)
    assert (own.spread_mps, own.noise_mps) == (2.0 * spread, 0.0)
    assert GridWindConfig(speed_mps=2.0).spread_mps == 1.0


def test_divergence_is_none_in_an_even_wind_and_within_bounds_in_others() -> None:
    even = GridWind(GridWindConfig(corner_spread=0.0, corner_noise=0.0, cells=12), 1)
    assert np.abs(even.divergence_ps(5.0)).max() < 1e-12
    # Without obstacles it is that of the corners' differences over the length of the square, steepened a little.
    for seed in range(3):
        asked = wind(seed=seed, standing=False)
        corners = asked.corners_mps(8.0)
        steepest = np.ptp(corners, axis=(1, 2)).sum() / SMALL.length_m
        assert np.sqrt((asked.divergence_ps(8.0) ** 2).mean()) < 1.5 * steepest
        assert np.abs(asked.divergence_ps(8.0)[4:-4, 4:-4]).max() < 3.0 * steepest


def test_a_step_that_would_diverge_is_refused_with_the_one_that_holds() -> None:
    config = GridWindConfig(speed_mps=3.0, cells=60, step_s=0.4)
    with pytest.raises(
        ValueError, match=r"would diverge with a step of 0.4 s; steps up to .* s hold"
    ) as refusal:
        GridWind(config, 1)
    assert "\n" not in str(refusal.value)
    holds_s = float(str(refusal.value).split("steps up to ")[1].split(" s ")[0])
    assert 0.99 * stable_step_s(config) <= holds_s <= stable_step_s(config)
    held = GridWind(GridWindConfig(speed_mps=3.0, cells=60, step_s=holds_s), 1)
    assert 0.0 < np.abs(held.grid_mps(60.0)).max() <= fastest_mps(config)


def test_beyond_the_bound_the_solver_does_diverge() -> None:
    """The bound is not a matter of taste."""
    from simvehicle.world.compiled_flow import flow_step

    config = GridWindConfig(speed_mps=3.0, length_m=120.0, cells=24, diffusivity_m2ps=60.0)
    flow = np.random.default_rng(1).normal(0.0, 1.0, (2, 25, 25))
    solid, corners = np.zeros((25, 25), np.bool_), np.zeros((2, 2, 2))
    largest = []
    for factor in (0.99, 1.2):
        before = flow.copy()
        for _ in range(200):
            after = np.empty_like(before)
            flow_step(before, after, corners, solid, 5.0, 60.0, factor * stable_step_s(config))
            before = after
        largest.append(float(np.abs(before).max()))
    assert largest[0] < 1.0
    assert not largest[1] < 1e3


def statistics(
    config: GridWindConfig, seed: int = 6, *, every_s: float = 4.0, times: int = 150, standing: bool = True
) -> np.ndarray:
    """Mean and standard deviation of both components over time, how different places are, mean and standard deviation
    of the speed: of places in the square that are not beside an obstacle."""
    asked = GridWind(config, seed, Obstacles((BLOCK,)) if standing else None)
    axis_m = np.linspace(-0.42, 0.42, 9) * config.length_m
    north, east = np.meshgrid(axis_m, axis_m, indexing="ij")
    places = np.column_stack([north.ravel(), east.ravel(), np.full(81, -5.0)])
    away = asked.obstacles.clearances_m(places) > 10.0
    winds = np.array([asked.winds_ned_mps(places[away], every_s * k)[:, :2] for k in range(times)])
    speeds = np.hypot(winds[..., 0], winds[..., 1])
    return np.array(
        [
            *winds.mean(axis=(0, 1)),
            *winds.std(axis=0).mean(axis=0),
            *winds.mean(axis=0).std(axis=0),
            speeds.mean(),
            speeds.std(),
        ]
    )


def test_halving_the_step_or_the_cells_changes_the_statistics_by_less_than_a_twentieth() -> None:
    coarse = GridWindConfig(
        speed_mps=2.0, from_deg=230.0, length_m=120.0, cells=30, diffusivity_m2ps=8.0, noise_bandwidth_radps=0.05,
        step_s=0.1,
    )  # fmt: skip
    at_first = statistics(coarse)
    size = math.hypot(*at_first[:2])
    for finer in ({"step_s": 0.05}, {"cells": 60}):
        again = statistics(msgspec.structs.replace(coarse, **finer))
        assert np.abs(again - at_first).max() < 0.05 * size
        assert again[-2:] == pytest.approx(at_first[-2:], rel=0.05)


@pytest.mark.long
@pytest.mark.parametrize("regime", ["laminar", "transitional", "turbulent"])
@pytest.mark.parametrize("standing", [False, True])
def test_the_papers_worlds_have_converged(regime: Any, standing: bool) -> None:
    """61^2 nodes over 91.4 m, as the experiments have them: half the step, and half the cells."""
    paper = GridWindConfig(speed_mps=0.5, from_deg=245.0, length_m=91.4, cells=60, regime=regime)
    step_s = GridWind(paper, 1).step_s
    at_first = statistics(paper, every_s=10.0, times=100, standing=standing)
    for finer in ({"step_s": 0.5 * step_s}, {"cells": 120}):
        again = statistics(
            msgspec.structs.replace(paper, **finer), every_s=10.0, times=100, standing=standing
        )
        assert np.abs(again - at_first).max() < 0.05 * paper.speed_mps
        assert again[-2] == pytest.approx(at_first[-2], rel=0.05)


def test_a_mean_wind_over_rough_ground_grows_with_the_logarithm_of_the_height() -> None:
    config = GridWindConfig(cells=8, roughness_m=0.1)
    asked = GridWind(config, 1)
    speeds = [
        math.hypot(*asked.wind_ned_mps((0.0, 0.0, -up_m), 0.0)) for up_m in (10.0, 31.6227766, 1.0, 0.05)
    ]
    assert [speed / speeds[0] for speed in speeds] == pytest.approx([1.0, 1.25, 0.5, 0.0], abs=1e-6)
    level = GridWind(GridWindConfig(cells=8), 1)
    assert level.wind_ned_mps((0.0, 0.0, -1.0), 0.0) == level.wind_ned_mps((0.0, 0.0, -50.0), 0.0)
    assert level.wind_ned_mps((0.0, 0.0, -10.0), 0.0) == pytest.approx(
        asked.wind_ned_mps((0.0, 0.0, -10.0), 0.0)
    )


def test_beyond_the_square_the_wind_is_that_of_its_edge() -> None:
    asked = wind(standing=False)
    assert asked.wind_ned_mps((500.0, 20.0, -5.0), 3.0) == asked.wind_ned_mps((60.0, 20.0, -5.0), 3.0)


def test_who_asks_again_for_long_ago_gets_the_same_answer() -> None:
    asked = GridWind(GridWindConfig(speed_mps=2.0, length_m=60.0, cells=8), 2)
    place = (3.0, 4.0, -5.0)
    times_s = [0.3 * k for k in range(0, 20_000, 700)]
    first = [asked.wind_ned_mps(place, t) for t in times_s]
    assert [asked.wind_ned_mps(place, t) for t in reversed(times_s)] == first[::-1]
    assert len(asked._states._marks) <= 32
