"""Verdicts on claims about cells of trials: a larger mean, a larger deviation, a threshold of the failure rate."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd

from simvehicle.experiments.experiment import Outcome, Verdict
from simvehicle.experiments.statistics import (
    Floats,
    Interval,
    bootstrap,
    deviation_ratio,
    mean_difference,
    wilson,
)
from simvehicle.experiments.table import columns, select
from simvehicle.trials.cell import Cell

BEGINS = 0.95
"""A strategy has begun to fail where fewer trials than this succeed."""


def pairs(rows: pd.DataFrame, a: Cell, b: Cell, name: str) -> tuple[Floats, Floats]:
    """One column of two cells' paired trials, where both have it."""
    first, second = columns(rows, a, name), columns(rows, b, name)
    both = np.isfinite(first) & np.isfinite(second)
    return first[both], second[both]


def above(interval: Interval, least: float) -> Outcome:
    """Whether a quantity is above `least`, by its 95 % interval."""
    low, high = interval
    return "holds" if low > least else "does not hold" if high < least else "undecided"


def larger_mean(rows: pd.DataFrame, a: Cell, b: Cell, name: str, claim: str) -> Verdict:
    """The verdict on "b's mean is above a's" of a column in seconds."""
    first, second = pairs(rows, a, b, name)
    if len(first) < 2:
        return Verdict(claim, "undecided", "fewer than two paired trials")
    low, high = bootstrap(mean_difference, first, second)
    statistic = (
        f"{a.strategy} {first.mean() / 60:.1f} min, {b.strategy} {second.mean() / 60:.1f} min; "
        f"difference {mean_difference(first, second) / 60:+.1f} min (95 % {low / 60:+.1f}..{high / 60:+.1f}, "
        f"{len(first)} pairs)"
    )
    return Verdict(claim, above((low, high), 0.0), statistic)


def larger_deviation(rows: pd.DataFrame, a: Cell, b: Cell, name: str, claim: str) -> Verdict:
    """The verdict on "b's standard deviation is above a's" of a column in seconds."""
    first, second = pairs(rows, a, b, name)
    if len(first) < 3:
        return Verdict(claim, "undecided", "fewer than three paired trials")
    low, high = bootstrap(deviation_ratio, first, second)
    statistic = (
        f"{a.strategy} {np.std(first, ddof=1) / 60:.1f} min, {b.strategy} {np.std(second, ddof=1) / 60:.1f} min; "
        f"ratio {deviation_ratio(first, second):.2f} (95 % {low:.2f}..{high:.2f}, {len(first)} pairs)"
    )
    return Verdict(claim, above((low, high), 1.0), statistic)


def begins_to_fail(rows: pd.DataFrame, cells: Sequence[Cell]) -> Interval:
    """The range of rates in which a strategy begins to fail: from where it may have to where it surely has.

    Upper end: the first rate at which the whole of Wilson's interval is below 95 %; lower end: the last rate before
    it at which at least 95 % of the trials succeed. The sampling error and the grid of rates are both in it.
    """
    low, high = 0.0, math.inf
    surely = False
    for cell in sorted(cells, key=lambda c: c.failure_rate):
        mine = select(rows, cell)
        interval = wilson(int(mine["success"].sum()), len(mine))
        if not surely and mine["success"].mean() >= BEGINS:
            low = cell.failure_rate
        if interval[1] < BEGINS:
            high = min(high, cell.failure_rate)
            surely = True
    return low, high


def within(found: Interval, claimed: Interval) -> Outcome:
    """Whether a rate that lies somewhere in `found` lies in the range `claimed`. It is surely not above `found`."""
    if found[1] <= claimed[0] or found[0] > claimed[1]:
        return "does not hold"
    return "holds" if claimed[0] <= found[0] and found[1] <= claimed[1] else "undecided"
