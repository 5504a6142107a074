"""A drone's way home: where it comes down, when it is over home, when nothing lets it through."""

from __future__ import annotations

import msgspec

from flightstack.autopilot import AutopilotSession, VehicleReport
from flightstack.config import AutopilotConfig, LimitsConfig
from flightstack.flight.guidance import horizontal_m
from flightstack.flight.homecoming import (
    CHOOSE_EVERY_S,
    LANDING_HEIGHT_M,
    OTHERS_DOWN_S,
    STUCK_S,
    Homecoming,
)
from mission.geometry.frames import Geodetic, LocalFrame, Vector3
from mission.strategies.contract import GoTo, Hold, Neighbour

LAYER_DOWN_M = -20.0
HOME: Vector3 = (0.0, 0.0, 0.0)
REPORT = AutopilotSession(
    1, LocalFrame(Geodetic(-5.06, 151.3, 500.0)), AutopilotConfig(link="udpin:127.0.0.1:1")
).report


def at(position: Vector3 | None, home: Vector3 | None = HOME) -> VehicleReport:
    return msgspec.structs.replace(REPORT, position_ned_m=position, home_ned_m=home)


def orphan(drone: int, north_m: float, east_m: float) -> Neighbour:
    return Neighbour(drone, (north_m, east_m, -10.0), (0.0, 0.0, 0.0), 0.2, True, adrift=True)


def landing_of(homecoming: Homecoming) -> Vector3:
    """The place itself, as the way from right above it tells."""
    for north_m in range(-30, 31):
        for east_m in range(-30, 31):
            above = (float(north_m), float(east_m), LAYER_DOWN_M)
            intent = homecoming.intent(above)
            assert isinstance(intent, GoTo)
            north, east, down = intent.position_ned_m
            if (north, east) == above[:2]:
                return north, east, down + LANDING_HEIGHT_M
    raise AssertionError("no landing place")


def test_the_way_home_is_known_when_home_is() -> None:
    homecoming = Homecoming(LimitsConfig(), None, LAYER_DOWN_M)
    homecoming.step(0.0, at((40.0, 0.0, -10.0), None), (), returning=True)
    assert homecoming.intent((40.0, 0.0, -10.0)) == Hold()
    homecoming.step(0.1, at((40.0, 0.0, -10.0)), (), returning=True)
    assert homecoming.intent((40.0, 0.0, -10.0)) == GoTo((40.0, 0.0, LAYER_DOWN_M))
    assert not homecoming.over_home
    homecoming.step(0.2, at((0.5, 0.0, -4.2)), (), returning=True)
    assert homecoming.over_home


def test_a_place_beside_home_is_kept_until_it_is_blocked_itself() -> None:
    homecoming = Homecoming(LimitsConfig(), None, LAYER_DOWN_M)
    homecoming.step(0.0, at((40.0, 0.0, -20.0)), (orphan(2, 1.0, 0.0),), returning=True)
    first = landing_of(homecoming)
    assert horizontal_m(first, (1.0, 0.0, 0.0)) >= 7.5
    homecoming.step(9.0, at((30.0, 0.0, -20.0)), (), returning=True)
    assert landing_of(homecoming) == first  # the orphan has gone, but changing one's mind costs battery
    homecoming.step(18.0, at((30.0, 0.0, -20.0)), (orphan(2, *first[:2]),), returning=True)
    assert horizontal_m(landing_of(homecoming), first) >= 7.5
    assert horizontal_m(landing_of(homecoming), HOME) < 3.0


def test_where_everything_is_taken_it_looks_again_now_and_then_only() -> None:
    """Looking takes as long as a tick; and home stays the best guess."""
    homecoming = Homecoming(LimitsConfig(), None, LAYER_DOWN_M)
    crowd = tuple(orphan(2 + 5 * i + j, 10.0 * i - 20.0, 10.0 * j - 20.0) for i in range(5) for j in range(5))
    homecoming.step(0.0, at((40.0, 0.0, -20.0)), crowd, returning=True)
    assert landing_of(homecoming) == HOME
    homecoming.step(0.5 * CHOOSE_EVERY_S, at((40.0, 0.0, -20.0)), crowd[12:13], returning=True)
    assert landing_of(homecoming) == HOME
    homecoming.step(CHOOSE_EVERY_S, at((40.0, 0.0, -20.0)), crowd[12:13], returning=True)
    assert horizontal_m(landing_of(homecoming), HOME) >= 7.5


