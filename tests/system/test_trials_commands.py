"""The commands `simvehicle experiment` and `simvehicle trial` as a person types them, and rows on a cluster."""

from __future__ import annotations

import json
import os
import pathlib
import signal
import subprocess
import sys
import time

import pandas as pd
import pytest

from simvehicle.trials.batch import complete
from simvehicle.trials.cell import Cell
from simvehicle.trials.store import Run, Store

pytestmark = pytest.mark.system


def simvehicle(*arguments: str, cwd: pathlib.Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "simvehicle.cli.main", *arguments],
        capture_output=True,
        text=True,
        cwd=cwd,
        timeout=280,
    )


def test_an_experiment_prints_one_json_row_a_cell(tmp_path: pathlib.Path) -> None:
    arguments = ["experiment", "locus-1", "--sizes", "3,5", "--trials", "10", "--motion", "pd", "--seed", "1"]
    done = simvehicle(*arguments, "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert [(row["strategy"], row["drones"]) for row in rows] == [
        ("locus", 3),
        ("locus", 5),
        ("mobs", 3),
        ("mobs", 5),
    ]
    assert all(row["trials"] == 10 and row["plume"] == "smooth" for row in rows)
    (page,) = tmp_path.glob("out/experiments/locus-1-*/locus-1.md")
    assert (
        "does not hold" in page.read_text() or "holds" in page.read_text() or "undecided" in page.read_text()
    )
    assert page.with_suffix(".png").stat().st_size > 5000
    assert len(pd.read_parquet(page.with_name("rows.parquet"))) == 40
    again = simvehicle(*arguments, "--json", cwd=tmp_path)
    assert again.stdout == done.stdout


def test_failure_experiments_take_rates_and_tell_healing(tmp_path: pathlib.Path) -> None:
    done = simvehicle(
        "experiment",
        "locus-4",
        *("--rates", "1e-4,1e-2", "--trials", "5", "--sizes", "5", "--plumes", "perturbed"),
        *("--rows", "csv", "--out", "here", "--json"),
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert [(r["strategy"], r["healing"], r["failure_rate"]) for r in rows] == [
        ("locus", True, 1e-4),
        ("locus", True, 1e-2),
        ("locus", False, 1e-4),
        ("locus", False, 1e-2),
        ("mobs", False, 1e-4),
        ("mobs", False, 1e-2),
    ]
    assert len(pd.read_csv(tmp_path / "here" / "rows.csv")) == 30


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["experiment", "locus-7"], "no experiment is called 'locus-7'"),
        (["experiment", "locus-1", "--strategies", "swim"], "no strategy is called 'swim'"),
        (["experiment", "locus-1", "--motion", "crawl"], "no motion model is called 'crawl'"),
        (["experiment", "locus-1", "--motion", "cruise", "--speed", "0"], "speed_mps must be above 0"),
        (["experiment", "locus-1", "--r-min", "5"], "r_min (5 m) is above r_max (3 m)"),
        (["experiment", "locus-3", "--rates", "1.5"], "probability from 0 to 1"),
        (["experiment", "locus-1", "--sizes", "five"], "--sizes 'five': give numbers"),
        (["trial", "--plume-at", "500,0"], "outside the arena"),
        (["trial", "--plume-at", "5"], "give NORTH,EAST"),
        (["trial", "--strategy", "none"], "no strategy is called 'none'"),
        (["trial", "--rate", "1e-4"], "needs a kind of failure"),
    ],
)
def test_what_cannot_be_is_one_line(arguments: list[str], words: str, tmp_path: pathlib.Path) -> None:
    done = simvehicle(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert words in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_no_room_for_machine_code_is_one_line(tmp_path: pathlib.Path) -> None:
    limited = "import resource, runpy, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096)); "
    limited += "sys.argv = ['simvehicle', 'trial', '--drones', '2', '--arena', '20']; "
    limited += "runpy.run_module('simvehicle.cli.main', run_name='__main__')"
    done = subprocess.run(
        [sys.executable, "-c", limited],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "XDG_CACHE_HOME": str(tmp_path)},
        timeout=280,
    )
    assert done.returncode == 2, done.stderr
    assert f"File too large; machine code is kept in {tmp_path}" in done.stderr
    assert "Traceback" not in done.stderr


def test_another_experiments_directory_is_refused(tmp_path: pathlib.Path) -> None:
    arguments = ["experiment", "locus-1", "--sizes", "3", "--trials", "2", "--out", "here"]
    assert simvehicle(*arguments, cwd=tmp_path).returncode == 0
    done = simvehicle(*arguments, "--seed", "9", cwd=tmp_path)
    assert done.returncode == 2
    assert "holds the results of another experiment" in done.stderr


def test_a_trial_is_shown_and_filmed(tmp_path: pathlib.Path) -> None:
    done = simvehicle(
        "trial",
        *("--drones", "5", "--arena", "30", "--failure", "generic", "--rate", "1e-4"),
        *("--plot", "--animate", "--out", ".", "--json"),
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    row = json.loads(done.stdout)
    assert row["strategy"] == "locus"
    picture, film = (tmp_path / name for name in row["files"])
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert film.read_bytes().startswith(b"GIF89a")


def test_a_killed_experiment_goes_on(tmp_path: pathlib.Path) -> None:
    arguments = ["experiment", "locus-2", "--sizes", "2,3,4,5,6,7,8,9,10", "--trials", "60", "--json"]
    arguments += ["--strategies", "mobs,locus", "--out", "here"]
    running = subprocess.Popen(
        [sys.executable, "-m", "simvehicle.cli.main", *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        cwd=tmp_path,
        start_new_session=True,
    )
    parts = tmp_path / "here" / "rows"
    try:
        while running.poll() is None and len(list(parts.glob("*.parquet"))) < 3:
            time.sleep(0.02)
    finally:
        if running.poll() is None:
            os.killpg(running.pid, signal.SIGKILL)
        running.wait()
    kept = {path.name: path.stat().st_mtime_ns for path in parts.glob("*.parquet")}
    assert kept
    done = simvehicle(*arguments, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) == 18
    for name, made in kept.items():
        assert (parts / name).stat().st_mtime_ns == made


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_rows_are_identical_on_one_core_two_cores_and_a_cluster(tmp_path: pathlib.Path) -> None:
    distributed = pytest.importorskip("distributed")
    cells = (
        Cell(drones=5, failure="generic", failure_rate=2e-5),
        Cell(strategy="mobs", drones=4, plume="perturbed"),
        Cell(strategy="locus-multi", drones=10),
    )
    run = Run("locus-3", 5, 10, 3, cells)
    alone = complete(run, Store(tmp_path / "alone", run), jobs=1)
    both = complete(run, Store(tmp_path / "both", run), jobs=2)
    pd.testing.assert_frame_equal(alone, both)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address=None
    ) as cluster:
        spread = complete(run, Store(tmp_path / "spread", run), scheduler=cluster.scheduler_address)
    pd.testing.assert_frame_equal(alone, spread)
