"""Experiments on traced plumes: what is flown, the verdicts on rows of our own, and the files."""

from __future__ import annotations

import json
import pathlib
from collections import Counter
from typing import Any

import numpy as np
import pandas as pd
import pytest

from simvehicle.experiments.experiment import Experiment, ExperimentReport, Options
from simvehicle.experiments.page import write_report
from simvehicle.experiments.papers import paper_of
from simvehicle.experiments.tracing.traced_cells import TracedCell, define
from simvehicle.experiments.tracing.traced_paper import TRACING
from simvehicle.experiments.tracing.traced_table import mean_interval, summarise
from simvehicle.experiments.tracing.traced_verdicts import compare, judge
from simvehicle.trials.cell import Cell
from simvehicle.trials.trials_error import TrialsError


def test_the_full_size_is_the_papers() -> None:
    third = define("fluxo-3", Options(full=True))
    assert len(third.work) * third.trials * len(third.work[0].robots) == 40_500
    kinds = Counter((world.regime, world.obstacles, world.obstacle_m) for world in third.work)
    assert len(kinds) == 27
    assert set(kinds.values()) == {3}
    assert third.work[0].vehicles.limit_steps == 7000
    assert third.work[0].robots == (7, 14, 21, 28, 35, 42, 49, 56, 63, 70)
    fourth = define("fluxo-4", Options(full=True))
    assert (len(fourth.work), fourth.trials, len(fourth.work[0].robots)) == (10, 30, 15)
    assert {(world.obstacles, world.obstacle_m) for world in fourth.work} == {(10, 1.5)}


def test_a_few_worlds_are_evenly_mixed_and_the_same_as_the_first_of_many() -> None:
    few, many = define("fluxo-3", Options(worlds=9)), define("fluxo-3", Options(worlds=27, trials=9))
    assert few.work == many.work[:9]
    assert Counter(world.regime for world in few.work) == dict.fromkeys(
        ("laminar", "transitional", "turbulent"), 3
    )
    assert len({(world.obstacles, world.obstacle_m) for world in few.work}) == 9
    one = define("fluxo-4", Options(regimes=("turbulent",), strategies=("casting", "casting"), sizes=(3,)))
    assert {(cell.strategy, cell.robots, cell.regime) for cell in one.cells} == {("casting", 3, "turbulent")}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (Options(rates=(0.1,)), "fluxo-3 has no use for --rates"),
        (Options(plumes=("smooth",)), "no use for --plumes"),
        (Options(base=Cell(motion="paper", arena_m=50.0)), "no use for --motion, --arena"),
        (Options(worlds=0), "--worlds must be at least 1"),
        (Options(trials=0), "--trials must be at least 1"),
        (Options(regimes=("calm",)), "no regime is called 'calm'"),
        (Options(strategies=("locus",)), "strategy locus is no rule of ticks"),
        (Options(strategies=("sniff",)), "no strategy is called 'sniff'"),
        (Options(sizes=(0,)), "a swarm has 1 to 1000 robots"),
    ],
)
def test_impossible_options_are_one_line(options: Options, words: str) -> None:
    with pytest.raises(TrialsError, match=words):
        define("fluxo-3", options)


def test_worlds_belong_to_traced_plumes_alone() -> None:
    for options in (Options(worlds=3), Options(regimes=("laminar",))):
        with pytest.raises(TrialsError, match="--regimes and --worlds belong to"):
            paper_of("locus-1").define("locus-1", options)


def made(experiment: Experiment, arrivals: dict[str, float], *, noise: float = 200.0) -> pd.DataFrame:
    """Rows of our own: each strategy's arrival about a number of steps, sooner with more robots."""
    rng = np.random.default_rng(5)
    rows: list[dict[str, Any]] = []
    for world in experiment.work:
        harder = rng.normal(0.0, noise)
        for strategy in world.strategies:
            for robots in world.robots:
                for trial in range(experiment.trials):
                    steps = arrivals[strategy] + harder + rng.normal(0.0, noise) - 5.0 * robots
                    rows.append(
                        {
                            "strategy": strategy,
                            "robots": robots,
                            "regime": world.regime,
                            "condition": world.condition,
                            "obstacle_share": world.obstacle_share,
                            "world": world.number,
                            "seed": 1,
                            "trial": trial,
                            "success": steps < 7000.0,
                            "arrival_steps": steps if steps < 7000.0 else np.nan,
                            "contact_steps": 10.0,
                            "limit_steps": 7000,
                            "localisation": 20_000.0 - 2.0 * steps,
                            "lost": 0,
                            "intermittency": 0.1 * (world.number % 10),
                            "peak_to_mean": 2.0 + world.number,
                            "plume_share": 0.1,
                        }
                    )
    return pd.DataFrame(rows)


