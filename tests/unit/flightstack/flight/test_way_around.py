"""The way around what hovers and makes way for nobody, flown by the guard."""

from __future__ import annotations

import math

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from flightstack.config import LimitsConfig
from flightstack.flight.way_around import RIM_M, Room, WayAround
from mission.geometry.frames import Vector3
from mission.geometry.geofence import LocalFence
from mission.strategies.contract import GoTo, Hold, Neighbour
from tests.unit.flightstack.flight.test_guard import SQUARE, STEP_S, STILL, U_SHAPE, Drone, fence

ROOM_M = 6.0
"""Around one that has been silent for long: separation, margin, and what its age adds."""
DOWN_M = -10.0


def hovering(
    *places: tuple[float, float], down_m: float = DOWN_M, age_s: float = 10.0
) -> tuple[Neighbour, ...]:
    return tuple(
        Neighbour(20 + k, (north, east, down_m), STILL, age_s, True, adrift=True)
        for k, (north, east) in enumerate(places)
    )


class Flown:
    """A drone that flies to a point, by its guard, among what hovers."""

    def __init__(self, start: tuple[float, float], area: LocalFence | None = None) -> None:
        self.drone = Drone((*start, DOWN_M), LimitsConfig(), area)
        self.track: list[Vector3] = [self.drone.position]
        self.held_by: set[str] = set()
        self.nearest_m = math.inf

    def fly(self, target: tuple[float, float], others: tuple[Neighbour, ...], seconds: float) -> Vector3:
        for _ in range(round(seconds / STEP_S)):
            self.held_by.update(self.drone.step(GoTo((*target, DOWN_M)), others))
            self.track.append(self.drone.position)
            for other in others:
                self.nearest_m = min(self.nearest_m, math.dist(self.drone.position, other.position_ned_m))
        return self.drone.position


def test_what_hovers_on_the_straight_way_is_gone_around() -> None:
    flown = Flown((0.0, 0.0))
    end = flown.fly((40.0, 0.0), hovering((20.0, 0.0)), 25.0)
    assert math.dist(end, (40.0, 0.0, DOWN_M)) < 0.5
    assert flown.nearest_m > ROOM_M - 0.1
    assert "goes around drone 20" in flown.held_by
    length_m = sum(math.dist(a, b) for a, b in zip(flown.track, flown.track[1:], strict=False))
    assert length_m < 48.0


def test_what_is_beside_the_way_or_above_it_changes_nothing() -> None:
    alone, beside = Flown((0.0, 0.0)), Flown((0.0, 0.0))
    others = hovering((20.0, 12.0)) + hovering((20.0, 0.0), down_m=DOWN_M - 12.0)
    alone.fly((40.0, 0.0), (), 20.0)
    beside.fly((40.0, 0.0), others, 20.0)
    assert max(math.dist(a, b) for a, b in zip(alone.track, beside.track, strict=True)) < 0.3
    assert not any("goes around" in text for text in beside.held_by)


def test_one_that_moves_is_not_gone_around() -> None:
    passing = Neighbour(20, (20.0, -30.0, DOWN_M), (0.0, 3.0, 0.0), 0.2, True, adrift=True)
    flown = Flown((0.0, 0.0))
    flown.fly((40.0, 0.0), (passing,), 3.0)
    assert not any("goes around" in text for text in flown.held_by)


def test_a_target_in_a_room_is_flown_to_as_near_as_may_be_and_there_the_drone_stands_still() -> None:
    flown = Flown((0.0, 0.0))
    end = flown.fly((21.0, 2.0), hovering((20.0, 0.0)), 30.0)
    assert math.dist(end[:2], (20.0, 0.0)) == pytest.approx(ROOM_M + RIM_M, abs=0.4)
    towards = math.atan2(end[1], end[0] - 20.0)
    assert towards == pytest.approx(math.atan2(2.0, 1.0), abs=0.3), "on the target's side"
    assert math.hypot(*flown.drone.velocity) < 0.1
    assert "as near to the target as drone 20 allows" in flown.held_by


def test_a_drone_that_holds_in_a_room_leaves_it() -> None:
    drone = Drone((0.0, 0.0, DOWN_M))
    for _ in range(200):
        drone.step(Hold(), hovering((3.0, 0.0)))
    assert math.dist(drone.position[:2], (3.0, 0.0)) > ROOM_M - 0.1
    assert math.hypot(*drone.velocity) < 0.1


