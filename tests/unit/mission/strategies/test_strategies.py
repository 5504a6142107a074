"""The rules inside the strategies: spiral, gradient, MoBS steps, arrival, estimate, the table of names."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.estimation.estimates import Reading, Scalar, Wind
from mission.estimation.source import estimate_source
from mission.geometry.formation import Hexagonal
from mission.strategies.arrival import Arrival
from mission.strategies.contract import Observation, Order, OwnState, Stage, TreePlace
from mission.strategies.entry import StrategyEntry
from mission.strategies.locus.gradient import plane_gradient, waypoint_uphill
from mission.strategies.locus.note import LocusNote, noted
from mission.strategies.locus.spiral import arm_spacing_m, spiral_index, spiral_point
from mission.strategies.mobs import (
    ALONG,
    BEARING,
    MOTH,
    STATE_SIZE,
    mobs_begin,
    mobs_next,
)
from mission.strategies.reactive import ReactiveStrategy
from mission.strategies.registry import BUILT_IN, make
from mission.strategies.spokes import GOLDEN


def test_the_spiral_is_the_papers() -> None:
    arms_m = arm_spacing_m(3, 3.0)
    assert arms_m == 30.0
    assert spiral_point(0, arms_m, even=False) == (0.0, 0.0)
    for index in (1, 30, 75, 400):
        north_m, east_m = spiral_point(index, arms_m, even=False)
        assert math.hypot(north_m, east_m) == pytest.approx(index * arms_m / 30.0)
    assert spiral_point(30, arms_m, even=False) == pytest.approx((30.0, 0.0), abs=1e-9)


def test_even_spiral_points_never_stand_farther_apart_than_the_arms() -> None:
    points = [spiral_point(index, 20.0, even=True) for index in range(600)]
    legs = [math.dist(a, b) for a, b in itertools.pairwise(points)]
    assert max(legs) < 20.7
    assert legs[-1] == pytest.approx(20.0, rel=0.01)
    assert points[:100] == [spiral_point(index, 20.0, even=False) for index in range(100)]


@pytest.mark.parametrize("even", [False, True])
def test_a_points_number_is_found_again_from_its_radius(even: bool) -> None:
    for index in (0, 1, 30, 143, 144, 500):
        radius_m = math.hypot(*spiral_point(index, 20.0, even))
        assert spiral_index(radius_m, 20.0, even) == pytest.approx(index, abs=1e-9)


finite = st.floats(-50.0, 50.0)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(finite, finite), min_size=3, max_size=12, unique=True),
    finite,
    finite,
    finite,
    st.floats(0.1, 10.0),
)
def test_a_plane_is_recovered_or_called_degenerate(
    places: list[tuple[float, float]], slope_n: float, slope_e: float, level: float, weight: float
) -> None:
    place_m = np.array(places)
    value = level + place_m @ np.array([slope_n, slope_e])
    weights = np.full(len(places), weight)
    weights[0] = 3.0 * weight
    gradient_n, gradient_e, rank = plane_gradient(
        place_m[:, 0], place_m[:, 1], value, weights, len(places), 0.3
    )
    if rank == 2:
        assert (gradient_n, gradient_e) == pytest.approx((slope_n, slope_e), abs=1e-3)
    else:
        spread = np.linalg.svd(place_m - np.average(place_m, axis=0, weights=weights), compute_uv=False)
        assert spread[1] < 0.3 * math.sqrt(3.0 * len(places))


def test_readings_on_a_line_give_the_gradient_along_it() -> None:
    along = np.array([0.0, 1.0, 2.0])
    value = 3.0 * along
    ones = np.ones(3)
    east, north, rank = plane_gradient(along * 0.6, along * 0.8, value, ones, 3, 1e-3)
    assert rank == 1
    assert (east, north) == pytest.approx((1.8, 2.4))
    assert plane_gradient(np.zeros(3), np.zeros(3), value, ones, 3, 1e-3) == (0.0, 0.0, 0)
    assert plane_gradient(along, along, value, np.zeros(3), 3, 1e-3)[2] == 0


def test_the_waypoint_is_one_step_uphill_or_none() -> None:
    assert waypoint_uphill(3.0, 4.0, 10.0, 20.0, 2.0, 0.05, -0.05) == pytest.approx(
        (True, 10.0 + 1.2 + 0.05, 20.0 + 1.6 - 0.05)
    )
    assert waypoint_uphill(0.0, 0.0, 10.0, 20.0, 2.0, 0.05, -0.05) == (False, 10.0, 20.0)


def test_mobs_flies_spokes_a_golden_angle_apart() -> None:
    state = np.zeros(STATE_SIZE)
    mobs_begin(state, 0.5)
    here = (0.0, 0.0)
    for step in range(1, 11):
        here = mobs_next(state, *here, 0.0, 10.0, 1.0, 0.9)
        assert math.hypot(*here) == pytest.approx(step)
        assert math.atan2(here[1], here[0]) == pytest.approx(0.5)
    assert mobs_next(state, *here, 0.0, 10.0, 1.0, 0.9) == (0.0, 0.0)
    north_m, east_m = mobs_next(state, 0.0, 0.0, 0.0, 10.0, 1.0, 0.9)
    assert math.atan2(east_m, north_m) % math.tau == pytest.approx((0.5 + math.tau / GOLDEN) % math.tau)


def test_mobs_keeps_a_heading_that_pays_and_draws_another_otherwise() -> None:
    state = np.zeros(STATE_SIZE)
    mobs_begin(state, 0.0)
    assert mobs_next(state, 5.0, 0.0, 0.2, 10.0, 1.0, 0.25) == pytest.approx((6.0, 0.0))
    assert state[MOTH] == 1.0
    assert mobs_next(state, 6.0, 0.0, 0.3, 10.0, 1.0, 0.25) == pytest.approx((7.0, 0.0))
    assert mobs_next(state, 7.0, 0.0, 0.3, 10.0, 1.0, 0.25) == pytest.approx((7.0, 1.0))
    here = (7.0, 1.0)
    for _ in range(5):  # the first zero still has a reading before it
        here = mobs_next(state, *here, 0.0, 10.0, 1.0, 0.5)
        assert state[MOTH] == 1.0
    assert mobs_next(state, *here, 0.0, 10.0, 1.0, 0.5) == (0.0, 0.0)
    assert (state[MOTH], state[ALONG]) == (0.0, 0.0)
    assert state[BEARING] == pytest.approx(math.tau / GOLDEN)


def arrival() -> Arrival:
    return Arrival(arrival_m=1.0, settle_mps=0.7, settle_s=1.0, blocked_s=5.0)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.floats(-30.0, 30.0), st.floats(-30.0, 30.0), st.integers(1, 300)), min_size=1),
    st.floats(0.0, 5.0),
)
def test_whatever_a_drone_flies_it_arrives_in_a_bounded_time(
    flown: list[tuple[float, float, int]], speed_mps: float
) -> None:
    """It comes nearer, which has an end, or it does not, and then that is as near as it comes."""
    watch = arrival()
    target = (100.0, 0.0, -10.0)
    places = itertools.chain.from_iterable([(n, e)] * ticks for n, e, ticks in itertools.cycle(flown))
    for k, (north, east) in enumerate(places):
        if watch.step(0.1 * k, (north, east, -10.0), (speed_mps, 0.0, 0.0), target):
            return
        assert 0.1 * k < 20.0 * (60.0 / 0.5 + 2.0)


def test_a_drone_that_circles_before_an_obstacle_arrives_where_it_is() -> None:
    """A vehicle without an agent hovers at the target: the guard steps aside for ever, and nobody stands still."""
    watch = arrival()
    target = (0.0, 0.0, -10.0)
    circling = [5.0 * math.cos(0.02 * k) for k in range(400)], [5.0 * math.sin(0.02 * k) for k in range(400)]
    reached = [
        watch.step(0.1 * k, (north, east, -10.0), (0.0, 1.0, 0.0), target)
        for k, (north, east) in enumerate(zip(*circling, strict=True))
    ]
    assert reached.index(True) == pytest.approx(200, abs=2)
    assert all(reached[reached.index(True) :])
    assert not watch.step(40.0, (5.0, 0.0, -10.0), (0.0, 1.0, 0.0), (50.0, 0.0, -10.0)), "a new target"


def test_a_way_around_that_leads_away_first_is_no_block() -> None:
    watch = arrival()
    target = (0.0, 0.0, -10.0)
    way = [20.0] * 50 + [20.0 + 0.1 * k for k in range(80)] + [28.0 - 0.2 * k for k in range(135)]
    for k, north in enumerate(way):
        assert not watch.step(0.1 * k, (north, 0.0, -10.0), (1.0, 0.0, 0.0), target)


def test_arrival_needs_to_be_near_and_slow_for_a_while() -> None:
    watch = arrival()
    target = (10.0, 0.0, -10.0)
    assert not watch.step(0.0, (9.5, 0.0, -10.0), (2.0, 0.0, 0.0), target)
    assert not watch.step(1.0, (9.9, 0.0, -10.0), (0.5, 0.0, 0.0), target)
    assert not watch.step(1.9, (9.9, 0.0, -10.0), (0.1, 0.0, 0.0), target)
    assert watch.step(2.0, (9.9, 0.0, -10.0), (0.1, 0.0, 0.0), target)
    assert watch.arrived_s == 2.0
    assert watch.step(3.0, (12.0, 0.0, -10.0), (1.0, 0.0, 0.0), target)
    assert not watch.step(4.0, (12.0, 0.0, -10.0), (1.0, 0.0, 0.0), (20.0, 0.0, -10.0))


def test_a_drone_that_is_held_back_arrives_where_it_stands() -> None:
    watch = arrival()
    target = (100.0, 0.0, -10.0)
    assert not watch.step(0.0, (50.0, 0.0, -10.0), (0.0, 0.0, 0.0), target)
    assert not watch.step(4.9, (50.0, 0.0, -10.0), (0.1, 0.0, 0.0), target)
    assert watch.step(5.0, (50.0, 0.0, -10.0), (0.0, 0.1, 0.0), target)


def test_the_source_of_a_gaussian_is_its_summit() -> None:
    rng = np.random.default_rng(1)
    readings = []
    for number in range(60):
        north_m, east_m = rng.uniform(-8.0, 8.0, 2)
        value = 1000.0 * math.exp(-0.5 * (((north_m - 2.0) / 6.0) ** 2 + ((east_m + 1.0) / 9.0) ** 2))
        readings.append(Reading(1, number, (north_m, east_m, -10.0), value, 1.0))
    readings.append(Reading(2, 0, (50.0, 50.0, -10.0), 0.0, math.inf))
    assert estimate_source(readings, 10.0) == pytest.approx((2.0, -1.0, -10.0), abs=1e-6)


def test_few_readings_give_their_strongest_place() -> None:
    reading = Reading(1, 1, (3.0, 4.0, -10.0), 100.0, 1.0)
    assert estimate_source([reading], 10.0) == (3.0, 4.0, -10.0)


@pytest.mark.parametrize("name", [entry.name for entry in BUILT_IN.values() if entry.ticks is None])
def test_every_strategy_is_made_by_its_name(name: str) -> None:
    assert type(make(name, layout=Hexagonal(10.0), start_ned_m=[1, 2, -3])) is BUILT_IN[name].make


@pytest.mark.parametrize("entry", [entry for entry in BUILT_IN.values() if entry.ticks is not None])
def test_every_rule_is_made_a_strategy_by_its_name(entry: StrategyEntry) -> None:
    assert isinstance(make(entry.name, layout=Hexagonal(10.0)), ReactiveStrategy)


def test_what_a_strategy_is_not_given_right_is_said_in_one_line() -> None:
    layout = Hexagonal(10.0)
    with pytest.raises(ValueError, match="there are locus, mobs, locus-hybrid, locus-multi"):
        make("lawnmower", layout=layout)
    with pytest.raises(ValueError, match=r"no parameter 'stepp'; it has .*step_m"):
        make("locus", layout=layout, stepp=1)
    with pytest.raises(ValueError, match=r"strategy locus: step_m: Expected `float` > 0\.0"):
        make("locus", layout=layout, step_m=-1.0)
    with pytest.raises(ValueError, match="strategy mobs: radius_m: Expected `float`, got `str`"):
        make("mobs", layout=layout, radius_m="far")


def test_a_root_that_has_forgotten_the_contact_still_tells_the_source() -> None:
    """After a long wait, or as an heir with nothing but the order: its other readings are all zero."""
    best = Reading(3, 2, (30.0, -20.0, -10.0), 80.0, 4.0)
    note = LocusNote(5.0, (0.0, 0.0, -10.0), best, waypoints_since_best=15)
    order = noted(Order(20, Stage.TRACK, (0.0, 0.0, -10.0), 0.0), note)
    strategy = make("locus", layout=Hexagonal(10.0))
    rng = np.random.default_rng(1)
    place = TreePlace(1, 0, {1: 0}, None, (), None, None, 1, False)
    own = OwnState(
        1, (0.0, 0.0, -10.0), (0.0, 0.0, 0.0), Scalar(0.0, 1.0, 0.1), Wind((3.0, 0.0, 0.0), 0.1, 0.1), 0.9
    )
    zeros = tuple(Reading(2, k, (float(k), 0.0, -10.0), 0.0, 4.0) for k in range(30))
    found = None
    for tick in range(60):
        decision = strategy.decide(Observation(tick * 0.1, own, (), place, order, zeros), rng)
        found = decision.order or found
    assert found is not None
    assert found.stage is Stage.FOUND
    assert found.source_ned_m is not None
    assert math.dist(found.source_ned_m, best.position_ned_m) < 25.0  # as far as a fit is believed
