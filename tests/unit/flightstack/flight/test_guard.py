"""The guard: whatever the intent, limits hold."""

from __future__ import annotations

import math
import random

import msgspec
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from flightstack.config import LimitsConfig
from flightstack.flight.guard import Guard, PositionTarget, VelocityTarget
from mission.geometry.frames import Geodetic, LocalFrame, Vector3
from mission.geometry.geofence import Circle, Geofence, LocalFence, Vertex
from mission.strategies.contract import GoTo, Hold, Intent, Neighbour, Velocity

LIMITS = LimitsConfig()
FRAME = LocalFrame(Geodetic(-5.06, 151.3, 500.0))
STILL: Vector3 = (0.0, 0.0, 0.0)
STEP_S = 0.1


def fence(*polygon: tuple[float, float], exclusion: tuple[tuple[float, float], ...] = ()) -> LocalFence:
    def corners(points: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        places = [FRAME.to_geodetic((n, e, 0.0)) for n, e in points]
        return tuple((place.latitude_deg, place.longitude_deg) for place in places)

    return LocalFence(
        FRAME, Geofence(inclusion=(corners(polygon),), exclusion=(corners(exclusion),) if exclusion else ())
    )


SQUARE = fence((-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-50.0, 50.0))
U_SHAPE = fence(
    (-60.0, -60.0), (60.0, -60.0), (60.0, -20.0), (-20.0, -20.0),
    (-20.0, 20.0), (60.0, 20.0), (60.0, 60.0), (-60.0, 60.0),
)  # fmt: skip


def neighbour(position: Vector3, velocity: Vector3 = STILL, age_s: float = 0.1) -> Neighbour:
    return Neighbour(9, position, velocity, age_s, True)


class Drone:
    """A vehicle that follows velocity targets within its acceleration, one step behind, as real ones do."""

    def __init__(
        self, position: Vector3, limits: LimitsConfig = LIMITS, area: LocalFence | None = None
    ) -> None:
        self.position = position
        self.velocity: Vector3 = STILL
        self.guard = Guard(limits, area)
        self.limits = limits

    def step(self, intent: Intent, neighbours: tuple[Neighbour, ...] = ()) -> tuple[str, ...]:
        guarded = self.guard.apply(intent, self.position, self.velocity, 0.1, neighbours)
        match guarded.setpoint:
            case VelocityTarget(velocity_ned_mps=wanted):
                pass
            case PositionTarget(position_ned_m=point):
                wanted = tuple(p - q for p, q in zip(point, self.position, strict=True))
        n, e, d = (w - v for w, v in zip(wanted, self.velocity, strict=True))
        most_mps = self.limits.acceleration_mps2 * STEP_S
        scale = min(1.0, most_mps / (math.hypot(n, e) or 1.0))
        down_mps = min(max(d, -most_mps), most_mps)
        self.velocity = (
            self.velocity[0] + n * scale,
            self.velocity[1] + e * scale,
            self.velocity[2] + down_mps,
        )
        n, e, d = (p + v * STEP_S for p, v in zip(self.position, self.velocity, strict=True))
        self.position = (n, e, d)
        return guarded.held_by


def test_it_goes_where_it_is_told_and_keeps_the_station_there() -> None:
    drone = Drone((0.0, 0.0, -10.0))
    for _ in range(300):
        drone.step(GoTo((30.0, -20.0, -15.0)))
    assert math.dist(drone.position, (30.0, -20.0, -15.0)) < 0.3
    guarded = drone.guard.apply(GoTo((30.0, -20.0, -15.0)), drone.position, drone.velocity, 0.1, ())
    assert guarded.setpoint == PositionTarget((30.0, -20.0, -15.0))


def test_hold_stops_and_stays() -> None:
    drone = Drone((0.0, 0.0, -10.0))
    for _ in range(40):
        drone.step(GoTo((100.0, 0.0, -10.0)))
    for _ in range(100):
        drone.step(Hold())
    rest = drone.position
    for _ in range(100):
        drone.step(Hold())
    assert math.dist(drone.position, rest) < 0.3


def test_a_stale_position_means_stop() -> None:
    guard = Guard(LIMITS, None)
    guarded = guard.apply(GoTo((30.0, 0.0, -10.0)), (0.0, 0.0, -10.0), STILL, 1.5, ())
    assert guarded.setpoint == VelocityTarget((0.0, 0.0, 0.0))
    assert "1.5 s old" in guarded.held_by[0]


NAN, INF = math.nan, math.inf
HERE: Vector3 = (0.0, 0.0, -10.0)
THERE = GoTo((10.0, 2.0, -10.0))


@pytest.mark.parametrize("area", [None, SQUARE])
@pytest.mark.parametrize(
    ("intent", "position", "velocity", "age_s", "others"),
    [
        (THERE, None, STILL, 0.1, ()),
        (THERE, HERE, None, 0.1, ()),
        (THERE, HERE, STILL, None, ()),
        (THERE, (NAN, 0.0, -10.0), STILL, 0.1, ()),
        (Hold(), HERE, (NAN, 0.0, 0.0), 0.1, ()),
        (THERE, HERE, STILL, NAN, ()),
        (GoTo((0.0, INF, -10.0)), HERE, STILL, 0.1, ()),
        (GoTo((10.0, 2.0, -10.0), NAN), HERE, STILL, 0.1, ()),
        (Velocity((NAN, 0.0, 0.0)), HERE, STILL, 0.1, ()),
        (THERE, HERE, STILL, 0.1, (neighbour((NAN, 0.0, 0.0)),)),
        (THERE, HERE, STILL, 0.1, (neighbour((5.0, 0.0, -10.0), (INF, 0.0, 0.0)),)),
        (THERE, HERE, STILL, 0.1, (neighbour((5.0, 0.0, -10.0), STILL, NAN),)),
    ],
)
def test_what_is_not_known_or_no_number_means_stop(
    intent: Intent,
    position: Vector3 | None,
    velocity: Vector3 | None,
    age_s: float | None,
    others: tuple[Neighbour, ...],
    area: LocalFence | None,
) -> None:
    guarded = Guard(LIMITS, area).apply(intent, position, velocity, age_s, others)
    assert guarded.setpoint == VelocityTarget(STILL)
    assert len(guarded.held_by) == 1


def star(
    corners: int, chance: random.Random, nearest_m: float, farthest_m: float
) -> list[tuple[float, float]]:
    """A simple polygon about the origin, mostly concave, of either winding."""
    angles_rad = sorted(chance.uniform(0.0, 2.0 * math.pi) for _ in range(corners))
    reach_m = [chance.uniform(nearest_m, farthest_m) for _ in range(corners)]
    points = [(r * math.cos(a), r * math.sin(a)) for a, r in zip(angles_rad, reach_m, strict=True)]
    return points[:: chance.choice((1, -1))]


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_no_fence_of_any_shape_is_crossed(seed: int) -> None:
    """Concave inclusion polygons with holes: exclusion polygons and circles, wherever they happen to lie."""
    chance = random.Random(seed)

    def corners(points: list[tuple[float, float]], north_m: float, east_m: float) -> tuple[Vertex, ...]:
        places = [FRAME.to_geodetic((n + north_m, e + east_m, 0.0)) for n, e in points]
        return tuple((place.latitude_deg, place.longitude_deg) for place in places)

    def anywhere() -> tuple[float, float]:
        return chance.uniform(-50.0, 50.0), chance.uniform(-50.0, 50.0)

    round_ones = [FRAME.to_geodetic((*anywhere(), 0.0)) for _ in range(chance.randint(0, 2))]
    geofence = Geofence(
        inclusion=(corners(star(chance.randint(4, 14), chance, 15.0, 90.0), 0.0, 0.0),),
        exclusion=tuple(
            corners(star(chance.randint(3, 7), chance, 3.0, 15.0), *anywhere())
            for _ in range(chance.randint(0, 3))
        ),
        exclusion_circles=tuple(
            Circle(place.latitude_deg, place.longitude_deg, chance.uniform(3.0, 15.0)) for place in round_ones
        ),
    )
    assume(not geofence.problems())
    area = LocalFence(FRAME, geofence)
    start = area.nearest_allowed(*anywhere(), LIMITS.fence_margin_m)
    assume(area.clearance_m(*start) > LIMITS.fence_margin_m - 0.01)
    drone = Drone((*start, -10.0), area=area)
    for leg in range(8):
        place = (chance.uniform(-150.0, 150.0), chance.uniform(-150.0, 150.0), chance.uniform(-80.0, 5.0))
        wish: Intent = GoTo(place) if leg % 2 else Velocity((place[0] / 15.0, place[1] / 15.0, 0.0))
        for _ in range(30):
            drone.step(wish)
            assert area.contains(drone.position[0], drone.position[1])


@settings(max_examples=150, deadline=None)
@given(
    intent=st.tuples(*[st.floats(-200.0, 200.0)] * 3),
    as_velocity=st.booleans(),
    start=st.tuples(st.floats(-40.0, 40.0), st.floats(-40.0, 40.0)),
)
def test_never_over_fence_band_or_speed(
    intent: Vector3, as_velocity: bool, start: tuple[float, float]
) -> None:
    drone = Drone((*start, -10.0), area=SQUARE)
    wish: Intent = Velocity(intent) if as_velocity else GoTo(intent)
    for _ in range(300):
        drone.step(wish)
        assert SQUARE.contains(drone.position[0], drone.position[1])
        assert LIMITS.floor_above_home_m - 0.5 < -drone.position[2] < LIMITS.ceiling_above_home_m + 0.5
        assert math.hypot(drone.velocity[0], drone.velocity[1]) < LIMITS.speed_mps + 0.01
        assert -LIMITS.climb_mps - 0.01 < drone.velocity[2] < LIMITS.descent_mps + 0.01


@pytest.mark.parametrize("target", [(50.0, 40.0), (50.0, 0.0), (0.0, 0.0), (300.0, -300.0)])
def test_a_concave_fence_holds(target: tuple[float, float]) -> None:
    drone = Drone((40.0, -40.0, -10.0), area=U_SHAPE)
    for _ in range(600):
        drone.step(GoTo((*target, -10.0)))
        assert U_SHAPE.contains(drone.position[0], drone.position[1])


def test_a_drone_blown_over_the_fence_comes_back() -> None:
    drone = Drone((0.0, 55.0, -10.0), area=SQUARE)
    for _ in range(200):
        drone.step(Hold())
    assert SQUARE.clearance_m(drone.position[0], drone.position[1]) > 0.8 * LIMITS.fence_margin_m


@settings(max_examples=100, deadline=None)
@given(
    bearing_rad=st.floats(0.0, 6.3),
    offset_m=st.floats(-3.0, 3.0),
    height_m=st.floats(-3.0, 3.0),
    distance_m=st.floats(15.0, 60.0),
)
def test_two_drones_that_swap_places_never_meet(
    bearing_rad: float, offset_m: float, height_m: float, distance_m: float
) -> None:
    north, east = math.cos(bearing_rad), math.sin(bearing_rad)
    a: Vector3 = (0.0, 0.0, -20.0)
    b: Vector3 = (
        distance_m * north - offset_m * east,
        distance_m * east + offset_m * north,
        -20.0 + height_m,
    )
    one, two = Drone(a), Drone(b)
    for _ in range(600):
        seen_one, seen_two = neighbour(one.position, one.velocity), neighbour(two.position, two.velocity)
        one.step(GoTo(b), (seen_two,))
        two.step(GoTo(a), (seen_one,))
        assert math.dist(one.position, two.position) > LIMITS.separation_m


def test_two_drones_that_swap_places_get_there() -> None:
    a: Vector3 = (0.0, 0.0, -20.0)
    b: Vector3 = (40.0, 0.0, -20.0)
    one, two = Drone(a), Drone(b)
    for _ in range(900):
        seen_one, seen_two = neighbour(one.position, one.velocity), neighbour(two.position, two.velocity)
        one.step(GoTo(b), (seen_two,))
        two.step(GoTo(a), (seen_one,))
    assert math.dist(one.position, b) < 1.0
    assert math.dist(two.position, a) < 1.0


@settings(max_examples=80, deadline=None)
@given(st.lists(st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0)), min_size=2, max_size=6))
def test_a_crowd_of_silent_obstacles_is_not_flown_into(places: list[tuple[float, float]]) -> None:
    """A peer that has said nothing for a minute stays where it was last heard."""
    obstacles = tuple(neighbour((n, e, -10.0), STILL, 60.0) for n, e in places)
    assume(all(math.hypot(n + 30.0, e) > 8.0 for n, e in places))
    drone = Drone((-30.0, 0.0, -10.0))
    for _ in range(300):
        drone.step(GoTo((30.0, 0.0, -10.0)), obstacles)
        for n, e in places:
            assert math.dist(drone.position, (n, e, -10.0)) > LIMITS.separation_m


