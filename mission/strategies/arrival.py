"""When a drone that was sent to a point has got there and may take its reading."""

from __future__ import annotations

import math

from mission.geometry.frames import Vector3

_BLOCKED_MPS = 0.3
"""A drone that is slower than this far from its target is being held back."""

_NEARER_M = 0.5
"""What counts as having come nearer."""

_CIRCLES = 4.0
"""A drone that moves has so many times `blocked_s` to come nearer: the way around an obstacle leads away first."""


class Arrival:
    """Watches one flight to a target: arrived after `settle_s` near it and slow.

    A drone that the guard holds back (at a fence, behind a neighbour) would never get near. After standing still
    for `blocked_s`, or moving for four times as long without coming nearer (the guard steps aside before a vehicle
    that does not make way, for ever where that hovers at the target), it counts as arrived where it is: the swarm
    must not wait for it, and its reading carries the position where it was really taken.
    """

    def __init__(self, *, arrival_m: float, settle_mps: float, settle_s: float, blocked_s: float) -> None:
        self._arrival_m = arrival_m
        self._settle_mps = settle_mps
        self._settle_s = settle_s
        self._blocked_s = blocked_s
        self._target: Vector3 | None = None
        self._near_since_s = math.inf
        self._still_since_s = math.inf
        self._nearest_m = math.inf
        self._nearest_s = math.inf
        """When it last came nearer to the present target than it had been."""
        self.arrived_s = math.inf
        """When the drone arrived at the present target, infinite before."""

    def step(
        self, now_s: float, position_ned_m: Vector3, velocity_ned_mps: Vector3, target_ned_m: Vector3
    ) -> bool:
        """Whether the drone has arrived; once it has, it stays so until the target changes."""
        if target_ned_m != self._target:
            self._target = target_ned_m
            self.interrupt()
        speed_mps = math.hypot(*velocity_ned_mps)
        distance_m = math.dist(position_ned_m, target_ned_m)
        if distance_m < self._nearest_m - _NEARER_M:
            self._nearest_m, self._nearest_s = distance_m, now_s
        near = distance_m <= self._arrival_m and speed_mps <= self._settle_mps
        self._near_since_s = min(self._near_since_s, now_s) if near else math.inf
        self._still_since_s = min(self._still_since_s, now_s) if speed_mps <= _BLOCKED_MPS else math.inf
        settled = now_s - self._near_since_s >= self._settle_s
        blocked = (
            now_s - self._still_since_s >= self._blocked_s
            or now_s - self._nearest_s >= _CIRCLES * self._blocked_s
        )
        if (settled or blocked) and math.isinf(self.arrived_s):
            self.arrived_s = now_s
        return not math.isinf(self.arrived_s)

    def interrupt(self) -> None:
        """Something else flew the drone meanwhile: it has to arrive anew."""
        self._near_since_s = math.inf
        self._still_since_s = math.inf
        self._nearest_m = self._nearest_s = math.inf
        self.arrived_s = math.inf
