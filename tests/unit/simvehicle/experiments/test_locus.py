"""The LoCUS paper's experiments: their cells, and what the numbers make of its claims."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import pandas as pd
import pytest

from simvehicle.experiments.claims import begins_to_fail
from simvehicle.experiments.experiment import Options
from simvehicle.experiments.locus.definitions import FULL_RATES, define
from simvehicle.experiments.locus.verdicts import judge
from simvehicle.experiments.papers import paper_of
from simvehicle.trials.cell import Cell
from simvehicle.trials.outcome import run_cell
from simvehicle.trials.trials_error import TrialsError


def test_definitions_have_the_papers_cells() -> None:
    assert len(FULL_RATES) == 46
    assert FULL_RATES[0] == 1e-6
    assert FULL_RATES[-1] == 0.1
    assert [cell.drones for cell in define("locus-1", Options(strategies=("locus",))).cells] == [5, 10, 20]
    assert len(define("locus-2", Options(full=True)).cells) == 38
    three = define("locus-3", Options(full=True))
    assert len(three.cells) == 2 * 3 * 46
    assert {cell.failure for cell in three.cells} == {"generic"}
    assert define("locus-4", Options(quick=True)).trials == 20


def test_what_is_named_twice_is_run_once() -> None:
    twice = Options(sizes=(5, 5), strategies=("locus", "mobs", "locus"))
    once = Options(sizes=(5,), strategies=("locus", "mobs"))
    for name in ("locus-1", "locus-2"):
        assert define(name, twice) == define(name, once)
    assert define("locus-3", Options(rates=(1e-4, 1e-4))) == define("locus-3", Options(rates=(1e-4,)))


def test_the_experiments_fly_as_the_paper_did_and_both_readings_of_no_healing() -> None:
    options = Options(rates=(1e-4,), strategies=("locus", "mobs-authors"), plumes=("smooth", "gusty"))
    options = msgspec.structs.replace(options, unhealed=("reached", "nobody"))
    cells = define("locus-3", options).cells
    assert {cell.motion for cell in cells} == {"paper"}
    smooth = [cell for cell in cells if cell.plume == "smooth"]
    assert [(c.strategy, c.healing, c.unhealed) for c in smooth] == [
        ("locus", True, "reached"),
        ("locus", False, "reached"),
        ("locus", False, "nobody"),
        ("mobs-authors", False, "reached"),
    ]
    assert [(c.cut_cells, c.cut_goal) for c in smooth] == [(False, False)] * 3 + [(True, True)]
    assert not any(cell.cut_cells for cell in cells if cell.plume == "gusty"), "it has no cells"


def test_of_many_sizes_one_verdict_tells_where_a_claim_holds() -> None:
    experiment = define("locus-2", Options(sizes=tuple(range(2, 10)), trials=30))
    rng = np.random.default_rng(2)
    rows = []
    for cell in (*experiment.cells, *experiment.compared):
        scatter = 500.0 if (cell.strategy == "mobs") == (cell.drones != 7) else 50.0
        times = 1000.0 + scatter * rng.uniform(-1.0, 1.0, 30)
        rows.append(made_rows(cell, times - 100.0, times))
    verdicts = {one.claim: one for one in judge(experiment, pd.concat(rows))}
    claim = "LoCUS' deviation of the time to max flux is below MoBS'"
    assert verdicts[f"5 drones: {claim}"].verdict == "holds"
    assert f"7 drones: {claim}" not in verdicts
    every = verdicts[f"2 to 9 drones: {claim} at every size"]
    assert every.verdict == "does not hold"
    assert every.statistic == "holds at 2, 3, 4, 5, 6, 8, 9; does not hold at 7"


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("locus-9", Options(), "no experiment is called 'locus-9'"),
        ("locus-1", Options(rates=(1e-3,)), "--rates belongs to"),
        ("locus-1", Options(trials=0), "--trials must be at least 1"),
        ("locus-3", Options(rates=(2.0,)), "probability"),
        ("locus-1", Options(sizes=(0,)), "1 to 1000 drones"),
    ],
)
def test_impossible_experiments_are_named(name: str, options: Options, words: str) -> None:
    with pytest.raises(TrialsError, match=words):
        paper_of(name).define(name, options)


def made_rows(cell: Cell, contact_s: Any, source_s: Any) -> pd.DataFrame:
    """Rows as `run_cell` gives them, with times of our own."""
    rows = run_cell(msgspec.structs.replace(cell, arena_m=30.0), 1, 0, len(contact_s))
    rows["arena_m"] = cell.arena_m
    rows["contact_s"], rows["source_s"] = contact_s, source_s
    rows["success"] = np.isfinite(source_s)
    return rows


def test_verdicts_follow_the_numbers() -> None:
    rng = np.random.default_rng(1)
    experiment = define("locus-1", Options(sizes=(5,)))
    locus, mobs = experiment.cells
    short = rng.uniform(400.0, 600.0, 60)
    long = rng.uniform(500.0, 3000.0, 60)
    rows = pd.concat([made_rows(locus, short, short + 100.0), made_rows(mobs, long, long + 100.0)])
    verdicts = judge(experiment, rows)
    assert [one.verdict for one in verdicts] == ["holds"] * 4
    swapped = pd.concat([made_rows(mobs, short, short + 100.0), made_rows(locus, long, long + 100.0)])
    assert [one.verdict for one in judge(experiment, swapped)] == ["does not hold"] * 4
    same = pd.concat([made_rows(mobs, short, short), made_rows(locus, short[::-1], short[::-1])])
    assert [one.verdict for one in judge(experiment, same)] == ["undecided"] * 4


def test_where_a_strategy_begins_to_fail() -> None:
    cells = [Cell(failure="generic", failure_rate=rate, drones=3) for rate in (1e-6, 1e-5, 1e-4, 1e-3)]
    rows = []
    for cell, successes in zip(cells, (100, 98, 93, 10), strict=True):
        times = np.where(np.arange(100) < successes, 100.0, np.nan)
        rows.append(made_rows(cell, times, times))
    assert begins_to_fail(pd.concat(rows), cells) == (1e-5, 1e-3)


@pytest.mark.parametrize(
    ("rates", "successes", "verdict"),
    [
        ((2e-4, 9e-4), (100, 20), "holds"),
        ((1e-5, 1e-4), (100, 24), "does not hold"),  # it has begun before the range begins
        ((1e-5, 1e-3), (100, 24), "undecided"),  # before or within
        ((2e-4, 1e-2), (100, 24), "undecided"),
        ((2e-3, 1e-2), (100, 24), "does not hold"),
        ((2e-4, 9e-4), (100, 100), "undecided"),
        ((2e-4, 9e-4), (20, 10), "undecided"),
    ],
)
def test_a_threshold_holds_only_where_the_rates_flown_enclose_it(
    rates: Any, successes: Any, verdict: str
) -> None:
    """The claim: LoCUS with healing begins to fail between 1e-4 and 1e-3."""
    options = Options(rates=rates, strategies=("locus",), plumes=("smooth",), sizes=(3,))
    experiment = define("locus-3", options)
    succeeded = dict(zip(rates, successes, strict=True))
    rows = []
    for cell in experiment.cells:
        times = np.where(np.arange(100) < succeeded[cell.failure_rate], 100.0, np.nan)
        rows.append(made_rows(cell, times, times))
    first = judge(experiment, pd.concat(rows))[0]
    assert "with healing begins to fail" in first.claim
    assert first.verdict == verdict


def test_one_trial_does_not_decide_whether_healing_pays() -> None:
    options = Options(rates=(1e-4,), strategies=("locus",), plumes=("smooth",), sizes=(3,), trials=1)
    experiment = define("locus-3", options)
    healing, without = experiment.cells
    rows = pd.concat([made_rows(healing, [100.0], [100.0]), made_rows(without, [np.nan], [np.nan])])
    pays = judge(experiment, rows)[-1]
    assert "healing makes LoCUS succeed more often" in pays.claim
    assert (pays.verdict, pays.statistic) == ("undecided", "fewer than two paired trials")
