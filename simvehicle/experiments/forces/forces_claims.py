"""Do the paper's three claims hold? Search times of paired trials, those that did not arrive counted at the limit.

Intervals are Student's over the worlds' means: trials in one plume are not independent. The rank-sum test over all
trials is told beside them.
"""

from __future__ import annotations

import itertools

import msgspec
import numpy as np
import pandas as pd
from scipy import stats

from simvehicle.experiments.claims import above
from simvehicle.experiments.experiment import Experiment, Verdict
from simvehicle.experiments.forces.forces_cells import ForcesCell, select, times_s
from simvehicle.experiments.forces.forces_flights import TRACKER
from simvehicle.experiments.statistics import Floats, Interval
from simvehicle.experiments.tracing.traced_table import mean_interval


def judge(experiment: Experiment, rows: pd.DataFrame) -> list[Verdict]:
    """A verdict on each claim that the experiment's cells can decide."""
    cells: list[ForcesCell] = list(experiment.cells)
    found = _by_size(cells, rows)
    found += _more_so(cells, rows)
    found += _against_upwind(cells, rows)
    return found + _by_cohesion(cells, rows)


def _sizes(cells: list[ForcesCell]) -> list[int]:
    return sorted({cell.robots for cell in cells})


def _pooled(
    cells: list[ForcesCell], rows: pd.DataFrame, variant: str, robots: int, **fixed: float
) -> pd.DataFrame:
    """The rows of all cells of a variant and swarm size that have these values."""
    mine = [
        select(rows, cell)
        for cell in cells
        if cell.variant == variant
        and cell.robots == robots
        and all(getattr(cell, name) == value for name, value in fixed.items())
    ]
    return pd.concat(mine) if mine else rows.iloc[:0]


def _by_size(cells: list[ForcesCell], rows: pd.DataFrame) -> list[Verdict]:
    """Of every size and the next larger, over all obstacles and emissions."""
    found = []
    for small, large in itertools.pairwise(_sizes(cells)):
        first, second = (_pooled(cells, rows, TRACKER, size) for size in (small, large))
        claim = f"a larger swarm is faster: {large} robots than {small}"
        if len(first) < 2 or len(first) != len(second):
            found.append(Verdict(claim, "undecided", "too few paired trials"))
            continue
        slower, faster = times_s(first), times_s(second)
        low, high = mean_interval(first, slower - faster)
        p = float(stats.ranksums(slower, faster).pvalue)
        statistic = (
            f"{small} robots {slower.mean():.0f} s, {large} {faster.mean():.0f} s; lead "
            f"{(slower - faster).mean():+.0f} s (95 % {low:+.0f}..{high:+.0f} over {first['world'].nunique()} "
            f"worlds, {len(slower)} pairs; rank-sum p = {p:.2g})"
        )
        found.append(Verdict(claim, above((low, high), 0.0), statistic))
    return found


def _lead(cells: list[ForcesCell], rows: pd.DataFrame, **fixed: float) -> tuple[pd.DataFrame, Floats]:
    """By how many seconds the largest swarm is faster than the smallest, trial by trial, and whose these are."""
    sizes = _sizes(cells)
    first, second = (_pooled(cells, rows, TRACKER, size, **fixed) for size in (sizes[0], sizes[-1]))
    if len(first) != len(second):
        return rows.iloc[:0], np.zeros(0)
    return first, times_s(first) - times_s(second)


def _more_so(cells: list[ForcesCell], rows: pd.DataFrame) -> list[Verdict]:
    """Whether the largest swarm's lead over the smallest is larger where the paper says so."""
    found = []
    questions = (
        ("obstacles", "the more so the more obstacles there are", "obstacles", False),
        ("emission_gps", "the more so the weaker the source", "g/s", True),
    )
    for name, words, unit, least in questions:
        values = sorted({getattr(cell, name) for cell in cells if cell.variant == TRACKER})
        if len(values) < 2 or len(_sizes(cells)) < 2:
            continue
        hard, easy = (values[0], values[-1]) if least else (values[-1], values[0])
        (those, more), (others, less) = (_lead(cells, rows, **{name: value}) for value in (hard, easy))
        claim = f"a larger swarm is faster, {words}"
        if min(those["world"].nunique(), others["world"].nunique()) < 2:
            found.append(Verdict(claim, "undecided", "too few worlds"))
            continue
        # Other obstacles are other worlds; another emission is the same air.
        low, high = mean_interval(those, more - less) if least else _welch(those, more, others, less)
        sizes = _sizes(cells)
        statistic = (
            f"lead of {sizes[-1]} over {sizes[0]} robots: {more.mean():+.0f} s with {hard:g} {unit}, "
            f"{less.mean():+.0f} s with {easy:g}; difference {more.mean() - less.mean():+.0f} s "
            f"(95 % {low:+.0f}..{high:+.0f}, {len(more)} trials each)"
        )
        found.append(Verdict(claim, above((low, high), 0.0), statistic))
    return found


