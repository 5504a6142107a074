"""Where a drone that flies on its own account can stay: a slot may lie in an obstacle, or be hovered in."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from flightstack.config import LimitsConfig
from flightstack.flight.guard import SEPARATION_MARGIN_M
from flightstack.flight.guidance import PLACES_BESIDE_M, column_free
from flightstack.flight.way_around import RIM_M
from mission.geometry.frames import Vector3
from mission.geometry.geofence import LocalFence, LocalPoint
from mission.geometry.known_obstacles import LocalObstacles
from mission.strategies.contract import Neighbour

_SWAYS_M: Final = 0.6
"""A hovering vehicle moves about by so much: a place beside it is chosen so much farther away, and then kept."""


class FreePlaces:
    """The places of one survey. The guard's way ends at the same ones."""

    def __init__(
        self, limits: LimitsConfig, fence: LocalFence | None, obstacles: LocalObstacles | None
    ) -> None:
        self._fence_margin_m = limits.fence_margin_m
        self._fence = fence
        self._obstacles = obstacles
        self._separation_m = limits.separation_m
        self._beside: LocalPoint | None = None
        """The chosen place relative to the slot, while one hovers there."""

    def to_come_down_at(self, slot_ned_m: Vector3, neighbours: Sequence[Neighbour]) -> Vector3:
        """The slot, or the nearest place at its height that is beside everybody who hovers over, in or under it and
        makes way for nobody: nobody comes down on one that may climb."""
        slot = self.at(slot_ned_m)
        least_m = self._separation_m + SEPARATION_MARGIN_M
        if column_free(slot, neighbours, least_m):
            self._beside = None
            return slot
        if self._beside is not None:
            chosen = (slot[0] + self._beside[0], slot[1] + self._beside[1], slot[2])
            if self._is_free(chosen, neighbours, least_m):
                return chosen
        for beside_m in PLACES_BESIDE_M:
            place = (slot[0] + beside_m[0], slot[1] + beside_m[1], slot[2])
            if self._is_free(place, neighbours, least_m + _SWAYS_M):
                self._beside = beside_m
                return place
        return slot

    def _is_free(self, place: Vector3, neighbours: Sequence[Neighbour], room_m: float) -> bool:
        if self._fence is not None and not self._fence.keeps(place[0], place[1], self._fence_margin_m):
            return False
        return self.at(place) == place and column_free(place, neighbours, room_m)

    def at(self, place_ned_m: Vector3) -> Vector3:
        """The place, or the nearest at its height that keeps clear of what stands there."""
        return (*self.over(place_ned_m, place_ned_m[2]), place_ned_m[2])

    def over(self, place_ned_m: Vector3, down_m: float) -> LocalPoint:
        """The same for another height: north and east."""
        place_m = (place_ned_m[0], place_ned_m[1])
        if self._obstacles is None:
            return place_m
        return self._obstacles.nearest_free(place_m, -down_m, RIM_M, self._fence, self._fence_margin_m)
