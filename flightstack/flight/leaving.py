"""Why a drone leaves the survey by itself, or does not begin one."""

from __future__ import annotations

import msgspec

from flightstack.config import LimitsConfig
from flightstack.flight.launch_point import unfit
from flightstack.swarm.parting import GOES_HOME_BECAUSE, Part
from mission.geometry.frames import Vector3
from mission.geometry.geofence import LocalFence
from mission.geometry.known_obstacles import LocalObstacles

HASTE_SHARE = 0.8
"""Of `limits.battery_return_fraction`: with less than that a drone waits for nobody before it goes home."""

BATTERY_SAG_S = 3.0
"""How long the battery must be low: a sag under load is not an empty battery."""


class LeavingFacts(msgspec.Struct, frozen=True, kw_only=True):
    battery_fraction: float | None = None
    ground_heard_s: float | None = None
    """When the ground station was heard last, on the drone's clock; None: never."""
    armed: bool = False
    launch_ned_m: Vector3 | None = None
    """Where the drone stands, while it is on the ground and could be started."""
    strategy_failure: str = ""
    part: Part = Part.WHOLE


class Leaving:
    """One drone's reasons. `step` once a tick: some have to stand for a while."""

    def __init__(
        self,
        limits: LimitsConfig,
        fence: LocalFence | None,
        origin_amsl_m: float,
        obstacles: LocalObstacles | None = None,
    ) -> None:
        self._limits = limits
        self._fence = fence
        self._obstacles = obstacles
        self._origin_amsl_m = origin_amsl_m
        self._battery_low_since_s: float | None = None

    def step(self, now_s: float, facts: LeavingFacts) -> str:
        """Why the drone must return, or may not start; nothing if it can go on. Of several reasons the first."""
        battery = self._battery(now_s, facts.battery_fraction)
        if facts.launch_ned_m is not None:
            margin_m = self._limits.fence_margin_m
            reason = unfit(facts.launch_ned_m, self._fence, margin_m, self._origin_amsl_m, self._obstacles)
            if reason:
                return reason
        if facts.armed and facts.strategy_failure:
            return facts.strategy_failure
        if facts.armed and facts.part is Part.SMALLER:
            return GOES_HOME_BECAUSE
        return battery or self._ground(now_s, facts.ground_heard_s)

    def in_haste(self, battery_fraction: float | None) -> bool:
        """Whether the battery does not let it wait for its heir."""
        lowest = HASTE_SHARE * self._limits.battery_return_fraction
        return battery_fraction is not None and battery_fraction < lowest

    def _battery(self, now_s: float, fraction: float | None) -> str:
        lowest = self._limits.battery_return_fraction
        if fraction is None or fraction > lowest:
            self._battery_low_since_s = None
        elif self._battery_low_since_s is None:
            self._battery_low_since_s = now_s
        elif now_s - self._battery_low_since_s > BATTERY_SAG_S:
            return f"battery at {fraction:.0%}, below {lowest:.0%}"
        return ""

    def _ground(self, now_s: float, heard_s: float | None) -> str:
        limit_s = self._limits.ground_lost_s
        if limit_s is not None and heard_s is not None and now_s - heard_s > limit_s:
            return f"ground station silent for more than {limit_s:.0f} s"
        return ""