def _welch(those: pd.DataFrame, a: Floats, others: pd.DataFrame, b: Floats) -> Interval:
    """95 % interval of the difference of two means of different worlds, over the worlds' means (Welch 1947)."""
    means = [
        pd.Series(values).groupby(mine["world"].to_numpy()).mean()
        for mine, values in ((those, a), (others, b))
    ]
    if all(np.ptp(one) == 0.0 for one in means):
        difference = float(means[0].mean() - means[1].mean())
        return difference, difference
    found = stats.ttest_ind(*means, equal_var=False).confidence_interval(0.95)
    return float(found.low), float(found.high)


def _against_upwind(cells: list[ForcesCell], rows: pd.DataFrame) -> list[Verdict]:
    """Whether the tracker arrives more often than who goes upwind, by obstacles, or in the large arena by size."""
    found = []
    compared = [cell for cell in cells if cell.variant == "upwind"]
    large = any(cell.arena == "large" for cell in cells)
    groups = [("robots", size) for size in _sizes(cells)] if large else []
    groups = groups or [("obstacles", number) for number in sorted({cell.obstacles for cell in compared})]
    for name, value in groups:
        upwind = [select(rows, cell) for cell in compared if getattr(cell, name) == value]
        tracker = [select(rows, _tracker_beside(cell)) for cell in compared if getattr(cell, name) == value]
        if not upwind or any(mine.empty for mine in tracker):
            continue
        whose = pd.concat(upwind)
        a, b = whose["success"].to_numpy(dtype=float), pd.concat(tracker)["success"].to_numpy(dtype=float)
        low, high = mean_interval(whose, b - a)
        words = f"{value:g} robots" if large else f"{value:g} obstacles"
        what = "the swarm follows a meandering plume" if large else "the swarm finds the source"
        statistic = (
            f"arrived: {100 * b.mean():.0f} %, upwind alone {100 * a.mean():.0f} %; difference "
            f"{100 * (b.mean() - a.mean()):+.0f} (95 % {100 * low:+.0f}..{100 * high:+.0f}, {len(a)} pairs)"
        )
        claim = f"{what} where going upwind does not: {words}"
        found.append(Verdict(claim, above((low, high), 0.0), statistic))
    return found


def _tracker_beside(cell: ForcesCell) -> ForcesCell:
    """The tracker's cell beside another variant's."""
    return msgspec.structs.replace(cell, variant=TRACKER)


def _by_cohesion(cells: list[ForcesCell], rows: pd.DataFrame) -> list[Verdict]:
    """What cohesion does: whether those that smell nothing follow by it, so that more are near who arrives."""
    without = [cell for cell in cells if cell.variant == "no-cohesion" and cell.robots > 1]
    if not without:
        return []
    a = pd.concat([select(rows, cell) for cell in without])
    b = pd.concat([select(rows, _tracker_beside(cell)) for cell in without])
    if len(a) != len(b):
        return []
    slower, faster = times_s(a), times_s(b)
    low, high = mean_interval(a, slower - faster)
    statistic = (
        f"with cohesion {faster.mean():.0f} s, without {slower.mean():.0f} s; lead {(slower - faster).mean():+.0f} s "
        f"(95 % {low:+.0f}..{high:+.0f} over {a['world'].nunique()} worlds, {len(a)} pairs)"
    )
    found = [Verdict("cohesion makes the search faster", above((low, high), 0.0), statistic)]
    for name, claim, unit, scale in (
        (
            "followers",
            "robots that smell nothing follow by cohesion",
            "% of the others within hearing",
            100.0,
        ),
        ("nearest_pair_m", "cohesion keeps robots from close encounters", "cm at the nearest", 100.0),
    ):
        first, second = a[name].to_numpy(dtype=float), b[name].to_numpy(dtype=float)
        both = np.isfinite(first) & np.isfinite(second)
        if both.sum() < 2:
            found.append(Verdict(claim, "undecided", "fewer than two pairs that both arrive"))
            continue
        first, second = scale * first[both], scale * second[both]
        low, high = mean_interval(a[both], second - first)
        statistic = (
            f"with cohesion {second.mean():.1f} {unit}, without {first.mean():.1f}; difference "
            f"{second.mean() - first.mean():+.1f} (95 % {low:+.1f}..{high:+.1f}, {both.sum()} pairs)"
        )
        found.append(Verdict(claim, above((low, high), 0.0), statistic))
    return found
