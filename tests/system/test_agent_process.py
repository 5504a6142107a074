"""`flightstack run` as a process on a simulated vehicle: how it stops, dies, comes back, and what it recorded."""

from __future__ import annotations

import contextlib
import csv
import pathlib
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

from flightstack.recording import read_recording
from simvehicle.launch import free_ports

pytestmark = pytest.mark.system

SPEEDUP = 4.0
FLEET = """
origin: {{latitude_deg: -5.06, longitude_deg: 151.3, amsl_m: 500.0}}
vehicles:
  - id: 1
    flavour: {flavour}
    links: ["udpout:127.0.0.1:{udp}"]
    instruments: [{{name: co2, type: sba5, port: "127.0.0.1:{instrument}"}}]
speedup: {speedup}
ready_after_s: 6
truth: {truth}
"""
DRONE = """
drone: 1
swarm: {{name: alone, members: [1], listen: ["tcp/127.0.0.1:{tcp}"]}}
origin: {{latitude_deg: -5.06, longitude_deg: 151.3, amsl_m: 500.0}}
autopilot: {{link: "udpin:127.0.0.1:{udp}", flavour: {flavour}}}
instruments: [{{name: co2, type: sba5, port: "socket://127.0.0.1:{instrument}"}}]
geofence: {{inclusion_circles: [{{latitude_deg: -5.06, longitude_deg: 151.3, radius_m: 300.0}}]}}
speedup: {speedup}
record_to: {recordings}
"""


class Rig:
    """One simulated vehicle, its agent and the operator, each a process."""

    def __init__(self, directory: pathlib.Path, flavour: str) -> None:
        udp = free_ports(socket.SOCK_DGRAM, 1)[0]
        self.tcp, instrument = free_ports(socket.SOCK_STREAM, 2)
        self.recordings = directory / "flights"
        self.truth = directory / "truth.csv"
        self.log = directory / "agent.log"
        known = {
            "udp": udp, "tcp": self.tcp, "instrument": instrument, "flavour": flavour, "speedup": SPEEDUP,
            "recordings": self.recordings, "truth": self.truth,
        }  # fmt: skip
        self._fleet, self._drone = directory / "fleet.yaml", directory / "drone.yaml"
        self._fleet.write_text(FLEET.format(**known))
        self._drone.write_text(DRONE.format(**known))
        self._vehicle_log = directory / "vehicle.log"
        self.vehicle = self._start("simvehicle.cli", self._fleet, self._vehicle_log)
        self.agent = self._start("flightstack.cli", self._drone, self.log)

    @staticmethod
    def _start(module: str, config: pathlib.Path, log: pathlib.Path) -> subprocess.Popen[bytes]:
        with log.open("ab") as file:
            return subprocess.Popen(
                [sys.executable, "-m", module, "run", "--config", str(config)], stdout=file, stderr=file
            )

    def restart_agent(self) -> None:
        self.agent = self._start("flightstack.cli", self._drone, self.log)

    def said(self, words: str, times: int = 1) -> None:
        """Wait until the agent's log has `words` in it so often."""
        deadline_s = time.monotonic() + 90.0
        while len(re.findall(words, self.log.read_text())) < times:
            assert self.agent.poll() is None, self.log.read_text()
            assert time.monotonic() < deadline_s, f"{words!r} is not in\n{self.log.read_text()}"
            time.sleep(0.1)

    def command(self, name: str) -> None:
        deadline_s = time.monotonic() + 60.0
        while True:
            done = subprocess.run(
                [
                    *(sys.executable, "-m", "gcs.cli", "survey", name, "--deadline", "3"),
                    *("--swarm", "alone", "--connect", f"tcp/127.0.0.1:{self.tcp}"),
                ],
                capture_output=True,
                text=True,
            )
            if done.returncode == 0:
                return
            assert time.monotonic() < deadline_s, done.stdout + done.stderr + self.log.read_text()

    def fly(self) -> None:
        self.said("ready: autopilot on")
        self.command("start")
        self.said("searching: in formation")

    def end(self, *signals: signal.Signals) -> int:
        for number in signals:
            self.agent.send_signal(number)
        return self.agent.wait(120.0)

    def vehicle_flies(self) -> bool:
        with self.truth.open() as file:
            return list(csv.DictReader(file))[-1]["airborne"] == "1"

    def replay(self, recordings: int = 1) -> None:
        files = sorted(self.recordings.glob("drone-1-*.mcap"))
        assert len(files) == recordings
        done = subprocess.run(
            [sys.executable, "-m", "flightstack.cli", "replay", *map(str, files)],
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        assert done.stdout.count("ticks, all outputs the same") == recordings

    def close(self) -> None:
        for process in (self.agent, self.vehicle):
            if process.poll() is None:
                process.kill()
                process.wait()


@pytest.fixture
def rig(tmp_path: pathlib.Path, request: pytest.FixtureRequest) -> Iterator[Rig]:
    with contextlib.closing(Rig(tmp_path, getattr(request, "param", "ardupilot"))) as one:
        yield one


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_on_the_ground_a_signal_ends_the_agent(rig: Rig, number: signal.Signals) -> None:
    rig.said("ready: autopilot on")
    assert rig.end(number) == 0
    assert "Traceback" not in rig.log.read_text()
    rig.replay()


@pytest.mark.parametrize("rig", ["ardupilot", "px4"], indirect=True)
def test_in_flight_a_signal_brings_the_drone_home_first(rig: Rig) -> None:
    rig.fly()
    assert rig.end(signal.SIGTERM) == 0
    log = rig.log.read_text()
    assert "going home first" in log
    assert log.index("returning: ") < log.index("landing: ") < log.index("landed: ")
    deadline_s = time.monotonic() + 20.0
    while rig.vehicle_flies():  # the file is a second behind
        assert time.monotonic() < deadline_s
        time.sleep(0.1)
    rig.replay()


def test_the_second_signal_ends_the_agent_at_once(rig: Rig) -> None:
    rig.fly()
    rig.agent.send_signal(signal.SIGINT)
    rig.said("going home first")
    assert rig.end(signal.SIGTERM) == 0
    assert "landed: " not in rig.log.read_text()
    assert rig.vehicle_flies()
    rig.replay()


def test_an_agent_killed_in_flight_leaves_its_recording_and_its_successor_obeys(rig: Rig) -> None:
    rig.fly()
    killed_at_s = time.time()
    assert rig.end(signal.SIGKILL) == -signal.SIGKILL
    (file,) = rig.recordings.glob("drone-1-*.mcap")
    last = max(record.wall_s for record in read_recording(file))
    assert killed_at_s - last < 5.0  # written twice a second; the rest is for a busy machine
    rig.replay()
    rig.restart_agent()
    rig.said("ready: autopilot on", times=2)
    rig.command("abort")
    rig.said("landed: ")
    assert rig.end(signal.SIGINT) == 0
    rig.replay(recordings=2)
