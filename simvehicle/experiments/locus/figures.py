"""The paper's figures 6 and 7 from our own rows."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from simvehicle.experiments.locus.definitions import ALONE
from simvehicle.experiments.table import healing_words

_COLOURS = {
    "locus": "#6a3d9a",
    "mobs": "#e66100",
    "mobs-authors": "#b2182b",
    "locus-hybrid": "#1b7837",
    "locus-multi": "#2166ac",
}
_OTHER = "#555555"
_NAMES = {
    "locus": "LoCUS",
    "mobs": "MoBS",
    "mobs-authors": "MoBS as programmed",
    "locus-hybrid": "hybrid",
    "locus-multi": "sub-swarms",
}
_REPORTED = (5, 10, 20)
"""The swarm sizes that the paper draws."""
_MOST_SIZES = 6
"""Bars of more sizes than this cannot be read."""
_HATCHED = ("perturbed", "gusty")
_STYLE: Any = {"axes.spines.top": False, "axes.spines.right": False, "font.size": 10}


def sizes(summaries: list[dict[str, Any]], title: str) -> Figure:
    """Figure 6; with many swarm sizes its bars are those of the paper's, and all are drawn as curves beneath."""
    with mpl.rc_context(_STYLE):
        flown = sorted({one["drones"] for one in summaries})
        if len(flown) <= _MOST_SIZES:
            kinds = len({(one["strategy"], one["plume"]) for one in summaries})
            figure = Figure(
                figsize=(max(9.2, 0.34 * len(flown) * (kinds + 1) + 4.2), 4.6), layout="constrained"
            )
            _bars(figure, figure.add_subplot(), summaries)
            figure.suptitle(title)
            return figure
        figure = Figure(figsize=(11.0, 8.6), layout="constrained")
        subfigures: Any = figure.subfigures(2, 1, height_ratios=(1.0, 1.1))
        top, bottom = subfigures
        shown = [one for one in summaries if one["drones"] in _REPORTED]
        _bars(top, top.add_subplot(), shown or summaries)
        _curves(bottom.subplots(1, 3), summaries)
        figure.suptitle(title)
        return figure


def _curves(panels: Any, summaries: list[dict[str, Any]]) -> None:
    """Mean times and the deviation of the second against the swarm size."""
    for panel, name, heading in zip(
        panels,
        ("contact_s_mean", "source_s_mean", "source_s_sd"),
        (
            "mean time to first contact, min",
            "mean time to max flux, min",
            "deviation of the time to max flux, min",
        ),
        strict=True,
    ):
        kinds = dict.fromkeys((one["strategy"], one["plume"]) for one in summaries)
        for number, (strategy, plume) in enumerate(kinds):
            line = [
                one
                for one in summaries
                if (one["strategy"], one["plume"]) == (strategy, plume) and one[name] is not None
            ]
            line.sort(key=lambda one: int(one["drones"]))
            panel.plot(
                [one["drones"] for one in line],
                [one[name] / 60.0 for one in line],
                "--" if plume in _HATCHED and len({one["plume"] for one in summaries}) > 1 else "-",
                marker="o",
                markersize=3.0,
                lw=max(1.0, 3.4 - 0.6 * number),  # a line under another is seen
                color=_COLOURS.get(strategy, _OTHER),
            )
        panel.set_yscale("log")
        panel.yaxis.set_major_formatter(mpl.ticker.FormatStrFormatter("%g"))
        panel.yaxis.set_minor_formatter(mpl.ticker.NullFormatter())
        panel.yaxis.set_major_locator(mpl.ticker.LogLocator(subs=(1.0, 2.0, 5.0)))
        panel.set_xlabel("drones")
        panel.set_title(heading, fontsize=10)
        panel.grid(alpha=0.25)


