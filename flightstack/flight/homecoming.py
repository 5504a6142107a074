"""How a drone comes home."""

from __future__ import annotations

import math

from flightstack.autopilot import VehicleReport
from flightstack.config import LimitsConfig
from flightstack.flight.columns import in_own_cell
from flightstack.flight.guard import AGEING_LIMIT_M, SEPARATION_MARGIN_M
from flightstack.flight.guidance import CORRIDOR_M, column_free, horizontal_m, landing_point, over_the_top
from flightstack.swarm.peers import FRESH_S
from mission.geometry.frames import Vector3
from mission.geometry.geofence import LocalFence
from mission.geometry.known_obstacles import LocalObstacles
from mission.strategies.contract import GoTo, Hold, Intent, Neighbour

LANDING_HEIGHT_M = 4.0
"""Height over home at which the autopilot's own landing takes over."""

STUCK_S = 60.0
"""How long a returning drone may come no nearer to its home before it lands where it is."""

CHOOSE_EVERY_S = 2.0
"""How often another landing place is looked for: with a crowd over home it takes the time of a tick."""


OTHERS_DOWN_S = 120.0
"""Who falls silent and goes home is down after so long. Those that are not may cross anywhere but over a home."""


AT_HOME_M = 1.0
"""Nearer than this to home is still home for the others, who keep the column over it free."""

_AT_HOME_M = [(0.0, 0.0)] + [
    (AT_HOME_M * math.cos(eighth * math.tau / 8.0), AT_HOME_M * math.sin(eighth * math.tau / 8.0))
    for eighth in range(8)
]


class Homecoming:
    """One drone's way home: over the others in its own layer, down to home or to a free place beside it."""

    def __init__(
        self,
        limits: LimitsConfig,
        fence: LocalFence | None,
        layer_down_m: float,
        obstacles: LocalObstacles | None = None,
    ) -> None:
        self._limits = limits
        self._fence = fence
        self._obstacles = obstacles
        self._layer_down_m = layer_down_m
        self._landing_ned_m: Vector3 | None = None
        """Where this drone comes down: home, unless somebody hovers there who will not make way."""
        self._choose_after_s = -math.inf
        self._waits_over_ned_m: Vector3 | None = None
        """Home, while a place beside it has to wait: there nobody keeps out of the way."""
        self._nearest: tuple[float, float] | None = None
        """(how far, since when) while returning."""
        self.over_home = False
        """Above the landing place and low enough for the autopilot's landing."""
        self.stuck = False
        """Returning, and no nearer to home for a minute."""

    def step(
        self, now_s: float, vehicle: VehicleReport, neighbours: tuple[Neighbour, ...], *, returning: bool
    ) -> None:
        self._choose_landing(now_s, vehicle.home_ned_m, neighbours, returning=returning)
        unheard = any(n.airborne and n.adrift and FRESH_S < n.age_s < OTHERS_DOWN_S for n in neighbours)
        beside = not _is_home(self._landing_ned_m, vehicle.home_ned_m)
        self._waits_over_ned_m = vehicle.home_ned_m if returning and beside and unheard else None
        position, home = vehicle.position_ned_m, self._landing_ned_m
        self.over_home = (
            position is not None
            and home is not None
            and horizontal_m(position, home) < CORRIDOR_M
            and home[2] - position[2] < LANDING_HEIGHT_M + 0.5
        )
        if not returning or position is None or home is None or self._waits_over_ned_m is not None:
            self._nearest = None
            self.stuck = False
            return
        distance_m = horizontal_m(position, home)
        # The climb to the layer and the descent at home are progress too, though not horizontal.
        way_m = distance_m if distance_m > CORRIDOR_M else home[2] - position[2] - 1000.0
        if self._nearest is None or way_m < self._nearest[0] - 0.5:
            self._nearest = (way_m, now_s)
        self.stuck = now_s - self._nearest[1] > STUCK_S

    def intent(self, position_ned_m: Vector3) -> Intent:
        """The way from here; a hold while home is not known."""
        home = self._landing_ned_m
        if home is None:
            return Hold()
        if self._waits_over_ned_m is not None:
            north_m, east_m, _ = self._waits_over_ned_m
            over = (north_m, east_m, self._layer_down_m)
        else:
            over = (home[0], home[1], home[2] - LANDING_HEIGHT_M)
        return GoTo(over_the_top(position_ned_m, over, self._layer_down_m))

    def _choose_landing(
        self, now_s: float, home: Vector3 | None, neighbours: tuple[Neighbour, ...], *, returning: bool
    ) -> None:
        """Home, or a place beside it; chosen anew only when the one chosen before is blocked."""
        if home is None or not returning:
            self._landing_ned_m = home
            return
        limits, fence, obstacles = self._limits, self._fence, self._obstacles
        least_m = limits.separation_m + SEPARATION_MARGIN_M
        room_m = least_m + AGEING_LIMIT_M + CORRIDOR_M
        chosen = self._landing_ned_m or home
        heard = [n for n in neighbours if n.age_s <= FRESH_S]
        unheard = [n for n in neighbours if n.age_s > FRESH_S]

        def free(place: Vector3) -> bool:
            """Home is what those keep free who are not heard: there they are in the way only where they hover."""
            room_unheard_m = least_m if _is_home(place, home) else room_m
            return column_free(place, heard, room_m) and column_free(place, unheard, room_unheard_m)

        if now_s < self._choose_after_s or free(chosen):
            self._landing_ned_m = chosen
            return

        others = [n.home_ned_m for n in neighbours if n.airborne and n.home_ned_m is not None]

        def allowed(north_m: float, east_m: float) -> bool:
            place = (north_m, east_m)
            if fence is not None and not fence.path_clear(place, place, limits.fence_margin_m):
                return False
            if obstacles is not None and not obstacles.is_free(north_m, east_m, 0.0):
                return False
            point = (north_m, east_m, home[2])
            return all(in_own_cell(point, home, other, limits.separation_m) for other in others)

        self._choose_after_s = now_s + CHOOSE_EVERY_S
        close = ((home[0] + north_m, home[1] + east_m, home[2]) for north_m, east_m in _AT_HOME_M)
        at_home = next((place for place in close if free(place)), None)
        self._landing_ned_m = at_home or landing_point(home, neighbours, room_m, allowed)


def _is_home(place: Vector3 | None, home: Vector3 | None) -> bool:
    if place is None or home is None:
        return True  # nothing was chosen
    return horizontal_m(place, home) < AT_HOME_M + 0.1
