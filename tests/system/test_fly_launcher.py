"""The launcher with stand-ins for vehicles, agents and ground station: real processes, a real network."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import pathlib
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import psutil
import pytest

from flightstack.recording.shared_clock import ClockCells
from simvehicle.survey import launch
from simvehicle.survey.agent_faults import Freeze, Kill
from simvehicle.survey.conduct import HEARD_WITHIN_S, Flown, fly, write_report
from simvehicle.survey.supervisor import SurveyOutcome
from simvehicle.survey.survey_file import load

pytestmark = pytest.mark.system

FILE = pathlib.Path(__file__).with_name("fly_standin.py")
SURVEY = """
name: stand-in
origin: {latitude_deg: 38.4040, longitude_deg: 14.9630, amsl_m: 300.0}
launch_line: {count: 3, spacing_m: 10.0, east_m: 20.0}
formation: {radio_range_m: 60.0}
plume: {type: gaussian, source_north_m: 30.0, source_east_m: -85.0}
speedup: 20.0
time_limit_s: 1500.0
"""


def standins() -> tuple[launch.Commands, launch.Commands]:
    spec = importlib.util.spec_from_file_location("fly_standin", FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.standin, module.broken


STANDIN, BROKEN = standins()


@pytest.fixture
def survey_file(tmp_path: pathlib.Path) -> pathlib.Path:
    path = tmp_path / "survey.yaml"
    path.write_text(SURVEY, encoding="utf-8")
    return path


def wait_until(condition: Callable[[], object], limit_s: float = 60.0) -> None:
    deadline_s = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < deadline_s, "it never happened"
        time.sleep(0.05)


def nothing_runs(directory: pathlib.Path) -> bool:
    """Whether no process is left that reads a file of this directory."""
    for process in psutil.process_iter(["cmdline", "status"]):
        line = process.info["cmdline"] or []
        if process.info["status"] != psutil.STATUS_ZOMBIE and any(str(directory) in part for part in line):
            return False
    return True


def test_a_survey_from_start_to_report(survey_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    survey = load(survey_file)
    flown = fly(survey, out=tmp_path / "out", commands=STANDIN)
    got = flown.summary
    assert got.outcome == SurveyOutcome.SOURCE_FOUND
    assert (got.drones, got.alive, got.orphans, got.lost_processes) == (3, 3, (), ())
    # At 20 times real time a message that needs 0.3 s on a busy machine is heard 6 s late.
    assert got.time_to_contact_s is not None
    assert got.time_to_source_s is not None
    assert 19.0 <= got.time_to_contact_s < 35.0
    assert 39.0 <= got.time_to_source_s < 55.0
    assert got.source_error_m == pytest.approx(1.12, abs=0.01)
    assert got.min_separation_m == pytest.approx(10.0, abs=0.01)
    assert all(drone.home_distance_m == pytest.approx(0.0, abs=0.01) for drone in got.per_drone)
    assert json.loads((flown.directory / "summary.json").read_text())["outcome"] == "source_found"
    assert "Source found" in write_report(survey, flown).read_text(encoding="utf-8")
    assert {f"{name}.log" for name in ("vehicles", "ground", "drone-1", "drone-2", "drone-3")} <= {
        path.name for path in flown.directory.iterdir()
    }
    assert nothing_runs(flown.directory)


def test_a_killed_agent_and_its_orphan(survey_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    flown = fly(load(survey_file), out=tmp_path / "out", kills=(Kill(3, 25.0),), commands=STANDIN)
    got = flown.summary
    assert (got.outcome, got.alive) == (SurveyOutcome.SOURCE_FOUND, 2)
    assert got.kills[3] == pytest.approx(25.0, abs=2.5), "simulated time waits for the launcher"
    assert [(o.drone, o.modes) for o in got.orphans] == [(3, "GUIDED > RTL")]
    assert got.lost_processes == (), "a kill on purpose is no surprise"
    assert nothing_runs(flown.directory)


def test_a_frozen_agent_is_not_waited_for_and_goes_on_when_it_is_woken(
    survey_file: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    flown = fly(load(survey_file), out=tmp_path / "out", freezes=(Freeze(3, 12.0, 16.0),), commands=STANDIN)
    got = flown.summary
    assert (got.outcome, got.alive, got.orphans) == (SurveyOutcome.SOURCE_FOUND, 3, ())
    (freeze,) = got.freezes
    assert freeze.drone == 3
    assert freeze.at_s == pytest.approx(12.0, abs=2.5)
    assert freeze.until_s == pytest.approx(16.0, abs=2.5)
    assert got.lost_processes == ()
    assert nothing_runs(flown.directory)


def test_an_encrypted_survey_is_heard_and_obeys(survey_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    flown = fly(load(survey_file), out=tmp_path / "out", tls=True, commands=STANDIN)
    assert (flown.summary.outcome, flown.summary.alive) == (SurveyOutcome.SOURCE_FOUND, 3)
    keys = flown.directory / "keys"
    assert {path.name for path in keys.iterdir()} == {"drone-1", "drone-2", "drone-3", "ground", "launcher"}
    assert [path for path in keys.rglob("*.key") if path.stat().st_mode & 0o077] == []
    assert not list(keys.rglob("authority.key")), "nobody else becomes a member"
    assert nothing_runs(flown.directory)


def test_a_part_that_cannot_start(survey_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    flown: Flown = fly(load(survey_file), out=tmp_path / "out", commands=BROKEN)
    assert flown.summary.outcome == SurveyOutcome.FAILED
    assert flown.bad_input
    assert flown.summary.reason == "ground ended (exit code 2): ground.yaml: port 14550 is in use"
    assert nothing_runs(flown.directory)


@contextlib.contextmanager
def launcher(survey_file: pathlib.Path, out: pathlib.Path) -> Iterator[subprocess.Popen[str]]:
    """The launcher in a process of its own, its survey in flight; the test ends it."""
    text = survey_file.read_text(encoding="utf-8")
    survey_file.write_text(text.replace("name: stand-in", "name: endless"), encoding="utf-8")
    command = [sys.executable, str(FILE), "fly", str(survey_file), str(out)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            wait_until(lambda: _in_flight(out) or process.poll() is not None)
            assert process.poll() is None, process.communicate()
            yield process
        finally:
            process.kill()


def _in_flight(out: pathlib.Path) -> bool:
    return any("[0.0" not in told.read_text() and "true" in told.read_text() for told in out.glob("*/*.told"))


def test_ctrl_c_lands_everybody_and_writes_what_there_is(
    survey_file: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    out = tmp_path / "out"
    with launcher(survey_file, out) as process:
        process.send_signal(signal.SIGINT)
        printed, _ = process.communicate(timeout=60.0)
    assert printed.startswith("aborted: interrupted"), printed
    (directory,) = out.iterdir()
    summary = json.loads((directory / "summary.json").read_text())
    assert summary["outcome"] == "aborted"
    assert all(drone["landed"] for drone in summary["per_drone"])
    assert nothing_runs(out)


def test_the_second_signal_ends_at_once(survey_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    out = tmp_path / "out"
    with launcher(survey_file, out) as process:
        process.send_signal(signal.SIGTERM)
        process.send_signal(
            signal.SIGINT
        )  # two of one kind would be one if they came before the first is seen
        process.communicate(timeout=30.0)
        assert process.returncode != 0
    wait_until(lambda: nothing_runs(out))


def test_simulated_time_waits_for_the_launcher(survey_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    out = tmp_path / "out"
    with launcher(survey_file, out) as process, contextlib.closing(clock_of(out)) as clock:
        process.send_signal(signal.SIGSTOP)
        stopped_s = clock.values[0]
        wait_until(lambda: stands(clock))
        assert clock.values[0] - stopped_s < HEARD_WITHIN_S + 0.5


def clock_of(out: pathlib.Path) -> ClockCells:
    (file,) = out.glob("*/clock")
    return ClockCells(file)


def stands(clock: ClockCells) -> bool:
    """Whether the time does not move: for half a second on the wall are 10 simulated ones."""
    before_s = clock.values[0]
    time.sleep(0.5)
    return clock.values[0] == before_s


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux ends the children of a killed parent")
def test_a_killed_launcher_leaves_nothing_behind(survey_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    out = tmp_path / "out"
    with launcher(survey_file, out) as process:
        process.kill()
        process.communicate(timeout=30.0)
    wait_until(lambda: nothing_runs(out))
