"""A drone, its agent and a ground station, all processes, while others talk on its links and its disk fills up."""

from __future__ import annotations

import contextlib
import json
import pathlib
import resource
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from simvehicle.survey.ports import free_ports

pytestmark = pytest.mark.system

SPEEDUP = 4.0
PATIENCE_S = 90.0
COMMON = """
origin: {{latitude_deg: -5.06, longitude_deg: 151.3, amsl_m: 500.0}}
swarm: {{name: crater, members: [1], listen: ["tcp/127.0.0.1:{listen}"], connect: ["tcp/127.0.0.1:{connect}"]}}
speedup: {speedup}
record_to: {directory}
"""
DRONE = """
drone: 1
autopilot: {{link: "udpin:127.0.0.1:{udp}", flavour: ardupilot}}
"""
GROUND = """
station: ground
mavlink: {{links: ["udpin:127.0.0.1:{udp}"]}}
"""


class Site:
    """A simulated vehicle, its agent and the ground station; and whoever else talks on their links."""

    def __init__(self, directory: pathlib.Path) -> None:
        self.directory = directory
        self.companion_udp, self.ground_udp, twin_udp = free_ports(socket.SOCK_DGRAM, 3)
        agent, ground, twin = free_ports(socket.SOCK_STREAM, 3)
        self._write("drone", DRONE, self.companion_udp, agent, ground)
        self._write("twin", DRONE, twin_udp, twin, ground)
        self._write("ground", GROUND, self.ground_udp, ground, agent)
        self.vehicle = self._start("vehicle", "simvehicle.cli.main", "run", *self._vehicle_options())
        self.agent = self._start("agent", "flightstack.cli", "run", "--config", str(directory / "drone.yaml"))
        self.station = self._start(
            "station", "gcs.cli.main", "serve", "--config", str(directory / "ground.yaml")
        )

    def _write(self, name: str, form: str, udp: int, listen: int, connect: int) -> None:
        known = {"listen": listen, "connect": connect, "speedup": SPEEDUP, "udp": udp}
        text = (form + COMMON).format(**known, directory=self.directory / f"flights-{name}")
        (self.directory / f"{name}.yaml").write_text(text)

    def _vehicle_options(self) -> list[str]:
        ports = ["--companion-port", str(self.companion_udp), "--ground-port", str(self.ground_udp)]
        return [*ports, "--speedup", str(SPEEDUP), "--ready-after-s", "3"]

    def _start(self, name: str, *command: str) -> subprocess.Popen[bytes]:
        with (self.directory / f"{name}.log").open("wb") as log:
            return subprocess.Popen([sys.executable, "-m", *command], stdout=log, stderr=log)

    def log(self, name: str) -> str:
        return (self.directory / f"{name}.log").read_text()

    def gcs(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "gcs.cli.main", *arguments]
        command += ["--config", str(self.directory / "ground.yaml")]
        return subprocess.run(command, capture_output=True, text=True, timeout=60)

    def status(self) -> dict[str, Any]:
        report: dict[str, Any] = json.loads(self.gcs("status", "--json", "--seconds", "2").stdout)
        return report

    def until(self, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """The first status for which `condition` holds."""
        deadline_s = time.monotonic() + PATIENCE_S
        while True:
            status = self.status()
            if condition(status):
                return status
            assert time.monotonic() < deadline_s, f"{status}\n{self.log('agent')}\n{self.log('station')}"

    def fly(self) -> None:
        self.until(lambda status: row(status, 1).get("agent") == "live")
        deadline_s = time.monotonic() + PATIENCE_S
        while self.gcs("survey", "start", "--deadline", "3").returncode:
            assert time.monotonic() < deadline_s, self.log("agent")
        self.until(lambda status: row(status, 1)["phase"] == "searching")

    @contextlib.contextmanager
    def talk(self, port: int, words: Callable[[], bytes]) -> Iterator[None]:
        """Say this on a link five times a second."""
        over = threading.Event()

        def run() -> None:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
                while not over.wait(0.2):
                    end.sendto(words(), ("127.0.0.1", port))

        thread = threading.Thread(target=run)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()

    def close(self) -> None:
        for process in (self.agent, self.station, self.vehicle):
            if process.poll() is None:
                process.send_signal(signal.SIGCONT)
                process.kill()
                process.wait()


def row(status: dict[str, Any], drone: int) -> dict[str, Any]:
    return next((r for r in status["drones"] if r["drone"] == drone), {})


def codes(status: dict[str, Any]) -> set[str]:
    return {alarm["code"] for alarm in status["alarms"]}


def flies_on(status: dict[str, Any]) -> bool:
    drone = row(status, 1)
    return (drone["phase"], drone["mode"], drone["airborne"]) == ("searching", "GUIDED", True)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    with contextlib.closing(Site(tmp_path_factory.mktemp("site"))) as made:
        made.fly()
        yield made


def test_an_agent_keeps_its_vehicle_whatever_else_is_on_its_link(site: Site, neighbours: Any) -> None:
    """Also while the vehicle is silent for longer than its heartbeat may be missed."""
    kinds = ("ping0", "ping8", "gimbal0", "gimbal3", "camera", "copter154", "other2", "sys0")
    with site.talk(site.companion_udp, lambda: b"".join(map(neighbours.talkative, kinds))):
        site.vehicle.send_signal(signal.SIGSTOP)
        site.until(lambda status: "vehicle_silent" in codes(status))
        site.vehicle.send_signal(signal.SIGCONT)
        status = site.until(lambda status: "vehicle_silent" not in codes(status))
    assert flies_on(status)
    log = site.log("agent")
    assert "MODE_" not in log
    assert "phase: pilot" not in log
    assert "landed" not in log


def test_a_station_sees_its_drone_fly_whatever_else_is_on_its_link(site: Site, neighbours: Any) -> None:
    kinds = ("ping0", "ping8", "gimbal0", "gimbal3", "camera", "sys0", "veh251", "qgc")
    with site.talk(site.ground_udp, lambda: b"".join(map(neighbours.talkative, kinds))):
        status = site.until(lambda status: codes(status) >= {"foreign", "station:system"})
        assert flies_on(status)
        assert row(status, 251)["mode"] == "GUIDED"
    status = site.until(lambda status: not codes(status) and not row(status, 251))
    assert [drone["drone"] for drone in status["drones"]] == [1]
    assert "lost" not in site.log("station")


def test_texts_reach_the_stations_log_whole_in_order_and_visible(site: Site, neighbours: Any) -> None:
    parts = (
        (b"D-second", 10, 1),
        (b"D-first-" + b"d" * 42, 10, 0),
        (b"B" * 50, 8, 0),
        (b"G \x1b[31mred\x1b[0m \x07bell\nnewline", 0, 0),
    )
    with site.talk(site.ground_udp, lambda: b"".join(neighbours.text(*part) for part in parts)):
        site.until(lambda _: "[part missing]" in site.log("station"))
    log = site.log("station")
    assert f"statustext: D-first-{'d' * 42}D-second\n" in log
    assert f"statustext: {'B' * 50} [part missing]\n" in log
    assert r"statustext: G \x1b[31mred\x1b[0m \x07bell\nnewline" in log
    assert not {"\x1b", "\x07"} & set(log)


def test_a_twin_is_refused_and_leaves_nothing_behind(site: Site) -> None:
    before = len(site.log("station"))
    twin = subprocess.run(
        [sys.executable, "-m", "flightstack.cli", "run", "--config", str(site.directory / "twin.yaml")],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    assert twin.returncode == 2
    assert "another agent of the swarm is drone 1 already" in twin.stderr
    assert flies_on(site.until(lambda status: not codes(status)))
    assert "orphan" not in site.log("station")[before:]


def test_a_disk_that_fills_up_in_flight_is_an_alarm_until_it_has_room_again(site: Site) -> None:
    (recording,) = (site.directory / "flights-drone").glob("drone-1-*.mcap")
    _, hard = resource.prlimit(site.agent.pid, resource.RLIMIT_FSIZE)
    resource.prlimit(site.agent.pid, resource.RLIMIT_FSIZE, (recording.stat().st_size, hard))
    status = site.until(lambda status: "recording" in codes(status))
    assert "File too large" in row(status, 1)["storage"]
    assert flies_on(status)
    table = site.gcs("status", "--seconds", "2").stdout
    assert "WARN recording" in table
    resource.prlimit(site.agent.pid, resource.RLIMIT_FSIZE, (hard, hard))
    status = site.until(lambda status: "recording" not in codes(status))
    assert row(status, 1)["storage"] == ""
    assert "the flight is recorded again" in site.log("agent")


def test_the_flight_ends_well_and_all_of_it_was_recorded(site: Site) -> None:
    assert site.gcs("survey", "abort").returncode == 0
    site.until(lambda status: row(status, 1)["phase"] == "landed")
    site.agent.send_signal(signal.SIGTERM)
    assert site.agent.wait(PATIENCE_S) == 0
    recordings = [str(path) for path in (site.directory / "flights-drone").glob("drone-1-*.mcap")]
    done = subprocess.run(
        [sys.executable, "-m", "flightstack.cli", "replay", *recordings], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "all outputs the same" in done.stdout


def test_a_start_without_room_for_the_recording_is_refused_unless_told_otherwise(
    tmp_path: pathlib.Path,
) -> None:
    with contextlib.closing(Site(tmp_path)) as site:
        site.until(lambda status: row(status, 1).get("agent") == "live")
        (recording,) = (site.directory / "flights-drone").glob("drone-1-*.mcap")
        _, hard = resource.prlimit(site.agent.pid, resource.RLIMIT_FSIZE)
        resource.prlimit(site.agent.pid, resource.RLIMIT_FSIZE, (recording.stat().st_size, hard))
        site.until(lambda status: "recording" in codes(status))
        refused = site.gcs("survey", "start")
        assert refused.returncode == 1
        assert "drone 1: refused: " in refused.stdout
        assert "File too large" in refused.stdout
        assert "--without-recording" in refused.stdout
        accepted = site.gcs("survey", "start", "--without-recording")
        assert accepted.stdout == "drone 1: accepted\n"
