"""Where the source probably is, and how well that is known: particles of a plume that has gaps.

What a swarm meets in a real plume is no smooth field: contacts of any strength, and blanks between them, both of
which tell something. A particle is one whole explanation of them: where the source is (north, east), how strong, the
plume's width at the vent and its growth, the angle between the measured wind and the plume, how often there is gas on
the axis, whether the plume's edges are thin or seldom, and how much its strength fluctuates. Bayes' rule with such a
model is the usual way to find a release with moving sensors (Hutchinson, Oh & Chen 2017, "A review of source term
estimation methods for atmospheric dispersion events using static or mobile sensors", Information Fusion 36,
10.1016/j.inffus.2016.11.010).

* In the mean the plume is the Gaussian of `mission.estimation.source`: d downwind of the source and y across,
  C = A s0^2/s^2 phi, with s^2 = s0^2 + (g max(d, 0))^2 and phi = exp(-y^2/2s^2), upwind of the source
  phi = exp(-(d^2 + y^2)/2s0^2).
* It is made of gaps and whiffs, as Yee & Chan have it (1997, "A simple model for the probability density function of
  concentration fluctuations in atmospheric plumes", Atmospheric Environment 31): there is gas for a share
  g0 phi^(1-e) of the time, and then as much as A s0^2/s^2 phi^e in the mean, log-normally distributed (theirs is a
  clipped gamma distribution; of ours the cells need to keep two moments only). A plume that meanders has e near 0,
  a steady one e near 1 and g0 near 1.
* A share of all that is measured is false, and explains nothing.

The particles follow Chopin (2002, "A sequential particle filter method for static models", Biometrika 89): what is
new weighs them; when the weights differ too much they are resampled, and moved by Metropolis-Hastings steps on all
that was ever measured, with the differences of other particles as steps (ter Braak 2006, "A Markov chain Monte Carlo
version of the genetic algorithm differential evolution", Statistics and Computing 16). A call does a bounded amount
of work; what is left over is done in the next ones.
"""

from __future__ import annotations

import math
from typing import Final

import msgspec
import numpy as np

from mission.estimation.plume_evidence import (
    BLANK,
    BLANK_LOG,
    COLUMNS,
    CONTACT,
    CONTACT_LOG,
    CONTACT_LOG_VARIANCE,
    DOWNWIND_EAST,
    DOWNWIND_NORTH,
    EAST,
    NORTH,
    Evidence,
)
from mission.geometry.formation import FloatArray, IntArray

# Columns of the particles.
(
    SOURCE_NORTH,
    SOURCE_EAST,
    LOG_PPM,
    LOG_VENT,
    LOG_GROWTH,
    TURN,
    GAPS,
    EDGES,
    LOG_SPREAD,
    DIMENSIONS,
) = range(10)

_FALSE: Final = 0.02
"""Share of all measurements that are false."""
_FALSE_DENSITY: Final = 1.0 / 8.0
"""Of the logarithm of a false contact: it may be anything over some 3000-fold."""
_LOG_PPM_RANGE: Final = (math.log(2.0), math.log(50_000.0))
"""Of the excess at the vent, as likely in each of its decades; in the lowest there is nothing to find."""
_PRIOR: Final = (
    (LOG_VENT, math.log(3.0), 0.7),
    (LOG_GROWTH, math.log(0.12), 0.6),
    (TURN, 0.0, 0.2),
    (GAPS, 1.0, 1.5),
    (EDGES, 0.0, 1.5),
    (LOG_SPREAD, math.log(0.8), 0.4),
)
"""(column, mean, standard deviation) of what is known beforehand: vents of metres, plumes that grow by a tenth, the
wind's direction within 12 degrees, gas for three quarters of the time (a logit), edges of any kind (a logit), and
strengths that differ by a factor of two."""
_LEAST_SPREAD: Final = 0.35

