"""The main job, whole: `simvehicle fly` with the real vehicles' process, agents and ground station."""

from __future__ import annotations

import json
import pathlib
import signal
import subprocess
import sys
import time
from typing import Any

import psutil
import pytest

pytestmark = [pytest.mark.system, pytest.mark.timeout(1200)]

EXAMPLES = pathlib.Path(__file__).parents[2] / "examples"
FLY = [sys.executable, "-m", "simvehicle.cli", "fly"]


def fly(out: pathlib.Path, *options: str, survey: str = "survey.yaml") -> dict[str, Any]:
    """Fly to "source found" as fast as this machine can, and return the summary."""
    command = [*FLY, str(EXAMPLES / survey), "--json", "--speedup", "10", "--out", str(out), *options]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    summary: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    assert nothing_runs(out)
    return summary


def nothing_runs(directory: pathlib.Path) -> bool:
    """Whether no process is left that reads a file of this directory."""
    for process in psutil.process_iter(["cmdline", "status"]):
        line = process.info["cmdline"] or []
        if process.info["status"] != psutil.STATUS_ZOMBIE and any(str(directory) in part for part in line):
            return False
    return True


def check(summary: dict[str, Any]) -> None:
    """What every good survey has, whatever happened to it."""
    assert summary["outcome"] == "source_found"
    assert summary["drones"] == 5
    assert summary["source_error_m"] < 5.0
    assert summary["min_separation_m"] >= summary["configured_separation_m"]
    assert summary["fence_breaches"] == 0
    assert 0.0 < summary["time_to_contact_s"] < summary["time_to_source_s"]
    assert summary["missed_deadline_fraction"] <= 0.01
    for drone in summary["per_drone"]:
        assert drone["landed"]
        assert not drone["crashed"]
        assert drone["home_distance_m"] < 3.0


@pytest.mark.parametrize("survey", ["survey.yaml", "survey_px4.yaml"])
def test_the_examples_find_their_source(survey: str, tmp_path: pathlib.Path) -> None:
    summary = fly(tmp_path, survey=survey)
    check(summary)
    assert (summary["alive"], summary["heals"], summary["lost_processes"]) == (5, 0, [])
    (directory,) = tmp_path.iterdir()
    files = {path.name for path in directory.iterdir()}
    assert {"summary.json", "report.html", "truth.csv", "ground.log", "vehicles.log", "drone-5.log"} <= files
    assert len([name for name in files if name.endswith(".tlog")]) == 5
    assert len([name for name in files if name.endswith(".mcap")]) == 1


def test_a_killed_agent_costs_one_drone_and_not_the_survey(tmp_path: pathlib.Path) -> None:
    summary = fly(tmp_path, "--kill", "3@60")
    check(summary)
    assert summary["alive"] == 4
    assert summary["heals"] >= 1
    (orphan,) = summary["orphans"]
    assert orphan["drone"] == 3
    assert orphan["brought_home_by"] == "ground station"
    assert "RTL" in orphan["modes"]


def test_an_unplugged_instrument_is_told_and_the_others_go_on(tmp_path: pathlib.Path) -> None:
    summary = fly(tmp_path, "--fault", "co2-unplug:2@90")
    check(summary)
    assert summary["alive"] == 5
    (directory,) = tmp_path.iterdir()
    assert "co2" in "".join(line for line in (directory / "ground.log").open() if "drone 2: sensor" in line)


def test_ctrl_c_in_flight_lands_everybody(tmp_path: pathlib.Path) -> None:
    command = [*FLY, str(EXAMPLES / "survey.yaml"), "--json", "--speedup", "10", "--out", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            while process.poll() is None and not in_the_air(tmp_path):
                time.sleep(0.5)
            process.send_signal(signal.SIGINT)
            printed, said = process.communicate(timeout=600.0)
        finally:
            process.kill()
    assert process.returncode == 1, said
    summary = json.loads(printed.splitlines()[-1])
    assert summary["outcome"] == "aborted"
    assert all(drone["landed"] and not drone["crashed"] for drone in summary["per_drone"])
    assert summary["min_separation_m"] >= summary["configured_separation_m"]
    (directory,) = tmp_path.iterdir()
    assert "Aborted" in (directory / "report.html").read_text(encoding="utf-8")
    assert nothing_runs(tmp_path)


def in_the_air(out: pathlib.Path) -> bool:
    """Whether some vehicle has been 5 m up."""
    return any(
        float(line.split(",")[4]) < -5.0
        for truth in out.glob("*/truth.csv")
        for line in truth.read_text(encoding="utf-8").splitlines()[1:-1]
    )


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["no/such/file.yaml"], "no/such/file.yaml: cannot be read"),
        ([str(EXAMPLES / "survey.yaml"), "--kill", "9@60"], "there is no drone 9"),
        ([str(EXAMPLES / "survey.yaml"), "--kill", "nine"], "write DRONE@SECONDS"),
        ([str(EXAMPLES / "survey.yaml"), "--fault", "fire:1@1"], "--fault fire:1@1"),
        ([str(EXAMPLES / "survey.yaml"), "--fault", "co2-unplug:9@1"], "there is no drone 9"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    options: list[str], words: str, tmp_path: pathlib.Path
) -> None:
    done = subprocess.run([*FLY, *options, "--out", str(tmp_path / "out")], capture_output=True, text=True)
    assert done.returncode == 2
    assert words in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert done.stdout == ""
    assert not (tmp_path / "out").exists()
