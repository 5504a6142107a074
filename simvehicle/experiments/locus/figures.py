"""The paper's figures 6 and 7 from our own rows."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

_COLOURS = {"locus": "#6a3d9a", "mobs": "#e66100", "locus-hybrid": "#1b7837", "locus-multi": "#2166ac"}
_NAMES = {"locus": "LoCUS", "mobs": "MoBS", "locus-hybrid": "hybrid", "locus-multi": "sub-swarms"}
_HATCHED = ("perturbed", "gusty")
_STYLE: Any = {"axes.spines.top": False, "axes.spines.right": False, "font.size": 10}


def bars(summaries: list[dict[str, Any]], title: str) -> Figure:
    """Figure 6: per swarm size and strategy the mean time to contact (lower part of a bar) and to max flux.

    Stars are medians of the time to max flux; error bars are one standard deviation about its mean.
    """
    with mpl.rc_context(_STYLE):
        sizes = sorted({one["drones"] for one in summaries})
        kinds = list(dict.fromkeys((one["strategy"], one["plume"]) for one in summaries))
        figure = Figure(
            figsize=(max(9.2, 0.34 * len(sizes) * (len(kinds) + 1) + 4.2), 4.6), layout="constrained"
        )
        axes = figure.add_subplot()
        width = 0.8 / len(kinds)
        for one in summaries:
            kind = kinds.index((one["strategy"], one["plume"]))
            x = sizes.index(one["drones"]) + (kind + 0.5) * width - 0.4
            if one["source_s_mean"] is None:
                continue
            contact, source = (one["contact_s_mean"] or 0.0) / 60.0, one["source_s_mean"] / 60.0
            colour = _COLOURS[one["strategy"]]
            hatch = "//" if one["plume"] in _HATCHED else None
            bar: dict[str, Any] = {
                "width": 0.92 * width,
                "edgecolor": "white",
                "linewidth": 0.5,
                "hatch": hatch,
            }
            axes.bar(x, contact, color=colour, alpha=0.45, **bar)
            axes.bar(x, source - contact, bottom=contact, color=colour, **bar)
            deviation = (one["source_s_sd"] or 0.0) / 60.0
            axes.errorbar(
                x, source, yerr=[[min(deviation, source)], [deviation]], color="black", lw=1.0, capsize=2.0
            )
            median = one["source_s_median"] / 60.0
            axes.plot(x, median, "*", color="gold", markeredgecolor="black", markersize=8.0, zorder=5)
        axes.set_xticks(range(len(sizes)), [str(size) for size in sizes])
        axes.set_xlabel("drones")
        axes.set_ylabel("time, min")
        axes.set_ylim(bottom=0.0)
        axes.set_title(title)
        handles: list[Any] = []
        for strategy in dict.fromkeys(strategy for strategy, _ in kinds):
            name = _NAMES[strategy]
            handles.append(Patch(color=_COLOURS[strategy], alpha=0.45, label=f"{name}: to first contact"))
            handles.append(Patch(color=_COLOURS[strategy], label=f"{name}: contact to max flux"))
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
                handles.append(
                    Patch(facecolor="grey", edgecolor="white", hatch=hatch, label=f"{plume} plume")
                )
        figure.legend(handles=[*handles, star], frameon=False, fontsize=9, loc="outside right upper")
        return figure


def rates(summaries: list[dict[str, Any]], title: str) -> Figure:
    """Figure 7: success against failure rate, with Wilson's 95 % intervals; one panel a plume."""
    with mpl.rc_context(_STYLE):
        plumes = list(dict.fromkeys(one["plume"] for one in summaries))
        figure = Figure(figsize=(5.2 * len(plumes) + 0.6, 4.4), layout="constrained")
        panels = figure.subplots(1, len(plumes), sharey=True, squeeze=False)[0]
        for panel, plume in zip(panels, plumes, strict=True):
            mine = [one for one in summaries if one["plume"] == plume]
            lines = dict.fromkeys((one["strategy"], one["healing"], one["drones"]) for one in mine)
            for strategy, healing, drones in lines:
                line = sorted(
                    (
                        one
                        for one in mine
                        if (one["strategy"], one["healing"], one["drones"]) == (strategy, healing, drones)
                    ),
                    key=lambda one: float(one["failure_rate"]),
                )
                rate = np.array([one["failure_rate"] for one in line])
                success = np.array([one["success_rate"] for one in line])
                low = success - np.array([one["success_low"] for one in line])
                high = np.array([one["success_high"] for one in line]) - success
                label = _NAMES[strategy]
                if strategy != "mobs":
                    label += ", healing" if healing else ", no healing"
                if len({key[2] for key in lines}) > 1:
                    label += f", {drones} drones"
                style = "--" if strategy == "mobs" else "-"
                panel.errorbar(
                    rate,
                    100.0 * success,
                    yerr=100.0 * np.clip([low, high], 0.0, None),
                    color=_COLOURS[strategy],
                    alpha=1.0 if healing or strategy == "mobs" else 0.55,
                    lw=2.2 if healing else 1.3,
                    ls=style,
                    marker="o" if healing else "s" if strategy == "mobs" else "^",
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
        panels[0].legend(frameon=False, fontsize=9, loc="lower left")
        figure.suptitle(title)
        return figure
