"""Two Kalman filters side by side, one for calm air and one for a plume, and how likely each is.

The interacting multiple model estimator (H. A. P. Blom, Y. Bar-Shalom, IEEE Trans. Automatic Control 33(8),
1988) for two modes that differ in process noise only. One filter with one process noise cannot be honest on
both sides of a plume's edge: tuned to the plume its variance in clean air is hundreds of times too large,
tuned to clean air it is confident and wrong for the second in which the drone flies in. (filterpy's own
estimator of this kind takes three times the time of these two filters, which are filterpy's.)
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from sensors.filters.co2_model import STATES, Array

_LEAST_CHANCE: Final = 1e-6
_ROWS: Final = tuple(np.eye(STATES)[state : state + 1] for state in range(STATES))
"""Measurement matrices: one state each."""

Snapshot = tuple[Array, Array, Array, Array, float]
"""State and covariance of both filters, and the chance of the plume."""


class TwoModes:
    """Mean and covariance of a mixture of two Gaussians, predicted and corrected as one."""

    def __init__(self, calm_time_s: float, plume_time_s: float) -> None:
        """`calm_time_s`, `plume_time_s`: how long the air stays in each mode on average."""
        # Imported late: it costs a second and 95 MB, and only a process that filters shall pay.
        from filterpy.kalman import KalmanFilter

        self._calm: Any = KalmanFilter(dim_x=STATES, dim_z=1)
        self._plume: Any = KalmanFilter(dim_x=STATES, dim_z=1)
        self._calm_time_s = calm_time_s
        self._plume_time_s = plume_time_s
        self.plume_chance = 0.5
        self._mixture: tuple[Array, Array] | None = None

    def begin(self, x: Array, p: Array, plume_chance: float) -> None:
        self._calm.x, self._calm.P = x, p
        self._plume.x, self._plume.P = x, p
        self.plume_chance = plume_chance
        self._mixture = None

    def snapshot(self) -> Snapshot:
        return self._calm.x, self._calm.P, self._plume.x, self._plume.P, self.plume_chance

    def restore(self, snapshot: Snapshot) -> None:
        self._calm.x, self._calm.P, self._plume.x, self._plume.P, self.plume_chance = snapshot
        self._mixture = None

    @property
    def x(self) -> Array:
        return self._mixed()[0]

    @property
    def p(self) -> Array:
        return self._mixed()[1]

    def predict(self, dt_s: float, transition: Array, calm_noise: Array, plume_noise: Array) -> None:
        """Both filters ahead by `dt_s`, each beginning from the mixture of where the other may have been."""
        calm, plume = self._calm, self._plume
        was_plume = self.plume_chance
        leave_calm = -math.expm1(-dt_s / self._calm_time_s)
        leave_plume = -math.expm1(-dt_s / self._plume_time_s)
        becomes_plume = was_plume * (1.0 - leave_plume) + (1.0 - was_plume) * leave_calm
        # Chance that a filter's mode now came from the plume's mode before.
        plume_from_plume = was_plume * (1.0 - leave_plume) / becomes_plume
        calm_from_plume = was_plume * leave_plume / (1.0 - becomes_plume)
        apart = calm.x - plume.x
        outer = apart[:, None] * apart
        calm_x, calm_p, plume_p = calm.x, calm.P, plume.P
        for kf, share, noise in ((calm, calm_from_plume, calm_noise), (plume, plume_from_plume, plume_noise)):
            kf.x = calm_x - share * apart
            kf.P = (1.0 - share) * calm_p + share * plume_p + (share * (1.0 - share)) * outer
            kf.predict(F=transition, Q=noise)
        self.plume_chance = becomes_plume
        self._mixture = None

    def innovation(self, z: float, variance: float, state: int) -> tuple[float, float]:
        """Distance of a measurement of one state from the mixture's mean, and squared in the likelier
        measure."""
        calm, plume = self._calm, self._plume
        in_calm, in_plume = z - float(calm.x[state]), z - float(plume.x[state])
        nearest = min(
            in_calm * in_calm / (float(calm.P[state, state]) + variance),
            in_plume * in_plume / (float(plume.P[state, state]) + variance),
        )
        return in_calm + self.plume_chance * (in_plume - in_calm), nearest

    def correct(self, z: float, variance: float, state: int, *, judge: bool = True) -> float:
        """Both filters with a measurement of one state; its log likelihood under the mixture.

        Without `judge` the measurement does not change how likely each mode is.
        """
        measured, noise, h = np.array([z]), np.array([[variance]]), _ROWS[state]
        logs = []
        for kf in (self._calm, self._plume):
            kf.update(measured, noise, h)
            # filterpy's state silently takes another shape when a measurement has the wrong one.
            assert kf.x.shape == (STATES,)  # noqa: S101
            y, s = float(kf.y[0]), float(kf.S[0, 0])
            logs.append(-0.5 * (y * y / s + math.log(2.0 * math.pi * s)))
        calm_log, plume_log = logs
        most = max(calm_log, plume_log)
        calm_share = (1.0 - self.plume_chance) * math.exp(calm_log - most)
        plume_share = self.plume_chance * math.exp(plume_log - most)
        if judge:
            chance = plume_share / (calm_share + plume_share)
            self.plume_chance = min(max(chance, _LEAST_CHANCE), 1.0 - _LEAST_CHANCE)
        self._mixture = None
        return most + math.log(calm_share + plume_share)

    def widen(self, variances: Array) -> None:
        """Add to the variances of the plume's filter, and hold the plume for certain."""
        self._plume.x, self._plume.P = self.x, self.p + np.diag(variances)
        self.plume_chance = 1.0 - _LEAST_CHANCE
        self._mixture = None

    def _mixed(self) -> tuple[Array, Array]:
        if self._mixture is None:
            calm, plume, chance = self._calm, self._plume, self.plume_chance
            apart = plume.x - calm.x
            x = calm.x + chance * apart
            p = (
                (1.0 - chance) * calm.P
                + chance * plume.P
                + (chance * (1.0 - chance)) * (apart[:, None] * apart)
            )
            self._mixture = (x, p)
        return self._mixture
