"""The rule of MoBS as its authors programmed it, tick by tick, and a drone that flies by it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mission.estimation.estimates import Scalar
from mission.geometry.formation import FloatArray
from mission.geometry.frames import Vector3
from mission.strategies.contract import OwnState
from mission.strategies.mobs import MobsParameters
from mission.strategies.mobs_authors import (
    ALONG,
    AUTHORS_STATE_SIZE,
    BEARING,
    DECISION,
    PHASE,
    SPOKES,
    STEP,
    TURNED,
    WAIT,
    ZEROS,
    MobsAuthorsFlight,
    mobs_authors_begin,
    mobs_authors_next,
)
from mission.strategies.spokes import GOLDEN

Place = tuple[float, float]


def begun(bearing_rad: float = 0.5) -> FloatArray:
    state = np.zeros(AUTHORS_STATE_SIZE)
    mobs_authors_begin(state, bearing_rad)
    return state


def tick(state: FloatArray, at: Place, reading: float, there: bool, draws: Place = (1.0, 0.5)) -> Place:
    """One tick on spokes of 4 m with a waypoint every metre."""
    return mobs_authors_next(state, 1, *at, reading, there, 4.0, 1.0, *draws)


def flown(state: FloatArray, ticks: int, reading: float = 0.0) -> list[Place]:
    """The targets of a drone that arrives wherever it is sent within a tick."""
    at: Place = (0.0, 0.0)
    targets = []
    for _ in range(ticks):
        at = tick(state, at, reading, there=True)
        targets.append(at)
    return targets


def test_a_spoke_is_flown_out_and_back_with_a_tick_between_waypoints() -> None:
    targets = flown(begun(), 24)
    along_m = [math.hypot(*target) for target in targets]
    # Two ticks from the centre to the first waypoint; then arrival at one tick, the next command at the next.
    out_and_back = [1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0, 3.0, 3.0, 2.0, 2.0, 1.0, 1.0]
    assert along_m == pytest.approx([0.0, 0.0, *out_and_back, *[0.0] * 5, 1.0, 1.0, 2.0])
    assert all(math.atan2(e, n) == pytest.approx(0.5) for n, e in targets[2:16])
    north_m, east_m = targets[-1]
    assert math.atan2(east_m, north_m) % math.tau == pytest.approx((0.5 + math.tau / GOLDEN) % math.tau)


def test_the_drone_stops_at_its_first_contact_wherever_it_is_and_decides_a_tick_later() -> None:
    state = begun(0.0)
    flown(state, 3)
    assert tick(state, (0.3, 0.4), 0.2, there=False) == (0.3, 0.4)
    assert (state[TURNED], state[PHASE], state[WAIT]) == (1.0, DECISION, 1.0)
    # A tick later the reading has grown: outwards from the centre, which is commanded one more tick later.
    assert tick(state, (0.33, 0.44), 0.3, there=False) == (0.3, 0.4)
    assert tick(state, (0.33, 0.44), 0.3, there=False) == pytest.approx((0.93, 1.24))
    # Arrival; a tick later no growth: a direction from the square, here north-east.
    tick(state, (0.93, 1.24), 0.3, there=True)
    tick(state, (0.93, 1.24), 0.3, there=False, draws=(1.0, 1.0))
    side_m = math.sqrt(0.5)
    assert tick(state, (0.93, 1.24), 0.3, there=False) == pytest.approx((0.93 + side_m, 1.24 + side_m))


def decide(state: FloatArray, reading: float) -> None:
    """One moth step: arrival, decision, command."""
    tick(state, (1.0, 1.0), reading, there=True)
    tick(state, (1.0, 1.0), reading, there=False)
    tick(state, (1.0, 1.0), reading, there=False)


def test_zeros_are_counted_over_the_whole_moth_phase_and_a_drone_turns_moth_once() -> None:
    state = begun(0.5)
    tick(state, (1.0, 1.0), 0.2, there=False)
    tick(state, (1.0, 1.0), 0.0, there=False)  # the first decision: a reading before
    tick(state, (1.0, 1.0), 0.0, there=False)
    for reading in (0.0, 0.0, 0.1, 0.2, 0.0, 0.0):  # twice nothing before and nothing now, then a third time
        decide(state, reading)
    assert (state[ZEROS], state[PHASE]) == (3.0, STEP)
    decide(state, 0.0)
    assert state[PHASE] == STEP
    tick(state, (1.0, 1.0), 0.0, there=True)
    tick(state, (1.0, 1.0), 0.0, there=False)
    assert (state[ZEROS], state[PHASE], state[WAIT]) == (5.0, SPOKES, 2.0)
    assert state[BEARING] == pytest.approx((0.5 + math.tau / GOLDEN) % math.tau)
    tick(state, (1.0, 1.0), 0.0, there=False)
    assert tick(state, (1.0, 1.0), 0.0, there=False) == (0.0, 0.0)
    assert flown(state, 4, reading=0.9)[-1] != (0.0, 0.0), "it heeds no reading any more"
    assert (state[TURNED], state[PHASE], state[ALONG]) == (1.0, SPOKES, 1.0)


def test_called_only_when_something_happens_it_decides_the_same() -> None:
    every, seldom = begun(), begun()
    at: Place = (0.0, 0.0)
    for _ in range(12):
        mobs_authors_next(seldom, 7, *at, 0.0, True, 4.0, 1.0, 0.0, 0.0)
        tick(every, at, 0.0, there=True)
        for _ in range(int(every[WAIT])):
            at = tick(every, at, 0.0, there=False)
        assert mobs_authors_next(seldom, int(seldom[WAIT]), *at, 0.0, False, 4.0, 1.0, 0.0, 0.0) == at
        assert every.tolist() == seldom.tolist()


def own(place: Vector3) -> OwnState:
    return OwnState(1, place, (0.0, 0.0, 0.0), Scalar(0.0, 0.0, 0.0), None, 0.9)


def test_a_flight_goes_on_from_where_the_drone_smelt_something() -> None:
    centre = (10.0, 20.0, -10.0)
    flight = MobsAuthorsFlight(centre, 0.0, MobsParameters(settle_s=0.0, radius_m=4.0))
    rng = np.random.default_rng(1)
    target = centre
    for k in range(7):
        target = flight.step(0.1 * k, own(target), 0.0, rng)
    assert target == pytest.approx((13.0, 20.0, -10.0))
    place = (12.5, 20.1, -10.2)
    assert flight.step(0.7, own(place), 40.0, rng) == pytest.approx((12.5, 20.1, -10.0))
    flight.step(0.8, own(place), 41.0, rng)
    step = flight.step(0.9, own(place), 41.0, rng)
    assert math.dist(step[:2], place[:2]) == pytest.approx(1.0)
    assert step[0] > 13.0, "outwards, for the reading had grown"
