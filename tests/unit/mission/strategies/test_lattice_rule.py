"""Algorithms B1 to B4: each branch on its own, and the source and sink theorems in flows that are known exactly."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.geometry.formation import FloatArray
from mission.strategies.lattice import lattice_rule as rule
from mission.strategies.lattice.lattice_rule import (
    ANEMOTAXIS,
    CAST,
    CENTRE_E,
    CENTRE_N,
    CHEMOTAXIS,
    FLUXOTAXIS,
    INFLUX,
    INFLUX_E,
    INFLUX_N,
    LATTICE_STATE,
    OUTFLUX,
    OUTFLUX_E,
    OUTFLUX_N,
    RADIUS_M,
    SENSING,
    TOWARD_E,
    TOWARD_N,
    lattice_begin,
    lattice_next,
    ring_flux,
)
from mission.strategies.spokes import GOLDEN

Field = Callable[[FloatArray, FloatArray], FloatArray]
Flow = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]


def numbers(tracer: int, most_m: float = 2.0, edge_m: float = 20.0) -> FloatArray:
    found = np.zeros(rule.LATTICE_NUMBERS)
    found[rule.TRACER], found[rule.LEAST_M], found[rule.MOST_M] = tracer, 0.5, most_m
    found[rule.WIDEN_M], found[rule.STEP_M] = 0.25, 1.0
    found[rule.DETECTION], found[rule.FLUX] = 1e-5, 1e-6
    found[rule.LOW_N] = found[rule.LOW_E] = -edge_m
    found[rule.HIGH_N] = found[rule.HIGH_E] = edge_m
    return found


CASTING = (math.cos(math.atan(GOLDEN)), math.sin(math.atan(GOLDEN)))
"""North and east of a step, but for signs."""


class Hexagon:
    """Seven vehicles that are always where they are sent, in a steady plume."""

    def __init__(
        self, tracer: int, gas: Field, flow: Flow, at: tuple[float, float] = (0.0, 0.0), **limits: float
    ) -> None:
        self.numbers = numbers(tracer, **limits)
        self.state = np.zeros(LATTICE_STATE)
        lattice_begin(self.state, self.numbers, *at, 0.5, 0.1)
        self.gas, self.flow = gas, flow
        self.rng = np.random.default_rng(5)

    def places(self) -> tuple[FloatArray, FloatArray]:
        bearing_rad = 2.0 * math.pi * np.arange(6) / 6.0
        north = self.state[CENTRE_N] + np.r_[0.0, self.state[RADIUS_M] * np.cos(bearing_rad)]
        east = self.state[CENTRE_E] + np.r_[0.0, self.state[RADIUS_M] * np.sin(bearing_rad)]
        return north, east

    def next(self, draw: float | None = None, held_m: tuple[float, float] = (0.0, 0.0)) -> FloatArray:
        """Decide once, with everybody `held_m` away from where they were sent; (3,) centre and radius."""
        north, east = self.places()
        north, east = north + held_m[0], east + held_m[1]
        draw = float(self.rng.random()) if draw is None else draw
        lattice_next(
            self.state, self.numbers, north, east, self.gas(north, east), *self.flow(north, east), 7, draw
        )
        return self.state[[CENTRE_N, CENTRE_E, RADIUS_M]].copy()

    def trace(self, waypoints: int) -> FloatArray:
        return np.array([self.next() for _ in range(waypoints)])


def clean(north: FloatArray, east: FloatArray) -> FloatArray:
    return np.zeros_like(north)


def calm(north: FloatArray, east: FloatArray) -> tuple[FloatArray, FloatArray]:
    return np.zeros_like(north), np.zeros_like(east)


def blowing(north_mps: float, east_mps: float) -> Flow:
    return lambda north, east: (np.full_like(north, north_mps), np.full_like(east, east_mps))


def gaussian(sd_m: float, at: tuple[float, float] = (0.0, 0.0)) -> Field:
    return lambda north, east: np.exp(-((north - at[0]) ** 2 + (east - at[1]) ** 2) / (2.0 * sd_m**2))


def radial(per_s: float) -> Flow:
    """Out of the origin, or into it."""
    return lambda north, east: (per_s * north, per_s * east)


def test_casting_pulsates_between_its_limits_and_crosses_the_whole_area() -> None:
    hexagon = Hexagon(CAST, clean, calm)
    path = hexagon.trace(2000)
    assert (path[:, 2].min(), path[:, 2].max()) == (0.5, 2.0)
    assert (np.abs(path[:, :2]) <= 20.0 - path[:, 2:] + 1e-9).all()
    assert (np.abs(np.diff(path[:, :2], axis=0)) <= 1.0 + 1.5).all()
    # Reflected ways that shift: every 5 m square within the limits is visited.
    seen = {tuple(cell) for cell in np.floor(path[:, :2] / 5.0).astype(int)}
    assert len(seen) >= 60


def test_an_advance_that_is_held_up_is_reversed_along_its_axis_alone() -> None:
    hexagon = Hexagon(CAST, clean, calm)
    hexagon.next()
    before = hexagon.state[[TOWARD_N, TOWARD_E]].copy()
    hexagon.next(held_m=(-0.7 * before[0], 0.0))
    assert hexagon.state[[TOWARD_N, TOWARD_E]].tolist() == [-before[0], before[1]]


def test_chemotaxis_goes_to_the_highest_reading_and_breathes_at_random() -> None:
    east = Hexagon(CHEMOTAXIS, lambda north, east: 1.0 + 0.1 * east + 0.0 * north, calm)
    centre_n, centre_e, radius_m = east.next(draw=0.4)
    assert (centre_n, radius_m) == pytest.approx((0.25, 0.75))  # the first of two at the same reading
    assert centre_e == pytest.approx(0.5 * math.sqrt(0.75))
    assert east.next(draw=0.6)[2] == 0.5
    assert east.next(draw=0.6)[2] == 0.5  # not below its least


def test_a_waypoint_is_no_farther_than_a_step() -> None:
    hexagon = Hexagon(CHEMOTAXIS, lambda north, east: 1.0 + north + 0.0 * east, calm)
    hexagon.state[RADIUS_M] = 2.0
    assert hexagon.next()[:2] == pytest.approx([1.0, 0.0])


def test_anemotaxis_goes_a_step_against_the_mean_wind_and_casts_without_any() -> None:
    hexagon = Hexagon(ANEMOTAXIS, gaussian(5.0), blowing(-0.3, 0.4))
    assert hexagon.next()[:2] == pytest.approx([0.6, -0.8])
    for other in (Hexagon(ANEMOTAXIS, gaussian(5.0), calm), Hexagon(ANEMOTAXIS, clean, blowing(0.3, 0.0))):
        assert np.abs(other.next()[:2]) == pytest.approx(CASTING)


def test_fluxotaxis_contracts_about_a_centre_with_more_than_half_of_all() -> None:
    hexagon = Hexagon(FLUXOTAXIS, gaussian(0.3), calm)
    hexagon.state[RADIUS_M] = 2.0
    assert hexagon.next() == pytest.approx([0.0, 0.0, 0.5])


def test_fluxotaxis_senses_at_three_radii_from_the_nearer_end() -> None:
    outward = Hexagon(FLUXOTAXIS, gaussian(3.0), radial(0.1), (2.0, 0.0))
    assert [outward.next()[2] for _ in range(2)] == [1.25, 2.0]  # at 0.5 m it is already
    assert outward.next()[:2] != pytest.approx([2.0, 0.0])
    inward = Hexagon(FLUXOTAXIS, gaussian(3.0), radial(0.1), (2.0, 0.0))
    inward.state[RADIUS_M] = 1.5
    assert [inward.next()[2] for _ in range(3)] == [2.0, 1.25, 0.5]
    assert inward.state[SENSING] == 3.0


def test_where_more_is_read_the_wider_the_ring_the_lattice_goes_to_the_centroids() -> None:
    hexagon = Hexagon(FLUXOTAXIS, lambda north, east: np.exp(1.5 * north) + 0.0 * east, calm)
    for _ in range(2):
        hexagon.next()
    north, east, _ = hexagon.next()
    assert 0.3 < north <= 1.0
    assert east == pytest.approx(0.0, abs=1e-9)


def test_where_less_is_read_the_wider_the_ring_the_lattice_goes_to_the_influx_or_the_outflux() -> None:
    plume = gaussian(1.5, (0.3, 0.0))
    into = Hexagon(FLUXOTAXIS, plume, blowing(0.0, -0.2))
    for _ in range(3):
        into.next()
    assert into.state[CENTRE_E] > 0.3  # the wind comes from the east
    out = Hexagon(FLUXOTAXIS, plume, blowing(0.0, -0.2))
    for _ in range(2):
        out.next()
    out.state[INFLUX] = -1.0
    out.numbers[rule.FLUX] = 0.01
    out.flow = lambda north, east: (0.0 * north, -0.2 * (east < 0.0))  # nothing comes in
    out.next()
    assert out.state[CENTRE_E] < -0.3
    still = Hexagon(FLUXOTAXIS, plume, calm)
    path = still.trace(3)
    assert np.abs(path[2, :2]) == pytest.approx(CASTING)  # no flux


def test_the_flux_through_an_edge_is_its_ends_mean_along_the_normal_times_its_length() -> None:
    state = np.zeros(LATTICE_STATE)
    north, east = np.array([0.0, 1.0, 1.0, -1.0, -1.0]), np.array([0.0, -1.0, 1.0, 1.0, -1.0])
    gas = np.array([9.0, 2.0, 4.0, 1.0, 1.0])
    wind = np.full(5, -0.5), np.zeros(5)  # from the north
    for order in ([0, 1, 2, 3, 4], [0, 4, 3, 2, 1]):
        state[:] = 0.0
        ring_flux(state, north[order], east[order], gas[order], *wind, 5)
        assert state[[INFLUX, INFLUX_N, INFLUX_E]].tolist() == pytest.approx([3.0 * 0.5 * 2.0, 1.0, 0.0])
        assert state[[OUTFLUX, OUTFLUX_N, OUTFLUX_E]].tolist() == pytest.approx([1.0 * 0.5 * 2.0, -1.0, 0.0])


STARTS = [(distance_m, bearing_rad) for distance_m in (0.3, 2.0, 5.0) for bearing_rad in (0.3, 2.0, 4.0)]


def last_away_m(tracer: int, sd_m: float, per_s: float, start: tuple[float, float]) -> float:
    """How far from the origin the lattice is on average at the end of 120 waypoints."""
    at = start[0] * math.cos(start[1]), start[0] * math.sin(start[1])
    path = Hexagon(tracer, gaussian(sd_m), radial(per_s), at).trace(120)
    return float(np.hypot(path[-20:, 0], path[-20:, 1]).mean())


@pytest.mark.parametrize("sd_m", [2.0, 4.0])
def test_source_theorem(sd_m: float) -> None:
    """Where mass flux diverges, chemotaxis and fluxotaxis both come to the source."""
    for start in STARTS:
        assert last_away_m(CHEMOTAXIS, sd_m, 0.2, start) < 0.5
        assert last_away_m(FLUXOTAXIS, sd_m, 0.2, start) < 1.0  # a step


@pytest.mark.parametrize("sd_m", [2.0, 4.0])
def test_sink_theorem(sd_m: float) -> None:
    """The same plume about a sink misleads chemotaxis, and fluxotaxis leaves it, even from within."""
    for start in STARTS:
        assert last_away_m(CHEMOTAXIS, sd_m, -0.2, start) < 0.5
        assert last_away_m(FLUXOTAXIS, sd_m, -0.2, start) > sd_m


finite = st.floats(-50.0, 50.0) | st.just(0.0)


@given(
    tracer=st.sampled_from([CAST, CHEMOTAXIS, ANEMOTAXIS, FLUXOTAXIS]),
    rows=st.lists(
        st.tuples(finite, finite, st.floats(0.0, 1e9) | st.just(0.0), finite, finite), min_size=1, max_size=9
    ),
    draws=st.lists(st.floats(0.0, 1.0, exclude_max=True), min_size=6, max_size=6),
    most_m=st.sampled_from([0.5, 2.0, 30.0]),
)
@settings(deadline=None, max_examples=200)
def test_whatever_is_read_the_next_lattice_is_within_its_limits(
    tracer: int, rows: list[tuple[float, ...]], draws: list[float], most_m: float
) -> None:
    limits = numbers(tracer, most_m)
    state = np.zeros(LATTICE_STATE)
    lattice_begin(state, limits, 40.0, 0.0, 0.5, draws[0])
    columns: Any = np.array(rows).T.copy()
    for draw in draws:
        lattice_next(state, limits, *columns, len(rows), draw)
        assert np.isfinite(state).all()
        assert 0.5 <= state[RADIUS_M] <= min(most_m, 20.0)
        assert (np.abs(state[[CENTRE_N, CENTRE_E]]) <= 20.0 - state[RADIUS_M] + 1e-9).all()
