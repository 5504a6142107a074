"""The claims of the fluxotaxis paper's first study, judged on paired worlds and starts, and what explains them.

Two tracers are compared by the Wilcoxon rank-sum test over all trials, as the paper does, and by Student's interval
of the paired difference over the worlds' means, for trials of one world are not independent. A claim holds where
both say so.
"""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from scipy import stats

from simvehicle.experiments.experiment import Experiment, Outcome, Verdict
from simvehicle.experiments.tracing.traced_table import mean_interval

_SIGNIFICANT = {"fluxo-1": 0.05, "fluxo-2": 0.01}
"""The paper's levels."""
_PAPER = {
    "fluxo-1": {
        "success": {"fluxotaxis": 0.746, "chemotaxis": 0.3184, "anemotaxis": 0.0667},
        "proximity": {"fluxotaxis": 0.9235, "chemotaxis": 0.6745, "anemotaxis": 0.6843},
    },
    "fluxo-2": {"containment": {"fluxotaxis": 0.491, "anemotaxis": 0.084, "chemotaxis": 0.072}},
}
_WORDS = {
    "success": "has the source inside at the end more often than",
    "proximity": "ends nearer to the source than",
    "containment": "contains the source longer than",
}


def judge(experiment: Experiment, rows: pd.DataFrame) -> list[Verdict]:
    """A verdict on each claim that the rows can decide."""
    name = experiment.name
    flown = set(rows["strategy"])
    found = []
    for measure, order in _PAPER[name].items():
        for rival in ("chemotaxis", "anemotaxis"):
            if {"fluxotaxis", rival} <= flown:
                claim = f"fluxotaxis {_WORDS[measure]} {rival}"
                found.append(_compare(rows, measure, "fluxotaxis", rival, claim, name, order))
                if rows["plume"].nunique() > 1:
                    found += [
                        _compare(mine, measure, "fluxotaxis", rival, f"{claim}: {plume} plumes", name, {})
                        for plume, mine in rows.groupby("plume", sort=False)
                    ]
    if name == "fluxo-1" and rows["factor"].nunique() > 1:
        found += _by_factor(rows, flown)
    return found


def _compare(
    rows: pd.DataFrame, measure: str, better: str, worse: str, claim: str, name: str, paper: dict[str, float]
) -> Verdict:
    first, second = _paired(rows, better), _paired(rows, worse)
    if len(first) < 2 or len(first) != len(second):
        return Verdict(claim, "undecided", "fewer than two paired trials")
    a, b = (mine[measure].to_numpy(dtype=np.float64) for mine in (first, second))
    probability = float(stats.ranksums(a, b).pvalue)
    low, high = mean_interval(first, a - b)
    outcome: Outcome = "undecided"
    if probability < _SIGNIFICANT[name] and (low > 0.0 or high < 0.0):
        outcome = "holds" if low > 0.0 else "does not hold"
    statistic = (
        f"{a.mean():.3f} and {b.mean():.3f}; difference {(a - b).mean():+.3f} (95 % {low:+.3f}..{high:+.3f} over "
        f"{first['world'].nunique()} worlds), rank-sum p = {probability:.2g}, {len(a)} pairs"
    )
    if paper:
        statistic += f"; the paper: {paper[better]:.3f} and {paper[worse]:.3f}"
    return Verdict(claim, outcome, statistic)


def _by_factor(rows: pd.DataFrame, flown: set[str]) -> list[Verdict]:
    """What the paper says of the greatest radius: success grows with it, and anemotaxis overtakes chemotaxis."""
    found = []
    for strategy in sorted(flown):
        ranks = []
        mine = rows[rows["strategy"] == strategy]
        for _, world in mine.groupby("world"):
            means = world.groupby("factor")["success"].mean()
            if np.ptp(means) > 0.0:
                ranks.append(float(stats.spearmanr(means.index, means).statistic))
        told = ", ".join(
            f"{factor}: {rate:.2f}" for factor, rate in mine.groupby("factor")["success"].mean().items()
        )
        claim = f"{strategy}: success grows with the greatest radius"
        if len(ranks) < 2:
            found.append(
                Verdict(claim, "undecided", f"by factor {told}; fewer than two worlds in which it varies")
            )
            continue
        half = float(stats.t.ppf(0.975, len(ranks) - 1) * np.std(ranks, ddof=1) / math.sqrt(len(ranks)))
        mean = float(np.mean(ranks))
        outcome: Outcome = "holds" if mean > half else "does not hold" if mean < -half else "undecided"
        statistic = (
            f"by factor {told}; rank correlation {mean:+.2f} (95 % {mean - half:+.2f}..{mean + half:+.2f})"
        )
        found.append(Verdict(claim, outcome, statistic))
    if {"anemotaxis", "chemotaxis"} <= flown:
        widest = rows[rows["factor"] == rows["factor"].max()]
        claim = "with the widest lattice anemotaxis ends nearer to the source than chemotaxis"
        found.append(_compare(widest, "proximity", "anemotaxis", "chemotaxis", claim, "fluxo-1", {}))
    return found


def _paired(rows: pd.DataFrame, strategy: str) -> pd.DataFrame:
    """A tracer's trials, in an order that is the same for all."""
    return rows[rows["strategy"] == strategy].sort_values(["world", "factor", "trial"])


def notes(experiment: Experiment, rows: pd.DataFrame) -> str:
    """Which tracer wins in which plumes."""
    measure = "success" if experiment.name == "fluxo-1" else "containment"
    flown = list(dict.fromkeys(rows["strategy"]))
    text = (
        "## Who wins when\n\nBy the plume's puffs and the wind's regime, with what a sensor at rest reads inside the "
        "plume: the share of the time without gas, the 99th percentile over the mean in time. "
        f"The numbers of the tracers are their mean {measure}.\n\n"
        "| plume | regime | worlds | intermittency | peak to mean | " + " | ".join(flown) + " |\n"
        "| --- | --- | --- | --- | --- |" + " --- |" * len(flown) + "\n"
    )
    for (plume, regime), mine in rows.groupby(["plume", "regime"], sort=False):
        once = mine.drop_duplicates("world")
        means = mine.groupby("strategy")[measure].mean()
        best = means.idxmax()
        numbers = [f"**{means[one]:.3f}**" if one == best else f"{means[one]:.3f}" for one in flown]
        text += f"| {plume} | {regime} | {len(once)} | {once['intermittency'].mean():.2f} "
        text += f"| {once['peak_to_mean'].mean():.1f} | " + " | ".join(numbers) + " |\n"
    return text + "\n"
