"""The wind from the vehicle's own tilt: what it leans, and does not accelerate by, the air pushes."""

from __future__ import annotations

import math

from mission.geometry.frames import Vector3
from sensors.filters.airframe import GRAVITY_MPS2, VehicleMotion, thrust_ned_mps2
from sensors.filters.wind_config import WindFilterConfig


class TiltWindow:
    """The airspeed from tilt and drag, averaged over a window at whose ends the velocity is compared."""

    def __init__(self, config: WindFilterConfig) -> None:
        self._config = config
        self._start: tuple[float, Vector3] | None = None
        self._sum = [0.0, 0.0, 0.0, 0.0]
        self._count = 0
        self._airspeed_mps = 0.0

    def clear(self) -> None:
        self._start = None

    def add(self, now_s: float, motion: VehicleMotion) -> tuple[tuple[float, float], float] | None:
        """The wind (north, east, m/s) over the window that ends now and its variance; None while it is
        open."""
        drag = self._config.drag
        if not motion.airborne or drag is None:
            self._start = None
            return None
        velocity = motion.velocity_ned_mps
        if self._start is None:
            self._start, self._count = (now_s, velocity), 0
            self._sum = [0.0, 0.0, 0.0, 0.0]
            return None
        down_mps2 = motion.acceleration_ned_mps2[2] if motion.acceleration_ned_mps2 else 0.0
        north, east = thrust_ned_mps2(motion.attitude_rad, down_mps2)
        for i, value in enumerate((north, east, velocity[0], velocity[1])):
            self._sum[i] += value
        self._count += 1
        since_s, before = self._start
        window_s = now_s - since_s
        if window_s < self._config.drag_window_s - 0.01:
            return None
        self._start, count = (now_s, velocity), self._count
        thrust_n, thrust_e, speed_n, speed_e = (total / count for total in self._sum)
        self._count = 0
        self._sum = [0.0, 0.0, 0.0, 0.0]
        if window_s > 3.0 * self._config.drag_window_s or count < 3:
            return None  # the autopilot was silent in between
        # a = f - drag(u), u = v - wind  =>  wind = v - u, with u against the drag
        drag_n = (velocity[0] - before[0]) / window_s - thrust_n
        drag_e = (velocity[1] - before[1]) / window_s - thrust_e
        size = math.hypot(drag_n, drag_e)
        self._airspeed_mps = drag.airspeed_mps(size)
        ratio = self._airspeed_mps / size if size > 1e-9 else 0.0
        return (speed_n + ratio * drag_n, speed_e + ratio * drag_e), self._variance(window_s, count)

    def _variance(self, window_s: float, count: int) -> float:
        config = self._config
        assert config.drag is not None  # noqa: S101
        slope = config.drag.slope_per_s(self._airspeed_mps)
        # A window's last velocity is the next one's first: over many windows their errors cancel but for the
        # ends.
        ends = (config.velocity_sd_mps / window_s) ** 2
        tilts = (GRAVITY_MPS2 * config.attitude_sd_rad) ** 2 / count
        # The gust moves on within the window: what is measured is its mean, half a window old.
        gust = config.gust_sd_mps**2 * 2.0 / 3.0 * window_s / config.gust_time_s
        return (ends + tilts) / slope**2 + gust

    def lasting_variance(self) -> float:
        """Per axis: the horizon's error and the drag coefficient's."""
        config = self._config
        assert config.drag is not None  # noqa: S101
        slope = config.drag.slope_per_s(self._airspeed_mps)
        level = GRAVITY_MPS2 * config.level_sd_rad / slope
        scale = config.drag_scale_sd * self._airspeed_mps
        return level * level + 0.5 * scale * scale
