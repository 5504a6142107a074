"""What an experiment is, and what a paper's folder gives: its experiments, its claims, its figures."""

from __future__ import annotations

import pathlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import msgspec

from simvehicle.trials.cell import Cell, PlumeKind, Unhealed

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

Outcome = Literal["holds", "does not hold", "undecided"]
Summary: TypeAlias = dict[str, Any]
"""A cell's row of the table (`simvehicle.experiments.table.summarise`)."""


class Options(msgspec.Struct, frozen=True, kw_only=True):
    """What a person may choose; None or empty: the experiment's own."""

    sizes: tuple[int, ...] = ()
    rates: tuple[float, ...] = ()
    strategies: tuple[str, ...] = ("locus", "mobs")
    plumes: tuple[PlumeKind, ...] = ()
    unhealed: tuple[Unhealed, ...] = ("reached",)
    """Without healing, who goes on once a drone in the tree is lost: a line of cells for each."""
    quick: bool = False
    full: bool = False
    trials: int | None = None
    base: Cell = Cell(motion="paper")
    """Arena, motion and formation of all cells."""


class Experiment(msgspec.Struct, frozen=True):
    name: str
    title: str
    cells: tuple[Cell, ...]
    """The cells whose rows are reported."""
    compared: tuple[Cell, ...]
    """Further cells that a verdict needs."""
    trials: int

    @property
    def by_rate(self) -> bool:
        """Whether its cells differ in their failure rate."""
        return any(cell.failure != "none" for cell in self.cells)


class Verdict(msgspec.Struct, frozen=True):
    claim: str
    verdict: Outcome
    statistic: str
    """The numbers that decided it."""


class Paper(msgspec.Struct, frozen=True):
    """What a paper's folder brings along; all else is the same for every paper."""

    names: tuple[str, ...]
    """Of its experiments."""
    define: Callable[[str, Options], Experiment]
    """The experiment of a name. `TrialsError` names what is impossible."""
    judge: Callable[[Experiment, pd.DataFrame], list[Verdict]]
    """A verdict on each claim that the rows can decide."""
    draw: Callable[[Experiment, list[Summary], str], Figure]
    """The figure of an experiment, with a title. Called late: plotting takes long to import."""


class ExperimentReport(msgspec.Struct, frozen=True):
    """An experiment that was run."""

    experiment: Experiment
    directory: pathlib.Path
    rows: pd.DataFrame
    summaries: list[Summary]
    verdicts: list[Verdict]
