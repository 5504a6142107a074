"""The parts of the trials: luck, plumes, motion, cells, the store."""

from __future__ import annotations

import math
import pathlib
import warnings
from typing import Any

import msgspec
import numba
import numpy as np
import pandas as pd
import pytest

from simvehicle.trials import randomness as luck
from simvehicle.trials.batch import complete
from simvehicle.trials.cell import Cell
from simvehicle.trials.flight import passes_source
from simvehicle.trials.motion import EX, ROW, VX, Cruise, Pd, X, fly, leg_ticks, motion_numbers, powers_of
from simvehicle.trials.outcome import kernel_setup, record_trial, run_cell
from simvehicle.trials.plume import SOURCE_X, WAVE_COUNT, WAVES, plume_numbers, reading
from simvehicle.trials.store import Block, Run, Store, blocks
from simvehicle.trials.trace import Tracks
from simvehicle.trials.trials_error import TrialsError
from simvehicle.world.gas import Gaussian
from simvehicle.world.world_config import GaussianPlume

POWERS = powers_of(Pd())


@numba.njit
def _fly(motion: Any, row: Any, tx: float, ty: float, powers: Any, work: Any) -> int:
    ticks = leg_ticks(motion, row, tx, ty, powers, work)
    fly(motion, row, tx, ty, ticks, powers)
    return ticks


@numba.njit
def _fly_ticks(motion: Any, row: Any, tx: float, ty: float, ticks: int, powers: Any) -> None:
    fly(motion, row, tx, ty, ticks, powers)


@numba.njit
def _reading(plume: Any, grid: Any, x: float, y: float, time_s: float) -> float:
    return reading(plume, grid, x, y, time_s)


@numba.njit
def _may_pass_source(scene: Any, row: Any, tx: float, ty: float) -> bool:
    return passes_source(scene, row, tx, ty)


def numbers(count: int, seed: int, trial: int, kind: int) -> list[float]:
    stream = np.zeros(1, np.uint64)
    luck.open_stream(stream, seed, trial, kind)
    return [luck.uniform(stream) for _ in range(count)]


def test_streams_are_uniform_and_do_not_repeat_each_other() -> None:
    drawn = np.array(numbers(20_000, 1, 2, 3))
    assert drawn.min() >= 0.0
    assert drawn.max() < 1.0
    assert drawn.mean() == pytest.approx(0.5, abs=0.01)
    assert np.histogram(drawn, 10)[0].min() > 1800
    assert numbers(3, 1, 2, 3) == drawn[:3].tolist()
    firsts = {
        numbers(1, seed, trial, kind)[0] for seed in range(5) for trial in range(20) for kind in range(5)
    }
    assert len(firsts) == 500


def test_geometric_ticks_have_the_right_mean() -> None:
    ticks = np.array([luck.geometric_tick(draw, 0.01) for draw in numbers(20_000, 4, 0, 0)])
    assert ticks.min() >= 1
    assert ticks.mean() == pytest.approx(100.0, rel=0.03)
    assert luck.geometric_tick(0.5, 0.0) > 10**18
    assert luck.geometric_tick(0.5, 1.0) == 1


def test_cruise_keeps_its_limits_and_waits_to_settle() -> None:
    motion = motion_numbers(Cruise(5.0, 2.0, 1.0))
    row = np.zeros(ROW)
    ticks = _fly(motion, row, 50.0, 0.0, POWERS, np.zeros(ROW))
    assert row[X] == 50.0
    assert ticks == math.ceil((50.0 / 5.0 + 5.0 / 2.0 + 1.0) * 16)
    row = np.zeros(ROW)
    ticks = _fly(motion, row, 0.0, 4.0, POWERS, np.zeros(ROW))
    assert ticks == math.ceil((2.0 * math.sqrt(4.0 / 2.0) + 1.0) * 16)


def test_pd_is_ten_times_slower_than_its_gains_suggest() -> None:
    row = np.zeros(ROW)
    ticks = _fly(motion_numbers(Pd()), row, 10.0, 0.0, POWERS, np.zeros(ROW))
    assert ticks / 16.0 == 18.5
    assert abs(row[X] - 10.0) < 0.1


def test_the_papers_motion_is_pd_ten_times_as_fast() -> None:
    row, slow = np.zeros(ROW), np.zeros(ROW)
    paper = Pd(10)
    ticks = _fly(motion_numbers(paper), row, 10.0, 60.0, powers_of(paper), np.zeros(ROW))
    assert ticks == math.ceil(_fly(motion_numbers(Pd()), slow, 10.0, 60.0, POWERS, np.zeros(ROW)) / 10)
    slow = np.zeros(ROW)
    _fly_ticks(motion_numbers(Pd()), slow, 10.0, 60.0, 10 * ticks, POWERS)
    np.testing.assert_allclose(row, slow, rtol=1e-9, atol=1e-12)


