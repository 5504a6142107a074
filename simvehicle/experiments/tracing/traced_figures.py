"""Arrival and localisation of traced plumes: by swarm size, by regime, and by the obstacles' share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from simvehicle.experiments.experiment import Summary
from simvehicle.experiments.tracing.traced_table import share_words

_COLOURS = {
    "casting": "#8c8c8c",
    "chemotaxis": "#e66100",
    "anemotaxis": "#2166ac",
    "fluxotaxis": "#1b7837",
    "virtual-forces": "#6a3d9a",
    "upwind": "#74add1",
    "surge-cast": "#b2182b",
    "spiral-surge": "#d6604d",
    "infotaxis": "#c7b100",
}
_MARKERS = "osD^vP*Xh"
_STYLE: Any = {"axes.spines.top": False, "axes.spines.right": False, "font.size": 10}


def draw(summaries: list[Summary], title: str) -> Figure:
    """Above: arrival, beneath: localisation; the means of the cells that share the value on the axis."""
    by = [("robots", "robots"), ("regime", "wind")]
    if len({one["obstacle_share"] for one in summaries}) > 1:
        by.append(("obstacle_share", "ground covered by obstacles"))
    if len({one["condition"] for one in summaries}) > 1:
        by.append(("condition", "condition"))
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(4.1 * len(by) + 1.6, 7.6), layout="constrained")
        panels: Any = figure.subplots(2, len(by), sharey="row", squeeze=False)
        for column, (key, label) in enumerate(by):
            values = _ordered({one[key] for one in summaries})
            for row, name in enumerate(("arrival_steps_mean", "localisation_mean")):
                _panel(panels[row, column], summaries, key, values, name)
            panels[1, column].set_xlabel(label)
        panels[0, 0].set_ylabel("mean arrival, steps (limit where never)")
        panels[1, 0].set_ylabel("mean localisation count")
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 6), frameon=False)
        figure.suptitle(title)
    return figure


def _panel(axes: Any, summaries: list[Summary], key: str, values: Sequence[Any], name: str) -> None:
    strategies = list(dict.fromkeys(one["strategy"] for one in summaries))
    numeric = key == "robots"
    places = np.array(values, np.float64) if numeric else np.arange(len(values), dtype=np.float64)
    for number, strategy in enumerate(strategies):
        means = [_mean(summaries, strategy, key, value, name) for value in values]
        aside = 0.0 if numeric else 0.06 * (number - 0.5 * (len(strategies) - 1))
        axes.plot(
            places + aside,
            means,
            "-" if numeric or key == "obstacle_share" else ":",
            color=_COLOURS.get(strategy, "#222222"),
            marker=_MARKERS[number % len(_MARKERS)],
            markersize=5.0,
            label=strategy,
        )
    if not numeric:
        words = [share_words(value) if key == "obstacle_share" else str(value) for value in values]
        axes.set_xticks(places, words, rotation=20 if max(map(len, words)) > 8 else 0)
        axes.set_xlim(-0.4, len(values) - 0.6)
    if name == "localisation_mean":
        axes.set_yscale("symlog", linthresh=100.0)
    axes.set_ylim(bottom=0.0)
    axes.grid(alpha=0.25)


def _mean(summaries: list[Summary], strategy: str, key: str, value: Any, name: str) -> float:
    """Over the cells of one strategy with this value, by their trials."""
    mine = [one for one in summaries if one["strategy"] == strategy and one[key] == value]
    mine = [one for one in mine if one[name] is not None]
    trials = sum(one["trials"] for one in mine)
    return sum(one[name] * one["trials"] for one in mine) / trials if trials else np.nan


def _ordered(values: set[Any]) -> list[Any]:
    order = ("laminar", "transitional", "turbulent")
    return sorted(values, key=lambda value: (order.index(value) if value in order else -1, value))
