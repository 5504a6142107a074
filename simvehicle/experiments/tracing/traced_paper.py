"""Experiments 3 and 4 of the fluxotaxis paper."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simvehicle.experiments.experiment import Experiment, Paper, Summary
from simvehicle.experiments.tracing.traced_cells import NAMES, define
from simvehicle.experiments.tracing.traced_table import listing, markdown, summarise
from simvehicle.experiments.tracing.traced_verdicts import explained, judge
from simvehicle.trials.batch import Trials
from simvehicle.trials.tracing.traced_world import code_of, engine_of, fly_world, kernels_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw(experiment: Experiment, summaries: list[Summary], title: str) -> Figure:
    from simvehicle.experiments.tracing import traced_figures

    del experiment
    return traced_figures.draw(summaries, title)


def heading(experiment: Experiment) -> str:
    return experiment.title


def caption(experiment: Experiment, summaries: list[Summary]) -> str:
    sizes = sorted({one["robots"] for one in summaries})
    words = ", ".join(map(str, sizes))
    return f"{len(experiment.worlds)} worlds of {experiment.trials} starts, swarms of {words} robots"


TRACING = Paper(
    names=NAMES,
    define=define,
    judge=judge,
    draw=draw,
    trials=Trials(fly_world, engine_of, code_of, kernels_of),
    summarise=summarise,
    heading=heading,
    caption=caption,
    table=markdown,
    listing=listing,
    notes=explained,
    weight=10_000,
)
