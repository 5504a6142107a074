"""The lattice's experiments: what is flown, and the verdicts on rows of our own."""

from __future__ import annotations

import pathlib
from collections import Counter
from typing import Any

import numpy as np
import pandas as pd
import pytest

from simvehicle.experiments.experiment import ExperimentReport, Options
from simvehicle.experiments.lattice.lattice_cells import define, summarise
from simvehicle.experiments.lattice.lattice_claims import judge
from simvehicle.experiments.lattice.lattice_flights import fly_world
from simvehicle.experiments.page import write_report
from simvehicle.trials.trials_error import TrialsError


def test_the_full_sizes_are_the_papers() -> None:
    first = define("fluxo-1", Options(full=True))
    assert (len(first.work), first.trials, len(first.work[0].factors)) == (35, 200, 10)
    assert {(world.limit_steps, world.start_m, world.obstacles) for world in first.work} == {(3000, None, 0)}
    second = define("fluxo-2", Options(full=True))
    assert (len(second.work), second.trials) == (150, 500)
    assert {(world.limit_steps, world.start_m, world.head_start_s) for world in second.work} == {
        (7000, 25.0, 3600.0)
    }
    kinds = Counter((w.regime, w.plume, w.obstacles, w.obstacle_m) for w in second.work)
    assert (len(kinds), set(kinds.values())) == (3 * 2 * 5, {5})


def test_a_few_worlds_are_the_first_of_many() -> None:
    assert define("fluxo-2", Options(worlds=7)).work == define("fluxo-2", Options()).work[:7]
    one = define("fluxo-1", Options(regimes=("laminar",), strategies=("casting", "casting"), worlds=2))
    assert {(world.regime, world.tracers) for world in one.work} == {("laminar", ("casting",))}
    assert [world.plume for world in one.work] == ["dense", "sparse"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (Options(sizes=(9,)), "lattices of 7 vehicles"),
        (Options(plumes=("smooth",)), "no use for --plumes"),
        (Options(regimes=("calm",)), "no regime is called 'calm'"),
        (Options(strategies=("locus",)), "flies fluxotaxis, chemotaxis, anemotaxis, casting, not 'locus'"),
        (Options(trials=0), "--trials must be 1 to 1000, not 0"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_is_impossible_is_told_in_one_line(options: Options, words: str) -> None:
    with pytest.raises(TrialsError, match=words):
        define("fluxo-1", options)


def rows_of(name: str, success: dict[str, float]) -> tuple[Any, pd.DataFrame]:
    """An experiment, and rows in which tracers have about this success, proximity and containment."""
    experiment = define(name, Options(worlds=6, trials=12))
    rng = np.random.default_rng(3)
    rows = []
    for world in experiment.work:
        for tracer in world.tracers:
            for factor in world.factors:
                share = success[tracer] * (0.5 + 0.5 * factor / max(world.factors))
                inside = rng.random(12) < share
                rows.append(
                    pd.DataFrame(
                        {
                            "strategy": tracer,
                            "robots": 7,
                            "regime": world.regime,
                            "plume": world.plume,
                            "obstacle_share": world.obstacle_share,
                            "factor": factor,
                            "world": world.number,
                            "trial": np.arange(12),
                            "success": inside,
                            "proximity": 0.5 + 0.4 * share + rng.uniform(-0.05, 0.05, 12),
                            "arrival_steps": np.where(inside, 500.0, np.nan),
                            "limit_steps": world.limit_steps,
                            "localisation": (share * world.limit_steps),
                            "containment": share + rng.uniform(-0.05, 0.05, 12),
                            "intermittency": 0.3,
                            "peak_to_mean": 6.0,
                            "plume_share": 0.2,
                        }
                    )
                )
    return experiment, pd.concat(rows, ignore_index=True)


def test_verdicts_follow_the_rows() -> None:
    found = {"fluxotaxis": 0.8, "chemotaxis": 0.2, "anemotaxis": 0.85}
    verdicts = {one.claim: one for one in judge(*rows_of("fluxo-1", found))}
    inside = "fluxotaxis has the source inside at the end more often than"
    assert verdicts[f"{inside} chemotaxis"].verdict == "holds"
    assert "the paper: 0.746 and 0.318" in verdicts[f"{inside} chemotaxis"].statistic
    assert verdicts[f"{inside} anemotaxis"].verdict == "undecided"
    assert verdicts[f"{inside} chemotaxis: dense plumes"].verdict == "holds"
    assert verdicts["fluxotaxis: success grows with the greatest radius"].verdict == "holds"
    nearer = "with the widest lattice anemotaxis ends nearer to the source than chemotaxis"
    assert verdicts[nearer].verdict == "holds"
    found = {"fluxotaxis": 0.3, "chemotaxis": 0.7, "anemotaxis": 0.1}
    verdicts = {one.claim: one for one in judge(*rows_of("fluxo-2", found))}
    longer = "fluxotaxis contains the source longer than"
    assert verdicts[f"{longer} chemotaxis"].verdict == "does not hold"
    assert verdicts[f"{longer} anemotaxis"].verdict == "holds"


@pytest.mark.parametrize("name", ["fluxo-1", "fluxo-2"])
def test_rows_page_and_figure(name: str, tmp_path: pathlib.Path) -> None:
    experiment, rows = rows_of(name, {"fluxotaxis": 0.8, "chemotaxis": 0.2, "anemotaxis": 0.4})
    summaries = [summarise(rows, cell) for cell in experiment.cells]
    wanted = {
        *("strategy", "robots", "regime", "obstacle_share", "trials"),
        *("arrival_steps_mean", "arrival_steps_median", "localisation_mean", "success_rate"),
    }
    assert all(wanted <= one.keys() for one in summaries)
    assert all(0.0 <= one["containment_low"] <= one["containment_high"] <= 1.0 for one in summaries)
    report = ExperimentReport(experiment, tmp_path, rows, summaries, judge(experiment, rows))
    page = write_report(report, f"simvehicle experiment {name}").read_text()
    assert "## Who wins when" in page
    assert "| dense | laminar |" in page
    assert (tmp_path / f"{name}.png").stat().st_size > 10_000


@pytest.mark.long
def test_a_world_is_the_same_however_its_trials_are_split() -> None:
    world = define("fluxo-1", Options(quick=True)).work[3]
    whole = fly_world(world, 1, 0, 3)
    parts = pd.concat([fly_world(world, 1, 0, 1), fly_world(world, 1, 1, 2)])
    order = ["strategy", "factor", "trial"]
    pd.testing.assert_frame_equal(
        whole.sort_values(order, ignore_index=True), parts.sort_values(order, ignore_index=True)
    )
