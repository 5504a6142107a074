"""The simulated wind: a steady mean and gusts, the same over the whole survey area."""

from __future__ import annotations

import math

import numpy as np

from mission.geometry.formation import FloatArray
from mission.geometry.frames import Vector3, wind_from
from simvehicle.world.world_config import WindConfig

_STEPS_PER_GUST = 25
"""Samples of the gust process per correlation time: between two of them it is drawn as a straight line."""
_CHUNK = 4096
_VERTICAL_SHARE = 0.5
"""Vertical gusts near the ground are about half as strong as horizontal ones (Stull 1988, surface layer)."""


class GustyWind:
    """Mean wind plus an Ornstein-Uhlenbeck process per axis: a pure function of the seed and the time.

    The process is sampled exactly (x[i+1] = x[i] e^(-dt/T) + s sqrt(1 - e^(-2 dt/T)) n[i]) on a fixed time
    grid that begins at 0 and grows as later times are asked for, so that the order of the questions does not
    matter. The standard deviation `gust_sd_mps` is that of each horizontal axis.
    """

    def __init__(self, config: WindConfig, seed: int) -> None:
        self.mean_ned_mps: Vector3 = wind_from(config.speed_mps, config.from_deg)
        self._step_s = config.gust_time_s / _STEPS_PER_GUST
        decay = math.exp(-1.0 / _STEPS_PER_GUST)
        self._decay = decay
        sd_mps = config.gust_sd_mps
        self.steady = sd_mps == 0.0
        axes_sd_mps = np.array([sd_mps, sd_mps, sd_mps * _VERTICAL_SHARE])
        self._kick_mps = axes_sd_mps * math.sqrt(1.0 - decay * decay)
        # A stream of its own, so that the wind stays the same when another part draws more or fewer numbers.
        self._rng = np.random.default_rng([seed & 0xFFFFFFFF, 0x3117D])
        self._last = self._rng.standard_normal(3) * axes_sd_mps
        north, east, down = self.mean_ned_mps
        first = self._last
        self._samples: list[Vector3] = [
            (north + float(first[0]), east + float(first[1]), down + float(first[2]))
        ]

    def wind_ned_mps(self, position_ned_m: Vector3, time_s: float) -> Vector3:  # noqa: ARG002 (uniform)
        """Velocity of the air (where it goes); times before 0 are answered as 0."""
        if self.steady:
            return self.mean_ned_mps
        place = max(0.0, time_s) / self._step_s
        index = int(place)
        while index + 1 >= len(self._samples):
            self._extend()
        share = place - index
        a, b = self._samples[index], self._samples[index + 1]
        return (
            a[0] + share * (b[0] - a[0]),
            a[1] + share * (b[1] - a[1]),
            a[2] + share * (b[2] - a[2]),
        )

    def winds_ned_mps(self, positions_ned_m: FloatArray, time_s: float) -> FloatArray:
        """`wind_ned_mps` at (n, 3) positions: the same at each."""
        return np.tile(self.wind_ned_mps((0.0, 0.0, 0.0), time_s), (len(positions_ned_m), 1))

    def _extend(self) -> None:
        north, east, down = self.mean_ned_mps
        kicks = self._rng.standard_normal((_CHUNK, 3)) * self._kick_mps
        x, y, z = (float(v) for v in self._last)
        decay = self._decay
        for kick_x, kick_y, kick_z in kicks.tolist():
            x, y, z = x * decay + kick_x, y * decay + kick_y, z * decay + kick_z
            self._samples.append((north + x, east + y, down + z))
        self._last = np.array([x, y, z])