def test_a_minute_without_getting_nearer_is_stuck_and_a_descent_is_no_standstill() -> None:
    homecoming = Homecoming(LimitsConfig(), None, LAYER_DOWN_M)
    homecoming.step(0.0, at((40.0, 0.0, -20.0)), (), returning=True)
    homecoming.step(STUCK_S - 1.0, at((40.0, 0.0, -20.0)), (), returning=True)
    assert not homecoming.stuck
    homecoming.step(STUCK_S + 1.0, at((40.0, 0.0, -20.0)), (), returning=True)
    assert homecoming.stuck
    for tick in range(100):
        homecoming.step(100.0 + tick, at((0.0, 0.0, -60.0 + 0.6 * tick)), (), returning=True)
        assert not homecoming.stuck
    homecoming.step(300.0, at((0.0, 0.0, -0.6)), (), returning=False)
    assert not homecoming.stuck


def test_a_place_beside_home_waits_over_home_until_those_who_fell_silent_are_down() -> None:
    """Over homes nobody passes; beside them one that is not heard may cross."""
    homecoming = Homecoming(LimitsConfig(), None, LAYER_DOWN_M)
    silent = Neighbour(3, (80.0, 0.0, -10.0), (0.0, 0.0, 0.0), 50.0, True, adrift=True)
    blocked = (orphan(2, 1.0, 0.0), silent)
    here = (0.2, 0.0, LAYER_DOWN_M)
    for now_s in (0.0, STUCK_S, 2.0 * STUCK_S):
        homecoming.step(now_s, at(here), blocked, returning=True)
        assert homecoming.intent(here) == GoTo((0.0, 0.0, LAYER_DOWN_M))
        assert not homecoming.stuck, "it waits, and that has an end"
    down = msgspec.structs.replace(silent, age_s=OTHERS_DOWN_S + 1.0)
    homecoming.step(130.0, at(here), (orphan(2, 1.0, 0.0), down), returning=True)
    intent = homecoming.intent(here)
    assert isinstance(intent, GoTo)
    assert horizontal_m(intent.position_ned_m, HOME) > 7.0


def test_a_place_beside_home_is_on_the_own_side_of_the_others_homes() -> None:
    homecoming = Homecoming(LimitsConfig(), None, LAYER_DOWN_M)
    coming = Neighbour(3, (80.0, 0.0, -25.0), (-3.0, 0.0, 0.0), 0.2, True, home_ned_m=(6.0, 0.0, 0.0))
    homecoming.step(0.0, at((40.0, 0.0, -20.0)), (orphan(2, -1.0, 0.0), coming), returning=True)
    place = landing_of(homecoming)
    assert place != HOME
    assert place[0] <= 1.0, "half of the separation from the middle between the homes"


def test_who_is_not_heard_blocks_home_only_where_it_would_be_hit() -> None:
    """Alive, it keeps out of the column over home, and out of no other place; its agent dead, it hovers on."""
    homecoming = Homecoming(LimitsConfig(), None, LAYER_DOWN_M)
    silent = Neighbour(3, (4.2, 0.0, -10.0), (0.0, 0.0, 0.0), 50.0, True, adrift=True)
    here = (-1.0, 0.0, LAYER_DOWN_M)
    homecoming.step(0.0, at(here), (silent,), returning=True)
    intent = homecoming.intent(here)
    assert isinstance(intent, GoTo)
    assert intent.position_ned_m[2] == -LANDING_HEIGHT_M, "down at once"
    assert horizontal_m(intent.position_ned_m, HOME) <= 1.0 + 1e-6
    assert horizontal_m(intent.position_ned_m, silent.position_ned_m) >= 5.0
    in_the_way = msgspec.structs.replace(silent, position_ned_m=(2.0, 0.0, -10.0), age_s=OTHERS_DOWN_S + 1.0)
    homecoming.step(9.0, at(here), (in_the_way,), returning=True)
    assert horizontal_m(landing_of(homecoming), in_the_way.position_ned_m) >= 7.5
