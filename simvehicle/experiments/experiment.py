"""What an experiment is, and what a paper's folder gives: its experiments, its claims, its figures."""

from __future__ import annotations

import pathlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import msgspec

from simvehicle.trials.cell import Cell, PlumeKind, Unhealed

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pandas as pd
    from matplotlib.figure import Figure

    from simvehicle.trials.batch import Trials

Outcome = Literal["holds", "does not hold", "undecided"]
Summary: TypeAlias = dict[str, Any]
"""A cell's row of the table, with the names of its columns."""


class Listing(msgspec.Struct, frozen=True):
    """A table for a terminal."""

    title: str
    heads: tuple[str, ...]
    left: int
    """The first so many columns are words, the others numbers."""
    rows: list[list[str]]


class Options(msgspec.Struct, frozen=True, kw_only=True):
    """What a person may choose; None or empty: the experiment's own. A paper refuses what it has no use for."""

    sizes: tuple[int, ...] = ()
    rates: tuple[float, ...] = ()
    strategies: tuple[str, ...] = ()
    plumes: tuple[PlumeKind, ...] = ()
    unhealed: tuple[Unhealed, ...] = ("reached",)
    """Without healing, who goes on once a drone in the tree is lost: a line of cells for each."""
    quick: bool = False
    full: bool = False
    trials: int | None = None
    regimes: tuple[str, ...] = ()
    """Of the wind."""
    worlds: int | None = None
    """How many plumes, each with its wind and obstacles."""
    base: Cell = Cell(motion="paper")
    """Of the LoCUS paper's cells: arena, motion and formation."""


class Experiment(msgspec.Struct, frozen=True):
    name: str
    title: str
    cells: tuple[Any, ...]
    """The cells that are reported, in structs of the paper's own."""
    compared: tuple[Any, ...]
    """Further cells that a verdict needs."""
    trials: int
    """Of each piece of work."""
    worlds: tuple[Any, ...] = ()
    """The work itself, where it is not cell by cell: rows of one world belong to many cells."""

    @property
    def work(self) -> tuple[Any, ...]:
        """What is run, stored and spread: each one's `trials`, as the paper's `Trials` fly them."""
        return self.worlds or self.cells + self.compared


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
    trials: Trials
    """How its work is flown."""
    summarise: Callable[[pd.DataFrame, Any], Summary]
    """A cell's row of the table, from all rows."""
    judge: Callable[[Experiment, pd.DataFrame], list[Verdict]]
    """A verdict on each claim that the rows can decide."""
    draw: Callable[[Experiment, list[Summary], str], Figure]
    """The figure of an experiment, with a title. Called late: plotting takes long to import."""
    heading: Callable[[Experiment], str]
    """Of page and figure."""
    caption: Callable[[Experiment, list[Summary]], str]
    """How much was flown, and how: the second line of the figure's title."""
    table: Callable[[str, Sequence[Summary]], str]
    """The page's table of the cells, Markdown."""
    listing: Callable[[Sequence[Summary]], Listing]
    """The terminal's."""
    weight: int = 1
    """How many of the LoCUS paper's trials one of its own takes as long as."""
    notes: Callable[[Experiment, pd.DataFrame], str] | None = None
    """Further Markdown for the page, from the rows: what explains the verdicts."""


class ExperimentReport(msgspec.Struct, frozen=True):
    """An experiment that was run."""

    experiment: Experiment
    directory: pathlib.Path
    rows: pd.DataFrame
    summaries: list[Summary]
    verdicts: list[Verdict]
