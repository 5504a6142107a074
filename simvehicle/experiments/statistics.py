"""The few statistics that tables, figures and verdicts need."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Interval = tuple[float, float]
_Z95 = 1.959964
_RESAMPLES = 2000


def wilson(successes: int, trials: int) -> Interval:
    """Wilson's 95 % interval of a success rate (Wilson 1927)."""
    if trials == 0:
        return 0.0, 1.0
    rate = successes / trials
    spread = _Z95**2 / trials
    centre = (rate + spread / 2.0) / (1.0 + spread)
    half = _Z95 / (1.0 + spread) * math.sqrt(rate * (1.0 - rate) / trials + spread / (4.0 * trials))
    return max(0.0, centre - half), min(1.0, centre + half)


def bootstrap(statistic: Callable[[Floats, Floats], float], a: Floats, b: Floats) -> Interval:
    """95 % interval of a statistic of paired samples, by resampling pairs; the same for the same samples."""
    rng = np.random.default_rng(20201203)
    picks = rng.integers(0, len(a), (_RESAMPLES, len(a)))
    values = [statistic(a[pick], b[pick]) for pick in picks]
    low, high = np.quantile(values, [0.025, 0.975])
    return float(low), float(high)


def mean_difference(a: Floats, b: Floats) -> float:
    """How much larger b is on average."""
    return float(np.mean(b - a))


def deviation_ratio(a: Floats, b: Floats) -> float:
    """The standard deviation of b over that of a."""
    below = float(np.std(a, ddof=1))
    return float(np.std(b, ddof=1)) / below if below > 0.0 else math.inf
