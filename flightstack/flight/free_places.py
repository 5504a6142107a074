"""Where a drone that flies on its own account can stay: a slot may lie in an obstacle."""

from __future__ import annotations

from flightstack.config import LimitsConfig
from flightstack.flight.way_around import RIM_M
from mission.geometry.frames import Vector3
from mission.geometry.geofence import LocalFence, LocalPoint
from mission.geometry.known_obstacles import LocalObstacles


class FreePlaces:
    """The places of one survey. The guard's way ends at the same ones."""

    def __init__(
        self, limits: LimitsConfig, fence: LocalFence | None, obstacles: LocalObstacles | None
    ) -> None:
        self._fence_margin_m = limits.fence_margin_m
        self._fence = fence
        self._obstacles = obstacles

    def at(self, place_ned_m: Vector3) -> Vector3:
        """The place, or the nearest at its height that keeps clear of what stands there."""
        return (*self.over(place_ned_m, place_ned_m[2]), place_ned_m[2])

    def over(self, place_ned_m: Vector3, down_m: float) -> LocalPoint:
        """The same for another height: north and east."""
        place_m = (place_ned_m[0], place_ned_m[1])
        if self._obstacles is None:
            return place_m
        return self._obstacles.nearest_free(place_m, -down_m, RIM_M, self._fence, self._fence_margin_m)
