"""Tables, and the files that an experiment leaves."""

from __future__ import annotations

import csv
import io
import pathlib
from typing import Any

import pandas as pd
import pytest

from simvehicle.experiments.experiment import ExperimentReport, Options
from simvehicle.experiments.locus.definitions import define
from simvehicle.experiments.page import cell_csv, write_report
from simvehicle.experiments.table import cell_table, full, summarise
from simvehicle.trials.cell import Cell
from simvehicle.trials.outcome import run_cell
from simvehicle.trials.trials_error import TrialsError


def test_summaries_and_tables_are_complete() -> None:
    cell = Cell(drones=3, arena_m=30.0, failure="generic", failure_rate=1e-3)
    summary = summarise(run_cell(cell, 1, 0, 5), cell)
    wanted = {"strategy", "drones", "plume", "trials", "success_rate", "contact_s_mean", "contact_s_sd"}
    wanted |= {"source_s_mean", "source_s_median", "source_s_sd", "failure_rate", "healing"}
    assert wanted <= summary.keys()
    assert summary["trials"] == 5
    assert "1e-03" in full([summary])
    nearly = summary | {"trials": 3000, "success_rate": 0.999, "success_low": 0.9971, "success_high": 0.9997}
    assert "| 99.9 % | 99.7..100.0 % |" in full([nearly])


def made(cell: Cell, success_rate: float = 0.5) -> dict[str, Any]:
    """A row of the table, with numbers of our own."""
    times = dict.fromkeys(
        ("contact_s_mean", "contact_s_sd", "source_s_mean", "source_s_median", "source_s_sd"), 60.0
    )
    return {
        "strategy": cell.strategy,
        "drones": cell.drones,
        "plume": cell.plume,
        "trials": 100,
        "success_rate": success_rate,
        "success_low": success_rate - 0.1,
        "success_high": success_rate + 0.1,
        **times,
        "source_s_max": 1.0 / 3.0,
        "motion": cell.motion,
        "failure_rate": cell.failure_rate,
        "healing": cell.healing,
        "heal_s_mean": None,
    }


def test_many_cells_are_a_file_and_a_short_table_of_decades() -> None:
    experiment = define("locus-3", Options(full=True, plumes=("smooth",)))
    summaries = [made(cell, 0.25 if cell.healing else 0.75) for cell in experiment.cells]
    table = cell_table("locus-3", summaries).splitlines()
    assert "[locus-3.csv](locus-3.csv)" in table[0]
    assert table[2].startswith(
        "| failure rate | smooth: locus, healing | smooth: locus, no healing | smooth: mobs |"
    )
    rates = [line.split("|")[1].strip() for line in table[4:]]
    assert rates == ["1e-06", "1e-05", "1e-04", "1e-03", "1e-02", "1e-01"]
    assert table[4].split("|")[2:4] == [" 25 % (15..35 %) ", " 75 % (65..85 %) "]
    odd = cell_table(
        "locus-3", [one for one in summaries if not f"{one['failure_rate']:.0e}".startswith("1e")]
    )
    assert len(odd.splitlines()) == 4 + 40, "no decade was flown"
    few = cell_table("locus-3", summaries[:10])
    assert few == full(summaries[:10]), "a person reads ten rows"


def test_the_file_has_every_cell_with_what_a_program_can_read() -> None:
    cells = define("locus-3", Options(rates=(1e-4, 1e-2))).cells
    read = list(csv.DictReader(io.StringIO(cell_csv([made(cell) for cell in cells]))))
    assert [float(row["failure_rate"]) for row in read] == [cell.failure_rate for cell in cells]
    assert [row["healing"] == "True" for row in read] == [cell.healing for cell in cells]
    assert read[0]["source_s_max"] == "0.333333"
    assert read[0]["heal_s_mean"] == ""


def test_a_report_names_the_files_that_it_writes(tmp_path: pathlib.Path) -> None:
    experiment = define("locus-4", Options(full=True, strategies=("locus",), plumes=("smooth",)))
    summaries = [made(cell) for cell in experiment.cells]
    rows = pd.DataFrame({"trial": [0]})
    page = write_report(
        ExperimentReport(experiment, tmp_path, rows, summaries, []), "simvehicle experiment …", "csv"
    )
    text = page.read_text(encoding="utf-8")
    assert text.startswith("# locus-4: Failures in the plume\n")
    written = {path.name for path in tmp_path.iterdir()}
    assert written == {"locus-4.md", "locus-4.png", "locus-4.json", "locus-4.csv", "rows.csv"}
    assert len((tmp_path / "locus-4.csv").read_text(encoding="utf-8").splitlines()) == 1 + 92
    with pytest.raises(TrialsError, match="the trials are kept"):
        write_report(ExperimentReport(experiment, tmp_path / "gone", rows, summaries, []), "…")
