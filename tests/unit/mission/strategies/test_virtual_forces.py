"""Virtual forces: known directions in symmetric places, what repels whom, and numbers whatever is given."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.geometry.formation import Hexagonal
from mission.strategies.reactive import ReactiveStrategy
from mission.strategies.registry import make
from mission.strategies.tick_rule import WORD, OwnSenses, Rule, numbers
from mission.strategies.virtual_forces import (
    BEAMS,
    LARGEST,
    MEAN,
    WORD_SIZE,
    UpwindParameters,
    VirtualForcesParameters,
    upwind,
    virtual_forces,
)

PAPER = VirtualForcesParameters(
    speed_mps=0.2,
    upwind=20.0,
    repulsion_m3ps=1.0,
    obstacle_m3ps=1.0,
    near_m=0.1,
    sight_m=0.3,
    least_m=0.03,
    gradient_m2ps=50.0,
    attraction_m3ps=1.0,
    far_m=0.5,
    range_m=1.0,
)
"""Its small arena."""
UNCUT = msgspec.structs.replace(PAPER, speed_mps=1e6)
"""What it gives is the force itself."""


def senses(**changes: Any) -> OwnSenses:
    usual = OwnSenses(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 10.0, 0.1, 0.5)
    return usual._replace(**changes)


def force(
    *others: tuple[float, ...],
    parameters: VirtualForcesParameters = UNCUT,
    own: OwnSenses | None = None,
    word: tuple[float, float] = (0.0, 0.0),
    ranges_m: Any = None,
) -> tuple[float, float]:
    """The velocity, given rows of (north, east, mean, largest)."""
    rows = np.zeros((len(others) + 1, WORD + WORD_SIZE))
    rows[-1] = math.nan  # no row of a neighbour
    for row, (north_m, east_m, mean, largest) in zip(rows, others, strict=False):
        row[:2], row[WORD + MEAN], row[WORD + LARGEST] = (north_m, east_m), mean, largest
    beams = np.full(BEAMS, math.inf) if ranges_m is None else np.array(ranges_m)
    return virtual_forces(
        own or senses(), rows, len(others), beams, np.zeros(0), np.array(word), numbers(parameters)
    )


def test_alone_it_goes_against_the_wind_at_full_speed() -> None:
    own = senses(wind_north_mps=0.3, wind_east_mps=-0.4)
    assert force(own=own) == pytest.approx((-20.0 * 0.3, 20.0 * 0.4))
    assert force(own=own, parameters=PAPER) == pytest.approx((-0.2 * 0.6, 0.2 * 0.8))
    assert force(own=senses(gas=3.0)) == (0.0, 0.0)  # calm: a robot alone has no gradient


def test_the_gradient_is_the_sum_of_the_difference_quotients() -> None:
    """Equation (4), of shares of the largest: 50 * ((1 - 0.5) / 0.4 north + (0.25 - 0.5) / 0.2 east)."""
    quiet = msgspec.structs.replace(UNCUT, attraction_m3ps=0.0)
    own = senses(gas=2.0)
    found = force((0.4, 0.0, 4.0, 4.0), (0.0, 0.2, 1.0, 4.0), own=own, word=(2.0, 2.0), parameters=quiet)
    assert found == pytest.approx((50.0 * 1.25, -50.0 * 1.25))


def test_between_two_that_smell_the_same_there_is_no_way_to_go() -> None:
    for away_m in (0.05, 0.3, 0.8):
        north, east = force((away_m, 0.0, 2.0, 2.0), (-away_m, 0.0, 2.0, 2.0), word=(1.0, 2.0))
        assert (north, east) == pytest.approx((0.0, 0.0), abs=1e-9)


def test_who_smells_much_attracts_from_afar_and_nobody_does_between_the_margins() -> None:
    still = msgspec.structs.replace(UNCUT, gradient_m2ps=0.0)
    assert force((0.0, 0.8, 1.0, 2.0), parameters=still) == pytest.approx((0.0, 0.5 / 0.64))
    assert force((0.0, 0.5, 1.0, 2.0), parameters=still) == (0.0, 0.0)
    assert force((0.0, 0.1, 1.0, 2.0), parameters=still) == (0.0, 0.0)
    assert force((0.0, 1.01, 2.0, 2.0), parameters=UNCUT) == (0.0, 0.0)  # out of range


def test_a_neighbour_that_smells_nothing_repels_all_the_same_and_does_not_attract() -> None:
    assert force((0.05, 0.0, 0.0, 2.0)) == pytest.approx((-1.0 / 0.05**2, 0.0))
    assert force((0.8, 0.0, 0.0, 2.0)) == (0.0, 0.0)


def test_while_nobody_has_smelt_anything_everybody_attracts_alike() -> None:
    """Cmax = C0: the weight is beta, and there is no gradient."""
    half = msgspec.structs.replace(UNCUT, weight=0.5, clean_air=0.03)
    assert force((0.8, 0.0, 0.0, 0.0), parameters=half) == pytest.approx((0.5 / 0.64, 0.0))
    assert force((0.8, 0.0, 0.03, 0.03), parameters=half, word=(0.01, 0.03)) == pytest.approx(
        (0.5 / 0.64, 0.0)
    )
    assert force((0.3, 0.0, 0.03, 0.03), parameters=half) == (0.0, 0.0)


def test_readings_below_clean_air_are_none() -> None:
    clean = msgspec.structs.replace(UNCUT, clean_air=0.5, attraction_m3ps=0.0)
    assert force((0.3, 0.0, 0.4, 1.5), word=(0.1, 1.5), own=senses(gas=0.1), parameters=clean) == (0.0, 0.0)
    north, _ = force((0.3, 0.0, 1.0, 1.5), word=(0.1, 1.5), own=senses(gas=0.1), parameters=clean)
    assert north == pytest.approx(50.0 * 0.5 / 0.3)


def test_obstacles_push_along_their_beams() -> None:
    ranges_m = [math.inf] * BEAMS
    ranges_m[0] = 0.2  # north
    assert force(ranges_m=ranges_m) == pytest.approx((-1.0 / 0.04, 0.0))
    ranges_m[4] = 0.2  # south
    assert force(ranges_m=ranges_m) == pytest.approx((0.0, 0.0), abs=1e-9)
    ranges_m[2] = 0.31  # east, farther than it sees
    assert force(ranges_m=ranges_m) == pytest.approx((0.0, 0.0), abs=1e-9)
    ranges_m = [math.inf] * BEAMS
    ranges_m[1] = 0.001  # north-east, counted as 0.03 m
    assert force(ranges_m=ranges_m) == pytest.approx([-math.sqrt(0.5) / 0.03**2] * 2)


def test_its_word_is_its_average_and_the_largest_that_it_knows() -> None:
    word = np.zeros(WORD_SIZE)
    rows = np.zeros((1, WORD + WORD_SIZE))
    rows[0, 0], rows[0, WORD + LARGEST] = 0.3, 0.2
    means = []
    for _ in range(60):
        virtual_forces(senses(gas=1.0), rows, 1, np.full(BEAMS, math.inf), np.zeros(0), word, numbers(PAPER))
        means.append(word[MEAN])
    assert means[29] == pytest.approx(1.0 - math.exp(-1.0))  # after its time constant of 3 s
    assert means[59] == pytest.approx(1.0 - math.exp(-2.0))
    assert word[LARGEST] == word[MEAN]
    virtual_forces(senses(gas=0.0), rows, 1, np.full(BEAMS, math.inf), np.zeros(0), word, numbers(PAPER))
    assert word[MEAN] < word[LARGEST] == means[-1]
    rows[0, WORD + LARGEST] = 7.0
    virtual_forces(senses(gas=0.0), rows, 1, np.full(BEAMS, math.inf), np.zeros(0), word, numbers(PAPER))
    assert word[LARGEST] == 7.0
    rows[0, WORD + LARGEST] = 1e300  # nobody smells that
    virtual_forces(senses(gas=0.0), rows, 1, np.full(BEAMS, math.inf), np.zeros(0), word, numbers(PAPER))
    assert word[LARGEST] == 7.0


def test_the_baseline_goes_upwind_off_its_neighbours_whatever_they_smell() -> None:
    parameters = numbers(
        UpwindParameters(speed_mps=1e6, upwind=20.0, repulsion_m3ps=1.0, near_m=0.1, least_m=0.03)
    )
    rows = np.zeros((1, WORD))
    own = senses(gas=5.0, wind_east_mps=0.5)
    far = np.full(BEAMS, math.inf)
    rows[0, 0] = 0.3
    assert upwind(own, rows, 1, far, np.zeros(0), np.zeros(0), parameters) == pytest.approx((0.0, -10.0))
    rows[0, 0] = 0.05
    assert upwind(own, rows, 1, far, np.zeros(0), np.zeros(0), parameters) == pytest.approx((-400.0, -10.0))
    rows[0, 0] = 0.0  # in the same place
    assert upwind(own, rows, 1, far, np.zeros(0), np.zeros(0), parameters) == pytest.approx((0.0, -10.0))


small = st.floats(-3.0, 3.0) | st.just(0.0)
anything = st.floats(allow_nan=False, allow_infinity=False)
level = st.floats(0.0, 1e6) | st.just(0.0)


@given(
    rows=st.lists(
        st.tuples(small | anything, small | anything, anything | level, anything | level), max_size=6
    ),
    gas=level,
    wind=st.tuples(small, small),
    ranges_m=st.lists(st.floats(0.0, 2.0) | st.just(math.inf), min_size=BEAMS, max_size=BEAMS),
    interval_s=st.floats(1e-3, 100.0),
    rule=st.sampled_from([virtual_forces, upwind]),
)
@settings(deadline=None, max_examples=300)
def test_the_velocity_is_one_within_the_limit_whatever_is_sensed(
    rows: list[tuple[float, ...]],
    gas: float,
    wind: tuple[float, float],
    ranges_m: list[float],
    interval_s: float,
    rule: Rule,
) -> None:
    table = np.zeros((len(rows), WORD + WORD_SIZE))
    for row, (north_m, east_m, mean, largest) in zip(table, rows, strict=True):
        row[:2], row[WORD + MEAN], row[WORD + LARGEST] = (north_m, east_m), mean, largest
    own = senses(gas=gas, wind_north_mps=wind[0], wind_east_mps=wind[1], interval_s=interval_s)
    word = np.zeros(WORD_SIZE)
    with np.errstate(over="ignore"):
        north, east = rule(own, table, len(rows), np.array(ranges_m), np.zeros(0), word, numbers(PAPER))
    assert math.hypot(north, east) <= PAPER.speed_mps * (1.0 + 1e-9)
    assert np.isfinite(word).all()


@given(
    rows=st.lists(st.tuples(small, small, level, level), max_size=5),
    wind=st.tuples(small, small),
    turn=st.integers(0, BEAMS - 1),
    ranges_m=st.lists(st.floats(0.0, 2.0) | st.just(math.inf), min_size=BEAMS, max_size=BEAMS),
)
@settings(deadline=None, max_examples=100)
def test_what_is_turned_as_a_whole_turns_the_force(
    rows: list[tuple[float, ...]], wind: tuple[float, float], turn: int, ranges_m: list[float]
) -> None:
    # Where a turned distance might fall on the other side of a margin, there is nothing to compare.
    margins_m = (PAPER.near_m, PAPER.far_m, PAPER.range_m)
    rows = [
        row
        for row in rows
        if math.hypot(*row[:2]) > 1e-6 and min(abs(math.hypot(*row[:2]) - m) for m in margins_m) > 1e-6
    ]
    cos, sin = math.cos(math.pi / 4.0 * turn), math.sin(math.pi / 4.0 * turn)

    def turned(north: float, east: float) -> tuple[float, float]:
        return north * cos - east * sin, north * sin + east * cos

    first = force(*rows, own=senses(wind_north_mps=wind[0], wind_east_mps=wind[1]), ranges_m=ranges_m)
    wind_n, wind_e = turned(*wind)
    second = force(
        *((*turned(*row[:2]), *row[2:]) for row in rows),
        own=senses(wind_north_mps=wind_n, wind_east_mps=wind_e),
        ranges_m=np.roll(ranges_m, turn),
    )
    assert second == pytest.approx(turned(*first), rel=1e-6, abs=1e-6)


def test_margins_in_the_wrong_order_are_refused_in_one_line() -> None:
    with pytest.raises(
        ValueError, match=r"^strategy virtual-forces: near_m \(13\) < far_m \(12\) < range_m \(22\)"
    ):
        make("virtual-forces", layout=Hexagonal(10.0), near_m=13.0)
    assert isinstance(make("upwind", layout=Hexagonal(10.0), speed_mps=1), ReactiveStrategy)