_CELLS_A_STEP: Final = 8
"""What is new is taken in so many cells at a time, so that no step can leave one particle alone."""
_EFFECTIVE: Final = 0.3
"""Share of the particles that must still count after a step; at twice this share they are resampled."""
_SMALLEST_STEP: Final = 0.02
_PAIRS_A_CALL: Final = 200_000
"""About so many pairs of a particle and a cell one call works out."""
_SWEEPS: Final = 5
"""How often every particle has to be moved after a backlog until the estimate counts."""


class SourceEstimate(msgspec.Struct, frozen=True):
    """What is known of the source. It means nothing while there was no contact."""

    north_m: float
    east_m: float
    sd_m: float
    """Standard deviation along the horizontal axis on which the place is known worst."""
    peak_ppm: float
    """Excess at the vent: the median."""
    strong_share: float
    """Probability that there is a source at least as strong as asked for in the area."""
    complete: bool
    """All that was measured is in it, and has been for a while."""


class SourceFilter:
    """The estimate of one root. `update` once a second; deterministic by the generator that it is given."""

    def __init__(
        self,
        centre_m: tuple[float, float],
        radius_m: float,
        rng: np.random.Generator,
        particles: int = 1000,
    ) -> None:
        """The source is anywhere within `radius_m` of `centre_m` (north, east) as long as nothing is measured."""
        self._centre_m = np.array(centre_m)
        self._radius_m = radius_m
        self._rng = rng
        self._particles = np.empty((particles, DIMENSIONS))
        away_m = radius_m * np.sqrt(rng.random(particles))
        bearing = 2.0 * math.pi * rng.random(particles)
        self._particles[:, SOURCE_NORTH] = centre_m[0] + away_m * np.cos(bearing)
        self._particles[:, SOURCE_EAST] = centre_m[1] + away_m * np.sin(bearing)
        self._particles[:, LOG_PPM] = rng.uniform(*_LOG_PPM_RANGE, particles)
        for column, mean, sd in _PRIOR:
            self._particles[:, column] = rng.normal(mean, sd, particles)
        self._log_weights = np.zeros(particles)
        self._known: FloatArray = np.zeros((0, COLUMNS))
        self._seen: IntArray = np.zeros(0, np.int64)
        self._log_likelihoods = np.zeros(particles)
        """Of all that is known."""
        self._next = 0
        """The particle that is moved next."""
        self._moved = 0
        """How many were moved since there was a backlog."""

    def update(self, evidence: Evidence) -> None:
        """Take in what has been measured since; a backlog is worked off over several calls."""
        fresh = len(evidence.cells) - len(self._seen)
        self._known = np.concatenate((self._known, np.zeros((fresh, COLUMNS))))
        self._seen = np.concatenate((self._seen, np.zeros(fresh, np.int64)))
        changed = np.flatnonzero(evidence.changes != self._seen)
        pairs, first = _PAIRS_A_CALL, 0
        while first < len(changed) and pairs > 0:
            rows = changed[first : first + _CELLS_A_STEP]
            pairs -= self._take(evidence, rows, pairs)
            first += _CELLS_A_STEP
        behind = bool((self._seen != evidence.changes).any())
        moved = self._move(max(pairs // 2, _PAIRS_A_CALL // 8))
        self._moved = 0 if behind else self._moved + moved

    def estimate(self, strong_ppm: float) -> SourceEstimate:
        """`strong_ppm`: what an excess at the vent must be to be worth finding."""
        weight = self._weights()
        place = self._particles[:, :2]
        mean = weight @ place
        off = place - mean
        covariance = (off * weight[:, None]).T @ off
        strong = self._particles[:, LOG_PPM] >= math.log(strong_ppm)
        order = np.argsort(self._particles[:, LOG_PPM])
        median = order[np.searchsorted(np.cumsum(weight[order]), 0.5)]
        return SourceEstimate(
            float(mean[0]),
            float(mean[1]),
            math.sqrt(max(float(np.linalg.eigvalsh(covariance)[-1]), 0.0)),
            math.exp(float(self._particles[median, LOG_PPM])),
            float(weight[strong].sum()),
            self._moved >= _SWEEPS * len(weight),
        )

    def _weights(self) -> FloatArray:
        weight: FloatArray = np.exp(self._log_weights - self._log_weights.max())
        weight /= weight.sum()
        return weight

    def _take(self, evidence: Evidence, rows: IntArray, pairs: int) -> int:
        """Weigh by the cells in `rows` as they are now, in steps that leave a good part of the particles; how many
        pairs of a particle and a cell were worked out. What `pairs` do not suffice for is left to the next call."""
        now, before = evidence.cells[rows].copy(), self._known[rows]
        spent, done = 0, 0.0
        while done < 1.0 and spent < pairs:
            here = log_likelihood(self._particles, self._known[rows])
            share = 1.0
            while True:
                partly = now.copy()
                for column in (BLANK, CONTACT):
                    partly[:, column] = before[:, column] + share * (now[:, column] - before[:, column])
                gain = log_likelihood(self._particles, partly) - here
                spent += len(gain) * len(rows)
                enough = _effective(self._log_weights + gain) >= _EFFECTIVE * len(gain)
                if enough or share - done < _SMALLEST_STEP:
                    break
                share = 0.5 * (done + share)
            done = share
            self._known[rows] = partly
            self._log_likelihoods += gain
            self._log_weights += gain
            if _effective(self._log_weights) < 2.0 * _EFFECTIVE * len(gain):
                self._resample()
                spent += self._move(_PAIRS_A_CALL) * len(self._known)
        if done >= 1.0:
            self._seen[rows] = evidence.changes[rows]
        return spent

    def _resample(self) -> None:
        """Systematically: each particle as often as its weight says, all of equal weight from then on."""
        weight = self._weights()
        count = len(weight)
        steps = (np.arange(count) + self._rng.random()) / count
        chosen = np.minimum(np.searchsorted(np.cumsum(weight), steps), count - 1)
        chosen = self._rng.permutation(chosen)
        self._particles = self._particles[chosen]
        self._log_likelihoods = self._log_likelihoods[chosen]
        self._log_weights[:] = 0.0

    def _move(self, pairs: int) -> int:
        """Move as many particles as `pairs` of one and a cell allow, after those that were moved last; how many."""
        count = len(self._particles)
        moved = min(pairs // max(len(self._known), 1), count)
        if moved < 2:
            return 0
        rows = (self._next + np.arange(moved)) % count
        self._next = (self._next + moved) % count
        rng = self._rng
        one, other = rng.integers(0, count, (2, moved))
        # Mostly steps of the usual length; now and then from one mode to another, or small ones in a few axes.
        length = np.where(rng.random(moved) < 0.1, 1.0, 2.38 / math.sqrt(2.0 * DIMENSIONS))
        length *= np.where(rng.random(moved) < 0.3, 0.3, 1.0)
        axes = rng.random((moved, DIMENSIONS)) < np.where(rng.random(moved) < 0.5, 1.0, 0.4)[:, None]
        step = (self._particles[one] - self._particles[other]) * length[:, None] * axes
        step += rng.normal(0.0, _JITTER, (moved, DIMENSIONS)) * axes
        here = self._particles[rows]
        there = here + step
        gain = self._log_prior(there) - self._log_prior(here)
        possible = gain > -math.inf
        places, there = rows[possible], there[possible]
        likelihood = log_likelihood(there, self._known)
        gain = gain[possible] + likelihood - self._log_likelihoods[places]
        taken = np.log(rng.random(len(gain))) < gain
        self._particles[places[taken]] = there[taken]
        self._log_likelihoods[places[taken]] = likelihood[taken]
        return moved

    def _log_prior(self, particles: FloatArray) -> FloatArray:
        least, most = _LOG_PPM_RANGE
        outside = np.square(particles[:, :2] - self._centre_m).sum(axis=1) > self._radius_m**2
        outside |= (particles[:, LOG_PPM] < least) | (particles[:, LOG_PPM] > most)
        log = np.where(outside, -math.inf, 0.0)
        for column, mean, sd in _PRIOR:
            log -= 0.5 * np.square((particles[:, column] - mean) / sd)
        return log


_JITTER: Final = np.array([0.1, 0.1, 0.02, 0.02, 0.02, 0.005, 0.03, 0.03, 0.02])
"""Standard deviation of the noise on every step, by column: particles that are copies of each other part."""


def _effective(log_weights: FloatArray) -> float:
    """How many particles of equal weight tell as much as these."""
    weight = np.exp(log_weights - log_weights.max())
    return float(weight.sum() ** 2 / np.square(weight).sum())


def log_likelihood(particles: FloatArray, cells: FloatArray) -> FloatArray:
    """(n,) of each particle (n, DIMENSIONS) for what was measured in `cells` (m, COLUMNS); see the module's text."""
    if not len(cells):
        return np.zeros(len(particles))
    p = particles[:, :, None]
    north = cells[:, NORTH] - p[:, SOURCE_NORTH]
    east = cells[:, EAST] - p[:, SOURCE_EAST]
    wind_n, wind_e = cells[:, DOWNWIND_NORTH], cells[:, DOWNWIND_EAST]
    ahead, aside = north * wind_n + east * wind_e, east * wind_n - north * wind_e
    cos, sin = np.cos(p[:, TURN]), np.sin(p[:, TURN])
    downwind, across = ahead * cos + aside * sin, aside * cos - ahead * sin
    calm = wind_n * wind_n + wind_e * wind_e < _CALM
    if calm.any():  # gas goes everywhere, and thins out with the distance
        away = np.hypot(north, east)
        downwind, across = np.where(calm, away, downwind), np.where(calm, away, across)
    vent2 = np.exp(2.0 * p[:, LOG_VENT])
    width2 = vent2 + np.square(np.exp(p[:, LOG_GROWTH]) * np.maximum(downwind, 0.0))
    log_phi = -0.5 * (across * across / width2 + np.square(np.minimum(downwind, 0.0)) / vent2)
    edges = 1.0 / (1.0 + np.exp(-p[:, EDGES]))
    share = np.exp((1.0 - edges) * log_phi) / (1.0 + np.exp(-p[:, GAPS]))
    spread = _LEAST_SPREAD + np.exp(p[:, LOG_SPREAD])
    # Of a log-normal strength the logarithm of the mean is that of the median and half the variance.
    middle = p[:, LOG_PPM] + np.log(vent2 / width2) + edges * log_phi - 0.5 * spread * spread
    log = np.zeros(len(particles))
    blank = cells[:, BLANK] > 0.0
    if blank.any():
        low = (cells[blank, BLANK_LOG] - middle[:, blank]) / spread
        seen = (1.0 - _FALSE) * share[:, blank] / (1.0 + np.exp(np.clip(_LOGISTIC * low, -30.0, 30.0)))
        log += np.log(1.0 - _FALSE - seen * (1.0 - _FALSE)) @ cells[blank, BLANK]
    contact = cells[:, CONTACT] > 0.0
    if contact.any():
        off2 = (
            np.square(cells[contact, CONTACT_LOG] - middle[:, contact]) + cells[contact, CONTACT_LOG_VARIANCE]
        )
        density = (
            share[:, contact] / spread * np.exp(-0.5 * off2 / (spread * spread)) / math.sqrt(2.0 * math.pi)
        )
        log += np.log((1.0 - _FALSE) * density + _FALSE * _FALSE_DENSITY) @ cells[contact, CONTACT]
    return log


_CALM: Final = 0.25
"""A mean downwind vector shorter than its root is no direction."""
_LOGISTIC: Final = 1.702
"""1 / (1 + exp(-1.702 z)) is the normal distribution's cumulative one to 0.01."""
