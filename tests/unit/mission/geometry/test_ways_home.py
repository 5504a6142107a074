"""Whom a vehicle has to wait for before its autopilot may bring it home."""

from __future__ import annotations

import itertools
import math
import random

import pytest

from mission.geometry.frames import Vector3
from mission.geometry.ways_home import WayHome, in_the_way

ROOM_M = 5.0
HOVERING = WayHome((40.0, 0.0, -10.0), (0.0, 0.0, 0.0))


def first(waiting: WayHome, *on_their_way: WayHome) -> int | None:
    return in_the_way({100: waiting}, dict(enumerate(on_their_way)), ROOM_M).get(100)


@pytest.mark.parametrize(
    ("place", "home", "meets"),
    [
        ((20.0, 3.0, -60.0), (20.0, 40.0, 0.0), True),
        ((20.0, 6.0, -60.0), (20.0, 40.0, 0.0), False),
        ((20.0, 40.0, -60.0), (20.0, -3.0, 0.0), True),
        ((20.0, 40.0, -60.0), (20.0, -40.0, 0.0), False),
        ((43.0, 0.0, -60.0), (80.0, 40.0, 0.0), True),
        ((80.0, 0.0, -60.0), (-40.0, 4.0, 0.0), True),
    ],
    ids=["climbs-there", "climbs-beside", "comes-down-there", "crosses", "beside-it", "flies-over-it"],
)
def test_one_waits_where_the_other_goes_up_or_down_on_its_way(
    place: Vector3, home: Vector3, meets: bool
) -> None:
    assert (first(HOVERING, WayHome(place, home)) is not None) is meets


def test_who_has_come_down_below_it_is_no_longer_in_the_way() -> None:
    home = (20.0, 0.0, 0.0)
    assert first(HOVERING, WayHome((20.0, 1.0, -12.0), home)) == 0
    assert first(HOVERING, WayHome((20.0, 1.0, -4.0), home)) is None
    assert first(HOVERING, WayHome((3.0, 0.0, -4.0), (3.0, 0.0, 0.0))) == 0, "it comes down there itself"


def test_who_hovers_over_anothers_home_goes_first() -> None:
    over_home = WayHome((2.0, 2.0, -10.0), (0.0, 30.0, 0.0))
    elsewhere = WayHome((-20.0, 0.0, -10.0), (-20.0, -30.0, 0.0))
    assert in_the_way({1: HOVERING, 2: elsewhere, 3: over_home}, {}, ROOM_M) == {1: 3}
    assert in_the_way({1: HOVERING, 2: elsewhere}, {3: over_home}, ROOM_M) == {1: 3}
    assert in_the_way({1: HOVERING, 3: over_home}, {}, ROOM_M, later={3}) == {1: 3}


def test_those_that_hover_over_each_others_homes_set_out_together() -> None:
    home, back = (0.0, 0.0, 0.0), (40.0, 0.0, 0.0)
    assert in_the_way({1: HOVERING, 2: WayHome((1.0, 0.0, -10.0), back)}, {}, ROOM_M) == {}
    assert in_the_way({1: HOVERING, 2: WayHome((1.0, 0.0, -10.0), back)}, {}, ROOM_M, later={2}) == {1: 2}
    behind = WayHome((60.0, 0.0, -10.0), home)
    assert in_the_way({1: HOVERING, 2: WayHome((1.0, 0.0, -10.0), back), 3: behind}, {}, ROOM_M) == {3: 1}


def test_whoever_goes_by_turns_meets_nobody() -> None:
    """From a formation to a launch line, at altitudes 5 m from each other in any order."""
    dice = random.Random(4)
    slots = [(10.0 * n, 10.0 * e, -10.0) for n in range(-2, 3) for e in range(-2, 3)]
    ordered, at_will = math.inf, math.inf
    for _ in range(20):
        count = dice.randint(2, 6)
        homes = [(6.0 * drone - 15.0, 1.0, 0.0) for drone in range(count)]
        places, layers_m = (
            dice.sample(slots, count),
            dice.sample([60.0 + 5.0 * k for k in range(count)], count),
        )
        from_s = [dice.randint(0, 20) for _ in range(count)]
        ordered = min(ordered, least_m(places, homes, layers_m, from_s, ROOM_M))
        at_will = min(at_will, least_m(places, homes, layers_m, from_s, 0.0))
    assert ordered > 4.0
    assert at_will < 3.0


def least_m(
    places: list[Vector3], homes: list[Vector3], layers_m: list[float], from_s: list[int], room_m: float
) -> float:
    """How near any two come that are sent home as soon as they may be, from some moment on."""
    on_their_way: set[int] = set()
    at, least, second = list(places), math.inf, 0
    while any(place[2] < 0.0 for place in at):
        ways = {k: WayHome(at[k], homes[k]) for k in range(len(at)) if at[k][2] < 0.0}
        flying = {k: way for k, way in ways.items() if k in on_their_way}
        waiting = {k: way for k, way in ways.items() if k not in on_their_way}
        later = {k for k in waiting if second < from_s[k]}
        on_their_way |= waiting.keys() - in_the_way(waiting, flying, room_m, later=later).keys() - later
        for k in on_their_way & ways.keys():
            at[k] = moved(at[k], homes[k], layers_m[k])
        least = min([least, *(math.dist(at[a], at[b]) for a, b in itertools.combinations(ways, 2))])
        second += 1
        assert second < 1500, "they wait for each other for ever"
    return least


def moved(place: Vector3, home: Vector3, layer_m: float) -> Vector3:
    """A second of an autopilot's way home."""
    north_m, east_m, down_m = place
    away_m = math.dist(place[:2], home[:2])
    if away_m < 0.1:
        return home[0], home[1], down_m + 1.5
    if -down_m < layer_m:
        return north_m, east_m, down_m - min(2.5, layer_m + down_m)
    share = min(1.0, 5.0 / away_m)
    return north_m + share * (home[0] - north_m), east_m + share * (home[1] - east_m), down_m
