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

REPOSITORY = pathlib.Path(__file__).parents[2]
SURVEY = "examples/survey.yaml"
FLY = [sys.executable, "-m", "simvehicle.cli.main", "fly"]


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
    assert summary["source_error_m"] < 5.0
    assert summary["min_separation_m"] >= summary["configured_separation_m"]
    assert summary["fence_breaches"] == 0
    assert 0.0 < summary["time_to_contact_s"] < summary["time_to_source_s"]
    assert summary["missed_deadline_fraction"] <= 0.01
    for drone in summary["per_drone"]:
        assert drone["landed"]
        assert not drone["crashed"]
        assert drone["home_distance_m"] < 3.0


def everybody_came_home(summary: dict[str, Any], directory: pathlib.Path) -> None:
    assert summary["drones"] == 5
    assert (summary["alive"], summary["heals"], summary["lost_processes"]) == (5, 0, [])
    files = {path.name for path in directory.iterdir()}
    assert {"summary.json", "report.html", "truth.csv", "ground.log", "vehicles.log", "drone-5.log"} <= files
    assert len([name for name in files if name.endswith(".tlog")]) == 5
    assert len([name for name in files if name.endswith(".mcap")]) == 1


def a_killed_agent_cost_one_drone(summary: dict[str, Any], directory: pathlib.Path) -> None:
    assert summary["alive"] == 4
    assert summary["heals"] >= 1
    (orphan,) = summary["orphans"]
    assert orphan["drone"] == 3
    assert orphan["brought_home_by"] == "ground station"
    assert "RTL" in orphan["modes"]


def an_unplugged_instrument_was_told(summary: dict[str, Any], directory: pathlib.Path) -> None:
    assert summary["alive"] == 5
    lines = (directory / "ground.log").read_text(encoding="utf-8").splitlines()
    assert any("drone 2: sensor" in line and "co2" in line for line in lines)


def a_swarm_came_apart_and_together(summary: dict[str, Any], directory: pathlib.Path) -> None:
    """Three of nine were killed, the root among them, and one was frozen and came back."""
    assert (summary["drones"], summary["alive"]) == (9, 6)
    assert summary["lost_processes"] == []
    assert summary["kills"].keys() == {"1", "2", "4"}
    assert [d["drone"] for d in summary["per_drone"] if not d["agent_alive"]] == [1, 2, 4]
    lost = [(h["drone"], h["cause"]) for h in summary["healings"]]
    assert lost == [(1, "killed"), (4, "killed"), (6, "frozen"), (2, "killed")]
    for heal in summary["healings"]:
        assert 0.0 < heal["noticed_after_s"] < 5.0
        assert 0.0 <= heal["agreed_after_s"] < 5.0
        assert 0.0 <= heal["flown_after_s"] < 60.0
    back = [r["drone"] for r in summary["rejoined"]]
    assert back == [6]
    assert summary["rejoined"][0]["in_slot_at_s"] is not None
    assert "Losses and heals" in (directory / "report.html").read_text(encoding="utf-8")


ALSO = {
    "--drones 9": a_swarm_came_apart_and_together,
    "--kill 3@60": a_killed_agent_cost_one_drone,
    "--fault co2-unplug:2@90": an_unplugged_instrument_was_told,
}
"""What a survey's own options must have done."""


def test_a_documented_survey_finds_its_source(flown_command: str, tmp_path: pathlib.Path) -> None:
    """As the documents have it, but as fast as this machine can."""
    finds_its_source(flown_command, tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("options", ["--radio-loss 20", "--tls", "--radio-loss 20 --tls"])
def test_nine_drones_find_it_over_a_bad_radio_and_encrypted(
    options: str, flown_commands: tuple[str, ...], tmp_path: pathlib.Path
) -> None:
    (command,) = (command for command in flown_commands if "--drones 9" in command)
    summary = finds_its_source(f"{command} {options}", tmp_path)
    assert summary["encrypted"] == ("--tls" in options)
    assert (summary["radio"] or {"loss": 0.0})["loss"] == (0.2 if "--radio-loss 20" in options else 0.0)


def finds_its_source(flown_command: str, tmp_path: pathlib.Path) -> dict[str, Any]:
    """Fly it, check what every good survey has and what its options must have done; its summary."""
    arguments = flown_command.removeprefix("simvehicle fly ").split()
    command = [*FLY, *arguments, "--speedup", "10", "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=REPOSITORY)
    assert done.returncode == 0, done.stdout + done.stderr
    (directory,) = tmp_path.iterdir()
    summary = json.loads((directory / "summary.json").read_text(encoding="utf-8"))
    if "--json" in arguments:
        assert json.loads(done.stdout.splitlines()[-1]) == summary
    else:
        assert done.stdout.startswith("source_found")
    assert nothing_runs(tmp_path)
    check(summary)
    option = next((words for words in ALSO if words in flown_command), None)
    ALSO.get(option, everybody_came_home)(summary, directory)
    return summary


def test_ctrl_c_in_flight_lands_everybody(tmp_path: pathlib.Path) -> None:
    command = [*FLY, SURVEY, "--json", "--speedup", "10", "--out", str(tmp_path)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, **pipes, text=True, cwd=REPOSITORY) as process:
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
        ([SURVEY, "--kill", "9@60"], "there is no drone 9"),
        ([SURVEY, "--kill", "nine"], "write DRONE@SECONDS"),
        ([SURVEY, "--freeze", "9@60"], "there is no drone 9"),
        ([SURVEY, "--unfreeze", "3@60"], "nothing froze it before"),
        ([SURVEY, "--fault", "fire:1@1"], "--fault fire:1@1"),
        ([SURVEY, "--fault", "co2-unplug:9@1"], "there is no drone 9"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    options: list[str], words: str, tmp_path: pathlib.Path
) -> None:
    command = [*FLY, *options, "--out", str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, cwd=REPOSITORY)
    assert done.returncode == 2
    assert words in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert done.stdout == ""
    assert not (tmp_path / "out").exists()
