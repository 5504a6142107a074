"""The places that are kept free of those who are steered: over homes, and over where somebody fell silent."""

from __future__ import annotations

import itertools
import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightstack.config import LimitsConfig
from flightstack.flight.columns import CLIMBS_WITHIN_S, columns, in_own_cell
from flightstack.flight.guard import Guard, VelocityTarget
from flightstack.flight.guidance import horizontal_m
from mission.geometry.frames import Vector3
from mission.strategies.contract import GoTo, Neighbour

STILL: Vector3 = (0.0, 0.0, 0.0)
AWAY: Vector3 = (60.0, 0.0, -10.0)
HOME: Vector3 = (0.0, 0.0, 0.0)
SILENT = Neighbour(9, AWAY, STILL, 20.0, True, adrift=True, home_ned_m=HOME)
ROOM_M = 5.0
numbers = st.floats(-30.0, 30.0)
places = st.tuples(numbers, numbers, st.just(0.0))


def changed(**what: object) -> Neighbour:
    return msgspec.structs.replace(SILENT, **what)


def flown(start: Vector3, target: Vector3, others: tuple[Neighbour, ...], own_home: Vector3) -> list[Vector3]:
    """Where a drone comes by that follows its guard, in steps of a tenth of a second."""
    guard, track, velocity = Guard(LimitsConfig(), None), [start], STILL
    for _ in range(600):
        guarded = guard.apply(GoTo(target), track[-1], velocity, 0.1, others, own_home)
        if not isinstance(guarded.setpoint, VelocityTarget):
            return track
        velocity = guarded.setpoint.velocity_ned_mps
        n, e, d = (p + 0.1 * v for p, v in zip(track[-1], velocity, strict=True))
        track.append((n, e, d))
    return track


@pytest.mark.parametrize(
    "neighbour",
    [
        SILENT,
        changed(age_s=3000.0),
        changed(age_s=0.2),  # heard, and its autopilot or a pilot has it
    ],
)
def test_nobody_is_steered_over_the_home_of_one_that_may_come_down_there(neighbour: Neighbour) -> None:
    track = flown((0.3, -30.0, -20.0), (0.0, 30.0, -20.0), (neighbour,), (-20.0, 0.0, 0.0))
    assert math.dist(track[-1], (0.0, 30.0, -20.0)) < 1.0, "it goes around"
    assert min(horizontal_m(place, HOME) for place in track) > ROOM_M - 0.5


def test_who_is_in_the_way_leaves_at_its_altitude() -> None:
    start = (1.0, 1.0, -10.0)
    track = flown(start, start, (SILENT,), (-20.0, 0.0, 0.0))
    assert horizontal_m(track[-1], HOME) > ROOM_M - 0.5
    assert track[-1][2] == pytest.approx(-10.0, abs=0.1)


@pytest.mark.parametrize(
    "neighbour", [changed(adrift=False, age_s=0.2), changed(airborne=False), changed(home_ned_m=None)]
)
def test_who_makes_way_or_stands_on_the_ground_keeps_nothing_free(neighbour: Neighbour) -> None:
    assert list(columns((neighbour,), (1.0, 1.0, -10.0), None, ROOM_M)) == []


def test_over_the_place_where_one_fell_silent_nobody_passes_until_it_has_climbed() -> None:
    silent, over = changed(home_ned_m=None), (50.0, 0.0, -20.0)
    assert list(columns((silent,), over, None, ROOM_M)) == [(9, (60.0, 0.0, -20.0), ROOM_M)]
    just_now = changed(home_ned_m=None, adrift=False, age_s=1.5)
    assert list(columns((just_now,), over, None, ROOM_M)) == [(9, (60.0, 0.0, -20.0), ROOM_M)]
    assert not list(columns((silent,), (50.0, 0.0, -4.0), None, ROOM_M)), "it climbs, it does not sink"
    later = changed(home_ned_m=None, age_s=CLIMBS_WITHIN_S + 1.0)
    assert not list(columns((later,), over, None, ROOM_M))
    target = (90.0, 0.0, -20.0)
    assert max(n for n, _, _ in flown((60.5 - 2 * ROOM_M, 0.0, -20.0), target, (later,), AWAY)) > 80.0


