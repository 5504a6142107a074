"""One row a cell of traced plumes: arrival, localisation, success; non-arrivals count as the limit of steps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from simvehicle.experiments.experiment import Listing, Summary
from simvehicle.experiments.statistics import Floats, Interval, wilson
from simvehicle.experiments.table import percent
from simvehicle.experiments.tracing.traced_cells import TracedCell

_CONFIDENCE = 0.95
_MOST_ROWS = 60
_UNKNOWN = (math.nan, math.nan)


def select(rows: pd.DataFrame, cell: TracedCell) -> pd.DataFrame:
    """The rows of one cell, by world and trial."""
    mine = (
        (rows["strategy"] == cell.strategy)
        & (rows["robots"] == cell.robots)
        & (rows["regime"] == cell.regime)
        & (rows["obstacle_share"] == cell.obstacle_share)
        & (rows["condition"] == cell.condition)
    )
    return rows[mine].sort_values(["world", "trial"])


def arrivals(rows: pd.DataFrame) -> Floats:
    """Steps to arrival, the limit where nobody arrived (censored)."""
    found: Floats = rows["arrival_steps"].fillna(rows["limit_steps"]).to_numpy(dtype=np.float64)
    return found


def mean_interval(rows: pd.DataFrame, values: Floats) -> Interval:
    """Of the mean, by Student's t over the worlds' means, for trials of one world are not independent; of a single
    world over its trials."""
    means = pd.Series(values).groupby(rows["world"].to_numpy()).mean().to_numpy()
    if len(means) < 2:
        means = values
    if len(means) < 2:
        return math.nan, math.nan
    half = float(
        stats.t.ppf(0.5 + 0.5 * _CONFIDENCE, len(means) - 1) * means.std(ddof=1) / math.sqrt(len(means))
    )
    return float(means.mean()) - half, float(means.mean()) + half


def summarise(rows: pd.DataFrame, cell: TracedCell) -> Summary:
    """The JSON row of a cell."""
    mine = select(rows, cell)
    trials, arrived = len(mine), int(mine["success"].sum())
    steps = arrivals(mine)
    localised = mine["localisation"].to_numpy(dtype=np.float64)
    low, high = wilson(arrived, trials)
    limit = float(mine["limit_steps"].max()) if trials else math.nan
    arrival_low, arrival_high = np.clip(mean_interval(mine, steps), 0.0, limit) if trials else _UNKNOWN
    localisation_low, localisation_high = (
        np.clip(mean_interval(mine, localised), 0.0, None) if trials else _UNKNOWN
    )
    return {
        "strategy": cell.strategy,
        "robots": cell.robots,
        "regime": cell.regime,
        "obstacle_share": cell.obstacle_share,
        "condition": cell.condition,
        "trials": trials,
        "arrival_steps_mean": _number(steps.mean()) if trials else None,
        "arrival_steps_low": _number(arrival_low),
        "arrival_steps_high": _number(arrival_high),
        "arrival_steps_median": _number(np.median(steps)) if trials else None,
        "censored": trials - arrived,
        "localisation_mean": _number(localised.mean()) if trials else None,
        "localisation_low": _number(localisation_low),
        "localisation_high": _number(localisation_high),
        "success_rate": arrived / trials if trials else None,
        "success_low": low,
        "success_high": high,
        "contact_steps_mean": _number(mine["contact_steps"].mean()),
        "lost_mean": _number(mine["lost"].mean()),
        "intermittency": _number(mine["intermittency"].mean()),
        "peak_to_mean": _number(mine["peak_to_mean"].mean()),
    }


def markdown(name: str, summaries: Sequence[Summary]) -> str:
    """The cells, a row each; of many the means over the obstacles' shares, and where the rest is."""
    shown = list(summaries)
    text = ""
    if len(shown) > _MOST_ROWS:
        shown = _over_shares(shown)
        text = (
            f"Means over the obstacles. All {len(summaries)} cells with all columns and their intervals are in "
            f"[{name}.csv]({name}.csv).\n\n"
        )
    some = len({one["condition"] for one in shown}) > 1
    head = ["strategy", "robots", "regime", *(["condition"] if some else [])]
    head += [] if text else ["obstacles"]
    head += ["trials", "arrived", "arrival, steps", "localisation"]
    text += "| " + " | ".join(head) + " |\n| " + " | ".join("---" for _ in head) + " |\n"
    for one in shown:
        cells = [one["strategy"], str(one["robots"]), one["regime"], *([one["condition"]] if some else [])]
        cells += [] if len(summaries) > _MOST_ROWS else [share_words(one["obstacle_share"])]
        cells += [str(one["trials"]), percent(one, "success_rate")]
        text += "| " + " | ".join(
            [*cells, _with_interval(one, "arrival_steps"), _with_interval(one, "localisation")]
        )
        text += " |\n"
    return text


def _over_shares(summaries: Sequence[Summary]) -> list[Summary]:
    """Means by trials of the cells that differ in nothing but their obstacles."""
    found: dict[tuple[str, ...], list[Summary]] = {}
    for one in summaries:
        kind = (one["condition"], one["regime"], one["robots"], one["strategy"])
        found.setdefault(kind, []).append(one)
    joined = []
    for cells in found.values():
        trials = sum(one["trials"] for one in cells)
        joined.append(
            {
                **{key: cells[0][key] for key in ("strategy", "robots", "regime", "condition")},
                "trials": trials,
                **{
                    key: sum(one[key] * one["trials"] for one in cells) / trials
                    for key in ("success_rate", "arrival_steps_mean", "localisation_mean")
                },
            }
        )
    return joined


def _with_interval(one: Summary, name: str) -> str:
    low, high = one.get(f"{name}_low"), one.get(f"{name}_high")
    interval = "" if low is None else f" ({_whole(low)}..{_whole(high)})"
    return _whole(one[f"{name}_mean"]) + interval


def listing(summaries: Sequence[Summary]) -> Listing:
    """The table for a terminal, as narrow as can be."""
    some = len({one["condition"] for one in summaries}) > 1
    heads = ("strategy", "robots", "wind", "obstacles", *(("condition",) if some else ()))
    rows = [
        [
            one["strategy"],
            str(one["robots"]),
            one["regime"],
            share_words(one["obstacle_share"]),
            *([one["condition"]] if some else []),
            percent(one, "success_rate"),
            _whole(one["arrival_steps_mean"]),
            _whole(one["arrival_steps_median"]),
            _whole(one["localisation_mean"]),
        ]
        for one in summaries
    ]
    numbers = ("arrived", "steps", "median", "localised")
    return Listing(
        "mean steps to arrival, all steps where never; localisation count",
        (*heads, *numbers),
        len(heads),
        rows,
    )


def share_words(share: float) -> str:
    return f"{100.0 * share:g} %"


def _whole(value: float | None) -> str:
    return "-" if value is None else f"{value:.0f}"


def _number(value: Any) -> float | None:
    number = float(value)
    return number if math.isfinite(number) else None
