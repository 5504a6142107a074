"""The rule of LoCUS, number by number: what is contact, what is best, where the swarm goes next."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from mission.estimation.estimates import Reading
from mission.geometry.formation import FloatArray
from mission.strategies.contract import Order, Stage
from mission.strategies.locus import rule
from mission.strategies.locus.groups import group_begin, group_count
from mission.strategies.locus.hybrid import ContactWord
from mission.strategies.locus.multi import GroupWord, group_centre, parted
from mission.strategies.locus.seats import nearest_first
from mission.strategies.mobs import MobsWord
from mission.strategies.packed import Packed
from mission.strategies.spokes import GOLDEN, next_on_spokes

NORTH_M = np.array([0.0, 0.0, 10.0])
EAST_M = np.array([0.0, 10.0, 0.0])
READING = Reading(2, 7, (1.0, 2.0, -10.0), 40.0, 4.0)


def numbers(**changed: float) -> FloatArray:
    """Steps of 2 m without chance, contact from 20 on, everything else as in flight."""
    values = np.zeros(rule.RULE_NUMBERS)
    values[rule.STEP_M] = 2.0
    values[rule.DETECTION] = values[rule.NOISE] = 20.0
    values[rule.IMPROVEMENT] = 0.1
    values[rule.PATIENCE] = 3.0
    values[rule.RETURNS] = 1.0
    values[rule.PATTERN] = rule.EVEN_SPIRAL
    values[rule.ARMS_M] = 20.0
    values[rule.LIMIT_M] = 100.0
    for name, value in changed.items():
        values[getattr(rule, name)] = value
    return values


def begun() -> FloatArray:
    state = np.zeros(rule.STATE_SIZE)
    rule.locus_begin(state, 5.0, -5.0, 0.25, 0.5)
    return state


def step(
    state: FloatArray,
    by: FloatArray,
    value: list[float],
    *,
    variance: float = 0.0,
    wind: tuple[float, float] = (0.0, 0.0),
    draws: tuple[float, float] = (0.5, 0.5),
) -> bool:
    """One waypoint with these three readings at (0, 0), 10 m east and 10 m north of it."""
    variances = np.full(3, variance)
    contact, weight = np.zeros(3), np.zeros(3)
    some = rule.contacts(by, np.array(value), variances, 3, contact, weight)
    return rule.locus_next(state, by, NORTH_M, EAST_M, contact, variances, weight, 3, 3, some, *wind, *draws)


def anchor(state: FloatArray) -> tuple[float, float]:
    return float(state[rule.ANCHOR_N]), float(state[rule.ANCHOR_E])


def test_contact_exceeds_the_limit_and_its_own_noise() -> None:
    contact, weight = np.zeros(3), np.zeros(3)
    value, variance = np.array([19.0, 25.0, 30.0]), np.array([0.0, 49.0, 49.0])
    assert rule.contacts(numbers(SIGMAS=4.0), value, variance, 3, contact, weight)
    assert contact.tolist() == [0.0, 0.0, 30.0]
    assert weight == pytest.approx([1.0 / 400.0, 1.0 / 449.0, 1.0 / 449.0])
    assert not rule.contacts(numbers(SIGMAS=4.0), value, variance, 2, contact, weight)


def test_up_the_gradient_with_jitter_and_turn() -> None:
    state, by = begun(), numbers(JITTER_M=0.1, TURN_RAD=0.8)
    assert step(state, by, [50.0, 50.0, 90.0], draws=(1.0, 0.0))
    assert anchor(state) == pytest.approx((5.0 + 2.0 + 0.1, -5.0 - 0.1))
    assert state[rule.STAGE] == rule.TRACK
    assert (state[rule.BEST], state[rule.BEST_ROW], state[rule.BEST_N]) == (90.0, 2.0, 10.0)
    rule.turn(state, by, 0.5)
    assert state[rule.ROTATION] == pytest.approx(0.25 + 0.4)


def test_a_known_wind_pulls_the_step_upwind() -> None:
    state = begun()
    assert step(state, numbers(UPWIND=1.0), [50.0, 50.0, 90.0], wind=(0.0, 3.0))
    half = 2.0 * math.sqrt(0.5)
    assert anchor(state) == pytest.approx((5.0 + half, -5.0 - half))


def test_the_source_is_found_when_the_best_was_not_beaten_for_long() -> None:
    state, by = begun(), numbers()
    step(state, by, [50.0, 50.0, 90.0])
    for since in (1.0, 2.0):
        step(state, by, [50.0, 50.0, 95.0])  # better, but not by a tenth
        assert (state[rule.SINCE_BEST], state[rule.BEST_ROW]) == (since, -1.0)
        assert state[rule.STAGE] == rule.TRACK
    step(state, by, [50.0, 50.0, 95.0])
    assert state[rule.STAGE] == rule.FOUND
    again, never = begun(), numbers(PATIENCE=0.0)
    for _ in range(50):
        step(again, never, [50.0, 50.0, 90.0])
    assert again[rule.STAGE] == rule.TRACK


def test_a_better_reading_must_exceed_the_noise_of_both() -> None:
    state, by = begun(), numbers()
    step(state, by, [50.0, 50.0, 90.0], variance=50.0)
    step(state, by, [50.0, 50.0, 108.9], variance=50.0)  # 90 * 1.1 + 10
    assert state[rule.SINCE_BEST] == 1.0
    step(state, by, [50.0, 50.0, 109.1], variance=50.0)
    assert (state[rule.SINCE_BEST], state[rule.BEST]) == (0.0, 109.1)


def test_without_contact_back_to_the_best_reading_and_only_then_on() -> None:
    state, by = begun(), numbers()
    step(state, by, [50.0, 50.0, 90.0])
    assert not step(state, by, [0.0, 0.0, 0.0])
    assert (anchor(state), state[rule.STAGE]) == ((10.0, 0.0), rule.TRACK)
    step(state, by, [0.0, 0.0, 0.0])
    assert (state[rule.STAGE], state[rule.BEST]) == (rule.SEARCH, 0.0)
    other = begun()
    step(other, numbers(RETURNS=0.0), [50.0, 50.0, 90.0])
    step(other, numbers(RETURNS=0.0), [0.0, 0.0, 0.0])
    assert other[rule.STAGE] == rule.SEARCH


def test_the_spiral_goes_on_from_its_radius_and_ends_at_the_limit() -> None:
    state, by = begun(), numbers()
    radii = []
    while state[rule.STAGE] != rule.GIVE_UP:
        before = anchor(state)
        step(state, by, [0.0, 0.0, 0.0])
        radii.append(float(state[rule.RADIUS]))
    assert radii[:3] == pytest.approx([20.0 / 30.0 * k for k in (1, 2, 3)])
    assert radii[-2] <= 100.0 < radii[-1]
    assert anchor(state) == before, "the point outside is not flown to"
    fresh = begun()
    fresh[rule.RADIUS] = -1.0
    step(fresh, by, [0.0, 0.0, 0.0])
    assert anchor(fresh) == (5.0, -5.0), "the centre is the spiral's first point"


def test_a_point_that_a_heal_kept_from_being_reached_is_ordered_again() -> None:
    for by in (numbers(), numbers(PATTERN=rule.SPOKES, SPOKE_M=30.0, SPOKE_STEP_M=10.0)):
        state = begun()
        for _ in range(3):
            step(state, by, [0.0, 0.0, 0.0])
        wanted = anchor(state)
        state[rule.ANCHOR_N] += 3.0
        step(state, by, [0.0, 0.0, 0.0])
        assert anchor(state) == pytest.approx(wanted)


def test_spokes_lead_out_and_then_begin_again_a_golden_angle_on() -> None:
    state, by = begun(), numbers(PATTERN=rule.SPOKES, SPOKE_M=30.0, SPOKE_STEP_M=10.0)
    flown = []
    for _ in range(5):
        step(state, by, [0.0, 0.0, 0.0])
        flown.append((float(state[rule.RADIUS]), float(state[rule.BEARING])))
    on = (0.5 + math.tau / GOLDEN) % math.tau
    assert flown == [(10.0, 0.5), (20.0, 0.5), (30.0, 0.5), (0.0, on), (10.0, on)]
    assert anchor(state) == pytest.approx((5.0 + 10.0 * math.cos(on), -5.0 + 10.0 * math.sin(on)))
    assert next_on_spokes(30.0, 0.5, 30.0, 10.0) == (0.0, on)


def test_whoever_is_nearest_takes_the_innermost_place() -> None:
    north_m, east_m = np.array([30.0, 2.0, 10.0, 1.0]), np.zeros(4)
    holder, placed = np.full(4, -1, np.int64), np.zeros(4, np.int64)
    nearest_first(north_m, east_m, np.array([1, 1, 1, 0]), 0.0, 0.0, placed, holder)
    assert holder.tolist() == [1, 2, 0, -1]
    nearest_first(np.ones(4), east_m, np.ones(4, np.int64), 0.0, 0.0, placed, holder)
    assert holder.tolist() == [0, 1, 2, 3], "of equally near ones the first"


@pytest.mark.parametrize(("drones", "size", "sizes"), [(20, 5, [5] * 4), (7, 3, [3, 4]), (4, 5, [4])])
def test_sub_swarms_are_of_about_one_size(drones: int, size: int, sizes: list[int]) -> None:
    groups = parted(range(1, drones + 1), size)
    assert [len(group) for group in groups] == sizes
    assert [drone for group in groups for drone in group] == list(range(1, drones + 1))
    assert (group_count(drones, size), group_begin(len(sizes), len(sizes), drones)) == (len(sizes), drones)


def test_sub_swarms_begin_a_gap_apart() -> None:
    centres = [group_centre(group, 5, 30.0) for group in range(5)]
    for one, other in zip(centres, centres[1:] + centres[:1], strict=True):
        assert math.dist(one, other) == pytest.approx(30.0)
    assert group_centre(0, 1, 30.0) == (0.0, 0.0)


ORDER = Order(3, Stage.TRACK, (1.0, 2.0, -10.0), 0.5)


@pytest.mark.parametrize(
    ("kind", "tag", "fields"),
    [
        (ContactWord, "locus-hybrid", (msgspec.structs.replace(READING, excess_co2_ppm=-1.0),)),
        (ContactWord, "locus-hybrid", (msgspec.structs.replace(READING, variance_ppm2=math.inf),)),
        (MobsWord, "mobs", (msgspec.structs.replace(READING, position_ned_m=(math.nan, 0.0, 0.0)),)),
        (GroupWord, "locus-multi", (msgspec.structs.replace(ORDER, anchor_ned_m=(1e9, 0.0, 0.0)), None)),
        (GroupWord, "locus-multi", (msgspec.structs.replace(ORDER, rotation_rad=math.nan), None)),
        (GroupWord, "locus-multi", (msgspec.structs.replace(ORDER, sequence=-1), None)),
        (GroupWord, "locus-multi", (ORDER, msgspec.structs.replace(READING, variance_ppm2=math.nan))),
    ],
)
def test_a_word_that_cannot_be_is_none(kind: type, tag: str, fields: tuple[object, ...]) -> None:
    assert Packed(kind).unpack(msgspec.msgpack.encode((tag, *fields))) is None


def test_words_come_back_and_are_short() -> None:
    for word in (ContactWord(READING), MobsWord(READING), GroupWord(ORDER, READING)):
        packed = Packed(type(word)).pack(word)
        assert Packed(type(word)).unpack(packed) == word
        assert len(packed) < 256
