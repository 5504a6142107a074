"""Running an experiment: what is missing of its trials, its table, its verdicts."""

from __future__ import annotations

import hashlib
import os
import pathlib

import msgspec

from simvehicle.experiments.experiment import Experiment, ExperimentReport, Options, Paper
from simvehicle.experiments.papers import paper_of
from simvehicle.trials.batch import Progress, complete
from simvehicle.trials.store import Run, Store

_ALONE = 2500
"""Runs of fewer trials than this are done before other processes have even started."""


def usual_jobs(paper: Paper, experiment: Experiment) -> int:
    """How many cores an experiment is spread over unless a person says."""
    trials = len(experiment.work) * experiment.trials * paper.weight
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
    paper = paper_of(name)
    experiment = paper.define(name, options)
    work = experiment.work
    run = Run(name, seed, experiment.trials, min(100, experiment.trials), work, paper.trials.engine(work))
    directory = out or pathlib.Path("out") / "experiments" / f"{name}-{_identity(run)}"
    store = Store(directory, run)
    rows = complete(
        run,
        store,
        paper.trials,
        jobs=jobs or usual_jobs(paper, experiment),
        scheduler=scheduler,
        progress=progress,
    )
    summaries = [paper.summarise(rows, cell) for cell in experiment.cells]
    return ExperimentReport(experiment, directory, rows, summaries, paper.judge(experiment, rows))


def _identity(run: Run) -> str:
    """Equal for equal runs: the same command again goes on with, or shows, the same results."""
    return hashlib.sha256(msgspec.json.encode(run)).hexdigest()[:10]
