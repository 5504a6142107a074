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

_MIXTURE: Final = (1 + STATES, STATES)
"""Shape of a mixture: its mean is the first row, its covariance are the rows below."""


class TwoModes:
    """Mean and covariance of a mixture of two Gaussians, predicted and corrected as one."""

    def __init__(self, model: Co2Model) -> None:
        # Imported late: it costs a second and 95 MB, and only a process that filters shall pay.
        from filterpy.kalman import KalmanFilter

        self._kf: Any = KalmanFilter(dim_x=2 * STATES, dim_z=2)
        self._kf.inv = _inverse_of_diagonal
        self._model = model
        self.plume_chance = 0.5
        self._kept_parts: Array | None = None
        self._mixture: list[list[float]] | None = None
        """What `_parts` and `_numbers` found, until the filters or the chance change."""

    def begin(self, x: Array, p: Array, plume_chance: float) -> None:
        """Both filters at `x` (4) with covariance `p` (4 x 4)."""
        self._set(x, p, x, p, plume_chance)

    def snapshot(self) -> Snapshot:
        return self._kf.x, self._kf.P, self.plume_chance

    def restore(self, snapshot: Snapshot) -> None:
        self._kf.x, self._kf.P, self.plume_chance = snapshot
        self._kept_parts = self._mixture = None

    @property
    def x(self) -> list[float]:
        """The mixture's mean."""
        return self._numbers()[0]

    @property
    def p(self) -> list[list[float]]:
        """The mixture's covariance, by rows."""
        return self._numbers()[1:]

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
        calm, plume = self._mixed(calm_from_plume, plume_from_plume)
        self._set(calm[0], calm[1:], plume[0], plume[1:], becomes_plume)
        ahead = self._model.ahead(dt_s)
        self._kf.predict(F=ahead.transition, Q=ahead.noise + plume_rate_variance * ahead.plume_rate_noise)

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
        self._kept_parts = self._mixture = None
        return most + math.log(calm_share + plume_share)

    def widen(self, variances: Array) -> None:
        """Add to the variances of the plume's filter, and hold the plume for certain."""
        (plume,) = self._mixed(self.plume_chance)
        x, p = self._kf.x, self._kf.P
        self._set(x[CALM], p[CALM, CALM], plume[0], plume[1:] + np.diag(variances), 1.0 - _LEAST_CHANCE)

    def _set(self, calm_x: Array, calm_p: Array, plume_x: Array, plume_p: Array, plume_chance: float) -> None:
        p = np.zeros((2 * STATES, 2 * STATES))
        p[CALM, CALM], p[PLUME, PLUME] = calm_p, plume_p
        self._kf.x, self._kf.P = np.concatenate((calm_x, plume_x)), p
        self.plume_chance = plume_chance
        self._kept_parts = self._mixture = None

    def _mixed(self, *chances: float) -> Array:
        """Both filters' Gaussians as one, for each of these chances of the plume's (see `_MIXTURE`).

        A mixture is linear in what it is made of, so that one product of matrices makes mean and covariance of all.
        """
        weights = np.array([(1.0 - chance, chance, chance * (1.0 - chance)) for chance in chances])
        mixed: Array = weights @ self._parts()
        return mixed.reshape(-1, *_MIXTURE)

    def _parts(self) -> Array:
        """Three rows: mean and covariance of calm air, of the plume, and the product of the means' distance with
        itself, which widens the covariance."""
        if self._kept_parts is None:
            x, p = self._kf.x, self._kf.P
            parts = np.zeros((3, *_MIXTURE))
            calm, plume, between = parts
            calm[0], calm[1:] = x[CALM], p[CALM, CALM]
            plume[0], plume[1:] = x[PLUME], p[PLUME, PLUME]
            apart = plume[0] - calm[0]
            between[1:] = apart[:, None] * apart
            self._kept_parts = parts.reshape(3, -1)
        return self._kept_parts

    def _numbers(self) -> list[list[float]]:
        """The mixture in plain numbers, which are read one by one, and often."""
        if self._mixture is None:
            self._mixture = self._mixed(self.plume_chance)[0].tolist()
        return self._mixture


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