def _bars(figure: Any, axes: Any, summaries: list[dict[str, Any]]) -> None:
    """Per swarm size and strategy the mean time to contact (lower part of a bar) and to max flux.

    Stars are medians of the time to max flux; error bars are one standard deviation about its mean.
    """
    flown = sorted({one["drones"] for one in summaries})
    kinds = list(dict.fromkeys((one["strategy"], one["plume"]) for one in summaries))
    width = 0.8 / len(kinds)
    for one in summaries:
        kind = kinds.index((one["strategy"], one["plume"]))
        x = flown.index(one["drones"]) + (kind + 0.5) * width - 0.4
        if one["source_s_mean"] is None:
            continue
        contact, source = (one["contact_s_mean"] or 0.0) / 60.0, one["source_s_mean"] / 60.0
        colour = _COLOURS.get(one["strategy"], _OTHER)
        hatch = "//" if one["plume"] in _HATCHED else None
        bar: dict[str, Any] = {"width": 0.92 * width, "edgecolor": "white", "linewidth": 0.5, "hatch": hatch}
        axes.bar(x, contact, color=colour, alpha=0.45, **bar)
        axes.bar(x, source - contact, bottom=contact, color=colour, **bar)
        deviation = (one["source_s_sd"] or 0.0) / 60.0
        axes.errorbar(
            x, source, yerr=[[min(deviation, source)], [deviation]], color="black", lw=1.0, capsize=2.0
        )
        median = one["source_s_median"] / 60.0
        axes.plot(x, median, "*", color="gold", markeredgecolor="black", markersize=8.0, zorder=5)
    axes.set_xticks(range(len(flown)), [str(size) for size in flown])
    axes.set_xlabel("drones")
    axes.set_ylabel("time, min")
    axes.set_ylim(bottom=0.0)
    handles: list[Any] = []
    for strategy in dict.fromkeys(strategy for strategy, _ in kinds):
        name = _NAMES.get(strategy, strategy)
        colour = _COLOURS.get(strategy, _OTHER)
        handles.append(Patch(color=colour, alpha=0.45, label=f"{name}: to first contact"))
        handles.append(Patch(color=colour, label=f"{name}: contact to max flux"))
    star = mpl.lines.Line2D(
        [],
        [],
        marker="*",
        color="gold",
        markeredgecolor="black",
        linestyle="",
        label="median to max flux",
    )
    plumes = list(dict.fromkeys(plume for _, plume in kinds))
    if len(plumes) > 1:
        for plume in plumes:
            hatch = "//" if plume in _HATCHED else None
            handles.append(Patch(facecolor="grey", edgecolor="white", hatch=hatch, label=f"{plume} plume"))
    figure.legend(handles=[*handles, star], frameon=False, fontsize=9, loc="outside right upper")


def rates(summaries: list[dict[str, Any]], title: str) -> Figure:
    """Figure 7: success against failure rate, with Wilson's 95 % intervals; one panel a plume."""
    with mpl.rc_context(_STYLE):
        plumes = list(dict.fromkeys(one["plume"] for one in summaries))
        figure = Figure(figsize=(5.2 * len(plumes) + 0.6, 4.9), layout="constrained")
        panels = figure.subplots(1, len(plumes), sharey=True, squeeze=False)[0]
        for panel, plume in zip(panels, plumes, strict=True):
            mine = [one for one in summaries if one["plume"] == plume]
            lines: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
            for one in mine:
                key = (one["strategy"], one["healing"], one.get("unhealed"), one["drones"])
                lines.setdefault(key, []).append(one)
            for (strategy, healing, unhealed, drones), line in lines.items():
                line.sort(key=lambda one: float(one["failure_rate"]))
                rate = np.array([one["failure_rate"] for one in line])
                success = np.array([one["success_rate"] for one in line])
                low = success - np.array([one["success_low"] for one in line])
                high = np.array([one["success_high"] for one in line]) - success
                alone = strategy in ALONE
                label = _NAMES.get(strategy, strategy)
                if not alone:
                    label += f", {healing_words(line[0], 'healing', 'no healing')}"
                if len({key[3] for key in lines}) > 1:
                    label += f", {drones} drones"
                panel.errorbar(
                    rate,
                    100.0 * success,
                    yerr=100.0 * np.clip([low, high], 0.0, None),
                    color=_COLOURS.get(strategy, _OTHER),
                    alpha=1.0 if healing or alone else 0.55,
                    lw=2.2 if healing else 1.3,
                    ls="--" if alone else ":" if not healing and unhealed == "nobody" else "-",
                    marker="o" if healing else "s" if alone else "^",
                    markersize=4.0,
                    elinewidth=0.8,
                    label=label,
                )
            panel.set_xscale("log")
            panel.set_xlabel("failure probability a drone and tick (1/16 s)")
            panel.set_title(f"{plume} plume")
            panel.grid(alpha=0.25)
        panels[0].set_ylabel("trials that find the source, %")
        panels[0].set_ylim(-3.0, 103.0)
        figure.legend(
            *panels[0].get_legend_handles_labels(),
            frameon=False,
            fontsize=9,
            loc="outside lower center",
            ncols=3,
        )
        figure.suptitle(title)
        return figure
