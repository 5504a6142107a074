"""The command `simvehicle run` as a process: what it says, what comes out of its ports, how it ends."""

from __future__ import annotations

import json
import pathlib
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.survey.ports import free_port

pytestmark = pytest.mark.system


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        one.settimeout(20.0)
        yield one


def start(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "simvehicle.cli.main", "run", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def heartbeats(listener: socket.socket, systems: int) -> dict[int, Any]:
    """The first HEARTBEAT of so many systems."""
    codec, found = mavlink.MAVLink(None), {}
    codec.robust_parsing = True
    while len(found) < systems:
        for message in codec.parse_buffer(listener.recv(65536)) or ():
            if message.get_type() == "HEARTBEAT":
                found.setdefault(message.get_srcSystem(), message)
    return found


@pytest.mark.parametrize("ending", [signal.SIGTERM, signal.SIGINT])
def test_easy_form_runs_until_it_is_told_to_end(listener: socket.socket, ending: signal.Signals) -> None:
    port = listener.getsockname()[1]
    companion = free_port(socket.SOCK_DGRAM)
    process = start(
        *("--count", "2", "--flavour", "px4", "--speedup", "4", "--json"),
        *("--companion-port", str(companion), "--ground-port", str(port)),
    )
    try:
        assert process.stdout is not None
        said = json.loads(process.stdout.readline())
        assert [vehicle["id"] for vehicle in said["vehicles"]] == [1, 2]
        assert said["vehicles"][1]["links"][0] == f"udpout:127.0.0.1:{companion + 1}"
        found = heartbeats(listener, 2)
        assert all(each.autopilot == mavlink.MAV_AUTOPILOT_PX4 for each in found.values())
        process.send_signal(ending)
        out, err = process.communicate(timeout=20)
        assert (process.returncode, out, err) == (0, "", "")
    finally:
        if process.poll() is None:
            process.kill()
            process.communicate()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "the file is empty"),
        (
            "origin: {latitude_deg: 1, longitude_deg: 2}\nvehicles: [{id: 1, links: [x], fast: 1}]\n",
            "vehicles[0].fast",
        ),
        (
            "origin: {latitude_deg: 1, longitude_deg: 2}\nvehicles:\n  - id: 1\n    links: [x]\n",
            ":4: vehicles[0].links[0]",
        ),
        (
            "origin: {latitude_deg: 1, longitude_deg: 2}\nvehicles: [{id: 1, links: ['udpout:127.0.0.1:9']}]\n"
            "faults:\n  - {drone: 2, at_s: 1, kind: motor}\n",
            ":4: faults[0].drone",
        ),
    ],
)
def test_bad_files_are_one_line_and_exit_code_2(tmp_path: pathlib.Path, text: str, expected: str) -> None:
    file = tmp_path / "fleet.yaml"
    file.write_text(text)
    process = start("--config", str(file))
    out, err = process.communicate(timeout=60)
    assert process.returncode == 2
    assert out == ""
    assert expected in err
    assert err.startswith(f"simvehicle: {file}")
    assert err.count("\n") == 1


def test_a_port_in_use(tmp_path: pathlib.Path, listener: socket.socket) -> None:
    port = listener.getsockname()[1]
    file = tmp_path / "fleet.yaml"
    file.write_text(
        f"origin: {{latitude_deg: 1, longitude_deg: 2}}\nvehicles: [{{id: 1, links: ['udpin:127.0.0.1:{port}']}}]\n"
    )
    process = start("--config", str(file))
    _, err = process.communicate(timeout=60)
    assert process.returncode == 2
    assert str(port) in err
    assert "Traceback" not in err


def test_a_vehicle_whose_process_is_kept_from_running_takes_that_for_nobodys_silence() -> None:
    """Its time is five times the client's: asleep for 1.8 s, it would wake 9 s later, with the upload given up."""
    companion, ground = free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_DGRAM)
    vehicle = start(
        *("--flavour", "ardupilot", "--ready-after-s", "0", "--speedup", "5", "--json"),
        *("--companion-port", str(companion), "--ground-port", str(ground)),
    )
    upload = None
    try:
        assert vehicle.stdout is not None
        assert json.loads(vehicle.stdout.readline())["vehicles"]
        plan = pathlib.Path(__file__).parents[1] / "data" / "cases" / "p01_ok.plan"
        upload = subprocess.Popen(
            [
                *(sys.executable, "-m", "gcs.cli.main", "fence", "upload", str(plan)),
                *("--action", "rtl", "--drone", "1", "--link", f"udpin:127.0.0.1:{ground}"),
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        for _ in range(30):
            vehicle.send_signal(signal.SIGCONT)
            if _ends_within(0.4, upload):
                break
            vehicle.send_signal(signal.SIGSTOP)
            if _ends_within(1.8, upload):
                break
        vehicle.send_signal(signal.SIGCONT)
        said, _ = upload.communicate(timeout=60)
        assert upload.returncode == 0, said
        assert "FENCE_ENABLE 1" in said
    finally:
        vehicle.send_signal(signal.SIGCONT)
        for process in (vehicle, upload):
            if process is not None:
                process.kill()
                process.communicate()


def _ends_within(limit_s: float, process: subprocess.Popen[str]) -> bool:
    try:
        process.wait(limit_s)
    except subprocess.TimeoutExpired:
        return False
    return True
