"""The command `simvehicle experiment`."""

from __future__ import annotations

import contextlib
import itertools
import pathlib
import sys
from collections.abc import Iterator
from enum import StrEnum
from typing import Annotated, Any

import typer

from simvehicle.cli.trial_options import (
    STRATEGY_HELP,
    Acceleration,
    Arena,
    CutCells,
    CutGoal,
    Layout,
    Motion,
    RMax,
    RMin,
    Seed,
    Speed,
    numbers,
    one_line,
    tell_compiling,
    words,
)

EXPERIMENTS = (
    "locus-1",
    "locus-2",
    "locus-3",
    "locus-4",
    "fluxo-1",
    "fluxo-2",
    "fluxo-3",
    "fluxo-4",
    "forces-small",
    "forces-large",
    "tracing",
)
"""Of `simvehicle.experiments.papers`, which takes long to import."""


class RowsName(StrEnum):
    PARQUET = "parquet"
    CSV = "csv"


def experiment(
    name: Annotated[str, typer.Argument(help=f"One of {', '.join(EXPERIMENTS)}.")],
    sizes: Annotated[str, typer.Option(help="Swarm sizes: 5,10,20.")] = "",
    rates: Annotated[str, typer.Option(help="Failure rates of locus-3 and locus-4: 1e-5,1e-4.")] = "",
    strategies: Annotated[
        str, typer.Option(help="Commas between; default: the experiment's. " + STRATEGY_HELP)
    ] = "",
    plumes: Annotated[
        str, typer.Option(help="Of smooth, perturbed, gaussian, gusty; instead of the experiment's.")
    ] = "",
    regimes: Annotated[
        str, typer.Option(help="Of laminar, transitional, turbulent: the winds of traced plumes.")
    ] = "",
    worlds: Annotated[
        int | None, typer.Option(help="How many traced plumes, each with its wind and obstacles.")
    ] = None,
    trials: Annotated[
        int | None,
        typer.Option(help="Trials a cell (locus: 100; 20 with --quick), or starts a traced plume."),
    ] = None,
    motion: Motion = "paper",
    unhealed: Annotated[
        str, typer.Option(help="Without healing, who goes on after a loss: reached, nobody, or both.")
    ] = "reached",
    cut_cells: CutCells = False,
    cut_goal: CutGoal = False,
    arena: Arena = 100.0,
    speed: Speed = 5.0,
    acceleration: Acceleration = 2.0,
    r_min: RMin = 3.0,
    r_max: RMax = 3.0,
    layout: Layout = "rings",
    seed: Seed = 1,
    quick: Annotated[
        bool, typer.Option("--quick", help="A coarse look: fewer trials, sizes, rates.")
    ] = False,
    full: Annotated[
        bool, typer.Option("--full", help="The paper's size: all swarm sizes, rates, worlds.")
    ] = False,
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Processes; default: by the amount of work.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="A dask scheduler to spread the trials over: tcp://HOST:8786.")
    ] = None,
    out: Annotated[
        pathlib.Path | None, typer.Option(help="Directory of rows, table, figure and verdicts.")
    ] = None,
    rows: Annotated[RowsName, typer.Option(help="Kind of the file with one row a trial.")] = RowsName.PARQUET,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON row a cell on standard output.")] = False,
) -> None:
    """Run one of the papers' experiments, and say which of its claims hold.

    A run that was stopped goes on where it was when the same command is given again.
    """
    with one_line():
        import json

        from simvehicle.experiments.experiment import Options, Verdict
        from simvehicle.experiments.page import write_report
        from simvehicle.experiments.papers import paper_of
        from simvehicle.experiments.run import run_experiment
        from simvehicle.trials.cell import Cell

        base = Cell(
            motion=motion,  # type: ignore[arg-type]  # checked by Cell.problems
            cut_cells=cut_cells,
            cut_goal=cut_goal,
            arena_m=arena,
            speed_mps=speed,
            acceleration_mps2=acceleration,
            r_min_m=r_min,
            r_max_m=r_max,
            layout=layout,  # type: ignore[arg-type]
        )
        options = Options(
            sizes=numbers(sizes, int, "--sizes"),
            rates=numbers(rates, float, "--rates"),
            strategies=words(strategies),
            plumes=words(plumes),
            unhealed=words(unhealed) or ("reached",),
            regimes=words(regimes),
            worlds=worlds,
            quick=quick,
            full=full,
            trials=trials,
            base=base,
        )
        # Wrong options are told before anything is compiled.
        paper = paper_of(name)
        work = paper.define(name, options).work
        tell_compiling(
            *itertools.chain(
                *map(paper.trials.kernels, {paper.trials.code(one): one for one in work}.values())
            )
        )
        with _progress(name) as progress:
            report = run_experiment(
                name, options, seed=seed, out=out, jobs=jobs, scheduler=scheduler, progress=progress
            )
        page = write_report(report, _command(), rows.value)
        if as_json:
            for summary in report.summaries:
                typer.echo(json.dumps(summary))
        else:
            _show(paper.listing(report.summaries), report.verdicts)
        decided: list[Verdict] = [one for one in report.verdicts if one.verdict == "holds"]
        typer.echo(f"{len(decided)} of {len(report.verdicts)} claims hold; {page}", err=True)


def _command() -> str:
    """The command as it was given, for the page that shows its results."""
    return " ".join(["simvehicle", *sys.argv[1:]])


@contextlib.contextmanager
def _progress(name: str) -> Iterator[Any]:
    """A bar on the terminal's error output; nothing where nobody looks."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn(name),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("trials"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(name)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def _show(listing: Any, verdicts: list[Any]) -> None:
    """Table and verdicts for a person."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title=listing.title)
    for place, head in enumerate(listing.heads):
        table.add_column(head, justify="left" if place < listing.left else "right")
    for row in listing.rows:
        table.add_row(*row)
    console = Console()
    console.print(table)
    for one in verdicts:
        console.print(f"{one.verdict.upper()}: {one.claim}\n    {one.statistic}", highlight=False)
