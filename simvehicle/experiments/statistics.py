"""The few statistics that tables, figures and verdicts need: all intervals are 95 %."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Floats = NDArray[np.float64]
Interval = tuple[float, float]
Statistic = Callable[..., Any]
"""Of two samples; with the axis along which they lie, as `scipy.stats.bootstrap` calls it."""
_CONFIDENCE = 0.95
_RESAMPLES = 2000
_BATCH = 100
"""Resamples at a time: few enough for the processor's cache."""


def wilson(successes: int, trials: int) -> Interval:
    """Wilson's interval of a success rate (Wilson 1927); anything from 0 to 1 without a trial."""
    if trials == 0:
        return 0.0, 1.0
    found = stats.binomtest(successes, trials).proportion_ci(_CONFIDENCE, method="wilson")
    return float(found.low), float(found.high)


def bootstrap(statistic: Statistic, a: Floats, b: Floats) -> Interval:
    """Percentile interval of a statistic of paired samples (two pairs at least), by resampling pairs.

    The same for the same samples.
    """
    with np.errstate(invalid="ignore"):  # infinite ratios have no standard error, which nobody asks for
        found = stats.bootstrap(
            (a, b),
            statistic,
            paired=True,
            vectorized=True,
            n_resamples=_RESAMPLES,
            batch=_BATCH,
            confidence_level=_CONFIDENCE,
            method="percentile",
            random_state=np.random.default_rng(20201203),
        ).confidence_interval
    return float(found.low), float(found.high)


def mean_difference(a: Floats, b: Floats, axis: int = -1) -> Any:
    """How much larger b is on average."""
    return np.mean(b - a, axis=axis)


def mean_ratio(a: Floats, b: Floats, axis: int = -1) -> Any:
    """The mean of b over that of a."""
    return np.mean(b, axis=axis) / np.mean(a, axis=axis)


def deviation_ratio(a: Floats, b: Floats, axis: int = -1) -> Any:
    """The standard deviation of b over that of a; infinite where a does not scatter."""
    below, above = np.std(a, axis=axis, ddof=1), np.std(b, axis=axis, ddof=1)
    return np.divide(above, below, out=np.full(np.shape(below), math.inf), where=below > 0.0)[()]