PAPERS_ORDER = {"fluxotaxis": 1500.0, "anemotaxis": 2500.0, "chemotaxis": 4000.0, "casting": 6000.0}


def test_claims_hold_where_rows_say_so_and_not_where_they_say_the_contrary() -> None:
    experiment = define("fluxo-3", Options(worlds=27, trials=3))
    verdicts = {one.claim: one for one in judge(experiment, made(experiment, PAPERS_ORDER))}
    for claim in (
        "fluxotaxis arrives before anemotaxis",
        "anemotaxis arrives before chemotaxis",
        "chemotaxis arrives before casting",
        "fluxotaxis localises more than chemotaxis",
        "fluxotaxis: larger swarms arrive sooner",
        "fluxotaxis: larger swarms localise more",
        "fluxotaxis arrives first whatever the obstacles",
        "fluxotaxis localises most whatever the obstacles",
    ):
        assert verdicts[claim].verdict == "holds", verdicts[claim]
    assert verdicts["chemotaxis localises more than anemotaxis"].verdict == "does not hold"
    contrary = dict(zip(PAPERS_ORDER, reversed(PAPERS_ORDER.values()), strict=True))
    verdicts = {one.claim: one for one in judge(experiment, made(experiment, contrary))}
    assert verdicts["fluxotaxis arrives before anemotaxis"].verdict == "does not hold"
    assert verdicts["fluxotaxis arrives first whatever the obstacles"].verdict == "does not hold"


def test_a_difference_by_chance_is_undecided_and_censoring_is_told() -> None:
    experiment = define("fluxo-3", Options(worlds=9, trials=4))
    rows = made(experiment, PAPERS_ORDER | {"fluxotaxis": 2490.0}, noise=800.0)
    verdict = compare(rows, "fluxotaxis", "anemotaxis", "…", localises=False)
    assert verdict.verdict == "undecided"
    assert "never arrived: 0 and 0" in verdict.statistic
    late = made(experiment, PAPERS_ORDER | {"casting": 9000.0})
    verdict = compare(late, "chemotaxis", "casting", "…", localises=False)
    assert verdict.verdict == "holds"
    assert f"never arrived: 0 and {9 * 4 * 3}" in verdict.statistic


def test_who_never_arrives_counts_with_all_steps() -> None:
    experiment = define("fluxo-3", Options(worlds=9, trials=4))
    rows = made(experiment, PAPERS_ORDER | {"casting": 9000.0})
    world = experiment.work[0]
    cell = TracedCell("casting", 7, world.regime, world.obstacle_share)
    summary = summarise(rows, cell)
    assert summary["arrival_steps_mean"] == summary["arrival_steps_median"] == 7000.0
    assert summary["success_rate"] == 0.0
    assert summary["censored"] == summary["trials"] == 4
    wanted = {"strategy", "robots", "regime", "obstacle_share", "trials", "arrival_steps_mean"}
    wanted |= {"arrival_steps_median", "localisation_mean", "success_rate"}
    assert wanted <= summary.keys()


def test_trials_of_one_world_are_one_case() -> None:
    rows = pd.DataFrame({"world": np.repeat([1, 2, 3], 100)})
    values = np.repeat([1.0, 2.0, 3.0], 100)
    low, high = mean_interval(rows, values)
    assert (low, high) == pytest.approx((2.0 - 4.303 / np.sqrt(3.0), 2.0 + 4.303 / np.sqrt(3.0)), abs=1e-3)
    assert mean_interval(rows[:100], np.arange(100.0))[0] == pytest.approx(49.5 - 1.984 * 2.901, abs=0.01)


def test_page_figure_and_table_are_written(tmp_path: pathlib.Path) -> None:
    experiment = define("fluxo-3", Options(worlds=9, trials=2))
    rows = made(experiment, PAPERS_ORDER)
    summaries = [TRACING.summarise(rows, cell) for cell in experiment.cells]
    report = ExperimentReport(experiment, tmp_path, rows, summaries, judge(experiment, rows))
    page = write_report(report, "simvehicle experiment fluxo-3", "csv").read_text()
    assert "9 worlds with 2 starts each" in page
    assert "| most intermittent third | 3 |" in page
    assert "first to arrive" in page
    assert "fluxo-3.csv" in page
    assert (tmp_path / "fluxo-3.png").stat().st_size > 10_000
    assert len(json.loads((tmp_path / "fluxo-3.json").read_text())["cells"]) == len(experiment.cells)
    listed = TRACING.listing(summaries)
    assert all(len(row) == len(listed.heads) for row in listed.rows)
