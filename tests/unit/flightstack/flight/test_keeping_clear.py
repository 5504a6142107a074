"""Obstacles that are known: whatever the intent, the guard flies into none, and gets around them."""

from __future__ import annotations

import math
import random

import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from flightstack.config import LimitsConfig
from flightstack.flight.guard import AN_OBSTACLE, Guard
from flightstack.flight.way_around import RIM_M
from mission.geometry.frames import Vector3
from mission.geometry.geofence import LocalFence
from mission.geometry.known_obstacles import KnownObstacle, LocalObstacles
from mission.strategies.contract import GoTo, Hold, Intent, Neighbour, Velocity
from tests.unit.flightstack.flight.test_guard import FRAME, LIMITS, SQUARE, STEP_S, Drone, star

MARGIN_M = LIMITS.obstacle_margin_m
ERODED_M = 0.7
"""So much of the margin a vehicle that follows its setpoints a step late may use up."""


def block(north_m: float, east_m: float, size_m: float, top_m: float | None = None) -> KnownObstacle:
    half_m = size_m / 2.0
    corners = tuple(
        (north_m + a * half_m, east_m + b * half_m) for a, b in ((-1, -1), (-1, 1), (1, 1), (1, -1))
    )
    return KnownObstacle(corners_north_east_m=corners, top_above_home_m=top_m)


def flown_among(
    *obstacles: KnownObstacle,
    start: Vector3,
    area: LocalFence | None = None,
    limits: LimitsConfig = LIMITS,
) -> tuple[Drone, LocalObstacles]:
    standing = LocalObstacles(FRAME, obstacles, limits.obstacle_margin_m)
    drone = Drone(start, limits, area)
    drone.guard = Guard(limits, area, standing)
    return drone, standing


