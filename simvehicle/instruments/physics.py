"""What happens between the air and an instrument's digits: lag, noise, drift, rounding, the end of the
range."""

from __future__ import annotations

import dataclasses
import math
from typing import Protocol

import numpy as np

from simvehicle.world.air import Air


class Emulator(Protocol):
    """An instrument as its serial line shows it: bytes in, bytes out."""

    def receive(self, now_s: float, data: bytes) -> None:
        """Commands that came over the line."""
        ...

    def step(self, now_s: float, air: Air) -> bytes:
        """What it says since the last step; the air has been like this since then."""
        ...


@dataclasses.dataclass(frozen=True)
class GasResponse:
    """How a gas instrument answers to the air; every number is that of one reading."""

    lag_s: float
    noise_ppm: float
    range_ppm: float
    resolution_ppm: float
    noise_fraction: float = 0.002
    drift_ppm_per_sqrt_hour: float = 2.0
    zero_sd_ppm: float = 0.5
    """Offset that a zero leaves."""


class GasCell:
    """First-order lag, noise that grows with the reading, and an offset that wanders until the next zero."""

    def __init__(self, response: GasResponse, rng: np.random.Generator) -> None:
        self.response = response
        self._rng = rng
        self._cell_ppm: float | None = None
        self._time_s: float | None = None
        self.offset_ppm = 0.0
        self.zero()

    def zero(self) -> None:
        self.offset_ppm = float(self._rng.normal(0.0, self.response.zero_sd_ppm))

    def breathe(self, now_s: float, co2_ppm: float) -> None:
        """The air has been like this since the last call."""
        if self._cell_ppm is None or self._time_s is None:
            self._cell_ppm, self._time_s = co2_ppm, now_s
            return
        dt_s = max(now_s - self._time_s, 0.0)
        self._time_s = now_s
        self._cell_ppm += (co2_ppm - self._cell_ppm) * -math.expm1(-dt_s / self.response.lag_s)
        if self.response.drift_ppm_per_sqrt_hour > 0.0 and dt_s > 0.0:
            sd_ppm = self.response.drift_ppm_per_sqrt_hour * math.sqrt(dt_s / 3600.0)
            self.offset_ppm += float(self._rng.normal(0.0, sd_ppm))

    def reading_ppm(self) -> float:
        """One reading, as far as the instrument can say it: never below zero, never over its range."""
        response = self.response
        cell_ppm = self._cell_ppm or 0.0
        sd_ppm = math.hypot(response.noise_ppm, response.noise_fraction * cell_ppm)
        noisy_ppm = cell_ppm + self.offset_ppm + float(self._rng.normal(0.0, sd_ppm))
        steps = round(min(max(noisy_ppm, 0.0), response.range_ppm) / response.resolution_ppm)
        return min(steps * response.resolution_ppm, response.range_ppm)


class Ticker:
    """Counts the periods that have passed, for instruments that talk by themselves."""

    def __init__(self, period_s: float) -> None:
        self.period_s = period_s
        self._next_s: float | None = None

    def passed(self, now_s: float, most: int = 50) -> int:
        """Periods since the last call; after a long pause at most `most`, as a full buffer would hold."""
        if self._next_s is None or now_s < self._next_s - 2.0 * self.period_s:
            self._next_s = now_s
        count = 0
        while now_s >= self._next_s - 1e-9:
            self._next_s += self.period_s
            count += 1
            if count > most:
                self._next_s = now_s + self.period_s
                return most
        return count