@pytest.mark.parametrize("below_m", [6.0, 12.0, 19.0])
@pytest.mark.parametrize("climb_mps", [2.5, 3.0])
def test_an_autopilot_that_climbs_under_one_that_comes_down_finds_its_way_free(
    below_m: float, climb_mps: float
) -> None:
    """The agent that steers it stands still, and the ground station tells where it is."""
    limits = LimitsConfig()
    guard, place, velocity, nearest_m = Guard(limits, None), (0.2, 0.0, -30.0), STILL, math.inf
    for tick in itertools.count():
        there = (0.0, 0.0, below_m - 30.0 - 0.1 * tick * climb_mps)
        if there[2] < place[2] - 8.0:  # it is above, and gone
            break
        nearest_m = min(nearest_m, math.dist(place, there))
        climbs = (0.0, 0.0, -climb_mps)
        other = Neighbour(9, there, climbs, 0.0, True, adrift=True, home_ned_m=AWAY)
        guarded = guard.apply(GoTo((0.0, 0.0, -10.0)), place, velocity, 0.1, (other,), (0.0, 30.0, 0.0))
        assert isinstance(guarded.setpoint, VelocityTarget)
        changes = (w - v for w, v in zip(guarded.setpoint.velocity_ned_mps, velocity, strict=True))
        most = limits.acceleration_mps2 * 0.1
        n, e, d = (v + min(max(c, -most), most) for v, c in zip(velocity, changes, strict=True))
        velocity = (n, e, d)
        n, e, d = (p + 0.1 * v for p, v in zip(place, velocity, strict=True))
        place = (n, e, d)
    assert nearest_m > limits.separation_m


def test_high_over_one_that_is_heard_anybody_may_pass() -> None:
    heard = changed(home_ned_m=None, age_s=0.2)
    assert not list(columns((heard,), (60.0, 0.0, -31.0), None, ROOM_M))
    assert list(columns((heard,), (60.0, 0.0, -29.0), None, ROOM_M)) == [(9, (60.0, 0.0, -29.0), ROOM_M)]
    assert not list(columns((heard,), (60.0, 0.0, -9.0), None, ROOM_M))


def test_what_fell_silent_over_anothers_home_may_leave_it_before_it_climbs() -> None:
    """Nobody comes nearer meanwhile, but nobody is pushed away for it either."""
    silent, own_home = changed(home_ned_m=None), (62.0, 0.0, 0.0)
    for away_m, room_m in ((3.0, 5.0), (6.0, 6.0), (8.0, 8.0), (20.0, 8.0)):
        ((_, place, kept_m),) = columns((silent,), (60.0 - away_m, 0.0, -20.0), own_home, ROOM_M)
        assert place == (60.0, 0.0, -20.0)
        assert kept_m == pytest.approx(room_m)


def test_the_way_down_to_the_own_home_stays_free_where_launch_points_stand_close() -> None:
    ((_, place, kept_m),) = columns((changed(age_s=99.0),), (3.0, 0.0, -20.0), (6.0, 0.0, 0.0), ROOM_M)
    assert (place, kept_m) == ((0.0, 0.0, -20.0), 4.5)
    track = flown((40.0, 3.0, -20.0), (6.0, 0.0, -4.0), (changed(age_s=99.0),), (6.0, 0.0, 0.0))
    assert math.dist(track[-1], (6.0, 0.0, -4.0)) < 1.0


@given(places, places, places, places)
def test_landing_places_in_two_cells_are_apart(a: Vector3, b: Vector3, of_a: Vector3, of_b: Vector3) -> None:
    room_m = 4.0
    if horizontal_m(a, b) >= room_m and in_own_cell(of_a, a, b, room_m) and in_own_cell(of_b, b, a, room_m):
        assert horizontal_m(of_a, of_b) >= room_m - 1e-6
    assert in_own_cell(a, a, b, room_m), "home always is"