def test_a_drone_that_is_called_back_at_full_speed_is_watched_where_it_runs_on() -> None:
    scene = kernel_setup(Cell(source=(0.0, 0.0))).scene
    source_m = scene.plume[SOURCE_X]
    row = np.zeros(ROW)
    row[X], row[VX] = source_m - 5.0, 95.0
    row[EX] = 60.0 - row[X]  # it was on its way to a point 60 m to the north
    target_m = row[X] - 4.0
    assert _may_pass_source(scene, row, target_m, 0.0)
    farthest_m = row[X]
    for ticks in range(1, 200):
        place = row.copy()
        _fly_ticks(scene.motion, place, target_m, 0.0, ticks, POWERS)
        farthest_m = max(farthest_m, place[X])
    assert farthest_m > source_m
    still = np.zeros(ROW)
    still[X] = source_m - 5.0
    assert not _may_pass_source(scene, still, target_m, 0.0)


def test_the_compiled_gaussian_is_the_worlds() -> None:
    plume, grid = plume_numbers("gaussian", False, 0.0)
    world = Gaussian(
        GaussianPlume(source_north_m=0.0, source_east_m=0.0, source_above_home_m=10.0, vent_sd_m=4.0),
        (3.0, 0.0, 0.0),
        0.0,
    )
    peak = world.excess_co2_ppm((0.0, 0.0, -10.0), 0.0)
    for place in ((0.0, 0.0), (5.0, 1.0), (60.0, -8.0), (-3.0, 2.0), (200.0, 10.0)):
        expected = world.excess_co2_ppm((*place, -10.0), 0.0) / peak
        assert _reading(plume, grid, *place, 0.0) == pytest.approx(expected if expected >= 0.005 else 0.0)


