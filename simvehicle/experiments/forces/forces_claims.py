"""Do the paper's three claims hold? Search times of paired trials, those that did not arrive counted at the limit."""

from __future__ import annotations

import itertools

import numpy as np
import pandas as pd
from scipy import stats

from simvehicle.experiments.claims import above
from simvehicle.experiments.experiment import Experiment, Verdict
from simvehicle.experiments.forces.forces_cells import ForcesCell, select, times_s
from simvehicle.experiments.forces.forces_flights import TRACKER
from simvehicle.experiments.statistics import Floats, bootstrap, mean_difference


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


def _difference(
    claim: str, slower: Floats, faster: Floats, names: tuple[str, str], least: int = 2
) -> Verdict:
    """The verdict on "the second's search times are below the first's", of paired trials."""
    if min(len(slower), len(faster)) < least or len(slower) != len(faster):
        return Verdict(claim, "undecided", "too few paired trials")
    low, high = bootstrap(mean_difference, faster, slower)
    p = float(stats.mannwhitneyu(slower, faster, alternative="greater").pvalue)
    statistic = (
        f"{names[0]} {slower.mean():.0f} s, {names[1]} {faster.mean():.0f} s; difference "
        f"{slower.mean() - faster.mean():+.0f} s (95 % {low:+.0f}..{high:+.0f}, {len(slower)} pairs; "
        f"rank-sum p {_p(p)})"
    )
    return Verdict(claim, above((low, high), 0.0), statistic)


def _p(p: float) -> str:
    return "below 0.001" if p < 0.001 else f"{p:.3f}"


def _by_size(cells: list[ForcesCell], rows: pd.DataFrame) -> list[Verdict]:
    found = []
    sizes = _sizes(cells)
    for small, large in itertools.pairwise(sizes):
        a, b = (times_s(_pooled(cells, rows, TRACKER, size)) for size in (small, large))
        claim = f"a larger swarm is faster: {large} robots than {small}"
        found.append(_difference(claim, a, b, (f"{small} robots", f"{large}")))
    return found


def _gain(cells: list[ForcesCell], rows: pd.DataFrame, **fixed: float) -> Floats:
    """By how many seconds the largest swarm is faster than the smallest, trial by trial."""
    sizes = _sizes(cells)
    a, b = (times_s(_pooled(cells, rows, TRACKER, size, **fixed)) for size in (sizes[0], sizes[-1]))
    return a - b if len(a) == len(b) else np.zeros(0)


def _more_so(cells: list[ForcesCell], rows: pd.DataFrame) -> list[Verdict]:
    """Whether the largest swarm's lead over the smallest is larger where the paper says so."""
    found = []
    questions = (
        ("obstacles", "the more so the more obstacles there are", "obstacles", False),
        ("emission_gps", "the more so the weaker the source", "g/s", True),
    )
    for name, words, unit, smallest in questions:
        values = sorted({getattr(cell, name) for cell in cells if cell.variant == TRACKER})
        if len(values) < 2 or len(_sizes(cells)) < 2:
            continue
        hard, easy = (values[0], values[-1]) if smallest else (values[-1], values[0])
        more, less = _gain(cells, rows, **{name: hard}), _gain(cells, rows, **{name: easy})
        claim = f"a larger swarm is faster, {words}"
        if min(len(more), len(less)) < 2 or len(more) != len(less):
            found.append(Verdict(claim, "undecided", "too few trials"))
            continue
        low, high = bootstrap(mean_difference, less, more)
        sizes = _sizes(cells)
        statistic = (
            f"lead of {sizes[-1]} over {sizes[0]} robots: {more.mean():+.0f} s with {hard:g} {unit}, "
            f"{less.mean():+.0f} s with {easy:g}; difference {more.mean() - less.mean():+.0f} s "
            f"(95 % {low:+.0f}..{high:+.0f}, {len(more)} trials each)"
        )
        found.append(Verdict(claim, above((low, high), 0.0), statistic))
    return found


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
        a, b = (pd.concat(all_)["success"].to_numpy(dtype=float) for all_ in (upwind, tracker))
        low, high = bootstrap(mean_difference, a, b)
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
    return ForcesCell(
        arena=cell.arena,
        variant=TRACKER,
        robots=cell.robots,
        obstacles=cell.obstacles,
        emission_gps=cell.emission_gps,
    )


def _by_cohesion(cells: list[ForcesCell], rows: pd.DataFrame) -> list[Verdict]:
    """Whether those that smell nothing follow by cohesion: with it, more of the others are near who arrives."""
    without = [cell for cell in cells if cell.variant == "no-cohesion" and cell.robots > 1]
    if not without:
        return []
    a = pd.concat([select(rows, cell) for cell in without])
    b = pd.concat([select(rows, _tracker_beside(cell)) for cell in without])
    if len(a) != len(b):
        return []
    found = []
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
        low, high = bootstrap(mean_difference, first, second)
        statistic = (
            f"with cohesion {second.mean():.1f} {unit}, without {first.mean():.1f}; difference "
            f"{second.mean() - first.mean():+.1f} (95 % {low:+.1f}..{high:+.1f}, {both.sum()} pairs)"
        )
        found.append(Verdict(claim, above((low, high), 0.0), statistic))
    return found
