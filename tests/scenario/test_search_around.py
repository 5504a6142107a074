"""Strategies and the guard together, where vehicles without agents hover in the way: every search comes to its end.

Drones are points that follow the guard's setpoints within their acceleration.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightstack.config import LimitsConfig
from flightstack.flight.guard import Guard, PositionTarget, VelocityTarget
from mission.geometry.frames import Vector3
from mission.strategies.contract import GoTo, Neighbour, Stage
from tests.scenario.test_search_points import (
    ACCELERATION_MPS2,
    ALTITUDE_M,
    TICK_S,
    Point,
    Swarm,
    error_m,
    plume_of,
    vector,
)

LIMITS = LimitsConfig()
STRATEGIES = ["locus", "mobs", "mobs-authors", "locus-hybrid", "locus-multi"]


class GuardedSwarm(Swarm):
    """Its drones fly by a guard, and keep clear of each other and of what hovers."""

    nearest_m = math.inf
    """The least distance between a drone and anything else that flies."""

    def hover(self, *places: tuple[float, float]) -> None:
        """Vehicles without agents at these places (north, east), as the ground station tells of them."""
        self.hovering = tuple(
            Neighbour(100 + k, (north, east, ALTITUDE_M), (0.0, 0.0, 0.0), 0.2, True, adrift=True)
            for k, (north, east) in enumerate(places)
        )
        for point in self.points.values():
            point.fly = self._flight(point)  # type: ignore[method-assign]

    def _flight(self, point: Point) -> Callable[[Vector3], None]:
        guard = Guard(LIMITS, None)

        def fly(target: Vector3) -> None:
            others = self.others(point)
            here = vector(point.position)
            match guard.apply(GoTo(target), here, vector(point.velocity), 0.0, others).setpoint:
                case VelocityTarget(velocity_ned_mps=wanted):
                    change = np.array(wanted) - point.velocity
                case PositionTarget(position_ned_m=place):
                    change = np.array(place) - point.position - point.velocity
            size = max(float(np.linalg.norm(change)), 1e-9)
            point.velocity += change * min(1.0, ACCELERATION_MPS2 * TICK_S / size)
            point.position += point.velocity * TICK_S
            here = vector(point.position)
            self.nearest_m = min(self.nearest_m, *(math.dist(here, o.position_ned_m) for o in others))

        return fly


def about(source: tuple[float, float], bearing_rad: float, away_m: float) -> tuple[float, float]:
    return source[0] + away_m * math.cos(bearing_rad), source[1] + away_m * math.sin(bearing_rad)


@pytest.mark.parametrize("seed", [2, 4, 8])
def test_a_source_beside_which_two_vehicles_hover_is_found(seed: int) -> None:
    """With seed 4 the root's waypoint once lay between the two: it stepped aside before them for ever."""
    plume = plume_of(seed)
    rng = np.random.default_rng(seed)
    bearing, away, other_bearing, other_away = rng.uniform(0.0, 1.0, 4) * (math.tau, 6.0, math.tau, 12.0)
    swarm = GuardedSwarm(5, plume, seed)
    places = [(bearing, away), (other_bearing, other_away)]
    swarm.hover(*(about(plume.source, float(b), float(a)) for b, a in places))
    swarm.run(900.0)
    assert error_m(swarm, plume) < 10.0  # nobody may come nearer than 5 m to where they hover
    assert swarm.nearest_m > LIMITS.separation_m


@pytest.mark.parametrize("strategy", STRATEGIES)
@settings(max_examples=3, deadline=None)
@given(
    st.integers(0, 50),
    st.lists(st.tuples(st.floats(0.0, math.tau), st.floats(0.0, 60.0)), min_size=1, max_size=6),
    st.sampled_from([0.0, 1.0]),
)
def test_wherever_vehicles_hover_every_strategy_comes_to_its_end(
    strategy: str, seed: int, where: list[tuple[float, float]], share: float
) -> None:
    """Some hover around the source, or (`share` 0: there is no plume) around the start."""
    plume = plume_of(seed)
    limit = {"search_radius_m": 60.0} if strategy == "locus" else {"search_limit_s": 300.0}
    swarm = GuardedSwarm(3, lambda position: share * plume(position), seed, strategy, **limit)
    centre = plume.source if share else (25.0, 25.0)
    starts = [vector(point.position)[:2] for point in swarm.points.values()]
    hovering = [about(centre, bearing, away) for bearing, away in where]
    swarm.hover(*(place for place in hovering if all(math.dist(place, start) > 6.0 for start in starts)))
    swarm.run(1500.0)
    assert swarm.order.stage in (Stage.FOUND, Stage.GIVE_UP)
    assert swarm.nearest_m > LIMITS.separation_m
