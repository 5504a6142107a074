"""Obstacles that only the range finder knows: the guard stops before them and goes around."""

from __future__ import annotations

import math
import random

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from flightstack.flight.guard import Guard
from flightstack.flight.seen_obstacles import SeenObstacles
from flightstack.mavlink.obstacle_distance import Ranges
from mission.geometry.frames import Vector3
from mission.geometry.known_obstacles import LocalObstacles
from mission.strategies.contract import GoTo, Intent, Neighbour, Velocity
from simvehicle.survey.survey_file import known_obstacles
from simvehicle.vehicle.range_finder import RangeFinder, RangeFinderConfig
from simvehicle.world.obstacles import Obstacles
from simvehicle.world.world_config import RectangularObstacle
from tests.unit.flightstack.flight.test_guard import FRAME, LIMITS, STILL, Drone

MARGIN_M = LIMITS.obstacle_margin_m


def rock(north_m: float, east_m: float, size_m: float, *, unknown: bool = True) -> RectangularObstacle:
    return RectangularObstacle(
        centre_north_m=north_m,
        centre_east_m=east_m,
        length_north_m=size_m,
        length_east_m=size_m,
        unknown=unknown,
    )


class Looking:
    """A drone with a range finder that looks around five times a second."""

    def __init__(
        self, *rocks: RectangularObstacle, start: tuple[float, float], noise_sd_m: float = 0.05
    ) -> None:
        self.obstacles = Obstacles(rocks)
        known = known_obstacles(rocks)
        self.drone = Drone((*start, -10.0))
        self.drone.guard = Guard(LIMITS, None, LocalObstacles(FRAME, known, MARGIN_M) if known else None)
        self.finder = RangeFinder(RangeFinderConfig(noise_sd_m=noise_sd_m), self.obstacles, system=1, seed=1)
        self.nearest_m = math.inf
        self.ticks = 0

    def fly(self, wish: Intent, seconds: float) -> tuple[str, ...]:
        held_by: set[str] = set()
        for _ in range(round(seconds * 10.0)):
            position, yaw_rad = self.drone.position, 0.3
            if self.ticks % 2 == 0 and not self.finder.silent:
                seen_m = self.finder.measure(position, yaw_rad)
                width_rad = math.tau / len(seen_m)
                beams = tuple((yaw_rad + k * width_rad, seen) for k, seen in enumerate(seen_m))
                self.drone.guard.look(self.ticks / 10.0, position, Ranges(beams, width_rad, 25.0), ())
            self.ticks += 1
            held_by.update(self.drone.step(wish))
            self.nearest_m = min(self.nearest_m, self.obstacles.clearance_m(self.drone.position))
        return tuple(held_by)


def test_it_stops_before_what_it_sees_and_slides_around() -> None:
    looking = Looking(rock(30.0, 1.0, 12.0), start=(0.0, 0.0))
    held_by = looking.fly(GoTo((60.0, 0.0, -10.0)), 40.0)
    assert math.dist(looking.drone.position, (60.0, 0.0, -10.0)) < 0.5
    assert looking.nearest_m > MARGIN_M - 1.0
    assert "goes around an obstacle" in held_by


def test_velocities_into_a_wall_end_before_it() -> None:
    looking = Looking(rock(40.0, 0.0, 30.0), start=(0.0, 0.0))
    looking.fly(Velocity((5.0, 0.0, 0.0)), 20.0)
    assert looking.nearest_m == pytest.approx(MARGIN_M, abs=1.0)
    assert looking.drone.position[0] > 15.0


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_no_sequence_of_intents_leads_into_what_is_seen(seed: int) -> None:
    chance = random.Random(seed)
    rocks = [
        rock(
            chance.uniform(-40.0, 40.0),
            chance.uniform(-40.0, 40.0),
            chance.uniform(2.0, 14.0),
            unknown=chance.random() < 0.7,
        )
        for _ in range(chance.randint(1, 6))
    ]
    looking = Looking(*rocks, start=(chance.uniform(-40.0, 40.0), chance.uniform(-40.0, 40.0)))
    assume(looking.obstacles.clearance_m(looking.drone.position) > MARGIN_M)
    for _ in range(8):
        north_m, east_m = chance.uniform(-60.0, 60.0), chance.uniform(-60.0, 60.0)
        wish = chance.choice((GoTo((north_m, east_m, -10.0)), Velocity((north_m / 8.0, east_m / 8.0, 0.0))))
        looking.fly(wish, chance.choice((1.0, 3.0, 8.0)))
        assert looking.nearest_m > 0.5, "touched"


@pytest.mark.parametrize(("silent", "lies_m"), [(True, 0.0), (False, 15.0), (False, -8.0)])
def test_a_sensor_that_is_silent_or_lies_leads_into_nothing_that_is_known(
    silent: bool, lies_m: float
) -> None:
    looking = Looking(
        rock(30.0, 1.0, 12.0, unknown=False), rock(60.0, 40.0, 8.0, unknown=False), start=(0.0, 0.0)
    )
    looking.fly(GoTo((80.0, 0.0, -10.0)), 2.0)
    looking.finder.silent, looking.finder.lies_m = silent, lies_m
    for target in ((80.0, 0.0), (30.0, 0.0)):
        looking.fly(GoTo((*target, -10.0)), 10.0)
    assert looking.nearest_m > MARGIN_M - 0.7


def look(*beams: tuple[float, float]) -> Ranges:
    return Ranges(
        tuple((math.radians(bearing_deg), range_m) for bearing_deg, range_m in beams),
        math.radians(10.0),
        25.0,
    )


def unknown(_place: tuple[float, float]) -> bool:
    return False


HERE: Vector3 = (0.0, 0.0, -10.0)


def test_what_is_seen_is_remembered_until_it_is_seen_through_or_long_ago() -> None:
    seen = SeenObstacles(3.0)
    seen.look(0.0, HERE, look((0.0, 10.0), (90.0, 12.0)), unknown)
    assert seen.beside_walls_m(0.0, 0.0) == pytest.approx(10.0)
    seen.look(1.0, HERE, look((180.0, math.inf)), unknown)
    assert seen.beside_walls_m(0.0, 0.0) == pytest.approx(10.0), "it looked elsewhere"
    seen.look(2.0, HERE, look((0.0, math.inf), (90.0, 12.0)), unknown)
    assert seen.beside_walls_m(0.0, 0.0) == pytest.approx(12.0), "nothing is there any more"
    seen.look(63.5, HERE, look((180.0, math.inf)), unknown)
    assert seen.beside_walls_m(0.0, 0.0) == math.inf, "long ago"


def test_what_is_kept_clear_of_anyway_is_not_remembered() -> None:
    other = Neighbour(2, (10.0, 0.5, -10.0), STILL, 0.1, True)
    guard = Guard(LIMITS, None)
    guard.look(0.0, HERE, look((0.0, 10.0)), (other,))
    guarded = guard.apply(Velocity((1.0, 0.0, 0.0)), (5.5, 10.0, -10.0), STILL, 0.1, ())
    assert guarded.held_by == ()
