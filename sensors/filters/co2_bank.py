"""Two Kalman filters side by side, one for calm air and one for a plume, and how likely each is.

The interacting multiple model estimator (H. A. P. Blom, Y. Bar-Shalom, IEEE Trans. Automatic Control 33(8),
1988) for two modes that differ in process noise only. One filter with one process noise cannot be honest on
both sides of a plume's edge: tuned to the plume its variance in clean air is hundreds of times too large,
tuned to clean air it is confident and wrong for the second in which the drone flies in. (filterpy's own
estimator of this kind takes three times the time of its two filters.)

Both filters are the halves of one of filterpy's, calm air's states first: its matrices are block diagonal and stay
so, and on matrices this small two filters in one call cost little more than one.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from sensors.filters.co2_model import CALM, PLUME, STATES, Array, Co2Model

_LEAST_CHANCE: Final = 1e-6

Snapshot = tuple[Array, Array, float]
"""State and covariance of both filters, and the chance of the plume."""

_Between = tuple[Array, Array, Array, Array, Array]
"""Calm air's mean and covariance; how far the plume's mean is from it, that times itself, and how much more its
covariance is."""


class TwoModes:
    """Mean and covariance of a mixture of two Gaussians, predicted and corrected as one."""

    def __init__(self, model: Co2Model) -> None:
        # Imported late: it costs a second and 95 MB, and only a process that filters shall pay.
        from filterpy.kalman import KalmanFilter

        self._kf: Any = KalmanFilter(dim_x=2 * STATES, dim_z=2)
        self._kf.inv = _inverse_of_diagonal
        self._model = model
        self.plume_chance = 0.5
        self._apart: _Between | None = None
        self._mixture: tuple[list[float], list[list[float]]] | None = None
        """What `_between` and `_numbers` found, until the filters or the chance change."""

    def begin(self, x: Array, p: Array, plume_chance: float) -> None:
        """Both filters at `x` (4) with covariance `p` (4 x 4)."""
        self._set(x, p, x, p, plume_chance)

    def snapshot(self) -> Snapshot:
        return self._kf.x, self._kf.P, self.plume_chance

    def restore(self, snapshot: Snapshot) -> None:
        self._kf.x, self._kf.P, self.plume_chance = snapshot
        self._apart = self._mixture = None

    @property
    def x(self) -> list[float]:
        """The mixture's mean."""
        return self._numbers()[0]

    @property
    def p(self) -> list[list[float]]:
        """The mixture's covariance, by rows."""
        return self._numbers()[1]

    def predict(self, dt_s: float, plume_rate_variance: float) -> None:
        """Both filters ahead by `dt_s`, each beginning from the mixture of where the other may have been.

        `plume_rate_variance`: of the concentration's rate in a plume, (ppm/s)^2.
        """
        config = self._model.config
        was_plume = self.plume_chance
        leave_calm = -math.expm1(-dt_s / config.calm_time_s)
        leave_plume = -math.expm1(-dt_s / config.plume_time_s)
        becomes_plume = was_plume * (1.0 - leave_plume) + (1.0 - was_plume) * leave_calm
        # Chance that a filter's mode now came from the plume's mode before.
        plume_from_plume = was_plume * (1.0 - leave_plume) / becomes_plume
        calm_from_plume = was_plume * leave_plume / (1.0 - becomes_plume)
        between = self._between()
        self._set(*_mixed(between, calm_from_plume), *_mixed(between, plume_from_plume), becomes_plume)
        ahead = self._model.ahead(dt_s)
        self._kf.predict(F=ahead.transition, Q=ahead.noise + plume_rate_variance * ahead.plume_rate_noise)
        self._apart = self._mixture = None

    def innovation(self, z: float, variance: float, state: int) -> tuple[float, float]:
        """Distance of a measurement of one state from the mixture's mean, and squared in the likelier
        measure."""
        x, p = self._kf.x, self._kf.P
        other = STATES + state
        in_calm, in_plume = z - x.item(state), z - x.item(other)
        nearest = min(
            in_calm * in_calm / (p.item(state, state) + variance),
            in_plume * in_plume / (p.item(other, other) + variance),
        )
        return in_calm + self.plume_chance * (in_plume - in_calm), nearest

    def correct(self, z: float, variance: float, state: int, *, judge: bool = True) -> float:
        """Both filters with a measurement of one state; its log likelihood under the mixture.

        Without `judge` the measurement does not change how likely each mode is.
        """
        kf = self._kf
        kf.update(np.array((z, z)), np.array(((variance, 0.0), (0.0, variance))), _ROWS[state])
        # filterpy's state silently takes another shape when a measurement has the wrong one.
        assert kf.x.shape == (2 * STATES,)  # noqa: S101
        calm_y, plume_y = float(kf.y[0]), float(kf.y[1])
        calm_s, plume_s = float(kf.S[0, 0]), float(kf.S[1, 1])
        calm_log = -0.5 * (calm_y * calm_y / calm_s + math.log(2.0 * math.pi * calm_s))
        plume_log = -0.5 * (plume_y * plume_y / plume_s + math.log(2.0 * math.pi * plume_s))
        most = max(calm_log, plume_log)
        calm_share = (1.0 - self.plume_chance) * math.exp(calm_log - most)
        plume_share = self.plume_chance * math.exp(plume_log - most)
        if judge:
            chance = plume_share / (calm_share + plume_share)
            self.plume_chance = min(max(chance, _LEAST_CHANCE), 1.0 - _LEAST_CHANCE)
        self._apart = self._mixture = None
        return most + math.log(calm_share + plume_share)

    def widen(self, variances: Array) -> None:
        """Add to the variances of the plume's filter, and hold the plume for certain."""
        x, p = _mixed(self._between(), self.plume_chance)
        self._set(self._kf.x[CALM], self._kf.P[CALM, CALM], x, p + np.diag(variances), 1.0 - _LEAST_CHANCE)

    def _set(self, calm_x: Array, calm_p: Array, plume_x: Array, plume_p: Array, plume_chance: float) -> None:
        p = np.zeros((2 * STATES, 2 * STATES))
        p[CALM, CALM], p[PLUME, PLUME] = calm_p, plume_p
        self._kf.x, self._kf.P = np.concatenate((calm_x, plume_x)), p
        self.plume_chance = plume_chance
        self._apart = self._mixture = None

    def _between(self) -> _Between:
        if self._apart is None:
            x, p = self._kf.x, self._kf.P
            calm_x, calm_p = x[CALM], p[CALM, CALM]
            apart = x[PLUME] - calm_x
            self._apart = calm_x, calm_p, apart, apart[:, None] * apart, p[PLUME, PLUME] - calm_p
        return self._apart

    def _numbers(self) -> tuple[list[float], list[list[float]]]:
        """The mixture in plain numbers, which are read one by one, and often."""
        if self._mixture is None:
            x, p = _mixed(self._between(), self.plume_chance)
            self._mixture = (x.tolist(), p.tolist())
        return self._mixture


def _mixed(between: _Between, chance: float) -> tuple[Array, Array]:
    """Mean and covariance of both filters' Gaussians, where the plume's has this chance."""
    calm_x, calm_p, apart, outer, wider = between
    return calm_x + chance * apart, calm_p + chance * (wider + (1.0 - chance) * outer)


def _measures(state: int) -> Array:
    """Measurement matrix of both filters for one state."""
    h = np.zeros((2, 2 * STATES))
    h[0, state] = h[1, STATES + state] = 1.0
    return h


_ROWS: Final = tuple(_measures(state) for state in range(STATES))


def _inverse_of_diagonal(matrix: Array) -> Array:
    """Of a 2 x 2 matrix: one measurement in each filter has nothing to do with the other's."""
    (a, _), (_, b) = matrix.tolist()
    return np.array(((1.0 / a, 0.0), (0.0, 1.0 / b)))
