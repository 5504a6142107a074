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


_ROWS = (
    ("arrival_steps_mean", "mean arrival, steps (limit where never)"),
    ("localisation_mean", "mean localisation count"),
)


def draw(summaries: list[Summary], title: str) -> Figure:
    """Above arrival, beneath localisation: the means of the cells that share the value on the axis, and last of each
    kind of world by how intermittent its plumes are."""
    keys = [("robots", "robots"), ("regime", "wind")]
    if len({one["obstacle_share"] for one in summaries}) > 1:
        keys.append(("obstacle_share", "ground covered by obstacles"))
    if len({one["condition"] for one in summaries}) > 1:
        keys.append(("condition", "condition"))
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(3.7 * (len(keys) + 1) + 1.2, 7.6), layout="constrained")
        panels: Any = figure.subplots(2, len(keys) + 1, sharey="row", squeeze=False)
        for row, (name, label) in enumerate(_ROWS):
            for axes, (key, _) in zip(panels[row], keys, strict=False):
                _by_value(axes, summaries, key, name)
            _by_intermittency(panels[row, -1], summaries, name)
            panels[row, 0].set_ylabel(label)
            most = max(1.0, *(one[name] for one in summaries if one[name] is not None))
            if name == "localisation_mean":
                panels[row, 0].set_yscale("symlog", linthresh=100.0)
            panels[row, 0].set_ylim(0.0, 1.05 * most if name == "arrival_steps_mean" else 2.0 * most)
        for axes, words in zip(
            panels[1], [*(word for _, word in keys), "intermittency of the plume"], strict=True
        ):
            axes.set_xlabel(words)
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 6), frameon=False)
        figure.suptitle(title)
    return figure


def _by_value(axes: Any, summaries: list[Summary], key: str, name: str) -> None:
    values = _ordered({one[key] for one in summaries})
    numeric = key == "robots"
    places = np.array(values, np.float64) if numeric else np.arange(len(values), dtype=np.float64)
    for number, strategy in enumerate(_strategies(summaries)):
        means = [_mean(summaries, strategy, name, **{key: value}) for value in values]
        aside = 0.0 if numeric else 0.06 * number
        axes.plot(places + aside, means, "-" if numeric else ":", label=strategy, **_look(strategy, number))
    if not numeric:
        words = [share_words(value) if key == "obstacle_share" else str(value) for value in values]
        axes.set_xticks(places, words, rotation=25 if max(map(len, words)) > 13 else 0)
        axes.set_xlim(-0.4, len(values) - 0.6 + 0.06 * len(_strategies(summaries)))
    axes.grid(alpha=0.25)


def _by_intermittency(axes: Any, summaries: list[Summary], name: str) -> None:
    """A point for each kind of world (regime, obstacles) of the first condition."""
    plain = [one for one in summaries if one["condition"] == summaries[0]["condition"]]
    kinds: dict[tuple[str, float], float] = {
        (one["regime"], one["obstacle_share"]): one["intermittency"]
        for one in plain
        if one["intermittency"] is not None
    }
    for number, strategy in enumerate(_strategies(plain)):
        means = [_mean(plain, strategy, name, regime=regime, obstacle_share=share) for regime, share in kinds]
        axes.plot(list(kinds.values()), means, linestyle="", **_look(strategy, number))
    axes.grid(alpha=0.25)


def _strategies(summaries: Sequence[Summary]) -> list[str]:
    return list(dict.fromkeys(one["strategy"] for one in summaries))


def _look(strategy: str, number: int) -> dict[str, Any]:
    return {
        "color": _COLOURS.get(strategy, "#222222"),
        "marker": _MARKERS[number % len(_MARKERS)],
        "markersize": 5.0,
    }


def _mean(summaries: list[Summary], strategy: str, name: str, **values: Any) -> float:
    """Over the cells of one strategy with these values, by their trials."""
    mine = [
        one
        for one in summaries
        if one["strategy"] == strategy
        and one[name] is not None
        and all(one[key] == value for key, value in values.items())
    ]
    trials = sum(one["trials"] for one in mine)
    return sum(one[name] * one["trials"] for one in mine) / trials if trials else np.nan


def _ordered(values: set[Any]) -> list[Any]:
    order = ("laminar", "transitional", "turbulent")
    return sorted(values, key=lambda value: (order.index(value) if value in order else -1, value))
