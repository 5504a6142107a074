"""The paths that a drone flies by itself, flown by a point that follows them exactly."""

from __future__ import annotations

import math
from collections.abc import Callable

from hypothesis import given, settings
from hypothesis import strategies as st

from flightstack.flight.guidance import CORRIDOR_M, horizontal_m, landing_point, over_the_top, underneath
from mission.geometry.frames import Vector3
from mission.strategies.contract import Neighbour

STEP_M = 0.5
places = st.tuples(st.floats(-100.0, 100.0), st.floats(-100.0, 100.0), st.floats(-40.0, -3.0))


def flown(path: Callable[[Vector3], Vector3], start: Vector3) -> list[Vector3]:
    """Every point on the way, in steps of half a metre, until nothing moves any more."""
    track = [start]
    for _ in range(2000):
        here, there = track[-1], path(track[-1])
        distance_m = math.dist(here, there)
        if distance_m < 1e-6:
            return track
        part = min(1.0, STEP_M / distance_m)
        n, e, d = (a + (b - a) * part for a, b in zip(here, there, strict=True))
        track.append((n, e, d))
    raise AssertionError("never arrived")


@settings(max_examples=100, deadline=None)
@given(places, places, st.floats(-60.0, -41.0))
def test_over_the_top_crosses_in_its_own_layer_only(start: Vector3, target: Vector3, layer_m: float) -> None:
    track = flown(lambda here: over_the_top(here, target, layer_m), start)
    assert math.dist(track[-1], target) < 1e-3
    for point in track:
        away_from_both = min(horizontal_m(point, start), horizontal_m(point, target)) > CORRIDOR_M + STEP_M
        assert not away_from_both or point[2] <= layer_m + 1.0 + STEP_M


@settings(max_examples=100, deadline=None)
@given(places, places)
def test_the_heir_crosses_underneath(start: Vector3, target: Vector3) -> None:
    layer_m = -2.0
    track = flown(lambda here: underneath(here, target, layer_m), start)
    assert math.dist(track[-1], target) < 1e-3
    for point in track:
        away_from_both = min(horizontal_m(point, start), horizontal_m(point, target)) > CORRIDOR_M + STEP_M
        assert not away_from_both or point[2] >= layer_m - 0.7 - STEP_M


@settings(max_examples=100, deadline=None)
@given(places, places, st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0)))
def test_where_something_stands_below_the_slot_the_heir_turns_up_beside_it(
    start: Vector3, target: Vector3, beside: tuple[float, float]
) -> None:
    turn = (target[0] + beside[0], target[1] + beside[1])
    track = flown(lambda here: underneath(here, target, -2.0, turn), start)
    assert math.dist(track[-1], target) < 1e-3


def hovering(position: Vector3, *, adrift: bool = True, airborne: bool = True) -> Neighbour:
    return Neighbour(9, position, (0.0, 0.0, 0.0), 0.2, airborne, adrift=adrift)


def everywhere(_north_m: float, _east_m: float) -> bool:
    return True


def test_home_is_where_one_lands_unless_somebody_hovers_there_for_good() -> None:
    home: Vector3 = (10.0, 5.0, 0.0)
    assert landing_point(home, (), 7.0, everywhere) == home
    passing = hovering((11.0, 5.0, -20.0), adrift=False)
    assert landing_point(home, (passing,), 7.0, everywhere) == home
    orphan = hovering((11.0, 5.0, -10.0))
    beside = landing_point(home, (orphan,), 7.0, everywhere)
    assert horizontal_m(beside, orphan.position_ned_m) >= 7.0
    assert horizontal_m(beside, home) < 9.0


def test_what_flies_past_or_lands_beside_home_does_not_block_it_for_good() -> None:
    home: Vector3 = (10.0, 5.0, 0.0)
    comes_home = Neighbour(9, (11.0, 5.0, -20.0), (0.0, 0.0, 1.0), 0.2, True, adrift=True)
    assert landing_point(home, (comes_home,), 7.0, everywhere) == home
    silent = Neighbour(9, (11.0, 5.0, -20.0), (0.0, 0.0, 1.0), 5.0, True, adrift=True)
    assert landing_point(home, (silent,), 7.0, everywhere) != home


def test_the_place_beside_home_is_allowed_and_free() -> None:
    home: Vector3 = (0.0, 0.0, 0.0)
    orphan = hovering((0.0, 1.0, -10.0))
    parked = hovering((-6.0, 0.0, 0.0), airborne=False)
    beside = landing_point(home, (orphan, parked), 6.0, lambda north_m, _east_m: north_m < 1.0)
    assert beside[0] < 1.0
    assert horizontal_m(beside, parked.position_ned_m) >= 3.0
    assert horizontal_m(beside, orphan.position_ned_m) >= 6.0
