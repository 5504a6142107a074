"""Intervals: by SciPy, and by hand where that is short."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simvehicle.experiments.statistics import bootstrap, deviation_ratio, mean_difference, mean_ratio, wilson


def test_wilson_is_wilsons() -> None:
    assert wilson(50, 100) == pytest.approx((0.4038, 0.5962), abs=1e-4)
    assert wilson(100, 100)[1] == 1.0
    assert wilson(100, 100)[0] == pytest.approx(0.9630, abs=1e-4)
    assert wilson(0, 0) == (0.0, 1.0)


@given(st.integers(1, 3000), st.data())
def test_wilson_solves_its_equation(trials: int, data: st.DataObject) -> None:
    """Both ends are the rates p at which the observed rate is 1.96 standard deviations away (Wilson 1927)."""
    rate = data.draw(st.integers(0, trials)) / trials
    for p in wilson(round(rate * trials), trials):
        assert (rate - p) ** 2 == pytest.approx(1.959964**2 * p * (1.0 - p) / trials, abs=1e-6)


def test_bootstrap_covers_a_known_difference() -> None:
    rng = np.random.default_rng(3)
    a = rng.normal(0.0, 1.0, 400)
    b = a + rng.normal(1.0, 0.5, 400)
    low, high = bootstrap(mean_difference, a, b)
    assert low < 1.0 < high
    assert high - low < 0.2
    assert bootstrap(deviation_ratio, a, 2.0 * a) == pytest.approx((2.0, 2.0))


def test_a_bootstrap_is_the_same_again_and_that_of_its_pairs() -> None:
    """The 2.5 % and 97.5 % quantiles over 2000 resamples of pairs, from the same stream of random numbers."""
    rng = np.random.default_rng(1)
    a, b = rng.exponential(1.0, 250), rng.exponential(1.3, 250)
    picks = np.random.default_rng(20201203).integers(0, 250, (2000, 250))
    for statistic in (mean_difference, mean_ratio, deviation_ratio):
        by_hand = np.quantile([statistic(a[pick], b[pick]) for pick in picks], [0.025, 0.975])
        assert bootstrap(statistic, a, b) == pytest.approx(tuple(by_hand))
        assert bootstrap(statistic, a, b) == bootstrap(statistic, a, b)


def test_a_sample_that_does_not_scatter_makes_an_infinite_ratio_and_no_noise() -> None:
    with warnings.catch_warnings(action="error"):
        low, high = bootstrap(deviation_ratio, np.array([1.0, 1.0, 2.0]), np.array([1.0, 2.0, 4.0]))
    assert math.isfinite(low)
    assert high == math.inf
