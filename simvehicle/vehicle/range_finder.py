"""A range finder that looks around: the distance to the nearest obstacle in each of its beams."""

from __future__ import annotations

import math
from typing import Annotated, Final

import msgspec
import numpy as np
from msgspec import Meta

from mission.geometry.frames import Vector3
from simvehicle.world.fields import ObstacleField
from simvehicle.world.obstacles import Obstacles

_STREAM: Final = 0xD1
"""Of the random numbers."""
_LOOKED_UP_M: Final = 10.0
"""A vehicle that has moved so far looks anew which obstacles are near."""


class RangeFinderConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    beams: Annotated[int, Meta(ge=1, le=72)] = 36
    """All around, each as wide as they are apart; the first looks forward."""
    max_range_m: Annotated[float, Meta(ge=1.0, le=600.0)] = 25.0
    min_range_m: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.2
    rate_hz: Annotated[float, Meta(ge=0.5, le=50.0)] = 5.0
    noise_sd_m: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.05


class RangeFinder:
    """One vehicle's. It sees obstacles, no vehicles and no ground; it is taken to look horizontally."""

    def __init__(
        self, config: RangeFinderConfig, obstacles: ObstacleField, *, system: int, seed: int
    ) -> None:
        self.config = config
        self.silent = False
        self.lies_m = 0.0
        """So much farther away than they are it sees things."""
        self._all = obstacles if isinstance(obstacles, Obstacles) else None
        self._near = self._all
        self._looked_up_at: Vector3 | None = None
        self._rng = np.random.default_rng([seed & 0xFFFFFFFF, system, _STREAM])

    def measure(self, position_ned_m: Vector3, yaw_rad: float) -> list[float]:
        """Metres to the nearest obstacle in each beam, clockwise from the vehicle's nose; infinite where none is
        within the largest range."""
        config = self.config
        near = self._around(position_ned_m)
        if near is None or not near.count:
            return [math.inf] * config.beams
        # In its middle and at its edges: what is narrower than half a beam may be missed, as by a real one.
        rays = 2 * config.beams
        bearings_rad = np.array([yaw_rad + ray * math.tau / rays for ray in range(rays)])
        seen_m = near.ranges_around_m(position_ned_m, bearings_rad).tolist()
        noise_m = self._rng.normal(0.0, config.noise_sd_m, config.beams).tolist()
        found = []
        for beam in range(config.beams):
            range_m = min(seen_m[2 * beam - 1], seen_m[2 * beam], seen_m[2 * beam + 1])
            range_m += noise_m[beam] + self.lies_m
            found.append(math.inf if range_m > config.max_range_m else max(range_m, 0.0))
        return found

    def _around(self, position: Vector3) -> Obstacles | None:
        if self._all is None:
            return None
        at = self._looked_up_at
        if at is None or math.dist(at[:2], position[:2]) > _LOOKED_UP_M:
            self._looked_up_at = position
            self._near = self._all.near(position[:2], self.config.max_range_m + _LOOKED_UP_M)
        return self._near
