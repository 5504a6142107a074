"""Outputs that break, and what all three commands have: one line and exit code 1, whatever was to be printed."""

from __future__ import annotations

import os
import pathlib
import subprocess
import sys

import pytest

pytestmark = pytest.mark.system

ROOT = pathlib.Path(__file__).parents[2]
MODULES = {"flightstack": "flightstack.cli", "gcs": "gcs.cli.main", "simvehicle": "simvehicle.cli.main"}
PLAN = str(ROOT / "tests" / "data" / "cases" / "p01_ok.plan")
COMMANDS = (
    "gcs --version",
    "gcs --help",
    "gcs status --swarm nobody --connect tcp/127.0.0.1:9 --seconds 0.2",
    f"gcs plan check {PLAN}",
    f"gcs plan check {PLAN} --json",
    "flightstack --version",
    f"flightstack check --config {ROOT / 'examples' / 'drone.yaml'}",
    "flightstack sensors list",
    "flightstack sensors list --json",
    "simvehicle --version",
    "simvehicle trial --help",
)
EVERYWHERE = COMMANDS[0], COMMANDS[3], COMMANDS[7], COMMANDS[9]


def end_of(line: str, **streams) -> tuple[int, list[str]]:
    """Exit code and lines of the error output."""
    package, *rest = line.split()
    command = [sys.executable, "-m", MODULES[package], *rest]
    done = subprocess.run(command, text=True, timeout=60, **{"stderr": subprocess.PIPE, **streams})
    return done.returncode, (done.stderr or "").splitlines()


@pytest.mark.parametrize("line", COMMANDS)
def test_a_full_disk(line: str) -> None:
    with open("/dev/full", "w") as full:
        code, lines = end_of(line, stdout=full)
    told = f"{line.split()[0]}: standard output cannot be written: No space left on device"
    assert (code, lines) == (1, [told])


@pytest.mark.parametrize("line", EVERYWHERE)
def test_a_closed_pipe(line: str) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    try:
        code, lines = end_of(line, stdout=writing)
    finally:
        os.close(writing)
    assert (code, lines) == (1, [f"{line.split()[0]}: standard output cannot be written: Broken pipe"])


@pytest.mark.parametrize("line", EVERYWHERE)
def test_an_output_that_is_closed(line: str) -> None:
    code, lines = end_of(line, preexec_fn=lambda: os.close(1))
    assert (code, lines) == (1, [f"{line.split()[0]}: standard output cannot be written: it is closed"])


@pytest.mark.parametrize("package", MODULES)
def test_an_error_output_that_is_broken_stops_nothing(package: str) -> None:
    with open("/dev/full", "w") as full:
        assert end_of(f"{package} --version", stdout=subprocess.DEVNULL, stderr=full)[0] == 0
        assert end_of(f"{package} no-such-thing", stderr=full)[0] == 2
    closed = {"stdout": subprocess.DEVNULL, "stderr": None, "preexec_fn": lambda: os.close(2)}
    assert end_of(f"{package} --version", **closed)[0] == 0
    assert end_of(f"{package} no-such-thing", **closed)[0] == 2


def test_numbers_of_the_command_line_are_numbers() -> None:
    for value in ("nan", "inf"):
        code, lines = end_of(f"gcs plan check {PLAN} --ceiling {value}", stdout=subprocess.DEVNULL)
        assert code == 2
        assert any(f"{value!r} is no number to work with" in line for line in lines), lines
    code, lines = end_of(f"gcs plan check {PLAN} --ceiling -5", stdout=subprocess.DEVNULL)
    assert code == 2
    assert any("-5.0 is not in the range" in line for line in lines), lines


def test_a_dumb_terminal_is_not_drawn_on(open_terminal, monkeypatch) -> None:
    command = (sys.executable, "-m", MODULES["gcs"], "watch", "--swarm", "nobody")
    terminal = open_terminal("env", "TERM=dumb", *command, "--connect", "tcp/127.0.0.1:9")
    assert terminal.finish(30.0) == 2
    assert b"gcs: gcs watch cannot draw on this terminal" in terminal.output
