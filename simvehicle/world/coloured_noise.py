"""Noise with a bandwidth: several independent processes of one configured colour, each a function of the time."""

from __future__ import annotations

from typing import Final

import numpy as np
import scipy.linalg

from mission.geometry.formation import FloatArray

_SAMPLES_PER_RADIAN: Final = 25
"""Of the bandwidth's own time: between two of them the noise is a straight line."""
_CHUNK: Final = 256


class ColouredNoise:
    """White noise through x'' + 2 d b x' + b^2 x (bandwidth b, damping d), as in Farrell et al. 2002.

    Standard deviation 1. Sampled exactly on a time grid of its own, so that whoever integrates something that it
    drives may take any step: the noise stays the same. It begins at `begin_s` and grows as later times are asked for.
    """

    def __init__(
        self,
        bandwidth_radps: float,
        damping: float,
        rng: np.random.Generator,
        *,
        processes: int,
        begin_s: float = 0.0,
    ) -> None:
        self._step_s = 1.0 / (_SAMPLES_PER_RADIAN * bandwidth_radps)
        self._begin_s = begin_s
        self._rng = rng
        b = bandwidth_radps
        motion = np.array([[0.0, 1.0], [-b * b, -2.0 * damping * b]])
        self._transition = np.asarray(scipy.linalg.expm(self._step_s * motion))
        stationary = np.diag([1.0, b * b])
        added = stationary - self._transition @ stationary @ self._transition.T
        # A step much shorter than the noise's own time kicks the rate alone; rounding must not make that negative.
        values, vectors = np.linalg.eigh(added)
        self._kick = vectors * np.sqrt(np.maximum(values, 0.0))
        self._last = rng.standard_normal((2, processes)) * np.array([[1.0], [b]])
        """Value and rate of change of each process."""
        self._values = self._last[:1].copy()

    def at(self, time_s: float) -> FloatArray:
        """(processes,) values; times before the beginning are answered as the beginning."""
        place = max(0.0, (time_s - self._begin_s) / self._step_s)
        index = int(place)
        while index + 1 >= len(self._values):
            self._extend()
        share = place - index
        return np.asarray((1.0 - share) * self._values[index] + share * self._values[index + 1])

    def _extend(self) -> None:
        # As many again as there are: a long flight does not copy the beginning over and over.
        count = max(_CHUNK, len(self._values))
        values = np.empty((count, self._last.shape[1]))
        for row in values:
            kicks = self._rng.standard_normal(self._last.shape)
            self._last = self._transition @ self._last + self._kick @ kicks
            row[:] = self._last[0]
        self._values = np.concatenate([self._values, values])
