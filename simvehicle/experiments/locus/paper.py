"""The LoCUS paper: its four experiments, its claims and its figures 6 and 7."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simvehicle.experiments.experiment import Experiment, Paper, Summary
from simvehicle.experiments.locus.definitions import NAMES, by_rate, define
from simvehicle.experiments.locus.verdicts import judge
from simvehicle.experiments.table import cell_table, listing, summarise
from simvehicle.trials.batch import CELLS

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw(experiment: Experiment, summaries: list[Summary], title: str) -> Figure:
    """Figure 7 for failure rates, figure 6 for swarm sizes."""
    from simvehicle.experiments.locus import figures

    return (figures.rates if by_rate(experiment) else figures.sizes)(summaries, title)


def heading(experiment: Experiment) -> str:
    """With rates there is a panel a plume; otherwise the plumes are named."""
    if by_rate(experiment):
        return experiment.title
    plumes = " and ".join(dict.fromkeys(cell.plume for cell in experiment.cells))
    return f"{experiment.title}, {plumes} plume"


def caption(experiment: Experiment, summaries: list[Summary]) -> str:
    return f"{experiment.trials} trials a cell, motion {summaries[0]['motion']}"


LOCUS = Paper(
    names=NAMES,
    define=define,
    judge=judge,
    draw=draw,
    trials=CELLS,
    summarise=summarise,
    heading=heading,
    caption=caption,
    table=cell_table,
    listing=listing,
)
