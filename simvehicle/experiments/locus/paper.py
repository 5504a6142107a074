"""The LoCUS paper: its four experiments, its claims and its figures 6 and 7."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simvehicle.experiments.experiment import Experiment, Paper, Summary
from simvehicle.experiments.locus.definitions import NAMES, define
from simvehicle.experiments.locus.verdicts import judge

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw(experiment: Experiment, summaries: list[Summary], title: str) -> Figure:
    """Figure 7 for failure rates, figure 6 for swarm sizes."""
    from simvehicle.experiments.locus import figures

    return (figures.rates if experiment.by_rate else figures.sizes)(summaries, title)


LOCUS = Paper(NAMES, define, judge, draw)