def test_a_drone_that_fell_silent_in_motion_may_be_anywhere_on_its_way() -> None:
    """Last heard 60 s ago flying north at 5 m/s: it came to rest somewhere between 0 and 20 m further."""
    coasting = neighbour((0.0, 0.0, -10.0), (5.0, 0.0, 0.0), 60.0)
    drone = Drone((12.0, -30.0, -10.0))
    for _ in range(200):
        drone.step(GoTo((12.0, 30.0, -10.0)), (coasting,))
        for along_m in range(21):
            assert math.dist(drone.position, (along_m, 0.0, -10.0)) > LIMITS.separation_m


def test_drones_on_the_ground_are_no_obstacles() -> None:
    parked = msgspec.structs.replace(neighbour((2.0, 0.0, 0.0)), airborne=False)
    drone = Drone((0.0, 0.0, -3.0))
    assert drone.step(GoTo((0.0, 0.0, -10.0)), (parked,)) == ()


def test_the_guard_says_what_held_it_back() -> None:
    drone = Drone((0.0, 0.0, -10.0), area=SQUARE)
    assert "the target lies outside the geofence" in drone.step(GoTo((80.0, 0.0, -10.0)))
    assert drone.step(GoTo((20.0, 0.0, -10.0)), (neighbour((4.5, 0.0, -10.0)),)) == (
        "kept apart from drone 9",
    )
