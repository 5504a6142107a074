"""One row a cell: what the paper's response variables came to."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd

from simvehicle.experiments.statistics import wilson
from simvehicle.trials.cell import Cell


def select(rows: pd.DataFrame, cell: Cell) -> pd.DataFrame:
    """The rows of one cell, by trial."""
    mine = (
        (rows["strategy"] == cell.strategy)
        & (rows["drones"] == cell.drones)
        & (rows["plume"] == cell.plume)
        & (rows["healing"] == cell.healing)
        & (rows["failure_rate"] == cell.failure_rate)
    )
    return rows[mine].sort_values("trial")


def summarise(rows: pd.DataFrame, cell: Cell) -> dict[str, Any]:
    """The JSON row of a cell; times in seconds over the trials in which the event happened, None without any."""
    mine = select(rows, cell)
    successes, trials = int(mine["success"].sum()), len(mine)
    low, high = wilson(successes, trials)
    summary: dict[str, Any] = {
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


def markdown(summaries: list[dict[str, Any]]) -> str:
    """The table for a person: minutes, as the paper gives them."""
    by_rate = any("failure_rate" in summary for summary in summaries)
    head = ["strategy", "drones", "plume"]
    head += ["healing", "failure rate"] if by_rate else []
    head += ["success", "95 %", "contact, min", "sd", "max flux, min", "median", "sd", "longest"]
    lines = ["| " + " | ".join(head) + " |", "| " + " | ".join("---" for _ in head) + " |"]
    for one in summaries:
        cells = [one["strategy"], str(one["drones"]), one["plume"]]
        if by_rate:
            cells += ["on" if one.get("healing") else "off", f"{one['failure_rate']:.0e}"]
        cells += [percent(one, "success_rate"), percent(one, "success_low", "success_high")]
        for name in ("contact_s_mean", "contact_s_sd", "source_s_mean"):
            cells.append(_minutes(one[name]))
        for name in ("source_s_median", "source_s_sd", "source_s_max"):
            cells.append(_minutes(one[name]))
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def percent(summary: dict[str, Any], *names: str) -> str:
    """Rates of a cell, as exact as its trials make them: 2997 of 3000 are not 100 %."""
    digits = 0 if summary["trials"] <= 100 else 1
    return "..".join(f"{100.0 * summary[name]:.{digits}f}" for name in names) + " %"


def _minutes(seconds: float | None) -> str:
    return "-" if seconds is None else f"{seconds / 60.0:.1f}"