def test_the_side_is_kept_while_what_hovers_sways() -> None:
    flown = Flown((0.0, 0.0))
    sides = set()
    for tick in range(250):
        sway_m = 0.4 * math.sin(0.7 * tick)
        flown.fly((40.0, 0.0), hovering((20.0, sway_m)), STEP_S)
        if 10.0 < flown.drone.position[0] < 30.0:
            sides.add(math.copysign(1.0, flown.drone.position[1]))
    assert len(sides) == 1
    assert math.dist(flown.drone.position, (40.0, 0.0, DOWN_M)) < 0.5


POCKET = hovering((20.0, 0.0), (20.0, 10.0), (20.0, -10.0), (12.0, 14.0), (12.0, -14.0))


def test_a_pocket_of_several_is_left_backwards() -> None:
    flown = Flown((8.0, 0.0))
    end = flown.fly((40.0, 0.0), POCKET, 60.0)
    assert math.dist(end, (40.0, 0.0, DOWN_M)) < 0.5
    assert flown.nearest_m > ROOM_M - 0.3


def test_the_way_around_stays_inside_of_the_fence() -> None:
    area = fence((-10.0, -7.0), (60.0, -7.0), (60.0, 40.0), (-10.0, 40.0))
    flown = Flown((0.0, 0.0), area)
    end = flown.fly((40.0, 0.0), hovering((20.0, 2.0)), 40.0)
    assert math.dist(end, (40.0, 0.0, DOWN_M)) < 0.5
    assert max(east for _, east, _ in flown.track) > 2.0 + ROOM_M, "the short side has no room"
    assert all(area.clearance_m(*place[:2]) > 2.5 for place in flown.track)


def test_where_no_way_leads_around_the_drone_stops() -> None:
    corridor = fence((-20.0, -9.0), (60.0, -9.0), (60.0, 9.0), (-20.0, 9.0))
    flown = Flown((0.0, 0.0), corridor)
    flown.fly((40.0, 0.0), hovering((20.0, 0.0)), 30.0)
    assert math.hypot(*flown.drone.velocity) < 0.2
    assert flown.nearest_m > ROOM_M - 0.1


def test_one_that_fell_silent_on_its_way_may_be_anywhere_on_it() -> None:
    lost = Neighbour(20, (20.0, -6.0, DOWN_M), (0.0, 3.0, 0.0), 10.0, True, adrift=True)
    flown = Flown((0.0, 0.0))
    end = flown.fly((40.0, 0.0), (lost,), 40.0)
    assert math.dist(end, (40.0, 0.0, DOWN_M)) < 0.5
    for rest_m in (-6.0, 0.0, 6.0):
        assert min(math.dist(p, (20.0, rest_m, DOWN_M)) for p in flown.track) > ROOM_M - 0.2


def test_a_way_is_planned_once_while_nothing_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    way = WayAround(None, 3.0)
    plans = []
    plan = WayAround._plan
    monkeypatch.setattr(WayAround, "_plan", lambda self, *a, **k: (plans.append(a), plan(self, *a, **k))[1])
    for k in range(20):
        room = Room(4, (20.0 + 0.02 * k, 0.0), (20.0 + 0.02 * k, 0.0), ROOM_M)
        assert way.step((0.1 * k, 0.0), (40.0, 0.01 * k), [room]).around == (4,)
    assert len(plans) == 1
    assert way.step((3.0, 0.0), (40.0, 1.0), []).around == ()
    assert way.avoids == frozenset()


places = st.tuples(st.floats(-40.0, 40.0), st.floats(-40.0, 40.0))


@settings(max_examples=30, deadline=None)
@given(places, places, st.lists(places, min_size=1, max_size=5), st.sampled_from([None, SQUARE, U_SHAPE]))
def test_wherever_others_hover_a_drone_gets_there_or_stands_still(
    start: tuple[float, float],
    target: tuple[float, float],
    where: list[tuple[float, float]],
    area: LocalFence | None,
) -> None:
    assume(all(math.dist(start, place) > ROOM_M for place in where))
    assume(area is None or (area.clearance_m(*start) > 3.0 and area.clearance_m(*target) > 3.0))
    flown = Flown(start, area)
    end = flown.fly(target, hovering(*where), 120.0)
    there = math.dist(end[:2], target) < 1.0
    assert there or math.hypot(*flown.drone.velocity) < 0.3
    assert flown.nearest_m > ROOM_M - 0.5
    assert area is None or all(area.clearance_m(*place[:2]) > 2.0 for place in flown.track)
    if area is None and len(where) < 3 and all(math.dist(target, place) > ROOM_M + 1.0 for place in where):
        assert there, "two rooms close nothing in"
