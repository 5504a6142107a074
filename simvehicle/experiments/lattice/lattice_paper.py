"""The fluxotaxis paper's first study: its two experiments, its claims, its table I and figures 6 and 7."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from simvehicle.experiments.experiment import Experiment, Listing, Paper, Summary
from simvehicle.experiments.lattice.lattice_cells import NAMES, define, summarise
from simvehicle.experiments.lattice.lattice_claims import judge, notes
from simvehicle.experiments.lattice.lattice_flights import code_of, engine_of, fly_world, kernels_of
from simvehicle.experiments.table import percent
from simvehicle.trials.batch import Trials

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_HEADS = (
    "strategy",
    "plume",
    "factor",
    "obstacles",
    "inside at the end",
    "95 %",
    "proximity",
    "inside",
    "95 %",
)


def draw(experiment: Experiment, summaries: list[Summary], title: str) -> Figure:
    from simvehicle.experiments.lattice import lattice_figure

    return (lattice_figure.by_factor if experiment.name == "fluxo-1" else lattice_figure.by_obstacles)(
        summaries, title
    )


def heading(experiment: Experiment) -> str:
    return experiment.title


def caption(experiment: Experiment, summaries: list[Summary]) -> str:
    del summaries
    world = experiment.worlds[0]
    return f"{len(experiment.worlds)} worlds with {experiment.trials} starts each, {world.limit_steps} steps of 1.2 s"


def _cells(one: Summary) -> list[str]:
    return [
        one["strategy"],
        one["plume"],
        str(one["factor"]),
        f"{100.0 * one['obstacle_share']:g} %",
        percent(one, "success_rate"),
        percent(one, "success_low", "success_high"),
        _shown(one["proximity_mean"]),
        _shown(one["containment_mean"]),
        f"{_shown(one['containment_low'])}..{_shown(one['containment_high'])}",
    ]


def _shown(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def table(name: str, summaries: Sequence[Summary]) -> str:
    """Every cell: there are few enough to be read."""
    del name
    lines = ["| " + " | ".join(_HEADS) + " |", "| " + " | ".join("---" for _ in _HEADS) + " |"]
    lines += ["| " + " | ".join(_cells(one)) + " |" for one in summaries]
    return "\n".join(lines) + "\n"


def listing(summaries: Sequence[Summary]) -> Listing:
    return Listing(
        "inside: share of the time with the source in the ring", _HEADS, 2, list(map(_cells, summaries))
    )


LATTICE = Paper(
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
