"""What went wrong once, with the right value: every case of `tests/data/cases/rows`.

A case is a list of commands, run in a folder with a copy of `tests/data/cases`, against a simulated vehicle of its
own if it asks for one; or, where it needs an agent in flight or other traffic on a link, the names of the tests that
play it.
"""

from __future__ import annotations

import ast
import os
import pathlib
import shlex
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator

import msgspec
import pytest

from simvehicle.survey.ports import free_ports

pytestmark = pytest.mark.system

ROOT = pathlib.Path(__file__).parents[2]
CASES = ROOT / "tests" / "data" / "cases"
ROWS = sorted((CASES / "rows").glob("*.yaml"))
MODULES = {"flightstack": "flightstack.cli", "gcs": "gcs.cli.main", "simvehicle": "simvehicle.cli.main"}

NUMBERED = {"0", "00", "000", *map(str, range(1, 27))}
"""The faults by the numbers under which they were reported; each has a case."""
ASKED_FOR = {
    "gcs param load",
    "gcs fence download and clear, gcs plan clear",
    "fences of other programs",
    "a drone's fence from a file",
    "older QGroundControl formats",
    "structure scans",
    "second ground station",
    "a plan far from the vehicle",
    "--version",
    "SBA-5+ check-sum mode",
    "PC-stamped logs",
}
"""What people asked for beside; each has a case, too."""


class Step(msgspec.Struct, forbid_unknown_fields=True):
    """One command and what is right of it."""

    run: str
    """`gcs …`, `flightstack …` or `simvehicle …`; {vehicle} stands for the vehicle's --connect value."""
    exit: int = 0
    says: list[str] = []
    """Each stands in what is printed, output and error output together."""
    never: list[str] = []
    """None of these does."""
    env: dict[str, str] = {}
    stdin: str = ""
    stdout: str | None = None
    """Where the output goes instead, such as /dev/full."""


class Case(msgspec.Struct, forbid_unknown_fields=True):
    row: str
    what: str
    vehicle: str | None = None
    steps: list[Step] = []
    checked_by: list[str] = []


def case_of(file: pathlib.Path) -> Case:
    return msgspec.yaml.decode(file.read_bytes(), type=Case)


@pytest.fixture
def folder(tmp_path: pathlib.Path) -> pathlib.Path:
    return pathlib.Path(shutil.copytree(CASES, tmp_path / "cases", ignore=shutil.ignore_patterns("rows")))


@pytest.fixture
def vehicle(request: pytest.FixtureRequest) -> Iterator[str]:
    """A simulated vehicle that is ready at once, in real time as its clients' patience is; its --connect value."""
    flavour = case_of(request.getfixturevalue("file")).vehicle
    if flavour is None:
        yield ""
        return
    companion, ground = free_ports(socket.SOCK_DGRAM, 2)
    command = [
        sys.executable,
        "-m",
        MODULES["simvehicle"],
        "run",
        "--flavour",
        flavour,
        "--ready-after-s",
        "0",
    ]
    command += ["--companion-port", str(companion), "--ground-port", str(ground), "--speedup", "1"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield f"udpin:127.0.0.1:{ground}"
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait(20)


def printed_by(step: Step, vehicle: str, folder: pathlib.Path) -> str:
    package, *rest = shlex.split(step.run.replace("{vehicle}", vehicle))
    with open(step.stdout or os.devnull, "w") as elsewhere:
        done = subprocess.run(
            [sys.executable, "-m", MODULES[package], *rest],
            input=step.stdin,
            stdout=elsewhere if step.stdout else subprocess.PIPE,
            stderr=subprocess.PIPE if step.stdout else subprocess.STDOUT,
            text=True,
            timeout=120,
            cwd=folder,
            env={k: v for k, v in os.environ.items() if k != "COLUMNS"} | {"COLUMNS": "200"} | step.env,
        )
    printed = done.stderr if step.stdout else done.stdout
    assert done.returncode == step.exit, printed
    return printed


@pytest.mark.parametrize("file", ROWS, ids=lambda file: file.stem)
def test_what_went_wrong_once(file: pathlib.Path, folder: pathlib.Path, vehicle: str) -> None:
    case = case_of(file)
    assert case.steps or case.checked_by
    for step in case.steps:
        printed = printed_by(step, vehicle, folder)
        for words in step.says:
            assert words in printed, f"{step.run} does not say {words!r}:\n{printed}"
        for words in ("Traceback", *step.never):
            assert words not in printed, f"{step.run} says {words!r}:\n{printed}"
    for name in case.checked_by:
        path, _, test = name.partition("::")
        functions = [
            node.name
            for node in ast.walk(ast.parse((ROOT / path).read_text()))
            if isinstance(node, ast.FunctionDef)
        ]
        assert test.rpartition("::")[2] in functions, f"there is no test {name}"


def test_every_fault_and_request_has_a_case() -> None:
    missing = (NUMBERED | ASKED_FOR) - {case_of(file).row for file in ROWS}
    assert not missing
