"""Turbulence of the atmosphere's lowest 300 m: the low-altitude Dryden model of MIL-F-8785C as a field that drifts.

MIL-F-8785C (1980), 3.7: Dryden's spectra, with lengths and standard deviations by the height and the wind at 20 ft.
The model says what is met along a straight path. Here the turbulence is carried along by the mean wind (Taylor's
hypothesis), so that who hovers and who flies through it meet the same gusts: along the wind they have the model's
autocorrelation, across it and over the height they fade into others.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from mission.geometry.formation import FloatArray
from simvehicle.world.wind_formulas import LOWEST_M, TALLEST_M, turbulence_lengths_m

LEVELS: Final = 8
"""Heights, from `LOWEST_M` to `TALLEST_M` and each about twice the one below, that have gusts of their own: over the
vertical length of the model gusts are others."""
LANES: Final = 16
"""Strips along the wind that have gusts of their own, each as wide as these are long. Then they come again."""
SAMPLES: Final = 1 << 14
"""Along a lane. Then they come again: after 8 km at a height of 3 m, 27 km at 10 m."""
_SAMPLES_PER_LENGTH: Final = 6
"""Of the shortest length, the vertical one: between two samples the gusts are a straight line."""


class Turbulence:
    """Gusts of standard deviation 1 along the wind, across it, and down, for each level, lane and place."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        # Zeros that nobody touched take no memory: of most levels nobody asks.
        self.series = np.zeros((LEVELS, LANES, SAMPLES + 1, 3))
        self.flat = self.series.reshape(-1)
        self.heights_m = LOWEST_M * (TALLEST_M / LOWEST_M) ** (np.arange(LEVELS) / (LEVELS - 1.0))
        self._made = [False] * LEVELS

    def make(self, level: int) -> None:
        """Draw the gusts of a level and of the one above it, if they have not been drawn yet."""
        for each in (level, min(level + 1, LEVELS - 1)):
            if not self._made[each]:
                self._made[each] = True
                self.series[each, :, :SAMPLES] = self._drawn(each)
                self.series[each, :, SAMPLES] = self.series[each, :, 0]

    def spacings_m(self) -> FloatArray:
        """(LEVELS,) between samples along the wind."""
        return np.asarray(self.heights_m / _SAMPLES_PER_LENGTH)

    def lanes_m(self) -> FloatArray:
        """(LEVELS,) width of a lane: gusts fade into others across the wind over half of their length along it."""
        return np.array([turbulence_lengths_m(height_m)[0] for height_m in self.heights_m.tolist()])

    def _drawn(self, level: int) -> FloatArray:
        """(LANES, SAMPLES, 3) Gaussian series with exactly the model's autocorrelation, by circulant embedding."""
        along_m, up_m = turbulence_lengths_m(float(self.heights_m[level]))
        away_m = float(self.spacings_m()[level]) * np.minimum(
            np.arange(SAMPLES), SAMPLES - np.arange(SAMPLES)
        )
        longitudinal = np.exp(-away_m / along_m)
        lateral = np.exp(-away_m / along_m) * (1.0 - 0.5 * away_m / along_m)
        vertical = np.exp(-away_m / up_m) * (1.0 - 0.5 * away_m / up_m)
        rng = np.random.default_rng([self._seed & 0xFFFFFFFF, 0xD27DE, level])
        drawn = np.empty((LANES, SAMPLES, 3))
        for axis, correlation in enumerate((longitudinal, lateral, vertical)):
            power = np.maximum(np.fft.rfft(correlation).real, 0.0)
            power[0] = 0.0  # the mean wind is what the configuration says
            noise = np.fft.rfft(rng.standard_normal((LANES, SAMPLES)))
            # Between samples a straight line has less variance than at them: make up for it on the average.
            kept = (2.0 + correlation[1]) / 3.0
            drawn[:, :, axis] = np.fft.irfft(noise * np.sqrt(power / kept), SAMPLES)
        return drawn
