"""One row a cell: what the paper's response variables came to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from simvehicle.experiments.experiment import Listing, Summary
from simvehicle.experiments.statistics import wilson
from simvehicle.trials.cell import Cell

_SHOWN_SIZES = (5, 10, 20)
_LONGEST = 60
"""A table of more cells than this is a file of its own; the page shows the decades of the failure rate, or a few
swarm sizes."""


def select(rows: pd.DataFrame, cell: Cell) -> pd.DataFrame:
    """The rows of one cell, by trial."""
    mine = (
        (rows["strategy"] == cell.strategy)
        & (rows["drones"] == cell.drones)
        & (rows["plume"] == cell.plume)
        & (rows["healing"] == cell.healing)
        & (rows["unhealed"] == cell.unhealed)
        & (rows["failure_rate"] == cell.failure_rate)
    )
    return rows[mine].sort_values("trial")


def summarise(rows: pd.DataFrame, cell: Cell) -> Summary:
    """The JSON row of a cell; times in seconds over the trials in which the event happened, None without any."""
    mine = select(rows, cell)
    successes, trials = int(mine["success"].sum()), len(mine)
    low, high = wilson(successes, trials)
    summary: Summary = {
        "strategy": cell.strategy,
        "drones": cell.drones,
        "plume": cell.plume,
        "trials": trials,
        "success_rate": successes / trials if trials else None,
        "success_low": low,
        "success_high": high,
        "contact_rate": _number(mine["contact_s"].notna().mean()),
        "contact_s_mean": _number(mine["contact_s"].mean()),
        "contact_s_sd": _number(mine["contact_s"].std()),
        "source_s_mean": _number(mine["source_s"].mean()),
        "source_s_median": _number(mine["source_s"].median()),
        "source_s_sd": _number(mine["source_s"].std()),
        "source_s_max": _number(mine["source_s"].max()),
        "motion": cell.motion,
        "arena_m": cell.arena_m,
    }
    if cell.failure != "none":
        healed = mine[mine["moves"] > 0]
        summary |= {
            "failure": cell.failure,
            "failure_rate": cell.failure_rate,
            "healing": cell.healing,
            "unhealed": cell.unhealed,
            "survivors_mean": _number(mine["survivors"].mean()),
            "moves_mean": _number(mine["moves"].mean()),
            "heal_s_mean": _number((healed["heal_s"] / healed["moves"]).mean()),
        }
    return summary


def _number(value: Any) -> float | None:
    number = float(value)
    return number if math.isfinite(number) else None


def columns(rows: pd.DataFrame, cell: Cell, name: str) -> np.ndarray:
    """One column of a cell's rows, by trial."""
    values: np.ndarray = select(rows, cell)[name].to_numpy(dtype=np.float64)
    return values


def is_long(summaries: Sequence[Summary]) -> bool:
    """Whether the cells are too many for a page that a person reads."""
    return len(summaries) > _LONGEST


def cell_table(name: str, summaries: Sequence[Summary]) -> str:
    """All cells, or of many the decades of the failure rate (the sizes 5, 10, 20) and where the rest is."""
    if not is_long(summaries):
        return full(summaries)
    if "failure_rate" not in summaries[0]:
        shown = [one for one in summaries if one["drones"] in _SHOWN_SIZES] or list(summaries)
        return f"All {len(summaries)} cells are in [{name}.csv]({name}.csv).\n\n{full(shown)}"
    return (
        "Trials that find the source, with Wilson's 95 % interval. "
        f"All {len(summaries)} cells with all columns are in [{name}.csv]({name}.csv).\n\n{by_rate(summaries)}"
    )


def full(summaries: Sequence[Summary]) -> str:
    """The table for a person, in Markdown: a row a cell, minutes as the paper gives them."""
    rated = any("failure_rate" in summary for summary in summaries)
    head = ["strategy", "drones", "plume"]
    head += ["healing", "failure rate"] if rated else []
    head += ["success", "95 %", "contact, min", "sd", "max flux, min", "median", "sd", "longest"]
    lines = ["| " + " | ".join(head) + " |", "| " + " | ".join("---" for _ in head) + " |"]
    for one in summaries:
        cells = [one["strategy"], str(one["drones"]), one["plume"]]
        if rated:
            cells += [healing_words(one), f"{one['failure_rate']:.0e}"]
        cells += [percent(one, "success_rate"), percent(one, "success_low", "success_high")]
        for name in ("contact_s_mean", "contact_s_sd", "source_s_mean"):
            cells.append(_minutes(one[name]))
        for name in ("source_s_median", "source_s_sd", "source_s_max"):
            cells.append(_minutes(one[name]))
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def by_rate(summaries: Sequence[Summary]) -> str:
    """Success by failure rate, in Markdown: a row a decade (a rate, where no decade was flown), a column a line."""
    found: dict[str, dict[float, str]] = {}
    sizes = {one["drones"] for one in summaries}
    alone = {one["strategy"] for one in summaries} - {one["strategy"] for one in summaries if one["healing"]}
    for one in summaries:
        head = f"{one['plume']}: {one['strategy']}"
        head += f" {one['drones']}" if len(sizes) > 1 else ""
        head += "" if one["strategy"] in alone else f", {healing_words(one, 'healing', 'no healing')}"
        text = f"{percent(one, 'success_rate')} ({percent(one, 'success_low', 'success_high')})"
        found.setdefault(head, {})[one["failure_rate"]] = text
    lines = [
        "| failure rate | " + " | ".join(found) + " |",
        "| " + " | ".join("---" for _ in range(1 + len(found))) + " |",
    ]
    rates = sorted({rate for column in found.values() for rate in column})
    for rate in [rate for rate in rates if f"{rate:.0e}".startswith("1e")] or rates:
        cells = (column.get(rate, "-") for column in found.values())
        lines.append(f"| {rate:.0e} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def healing_words(summary: Summary, yes: str = "on", no: str = "off") -> str:
    """Whether a cell heals, and if not, whether nobody goes on after a loss."""
    if summary.get("healing"):
        return yes
    return f"{no}, nobody goes on" if summary.get("unhealed") == "nobody" else no


def percent(summary: Summary, *names: str) -> str:
    """Rates of a cell, as exact as its trials make them: 2997 of 3000 are not 100 %."""
    digits = 0 if summary["trials"] <= 100 else 1
    return "..".join(f"{100.0 * summary[name]:.{digits}f}" for name in names) + " %"


def _minutes(seconds: float | None) -> str:
    return "-" if seconds is None else f"{seconds / 60.0:.1f}"


def listing(summaries: Sequence[Summary]) -> Listing:
    """The table for a terminal: a row a cell."""
    rated = any("failure_rate" in one for one in summaries)
    heads = ("strategy", "drones", "plume", *(("healing", "rate") if rated else ()))

    def minutes(one: Summary, *names: str) -> str:
        return " ± ".join(_minutes(one[name]) for name in names)

    rows = []
    for one in summaries:
        row = [one["strategy"], str(one["drones"]), one["plume"]]
        row += ["on" if one["healing"] else "off", f"{one['failure_rate']:.0e}"] if rated else []
        row += [percent(one, "success_rate"), minutes(one, "contact_s_mean", "contact_s_sd")]
        row += [minutes(one, "source_s_mean", "source_s_sd"), minutes(one, "source_s_median")]
        rows.append([*row, minutes(one, "source_s_max")])
    heads_of_numbers = ("success", "contact", "max flux", "median", "longest")
    return Listing(
        "times in minutes, mean ± standard deviation", (*heads, *heads_of_numbers), len(heads), rows
    )