def test_the_gusty_plume_meanders_and_keeps_its_source() -> None:
    plume, grid = plume_numbers("gaussian", False, 0.5)
    plume = plume.copy()
    plume[WAVES + WAVE_COUNT :] = (0.1, 1.0, 2.0, 3.0)
    far = [_reading(plume, grid, 80.0, 0.0, float(time_s)) for time_s in range(0, 300, 10)]
    near = [_reading(plume, grid, 0.0, 0.0, float(time_s)) for time_s in range(0, 300, 10)]
    assert np.std(far) > 0.005
    assert np.ptp(near) < 1e-9
    assert near[0] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"strategy": "zigzag"}, "no strategy is called 'zigzag'; there are locus, mobs"),
        ({"plume": "square"}, "no plume"),
        ({"motion": "walk"}, "no motion model"),
        ({"layout": "line"}, "no formation layout"),
        ({"drones": 0}, "1 to 1000 drones"),
        ({"unhealed": "some"}, "no way to go on without healing"),
        ({"plume": "gusty", "cut_cells": True}, "only the plumes smooth and perturbed have cells to cut"),
        ({"speed_mps": 0.0}, "speed_mps must be above 0"),
        ({"settle_s": -1.0}, "settle_s must not be below 0"),
        ({"r_min_m": 4.0}, r"r_min \(4 m\) is above r_max \(3 m\)"),
        ({"failure_rate": 1.5}, "probability from 0 to 1"),
        ({"failure_rate": math.nan}, "probability from 0 to 1"),
        ({"failure_rate": 0.1}, "needs a kind of failure: generic or in-plume"),
        ({"arena_m": 1.0}, "arena's radius"),
        ({"source": (90.0, 90.0)}, "outside the arena"),
        ({"limit_ticks": 0}, "at least 1 tick"),
    ],
)
def test_impossible_cells_are_named(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        run_cell(Cell(**changes), 1, 0, 1)


def test_trials_are_paired_and_do_not_depend_on_how_they_are_split() -> None:
    cell = Cell(drones=5, failure="generic", failure_rate=3e-5)
    whole = run_cell(cell, 3, 0, 12)
    parts = pd.concat([run_cell(cell, 3, 0, 5), run_cell(cell, 3, 5, 7)], ignore_index=True)
    pd.testing.assert_frame_equal(whole, parts)
    rival = run_cell(msgspec.structs.replace(cell, strategy="mobs", drones=9), 3, 0, 12)
    assert (whole[["plume_north_m", "plume_east_m"]] == rival[["plume_north_m", "plume_east_m"]]).all().all()
    assert not whole["source_s"].equals(run_cell(cell, 4, 0, 12)["source_s"])


@pytest.mark.parametrize("strategy", ["locus", "mobs", "mobs-authors", "locus-hybrid", "locus-multi"])
@pytest.mark.parametrize("motion", ["paper", "pd", "cruise"])
def test_every_strategy_finds_the_source_and_is_recorded_to_the_end(strategy: Any, motion: Any) -> None:
    cell = Cell(strategy=strategy, motion=motion, drones=10, arena_m=40.0)
    rows = run_cell(cell, 2, 0, 10)
    assert rows["success"].mean() >= 0.9
    assert (rows["contact_s"] <= rows["source_s"])[rows["success"]].all()
    trial = int(rows[rows["success"]]["trial"].iloc[0])
    recorded = record_trial(cell, 2, trial)
    assert recorded.row["source_s"] == rows.loc[trial, "source_s"]
    tracks = Tracks(recorded, 1.0 / 16.0)
    world, plume = recorded.setup.scene.world, recorded.setup.scene.plume
    source = np.array([world[0] + plume[1], world[1] + plume[2]])
    away_m = np.linalg.norm(tracks.place_m[-1] - source, axis=1)
    assert np.nanmin(away_m) < cell.success_m + 1e-6
    steps_m = np.linalg.norm(np.diff(tracks.place_m, axis=0), axis=2)
    # Nobody jumps between legs: 20 m/s at 16 ticks a second, or where the controller is ten times as fast 110.
    assert np.nanmax(steps_m) < (7.0 if motion == "paper" else 1.3)


@pytest.mark.parametrize("strategy", ["locus", "mobs", "mobs-authors", "locus-hybrid", "locus-multi"])
@pytest.mark.parametrize("failure", ["generic", "in-plume"])
def test_failures_are_monotone_in_their_rate(strategy: Any, failure: Any) -> None:
    rates = (1e-6, 1e-4, 1e-2)
    found = [
        run_cell(Cell(strategy=strategy, failure=failure, failure_rate=rate), 1, 0, 40) for rate in rates
    ]
    success = [rows["success"].mean() for rows in found]
    survivors = [rows["survivors"].mean() for rows in found]
    assert success[0] > success[2]
    assert survivors[0] > survivors[2]
    assert set(found[2]["ended"]) <= {"source", "all_failed", "limit"}


def test_the_physical_plume_in_gusts_can_be_searched() -> None:
    cell = Cell(plume="gusty", motion="cruise", drones=7, arena_m=60.0, limit_ticks=200_000)
    assert run_cell(cell, 1, 0, 10)["success"].mean() > 0.5


# --- Store and batch ---


def small_run(**changes: Any) -> Run:
    cells = (Cell(drones=3, arena_m=30.0), Cell(strategy="mobs", drones=3, arena_m=30.0))
    return Run(**({"name": "locus-1", "seed": 1, "trials": 7, "block": 3, "cells": cells} | changes))


def test_a_killed_run_goes_on_and_gives_the_same_rows(tmp_path: pathlib.Path) -> None:
    run = small_run()
    whole = complete(run, Store(tmp_path / "whole", run))
    assert len(whole) == 14
    store = Store(tmp_path / "part", run)
    for block in blocks(run)[::2]:
        store.add(block, run_cell(run.cells[block.cell], run.seed, block.first, block.count))
    (tmp_path / "part" / "rows" / "cell-0001-000000.part").write_bytes(b"half a file")
    told: list[tuple[int, int]] = []
    again = complete(
        run, Store(tmp_path / "part", run), progress=lambda done, total: told.append((done, total))
    )
    pd.testing.assert_frame_equal(whole, again)
    assert told[0][0] > 0
    assert told[-1] == (14, 14)
    assert not list((tmp_path / "part" / "rows").glob("*.part"))


def test_results_of_another_experiment_are_not_mixed(tmp_path: pathlib.Path) -> None:
    Store(tmp_path, small_run())
    with pytest.raises(TrialsError, match=r"another experiment \(locus-1; seed differ\)"):
        Store(tmp_path, small_run(seed=2))
    with pytest.raises(TrialsError, match="engine differ"):
        Store(tmp_path, small_run(engine="older"))
    (tmp_path / "run.json").write_text("{}")
    with pytest.raises(TrialsError, match="not the description of a run"):
        Store(tmp_path, small_run())
    (tmp_path / "run.json").unlink()
    (tmp_path / "rows" / "cell-0000-000000.parquet").write_bytes(b"")
    with pytest.raises(TrialsError, match=r"rows without run\.json"):
        Store(tmp_path, small_run())


def test_damaged_rows_are_named(tmp_path: pathlib.Path) -> None:
    run = small_run()
    store = Store(tmp_path, run)
    complete(run, store)
    (tmp_path / "rows" / Block(0, 3, 3).file).write_bytes(b"not parquet")
    with pytest.raises(TrialsError, match=r"cell-0000-000003.*remove it and run again"):
        store.rows()


def test_a_full_disk_is_one_line_and_loses_nothing(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = small_run()
    store = Store(tmp_path, run)
    first, second, *_ = blocks(run)
    rows = run_cell(run.cells[0], 1, 0, 3)
    store.add(first, rows)

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(pd.DataFrame, "to_parquet", full)
    with pytest.raises(TrialsError, match="no space left on the disk") as caught:
        store.add(second, rows)
    assert "\n" not in str(caught.value)
    assert store.missing()[0] == second


def test_an_error_while_two_cores_work_is_all_that_is_told(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise TrialsError("no space left")

    run = small_run(trials=60, block=2)
    store = Store(tmp_path, run)
    monkeypatch.setattr(store, "add", full)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        with pytest.raises(TrialsError, match="no space left"):
            complete(run, store, jobs=2)
    assert not told


def test_a_place_that_cannot_be_written_is_one_line(tmp_path: pathlib.Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(TrialsError, match="file"):
        Store(tmp_path / "file", small_run())
