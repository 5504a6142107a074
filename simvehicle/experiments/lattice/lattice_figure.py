"""The paper's figures 6 and 7 from our own rows: against the greatest radius, and against the obstacles."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from simvehicle.experiments.experiment import Summary

_COLOURS = {"fluxotaxis": "#6a3d9a", "chemotaxis": "#1b7837", "anemotaxis": "#e66100", "casting": "#555555"}
_STYLE: Any = {"axes.spines.top": False, "axes.spines.right": False, "font.size": 10}


def by_factor(summaries: list[Summary], title: str) -> Figure:
    """Proximity above, success below, against the expansion factor; a column a kind of plume."""
    rows = (
        ("proximity_mean", "proximity_low", "proximity_high"),
        ("success_rate", "success_low", "success_high"),
    )
    return _panels(summaries, title, rows, ("proximity at the end", "source inside at the end"), "factor")


def by_obstacles(summaries: list[Summary], title: str) -> Figure:
    """Containment above, success below, against the share of the ground under obstacles."""
    rows = (
        ("containment_mean", "containment_low", "containment_high"),
        ("success_rate", "success_low", "success_high"),
    )
    return _panels(
        summaries, title, rows, ("share of the time inside", "source inside at the end"), "obstacle_share"
    )


def _panels(
    summaries: list[Summary],
    title: str,
    rows: tuple[tuple[str, str, str], ...],
    words: tuple[str, ...],
    along: str,
) -> Figure:
    plumes = list(dict.fromkeys(one["plume"] for one in summaries))
    scale = 100.0 if along == "obstacle_share" else 1.0
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(max(6.4, 4.6 * len(plumes)), 6.6), layout="constrained")
        panels: Any = figure.subplots(len(rows), len(plumes), sharex=True, sharey="row", squeeze=False)
        for column, plume in enumerate(plumes):
            for row, (mean, low, high) in enumerate(rows):
                axes = panels[row][column]
                for place, strategy in enumerate(dict.fromkeys(one["strategy"] for one in summaries)):
                    line = [
                        one
                        for one in summaries
                        if one["strategy"] == strategy and one["plume"] == plume and one[mean] is not None
                    ]
                    line.sort(key=lambda one: float(one[along]))
                    beside = 0.006 * (place - 1) * scale * (max(one[along] for one in summaries) or 1.0)
                    axes.errorbar(
                        [scale * one[along] + beside for one in line],
                        [one[mean] for one in line],
                        yerr=(
                            [max(one[mean] - _or(one[low], one[mean]), 0.0) for one in line],
                            [max(_or(one[high], one[mean]) - one[mean], 0.0) for one in line],
                        ),
                        fmt="o-",
                        ms=4,
                        capsize=2,
                        color=_COLOURS.get(strategy, "#555555"),
                        label=strategy,
                    )
                axes.grid(alpha=0.25)
                axes.set_ylim(0.0, 1.04)
                if column == 0:
                    axes.set_ylabel(words[row])
            panels[0][column].set_title(f"{plume} plumes")
            panels[-1][column].set_xlabel(
                "greatest radius, in 0.25 m" if along == "factor" else "ground under obstacles, %"
            )
        handles, labels = panels[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
        figure.suptitle(title)
    return figure


def _or(value: float | None, other: float) -> float:
    return other if value is None else value
