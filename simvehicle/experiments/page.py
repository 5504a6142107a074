"""An experiment's results as files beside each other: page, figure, rows, and the table of a long page."""

from __future__ import annotations

import csv
import io
import json
import pathlib
from collections.abc import Sequence

import msgspec

from simvehicle.experiments.experiment import ExperimentReport, Summary, Verdict
from simvehicle.experiments.papers import paper_of
from simvehicle.experiments.table import is_long
from simvehicle.trials.trials_error import TrialsError


def write_report(report: ExperimentReport, command: str, rows_as: str = "parquet") -> pathlib.Path:
    """Write rows, table, verdicts and figure beside each other; the path of the page that shows them."""
    from simvehicle.experiments.picture import save

    experiment, directory = report.experiment, report.directory
    name = experiment.name
    paper = paper_of(name)
    heading = paper.heading(experiment)
    caption = paper.caption(experiment, report.summaries)
    notes = paper.notes(experiment, report.rows) if paper.notes else ""
    page = directory / f"{name}.md"
    try:
        save(paper.draw(experiment, report.summaries, f"{heading}\n{caption}"), directory / f"{name}.png")
        (directory / f"{name}.json").write_text(
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
            f"## Verdicts\n\n{verdict_table(report.verdicts)}\n{notes}"
            f"## Cells\n\n{paper.table(name, report.summaries)}",
            encoding="utf-8",
        )
        if is_long(report.summaries):
            (directory / f"{name}.csv").write_text(cell_csv(report.summaries), encoding="utf-8")
        if rows_as == "csv":
            report.rows.to_csv(directory / "rows.csv", index=False)
        else:
            report.rows.to_parquet(directory / "rows.parquet", index=False)
    except OSError as error:
        raise TrialsError(f"{directory}: {error.strerror or error}; the trials are kept") from error
    return page


def verdict_table(verdicts: Sequence[Verdict]) -> str:
    lines = ["| claim | verdict | statistic |", "| --- | --- | --- |"]
    lines += [f"| {one.claim} | **{one.verdict}** | {one.statistic} |" for one in verdicts]
    return "\n".join(lines) + "\n"


def cell_csv(summaries: Sequence[Summary]) -> str:
    """Every cell in a line, with the columns of its summary; empty where it has none."""
    text = io.StringIO()
    writer = csv.DictWriter(text, summaries[0].keys(), lineterminator="\n")
    writer.writeheader()
    for one in summaries:
        writer.writerow({key: _rounded(value) for key, value in one.items()})
    return text.getvalue()


def _rounded(value: object) -> object:
    """More digits than the trials decide are no knowledge."""
    return f"{value:.6g}" if isinstance(value, float) else value