@settings(max_examples=80, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_no_sequence_of_intents_leads_into_an_obstacle(seed: int) -> None:
    """Concave ones, overlapping, low and high, inside of a fence, among drones that make no way, with wishes that
    change their mind at any time."""
    chance = random.Random(seed)
    obstacles = []
    for _ in range(chance.randint(1, 6)):
        north_m, east_m = chance.uniform(-45.0, 45.0), chance.uniform(-45.0, 45.0)
        outline = star(chance.randint(3, 8), chance, 2.0, 15.0)
        corners = tuple((n + north_m, e + east_m) for n, e in outline)
        obstacle = KnownObstacle(
            corners_north_east_m=corners, top_above_home_m=chance.choice((None, chance.uniform(1.0, 40.0)))
        )
        if not obstacle.problem(FRAME):
            obstacles.append(obstacle)
    area = chance.choice((None, SQUARE))
    start = (chance.uniform(-46.0, 46.0), chance.uniform(-46.0, 46.0), -chance.uniform(3.0, 30.0))
    drone, standing = flown_among(*obstacles, start=start, area=area)
    assume(standing.is_free(*start[:2], -start[2]))
    for _ in range(12):
        place = (chance.uniform(-70.0, 70.0), chance.uniform(-70.0, 70.0), chance.uniform(-50.0, 2.0))
        wish: Intent = chance.choice(
            (
                GoTo(place),
                Velocity((place[0] / 10.0, place[1] / 10.0, chance.uniform(-3.0, 3.0))),
                Hold(),
                GoTo((*drone.position[:2], place[2])),
            )
        )
        others = tuple(
            Neighbour(
                drone=9 + k,
                position_ned_m=(drone.position[0] + chance.uniform(-12.0, 12.0),
                                drone.position[1] + chance.uniform(-12.0, 12.0),
                                drone.position[2] + chance.uniform(-3.0, 3.0)),
                velocity_ned_mps=(0.0, 0.0, 0.0),
                age_s=0.2,
                airborne=True,
                adrift=True,
            )
            for k in range(chance.randint(0, 2))
        )  # fmt: skip
        for _ in range(chance.choice((3, 15, 40))):
            drone.step(wish, others)
            assert standing.clearance_m(drone.position) > MARGIN_M - ERODED_M
            assert area is None or area.contains(*drone.position[:2])


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_way_around_them_does_not_get_stuck(seed: int) -> None:
    """Wherever a way exists that keeps the margin and the fence, the drone comes to its target."""
    chance = random.Random(seed)
    obstacles = [
        block(chance.uniform(-30.0, 30.0), chance.uniform(-30.0, 30.0), chance.uniform(3.0, 14.0))
        for _ in range(chance.randint(1, 8))
    ]
    start, goal = (-44.0, chance.uniform(-40.0, 40.0)), (44.0, chance.uniform(-40.0, 40.0))
    drone, standing = flown_among(*obstacles, start=(*start, -10.0), area=SQUARE)
    room = shapely.difference(SQUARE.room(LIMITS.fence_margin_m), standing.walls(10.0, RIM_M, pointed=True))
    assume(any(shapely.covers(part, shapely.MultiPoint([start, goal])) for part in shapely.get_parts(room)))
    for _ in range(900):
        drone.step(GoTo((*goal, -10.0)))
        assert standing.clearance_m(drone.position) > MARGIN_M - ERODED_M
        if math.dist(drone.position[:2], goal) < 0.5:
            break
    assert math.dist(drone.position[:2], goal) < 0.5


def test_a_drone_in_a_dead_end_comes_out_of_it() -> None:
    """A U of walls, open to where the drone comes from, and its target behind."""
    u_shape = KnownObstacle(
        corners_north_east_m=(
            (0.0, -20.0), (0.0, -16.0), (26.0, -16.0), (26.0, 16.0), (0.0, 16.0), (0.0, 20.0),
            (30.0, 20.0), (30.0, -20.0),
        )
    )  # fmt: skip
    drone, standing = flown_among(u_shape, start=(15.0, 0.0, -10.0))
    held_by: set[str] = set()
    for _ in range(600):
        held_by.update(drone.step(GoTo((45.0, 0.0, -10.0))))
        assert standing.clearance_m(drone.position) > MARGIN_M - ERODED_M
    assert math.dist(drone.position, (45.0, 0.0, -10.0)) < 0.5
    assert "goes around an obstacle" in held_by


def test_what_ends_well_below_is_flown_over_and_not_landed_on() -> None:
    drone, standing = flown_among(block(20.0, 0.0, 10.0, 6.0), start=(0.0, 0.0, -12.0))
    for _ in range(120):
        held_by = drone.step(GoTo((40.0, 0.0, -12.0)))
        assert abs(drone.position[1]) < 0.1
        assert "goes around an obstacle" not in held_by
    for _ in range(200):
        drone.step(GoTo((20.0, 0.0, -12.0)))
    for _ in range(300):
        held_by = drone.step(GoTo((20.0, 0.0, -2.0)))
        assert standing.clearance_m(drone.position) > MARGIN_M - ERODED_M
    assert -drone.position[2] == pytest.approx(6.0 + MARGIN_M, abs=0.3)
    assert AN_OBSTACLE in held_by


def test_what_ends_just_below_is_gone_around() -> None:
    """At the height of the margin itself a drone that sways would be stopped at the edge."""
    drone, _ = flown_among(block(20.0, 0.0, 10.0, 9.5 - MARGIN_M), start=(0.0, 0.0, -10.0))
    farthest_m = 0.0
    for _ in range(250):
        drone.step(GoTo((40.0, 0.0, -10.0)))
        farthest_m = max(farthest_m, abs(drone.position[1]))
    assert math.dist(drone.position, (40.0, 0.0, -10.0)) < 0.5
    assert farthest_m > 5.0 + MARGIN_M


def test_a_target_inside_is_flown_to_as_near_as_may_be() -> None:
    drone, _ = flown_among(block(20.0, 0.0, 10.0), start=(0.0, 0.0, -10.0))
    for _ in range(250):
        held_by = drone.step(GoTo((18.0, 1.0, -10.0)))
    assert drone.position == pytest.approx((15.0 - MARGIN_M - RIM_M, 1.0, -10.0), abs=0.3)
    assert "as near to the target as an obstacle allows" in held_by


def test_a_drone_that_was_blown_too_near_comes_away() -> None:
    drone, standing = flown_among(block(0.0, 0.0, 10.0), start=(6.0, 0.0, -10.0))
    for _ in range(200):
        drone.step(Hold())
    assert standing.clearance_m(drone.position) > MARGIN_M - 0.2


def test_one_over_a_roof_within_the_margin_climbs() -> None:
    drone, standing = flown_among(block(0.0, 0.0, 30.0, 8.0), start=(0.0, 0.0, -9.5))
    for _ in range(200):
        drone.step(Hold())
        assert standing.clearance_m(drone.position) > 1.3
    assert standing.clearance_m(drone.position) > MARGIN_M - 0.2


def test_velocities_slide_along_a_wall() -> None:
    drone, standing = flown_among(block(20.0, 0.0, 30.0), start=(0.0, 0.0, -10.0))
    for _ in range(round(40.0 / STEP_S)):
        drone.step(Velocity((2.0, 1.0, 0.0)))
        assert standing.clearance_m(drone.position) > MARGIN_M - ERODED_M
    assert drone.position[1] > 15.0, "it went along the wall"
    assert drone.position[0] > 20.0, "and past its corner"
