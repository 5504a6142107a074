"""Running an experiment from its options to its files: rows, table, figure, verdicts."""

from __future__ import annotations

import hashlib
import json
import os
import pathlib
from typing import Any

import msgspec
import pandas as pd

from simvehicle.experiments.locus.definitions import Experiment, Options, define
from simvehicle.experiments.locus.verdicts import Verdict, judge
from simvehicle.experiments.locus.verdicts import markdown as verdict_markdown
from simvehicle.experiments.table import markdown, summarise
from simvehicle.trials.batch import Progress, complete
from simvehicle.trials.store import Run, Store
from simvehicle.trials.trials_error import TrialsError

_ALONE = 2500
"""Runs of fewer trials than this are done before other processes have even started."""

_TITLES = {
    "locus-1": "Time to contact and to max flux",
    "locus-2": "Time to contact and to max flux",
    "locus-3": "Generic failures",
    "locus-4": "Failures in the plume",
}


class ExperimentReport(msgspec.Struct, frozen=True):
    experiment: Experiment
    directory: pathlib.Path
    rows: pd.DataFrame
    summaries: list[dict[str, Any]]
    verdicts: list[Verdict]


def usual_jobs(trials: int) -> int:
    """How many cores a run of so many trials is spread over unless a person says."""
    return len(os.sched_getaffinity(0)) if trials > _ALONE else 1


def run_experiment(
    name: str,
    options: Options,
    *,
    seed: int,
    out: pathlib.Path | None = None,
    jobs: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> ExperimentReport:
    """Run what is missing of an experiment and judge it. Everything that a person can get wrong: `TrialsError`."""
    experiment = define(name, options)
    cells = experiment.cells + experiment.compared
    run = Run(name, seed, experiment.trials, min(100, experiment.trials), cells)
    directory = out or pathlib.Path("out") / "experiments" / f"{name}-{_identity(run)}"
    store = Store(directory, run)
    rows = complete(
        run,
        store,
        jobs=jobs or usual_jobs(len(cells) * experiment.trials),
        scheduler=scheduler,
        progress=progress,
    )
    summaries = [summarise(rows, cell) for cell in experiment.cells]
    return ExperimentReport(experiment, directory, rows, summaries, judge(experiment, rows))


def _identity(run: Run) -> str:
    """Equal for equal runs: the same command again goes on with, or shows, the same results."""
    return hashlib.sha256(msgspec.json.encode(run)).hexdigest()[:10]


def write_report(report: ExperimentReport, command: str, rows_as: str = "parquet") -> pathlib.Path:
    """Write rows, table, verdicts and figure beside each other; the path of the page that shows them."""
    from simvehicle.experiments.locus import figures

    name = report.experiment.name
    heading = _TITLES[name]
    if not report.experiment.by_rate:  # with rates there is a panel a plume
        heading += f", {' and '.join(dict.fromkeys(cell.plume for cell in report.experiment.cells))} plume"
    draw = figures.rates if report.experiment.by_rate else figures.bars
    title = f"{heading}\n{report.experiment.trials} trials a cell, motion {report.summaries[0]['motion']}"
    page = report.directory / f"{name}.md"
    try:
        figures.save(draw(report.summaries, title), report.directory / f"{name}.png")
        (report.directory / f"{name}.json").write_text(
            json.dumps(
                {
                    "cells": report.summaries,
                    "verdicts": [msgspec.to_builtins(one) for one in report.verdicts],
                },
                indent=1,
            )
            + "\n",
            encoding="utf-8",
        )
        page.write_text(
            f"# {name}: {heading}\n\n```sh\n{command}\n```\n\n![{heading}]({name}.png)\n\n"
            f"## Verdicts\n\n{verdict_markdown(report.verdicts)}\n## Cells\n\n{markdown(report.summaries)}",
            encoding="utf-8",
        )
        if rows_as == "csv":
            report.rows.to_csv(report.directory / "rows.csv", index=False)
        else:
            report.rows.to_parquet(report.directory / "rows.parquet", index=False)
    except OSError as error:
        raise TrialsError(f"{report.directory}: {error.strerror or error}; the trials are kept") from error
    return page
