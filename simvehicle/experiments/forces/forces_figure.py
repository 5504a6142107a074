"""The paper's figures 9 and 10 from our own rows: search times and arrivals against the swarm's size."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from simvehicle.experiments.experiment import Summary
from simvehicle.experiments.forces.forces_flights import TRACKER

_COLOURS = {TRACKER: "#6a3d9a", "no-cohesion": "#1b7837", "upwind": "#e66100"}
_NAMES = {TRACKER: "virtual forces", "no-cohesion": "without cohesion", "upwind": "upwind only"}
_LINES = ("-", "--", ":")
_STYLE: Any = {"axes.spines.top": False, "axes.spines.right": False, "font.size": 10}


def times_and_arrivals(summaries: list[Summary], title: str) -> Figure:
    """A column of panels a number of obstacles: mean search time above, share of arrivals below."""
    obstacles = sorted({one["obstacles"] for one in summaries})
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(max(6.4, 3.9 * len(obstacles)), 6.6), layout="constrained")
        panels: Any = figure.subplots(2, len(obstacles), sharex=True, sharey="row", squeeze=False)
        for column, number in enumerate(obstacles):
            mine = [one for one in summaries if one["obstacles"] == number]
            _lines(panels[0][column], panels[1][column], mine)
            panels[0][column].set_title(f"{number} obstacles" if len(obstacles) > 1 else "")
            panels[1][column].set_xlabel("robots")
        panels[0][0].set_ylabel("search time, s (mean; limit if none)")
        panels[1][0].set_ylabel("arrived, % (95 %)")
        panels[0][0].set_ylim(bottom=0.0)
        panels[1][0].set_ylim(0.0, 104.0)
        handles, labels = panels[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 5), frameon=False)
        figure.suptitle(title)
    return figure


def _lines(times: Any, arrivals: Any, summaries: list[Summary]) -> None:
    kinds = dict.fromkeys((one["strategy"], one["emission_gps"]) for one in summaries)
    seen: dict[str, int] = {}
    for strategy, emission_gps in kinds:
        style = _LINES[seen.setdefault(strategy, 0) % len(_LINES)]
        seen[strategy] += 1
        line = sorted(
            (one for one in summaries if (one["strategy"], one["emission_gps"]) == (strategy, emission_gps)),
            key=lambda one: int(one["robots"]),
        )
        robots = [one["robots"] for one in line]
        colour = _COLOURS.get(strategy, "#555555")
        label = (
            f"{_NAMES.get(strategy, strategy)}, {emission_gps:g} g/s"
            if strategy != "upwind"
            else "upwind only"
        )
        times.plot(
            robots,
            [one["arrival_s_mean"] for one in line],
            style,
            color=colour,
            marker="o",
            ms=4,
            label=label,
        )
        rate = [100.0 * one["success_rate"] for one in line]
        low = [100.0 * (one["success_rate"] - one["success_low"]) for one in line]
        high = [100.0 * (one["success_high"] - one["success_rate"]) for one in line]
        arrivals.errorbar(
            robots, rate, yerr=(low, high), fmt=style, color=colour, marker="o", ms=4, capsize=2
        )
    for axes in (times, arrivals):
        axes.grid(alpha=0.25)
