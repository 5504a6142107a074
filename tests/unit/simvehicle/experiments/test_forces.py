"""The virtual-force experiments: what is flown, where it starts, and the verdicts on rows of our own."""

from __future__ import annotations

import pathlib
from collections import Counter
from typing import Any

import msgspec
import numpy as np
import pandas as pd
import pytest

from simvehicle.experiments.experiment import ExperimentReport, Options
from simvehicle.experiments.forces.forces_arena import ARENAS, ForcesWorld, start_places
from simvehicle.experiments.forces.forces_cells import ForcesCell, define, summarise
from simvehicle.experiments.forces.forces_claims import judge
from simvehicle.experiments.forces.forces_flights import engine_of, fly_world, parameters_of
from simvehicle.experiments.forces.forces_paper import FORCES
from simvehicle.experiments.page import write_report
from simvehicle.trials.tracing.swarm_flight import TracedScene, make_place
from simvehicle.trials.trials_error import TrialsError
from simvehicle.world.recorded_air import RecordedAir


def test_the_usual_size_is_the_papers_with_sixty_repeats() -> None:
    small = define("forces-small", Options())
    assert Counter(world.obstacles for world in small.work) == {0: 6, 5: 6, 10: 6}
    assert small.trials * 6 == 60
    assert len({world.number for world in small.work}) == 18
    tracker = [cell for cell in small.cells if cell.variant == "virtual-forces"]
    assert len(tracker) == 3 * 4 * 3
    assert {(cell.robots, cell.obstacles, cell.emission_gps) for cell in tracker} == {
        (robots, obstacles, emission)
        for robots in (5, 15, 20, 30)
        for obstacles in (0, 5, 10)
        for emission in (0.01, 0.02, 0.05)
    }
    large = define("forces-large", Options())
    assert len(large.work) * large.trials == 60
    assert {cell.robots for cell in large.cells} == {10, 20, 30, 40, 60}
    assert len(define("forces-small", Options(quick=True)).work) == 6
    assert len(define("forces-large", Options(full=True)).work) == 36


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (Options(rates=(0.1,)), "forces-small has no use for --rates"),
        (Options(regimes=("laminar",)), "no use for --regimes"),
        (Options(strategies=("locus",)), "flies virtual-forces, no-cohesion, upwind, not 'locus'"),
        (Options(sizes=(61,)), "a swarm of forces-small has 1 to 60 robots, not 61"),
        (Options(trials=0), "--trials must be at least 1, not 0"),
        (Options(worlds=0), "--worlds must be at least 1, not 0"),
        (Options(trials=101), "100 at most, not 101"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_is_impossible_is_told_in_one_line(options: Options, words: str) -> None:
    with pytest.raises(TrialsError, match=words) as told:
        define("forces-small", options)
    assert "\n" not in str(told.value)


def test_variants_differ_in_what_they_say_alone() -> None:
    arena = ARENAS["small"]
    tracker, loose = parameters_of(arena, "virtual-forces"), parameters_of(arena, "no-cohesion")
    assert {name for name in tracker if tracker[name] != loose[name]} == {"attraction_m3ps"}
    upwind = parameters_of(arena, "upwind")
    assert upwind.items() <= tracker.items()


def empty_place() -> TracedScene:
    arena = ARENAS["small"]
    gas = np.zeros((1, 51, 76), np.float32)
    gas[0, 20, 65] = 1.0
    air = RecordedAir(
        gas,
        np.zeros((1, 2, 2, 2), np.float32),
        np.zeros((51, 76), np.bool_),
        np.zeros(2),
        0.08,
        np.zeros(2),
        6.0,
        1.0,
        np.array([arena.north_m, arena.east_m]),
    )
    return make_place(air, np.array([arena.source_m]))


def test_robots_start_downwind_apart_and_the_first_where_the_plume_is_thickest() -> None:
    world = define("forces-small", Options()).work[0]
    place = empty_place()
    many = start_places(world, place, 1, 3, 30)
    assert many[0] == pytest.approx([1.6, 5.2])
    assert many[:, 1].min() >= 4.6
    apart_m = np.linalg.norm(many[:, None] - many, axis=2)[np.triu_indices(30, 1)]
    assert apart_m.min() > 2.0 * ARENAS["small"].vehicles.radius_m
    np.testing.assert_array_equal(many[:5], start_places(world, place, 1, 3, 5))
    assert (start_places(world, place, 1, 4, 5)[1:] != many[1:5]).all()


def made_rows(cell: ForcesCell, world: int, times_s: np.ndarray, **more: Any) -> pd.DataFrame:
    limit_s = 300.0
    return pd.DataFrame(
        {
            "strategy": cell.variant,
            "robots": cell.robots,
            "regime": cell.arena,
            "obstacles": cell.obstacles,
            "obstacle_share": 0.01 * cell.obstacles,
            "emission_gps": cell.emission_gps,
            "world": world,
            "trial": np.arange(len(times_s)),
            "success": times_s < limit_s,
            "arrival_steps": np.where(times_s < limit_s, 10.0 * times_s, np.nan),
            "limit_steps": 3000,
            "step_s": 0.1,
            "localisation": 1,
            "closest_m": 0.2,
            "nearest_pair_m": 0.1,
            "followers": 0.5,
            "intermittency": 0.4,
            "peak_to_mean": 5.0,
            "meander": 0.3,
            "plume_share": 0.5,
        }
        | more
    )


def rows_of(time_s: Any) -> tuple[Any, pd.DataFrame]:
    """An experiment, and for each of its cells and worlds ten trials that take about `time_s(cell)`."""
    experiment = define("forces-small", Options(sizes=(5, 30), worlds=3))
    rng = np.random.default_rng(1)
    rows = []
    for cell in experiment.cells:
        for world in experiment.work:
            if world.obstacles == cell.obstacles:
                times = time_s(cell) + rng.uniform(-5.0, 5.0, 10)
                followers = 0.9 if cell.variant == "virtual-forces" else 0.4
                rows.append(made_rows(cell, world.number, times, followers=followers))
    return experiment, pd.concat(rows, ignore_index=True)


def test_verdicts_follow_the_rows() -> None:
    def time_s(cell: ForcesCell) -> float:
        if cell.variant == "upwind":
            return 400.0 if cell.obstacles else 50.0
        if cell.variant == "no-cohesion":
            return 100.0
        lead = 40.0 if cell.robots == 30 else 0.0
        return 150.0 - lead * (1.0 + 0.1 * cell.obstacles) * (1.0 if cell.emission_gps > 0.01 else 0.5)

    verdicts = {one.claim: one for one in judge(*rows_of(time_s))}
    assert verdicts["a larger swarm is faster: 30 robots than 5"].verdict == "holds"
    assert verdicts["a larger swarm is faster, the more so the more obstacles there are"].verdict == "holds"
    assert verdicts["a larger swarm is faster, the more so the weaker the source"].verdict == "does not hold"
    upwind = "the swarm finds the source where going upwind does not: {} obstacles"
    assert verdicts[upwind.format(0)].verdict == "undecided"
    assert verdicts[upwind.format(10)].verdict == "holds"
    assert "upwind alone 0 %" in verdicts[upwind.format(10)].statistic
    assert verdicts["cohesion makes the search faster"].verdict == "does not hold"
    assert verdicts["robots that smell nothing follow by cohesion"].verdict == "holds"
    assert verdicts["cohesion keeps robots from close encounters"].verdict == "undecided"


def test_a_cells_row_counts_who_did_not_arrive_at_the_limit() -> None:
    cell = define("forces-small", Options()).cells[0]
    rows = made_rows(cell, 0, np.array([100.0, 200.0, 400.0, 400.0]))
    summary = summarise(rows, cell)
    assert summary["arrival_steps_mean"] == (1000.0 + 2000.0 + 2.0 * 3000.0) / 4.0
    assert summary["arrival_steps_median"] == 2500.0
    assert (summary["success_rate"], summary["trials"]) == (0.5, 4)
    wanted = {"strategy", "robots", "regime", "obstacle_share", "localisation_mean"}
    assert wanted <= summary.keys()


def test_page_and_figure_are_written(tmp_path: pathlib.Path) -> None:
    experiment, rows = rows_of(lambda cell: 100.0 + cell.robots)
    summaries = [summarise(rows, cell) for cell in experiment.cells]
    report = ExperimentReport(experiment, tmp_path, rows, summaries, judge(experiment, rows))
    page = write_report(report, "simvehicle experiment forces-small").read_text()
    assert "3 plumes with 10 starts" not in page  # it is in the figure's title
    assert "| 10 | 10.0 % | 0.02 | 0.40 | 5.0 | 0.30 | 50 % |" in page
    assert (tmp_path / "forces-small.png").stat().st_size > 10_000
    assert FORCES.listing(summaries).rows[0][:4] == ["virtual-forces", "5", "0", "0.01"]


@pytest.mark.long
def test_a_world_is_the_same_however_its_trials_are_split() -> None:
    world = ForcesWorld(
        arena="large",
        number=3,
        obstacles=0,
        emissions_gps=(0.05,),
        robots=(4,),
        variants=("virtual-forces", "upwind"),
    )
    whole = fly_world(world, 1, 0, 3)
    parts = pd.concat([fly_world(world, 1, 0, 1), fly_world(world, 1, 1, 2)])
    order = ["strategy", "trial"]
    pd.testing.assert_frame_equal(
        whole.sort_values(order, ignore_index=True), parts.sort_values(order, ignore_index=True)
    )
    assert whole["contact_steps"].notna().all()
    assert engine_of((world,)) == engine_of((msgspec.structs.replace(world, number=4),))
