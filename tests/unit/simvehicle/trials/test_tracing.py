"""Trials in recorded air: what vehicles may never do, what is counted, what is refused."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.strategies.tick_rule import NORTH, OwnSenses, TickRule, numbers
from simvehicle.trials.tracing.flying import (
    ARRIVAL,
    CLOSEST_M,
    CONTACT,
    LOCALISATION,
    LOST,
    NEAREST_PAIR_M,
    NEVER,
    SOURCES,
    STEPS,
)
from simvehicle.trials.tracing.swarm_flight import (
    TracedFlights,
    TracedScene,
    TracingVehicles,
    fly_rule,
    fly_trials,
    make_place,
    seconds,
)
from simvehicle.trials.trials_error import TrialsError
from simvehicle.world.obstacles import Obstacles
from simvehicle.world.recorded_air import RecordedAir
from simvehicle.world.world_config import PolygonalObstacle, RectangularObstacle

FloatArray = Any
LENGTH_M = 12.0
SOURCE_M = np.array([[6.0, 6.0]])
ROCKS = Obstacles(
    [
        RectangularObstacle(centre_north_m=3.0, centre_east_m=3.0, length_north_m=1.5, length_east_m=1.5),
        RectangularObstacle(centre_north_m=9.0, centre_east_m=8.0, length_north_m=3.0, length_east_m=1.0),
        PolygonalObstacle(corners_north_east_m=((2.0, 8.0), (4.0, 9.0), (2.5, 11.0))),
    ]
)


def still_air(
    *, gas: float = 0.0, frames: int = 2, wind_mps: tuple[float, float] = (0.0, 0.0)
) -> RecordedAir:
    nodes = 25
    wind = np.zeros((frames, 2, 5, 5), np.float32)
    wind[:, 0], wind[:, 1] = wind_mps
    return RecordedAir(
        np.full((frames, nodes, nodes), gas, np.float32),
        wind,
        np.zeros((nodes, nodes), bool),
        np.zeros(2),
        LENGTH_M / (nodes - 1),
        np.zeros(2),
        LENGTH_M / 4,
        1.0,
        np.array([LENGTH_M, LENGTH_M]),
    )


class NoParameters(msgspec.Struct, frozen=True):
    heading_rad: float = 0.0


def rush(
    own: OwnSenses,
    neighbours: FloatArray,
    count: int,
    ranges_m: FloatArray,
    state: FloatArray,
    word: FloatArray,
    parameters: FloatArray,
) -> tuple[float, float]:
    """Wildly about, and at the neighbour: nothing is avoided."""
    state[0] += own.draw * own.draw - 0.2
    if count > 0 and own.draw < 0.7:
        return 9.0 * neighbours[0, NORTH], 9.0 * neighbours[0, NORTH + 1]
    return 5.0 * math.cos(state[0]), 5.0 * math.sin(state[0])


def steady(
    own: OwnSenses,
    neighbours: FloatArray,
    count: int,
    ranges_m: FloatArray,
    state: FloatArray,
    word: FloatArray,
    parameters: FloatArray,
) -> tuple[float, float]:
    return 0.1 * math.cos(parameters[0]), 0.1 * math.sin(parameters[0])


def listening(
    own: OwnSenses,
    neighbours: FloatArray,
    count: int,
    ranges_m: FloatArray,
    state: FloatArray,
    word: FloatArray,
    parameters: FloatArray,
) -> tuple[float, float]:
    """Goes north with the gas as its speed, to the east with the count of its neighbours, and looks ahead."""
    return 0.01 * own.gas + (0.0 if ranges_m[0] == math.inf else -0.02), 0.01 * count


def fly(
    rule: Any,
    place: TracedScene,
    vehicles: TracingVehicles,
    starts_m: Any,
    *,
    seed: int = 1,
    beams: int = 0,
    **more: Any,
) -> TracedFlights:
    ticks = TickRule(rule=rule, parameters=NoParameters, range_m=1.0, state_size=1, word_size=1, beams=beams)
    parameters = numbers(NoParameters(**more))
    return fly_rule(place, vehicles, ticks, np.array(starts_m), rule.__name__, parameters, seed, 0, 1)


def spread(rng: np.random.Generator, robots: int, vehicles: TracingVehicles) -> FloatArray:
    """Places at random, free and apart."""
    found: list[FloatArray] = []
    while len(found) < robots:
        at = rng.uniform(vehicles.radius_m, LENGTH_M - vehicles.radius_m, 2)
        free = ROCKS.clearance_m((at[0], at[1], 0.0)) >= vehicles.radius_m
        if free and all(math.dist(at, other) >= 2.0 * vehicles.radius_m for other in found):
            found.append(at)
    return np.array(found)


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    robots=st.sampled_from([2, 7, 30, 64, 65, 90]),
    radius_m=st.floats(0.05, 0.3),
    share=st.floats(0.1, 1.0),
    avoidance_m=st.sampled_from([0.0, 0.35, 0.8]),
)
def test_nobody_leaves_the_world_enters_an_obstacle_or_touches_another(
    seed: int, robots: int, radius_m: float, share: float, avoidance_m: float
) -> None:
    vehicles = TracingVehicles(
        radius_m=radius_m,
        step_s=1.0,
        speed_mps=2.0 * radius_m * share,
        avoidance_m=avoidance_m,
        limit_steps=120,
    )
    starts = spread(np.random.default_rng(seed), min(robots, int(6.0 / radius_m**2)), vehicles)
    flown = fly(rush, make_place(still_air(), SOURCE_M, ROCKS), vehicles, starts[None], seed=seed)
    tracks = flown.tracks_m
    assert np.isfinite(tracks).all()
    assert tracks.min() >= radius_m
    assert tracks.max() <= LENGTH_M - radius_m
    flat = np.concatenate([tracks.reshape(-1, 2), np.zeros((tracks.shape[0] * tracks.shape[1], 1))], axis=1)
    assert ROCKS.clearances_m(flat).min() >= radius_m
    # On the way between two steps too: everybody moves along a straight line in the same time.
    for share_of_step in (0.0, 0.25, 0.5, 0.75):
        between = tracks[:-1] + share_of_step * np.diff(tracks, axis=0)
        for places in between:
            apart = np.linalg.norm(places[:, None] - places[None], axis=2)
            assert apart[np.triu_indices(len(places), 1)].min() >= 2.0 * radius_m
    assert np.linalg.norm(np.diff(tracks, axis=0), axis=2).max() > 0.5 * vehicles.speed_mps  # they did fly


def test_arrival_localisation_and_contact_are_counted_from_the_first_step() -> None:
    vehicles = TracingVehicles(step_s=1.0, limit_steps=60, radius_m=0.05, avoidance_m=0.0)
    place = make_place(still_air(gas=1.0), SOURCE_M)
    # 0.1 m a step to the north: within 1 m of the source from step 20 on, beyond it from step 40 on.
    flown = fly(steady, place, vehicles, [[[3.05, 6.0]]])
    counts = flown.counts[0]
    assert counts[CONTACT] == 0
    assert counts[ARRIVAL] == 20
    assert counts[LOCALISATION] == 20
    assert counts[STEPS] == 60
    assert counts[SOURCES] == 1
    assert flown.distances_m[0, CLOSEST_M] == pytest.approx(0.05)
    assert flown.distances_m[0, NEAREST_PAIR_M] == math.inf
    ended = fly(steady, place, msgspec.structs.replace(vehicles, until_arrival=True), [[[3.05, 6.0]]]).counts[
        0
    ]
    assert (ended[ARRIVAL], ended[LOCALISATION], ended[STEPS]) == (20, 1, 21)
    away = fly(steady, make_place(still_air(), SOURCE_M), vehicles, [[[8.0, 1.0]]])
    assert away.counts[0, ARRIVAL] == away.counts[0, CONTACT] == NEVER
    assert np.isnan(seconds(away.counts[:, ARRIVAL], vehicles)).all()


def test_a_source_that_moves_is_met_where_it_is_then() -> None:
    vehicles = TracingVehicles(step_s=1.0, limit_steps=30, radius_m=0.05)
    moving = np.array([[[9.0, 1.0], [1.0, 1.0]], [[6.0, 6.0], [1.0, 1.0]]])
    place = make_place(still_air(), moving, every_s=10.0)
    counts = fly(steady, place, vehicles, [[[6.0, 5.0], [1.0, 2.0]]], heading_rad=math.pi / 2.0).counts[0]
    assert counts[SOURCES] == 2
    assert counts[ARRIVAL] == 0  # the second source does not move
    alone = fly(steady, place, vehicles, [[[6.0, 5.0]]], heading_rad=math.pi / 2.0).counts[0]
    assert alone[ARRIVAL] == 10


def test_readings_have_a_threshold_a_lag_and_noise() -> None:
    starts = [[[2.0, 2.0]]]
    place = make_place(still_air(gas=0.5), SOURCE_M)
    vehicles = TracingVehicles(step_s=1.0, limit_steps=2, detection=0.4)
    assert fly(listening, place, vehicles, starts, beams=4).tracks_m[1, 0, 0] == pytest.approx(2.005)
    deaf = msgspec.structs.replace(vehicles, detection=0.5)
    assert fly(listening, place, deaf, starts, beams=4).tracks_m[1, 0, 0] == 2.0
    rising = still_air(gas=0.0, frames=3)
    rising.gas[1:] = 1.0
    lagging = TracingVehicles(step_s=1.0, limit_steps=3, lag_s=2.0, detection=0.0)
    track = fly(listening, make_place(rising, SOURCE_M), lagging, starts, beams=4).tracks_m[:, 0, 0]
    assert track[1] == 2.0
    assert track[2] - track[1] == pytest.approx(0.01 * (1.0 - math.exp(-0.5)))
    noisy = TracingVehicles(step_s=1.0, limit_steps=2000, noise=0.1, detection=0.0, speed_mps=0.1)
    steps = np.diff(fly(listening, place, noisy, [[[1.0, 11.0]]], beams=4).tracks_m[:1500, 0, 0]) / 0.01
    moved = steps[steps != 0.0]  # what is below the threshold counts as no gas
    assert np.mean(moved) == pytest.approx(0.5, abs=0.02)
    assert np.std(moved) == pytest.approx(0.1, abs=0.01)


def test_range_sensors_see_walls_and_obstacles_within_reach() -> None:
    place = make_place(still_air(), SOURCE_M, ROCKS)
    vehicles = TracingVehicles(step_s=1.0, limit_steps=2, reach_m=1.0)
    moved = [
        fly(listening, place, vehicles, [[[north, east]]], beams=4).tracks_m[1, 0, 0] - north
        for north, east in ((11.2, 2.0), (1.5, 3.0), (1.1, 3.0), (6.0, 8.0))
    ]
    assert moved == pytest.approx([-0.02, -0.02, 0.0, 0.0])


def test_a_shorter_range_shows_fewer_neighbours() -> None:
    place = make_place(still_air(), SOURCE_M)
    starts = np.array([[[5.0, 5.0], [5.0, 5.5], [5.0, 5.95]]])
    vehicles = TracingVehicles(step_s=1.0, limit_steps=2, avoidance_m=0.0)
    far = fly(listening, place, vehicles, starts, beams=4)
    near = fly(listening, place, msgspec.structs.replace(vehicles, range_m=0.5), starts, beams=4)
    assert far.tracks_m[1, :, 1] - starts[0, :, 1] == pytest.approx([0.02, 0.02, 0.02])
    assert near.tracks_m[1, :, 1] - starts[0, :, 1] == pytest.approx([0.01, 0.02, 0.01])


def test_members_are_lost_at_their_rate_the_same_ones_for_every_rule() -> None:
    vehicles = TracingVehicles(step_s=1.0, limit_steps=100, loss_rate=0.01)
    place = make_place(still_air(), SOURCE_M)
    starts = np.stack(np.meshgrid(np.arange(1.0, 11.0), np.arange(1.0, 11.0)), -1).reshape(1, -1, 2)
    one = fly(steady, place, vehicles, starts)
    other = fly(rush, place, vehicles, starts)
    assert one.counts[0, LOST] == other.counts[0, LOST] == pytest.approx(100 * (1 - 0.99**99), abs=15)
    assert np.array_equal(np.isnan(one.tracks_m), np.isnan(other.tracks_m))
    everybody = fly(steady, place, msgspec.structs.replace(vehicles, loss_rate=1.0), starts)
    assert everybody.counts[0, LOST] == 100
    assert everybody.counts[0, STEPS] < 100


def test_trials_are_the_same_however_they_are_split() -> None:
    place = make_place(still_air(), SOURCE_M, ROCKS)
    vehicles = TracingVehicles(limit_steps=40, loss_rate=0.001, noise=0.1)
    rng = np.random.default_rng(3)
    starts = np.stack([spread(rng, 9, vehicles) for _ in range(4)])
    whole = fly_trials(place, vehicles, "casting", starts, seed=5, first=0)
    halves = [fly_trials(place, vehicles, "casting", starts[k : k + 2], seed=5, first=k) for k in (0, 2)]
    assert np.array_equal(whole.counts, np.concatenate([half.counts for half in halves]))
    assert np.array_equal(whole.distances_m, np.concatenate([half.distances_m for half in halves]))


@pytest.mark.parametrize(
    ("changes", "starts", "words"),
    [
        ({"step_s": 4.0}, [[[1.0, 1.0]]], "longer than a vehicle"),
        ({"speed_mps": 0.0}, [[[1.0, 1.0]]], "speed_mps must be above 0"),
        ({"noise": -1.0}, [[[1.0, 1.0]]], "noise must not be below 0"),
        ({"loss_rate": 2.0}, [[[1.0, 1.0]]], "a probability from 0 to 1"),
        ({"limit_steps": 0}, [[[1.0, 1.0]]], "at least 1 step"),
        ({"range_m": 0.0}, [[[1.0, 1.0]]], "range_m must be above 0"),
        ({}, [[[0.1, 1.0]]], "outside the world"),
        ({}, [[[3.0, 3.0]]], "in an obstacle"),
        ({}, [[[1.0, 1.0], [1.0, 1.2]]], "two vehicles of trial 0 would start in each other"),
        ({}, [[1.0, 1.0]], "starting places are"),
    ],
)
def test_what_cannot_be_flown_is_refused_in_one_line(changes: Any, starts: Any, words: str) -> None:
    place = make_place(still_air(), SOURCE_M, ROCKS)
    with pytest.raises(TrialsError, match=words):
        fly(steady, place, TracingVehicles(**changes), starts)


def test_a_rule_that_gives_no_velocity_is_named() -> None:
    place = make_place(still_air(), SOURCE_M)
    with pytest.raises(TrialsError, match=r"strategy steady: .* robot 0 in step 0 of trial 0, seed 1"):
        fly(steady, place, TracingVehicles(limit_steps=10), [[[1.0, 1.0]]], heading_rad=math.nan)
    with pytest.raises(TrialsError, match="strategy locus is no rule of ticks"):
        fly_trials(place, TracingVehicles(), "locus", np.array([[[1.0, 1.0]]]), seed=1)


def test_a_source_must_be_somewhere() -> None:
    with pytest.raises(ValueError, match="is outside the world of 12 x 12 m"):
        make_place(still_air(), np.array([[13.0, 1.0]]))
    with pytest.raises(ValueError, match="is inside an obstacle"):
        make_place(still_air(), np.array([[3.0, 3.0]]), ROCKS)
