"""The virtual-force paper: its two experiments, its claims, its figures 9 and 10."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import pandas as pd

from simvehicle.experiments.experiment import Experiment, Listing, Paper, Summary
from simvehicle.experiments.forces.forces_cells import NAMES, define, summarise
from simvehicle.experiments.forces.forces_claims import judge
from simvehicle.experiments.forces.forces_flights import code_of, engine_of, fly_world, kernels_of
from simvehicle.experiments.table import percent
from simvehicle.trials.batch import Trials

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_HEADS = (
    "strategy",
    "robots",
    "obstacles",
    "g/s",
    "arrived",
    "95 %",
    "mean, s",
    "median, s",
    "nearest pair, m",
)


def draw(experiment: Experiment, summaries: list[Summary], title: str) -> Figure:
    from simvehicle.experiments.forces import forces_figure

    del experiment
    return forces_figure.times_and_arrivals(summaries, title)


def heading(experiment: Experiment) -> str:
    return experiment.title


def caption(experiment: Experiment, summaries: list[Summary]) -> str:
    plumes = len({world.number % 100 for world in experiment.worlds})
    return (
        f"{summaries[0]['trials']} trials a cell: {plumes} plumes with {experiment.trials} starts each, "
        f"{summaries[0]['limit_s']:.0f} s at most"
    )


def _cells(one: Summary) -> list[str]:
    pair_m = one["nearest_pair_m_median"]
    return [
        one["strategy"],
        str(one["robots"]),
        str(one["obstacles"]),
        f"{one['emission_gps']:g}",
        percent(one, "success_rate"),
        percent(one, "success_low", "success_high"),
        f"{one['arrival_s_mean']:.0f}",
        f"{one['arrival_s_median']:.0f}",
        "-" if pair_m is None else f"{pair_m:.2f}",
    ]


def table(name: str, summaries: Sequence[Summary]) -> str:
    """Every cell: there are few enough to be read, or they are in a file too."""
    lines = ["| " + " | ".join(_HEADS) + " |", "| " + " | ".join("---" for _ in _HEADS) + " |"]
    lines += ["| " + " | ".join(_cells(one)) + " |" for one in summaries]
    del name
    return "\n".join(lines) + "\n"


def listing(summaries: Sequence[Summary]) -> Listing:
    rows = [_cells(one) for one in summaries]
    return Listing("search times of all trials, those without arrival at the limit", _HEADS, 1, rows)


def notes(experiment: Experiment, rows: pd.DataFrame) -> str:
    """What the plumes are like, for a reader who asks why."""
    del experiment
    lines = [
        "## Plumes",
        "",
        "What a sensor at rest reads inside the plume, the mean over the plumes: the share of the time below the "
        "threshold, the 99th percentile over the mean in time, how far the plume's middle goes about (deviation over "
        "the plume's radius), the share of the ground that ever has gas.",
        "",
        "| obstacles | of the ground | g/s | intermittency | peak to mean | meander | plume |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for (obstacles, emission_gps), mine in rows.groupby(["obstacles", "emission_gps"]):
        once = mine.drop_duplicates("world")
        lines.append(
            f"| {obstacles} | {100 * once['obstacle_share'].mean():.1f} % | {emission_gps:g} "
            f"| {once['intermittency'].mean():.2f} | {once['peak_to_mean'].mean():.1f} "
            f"| {once['meander'].mean():.2f} | {100 * once['plume_share'].mean():.0f} % |"
        )
    return "\n".join(lines) + "\n\n"


FORCES = Paper(
    names=NAMES,
    define=define,
    trials=Trials(fly_world, engine_of, code_of, kernels_of),
    summarise=summarise,
    judge=judge,
    draw=draw,
    heading=heading,
    caption=caption,
    table=table,
    listing=listing,
    weight=1000,
    notes=notes,
)
