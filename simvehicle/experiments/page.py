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
from simvehicle.experiments.table import by_rate, full
from simvehicle.trials.trials_error import TrialsError

_SHOWN_SIZES = (5, 10, 20)
_LONGEST = 60
"""A table of more cells than this is a file of its own; the page shows the decades of the failure rate, or a few
swarm sizes."""


def write_report(report: ExperimentReport, command: str, rows_as: str = "parquet") -> pathlib.Path:
    """Write rows, table, verdicts and figure beside each other; the path of the page that shows them."""
    from simvehicle.experiments.picture import save

    experiment, directory = report.experiment, report.directory
    name, heading = experiment.name, experiment.title
    if not experiment.by_rate:  # with rates there is a panel a plume
        heading += f", {' and '.join(dict.fromkeys(cell.plume for cell in experiment.cells))} plume"
    title = f"{heading}\n{experiment.trials} trials a cell, motion {report.summaries[0]['motion']}"
    page = directory / f"{name}.md"
    try:
        save(paper_of(name).draw(experiment, report.summaries, title), directory / f"{name}.png")
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
            f"## Verdicts\n\n{verdict_table(report.verdicts)}\n## Cells\n\n{cell_table(name, report.summaries)}",
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


def is_long(summaries: Sequence[Summary]) -> bool:
    """Whether the cells are too many for a page that a person reads."""
    return len(summaries) > _LONGEST


def cell_table(name: str, summaries: Sequence[Summary]) -> str:
    """All cells, or of many the decades of the failure rate (the sizes 5, 10, 20) and where the rest is."""
    if not is_long(summaries):
        return full(summaries)
    if "failure_rate" not in summaries[0]:
        shown = [one for one in summaries if one["drones"] in _SHOWN_SIZES] or list(summaries)
        return f"All {len(summaries)} cells are in [{name}.csv]({name}.csv).\n\n{full(shown)}"
    return (
        "Trials that find the source, with Wilson's 95 % interval. "
        f"All {len(summaries)} cells with all columns are in [{name}.csv]({name}.csv).\n\n{by_rate(summaries)}"
    )


def cell_csv(summaries: Sequence[Summary]) -> str:
    """Every cell in a line, with the columns of `simvehicle.experiments.table.summarise`; empty where it has none."""
    text = io.StringIO()
    writer = csv.DictWriter(text, summaries[0].keys(), lineterminator="\n")
    writer.writeheader()
    for one in summaries:
        writer.writerow({key: _rounded(value) for key, value in one.items()})
    return text.getvalue()


def _rounded(value: object) -> object:
    """More digits than the trials decide are no knowledge."""
    return f"{value:.6g}" if isinstance(value, float) else value
