"""`flightstack run` as a process on a simulated vehicle: how it stops, dies, comes back, and what it recorded."""

from __future__ import annotations

import contextlib
import csv
import os
import pathlib
import pty
import re
import signal
import socket
import subprocess
import sys
import termios
import threading
import time
import tty
from collections.abc import Iterator

import pytest

from flightstack.mavlink.link import open_link
from flightstack.recording.recorder import read_recording
from simvehicle.survey.ports import free_ports

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
autopilot: {{link: "{link}", flavour: {flavour}{parameters}}}
instruments: [{{name: co2, type: sba5, port: "socket://127.0.0.1:{instrument}"}}]
geofence: {{inclusion_circles: [{{latitude_deg: -5.06, longitude_deg: 151.3, radius_m: 300.0}}]}}
speedup: {speedup}
record_to: {recordings}
"""


class Cable:
    """Between the vehicle and a serial port at which the agent sits: it can be pulled out."""

    def __init__(self, port: pathlib.Path, udp: int) -> None:
        self._port = port
        self._vehicle = open_link(f"udpin:127.0.0.1:{udp}")
        self._master: int | None = None
        self._lock = threading.Lock()
        self._over = threading.Event()
        self.plug()
        self._thread = threading.Thread(target=self._carry)
        self._thread.start()

    def plug(self) -> None:
        master, slave = pty.openpty()
        tty.setraw(slave, termios.TCSANOW)
        os.set_blocking(master, False)
        self._port.symlink_to(os.ttyname(slave))
        os.close(slave)
        with self._lock:
            self._master = master

    def unplug(self) -> None:
        with self._lock:
            if self._master is not None:
                self._port.unlink()
                os.close(self._master)
                self._master = None

    def _carry(self) -> None:
        while not self._over.wait(0.005):
            with self._lock:
                down = self._vehicle.read()
                if self._master is None:
                    continue
                with contextlib.suppress(OSError):  # nothing there, no room, or nobody has opened the port
                    os.write(self._master, down)
                with contextlib.suppress(OSError):
                    self._vehicle.write(os.read(self._master, 65536))

    def close(self) -> None:
        self._over.set()
        self._thread.join()
        self.unplug()
        self._vehicle.close()


class Rig:
    """One simulated vehicle, its agent and the operator, each a process."""

    def __init__(
        self, directory: pathlib.Path, flavour: str, serial_port: pathlib.Path | None = None
    ) -> None:
        udp = free_ports(socket.SOCK_DGRAM, 1)[0]
        self.cable = None if serial_port is None else Cable(serial_port, udp)
        self.tcp, instrument = free_ports(socket.SOCK_STREAM, 2)
        self.recordings = directory / "flights"
        self.truth = directory / "truth.csv"
        self.log = directory / "agent.log"
        known = {
            "udp": udp, "tcp": self.tcp, "instrument": instrument, "flavour": flavour, "speedup": SPEEDUP,
            "recordings": self.recordings, "truth": self.truth,
            "parameters": ", parameters: {COM_OBL_RC_ACT: 3, RTL_CONE_ANG: 0}" if flavour == "px4" else "",
            "link": f"udpin:127.0.0.1:{udp}" if serial_port is None else f"{serial_port},115200",
        }  # fmt: skip
        self._fleet, self._drone = directory / "fleet.yaml", directory / "drone.yaml"
        self._fleet.write_text(FLEET.format(**known))
        self._drone.write_text(DRONE.format(**known))
        self._vehicle_log = directory / "vehicle.log"
        self.vehicle = self._start("simvehicle.cli.main", self._fleet, self._vehicle_log)
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
                    *(sys.executable, "-m", "gcs.cli.main", "survey", name, "--deadline", "3"),
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
        return self._newest_truth()["airborne"] == "1"

    def let_pass(self, seconds: float) -> None:
        """Simulated seconds."""
        begin_s = float(self._newest_truth()["time_s"])
        while float(self._newest_truth()["time_s"]) < begin_s + seconds:
            time.sleep(0.1)

    def _newest_truth(self) -> dict[str, str]:
        with self.truth.open() as file:  # the last row may still be half written
            return [row for row in csv.DictReader(file) if row["battery_fraction"]][-1]

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
        if self.cable is not None:
            self.cable.close()


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


def test_a_terminal_that_is_closed_does_not_end_a_flight(rig: Rig) -> None:
    """A radio that fails takes the operator's remote shell with it."""
    rig.fly()
    rig.agent.send_signal(signal.SIGHUP)
    rig.let_pass(5.0)
    assert rig.agent.poll() is None
    assert rig.vehicle_flies()
    rig.command("abort")
    assert rig.agent.wait(120.0) == 0
    assert "landed: " in rig.log.read_text()
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


def test_a_cable_that_is_pulled_out_in_flight_and_put_back(tmp_path: pathlib.Path) -> None:
    """Serial: the vehicle hovers meanwhile, nobody takes it for a pilot's, and it obeys afterwards."""
    with contextlib.closing(Rig(tmp_path, "ardupilot", tmp_path / "ttypixhawk")) as rig:
        assert rig.cable is not None
        rig.fly()
        rig.cable.unplug()
        rig.said("ttypixhawk,115200 is lost")
        rig.let_pass(10.0)
        rig.cable.plug()
        rig.said("ttypixhawk,115200 is back")
        rig.let_pass(3.0)
        assert rig.vehicle_flies()
        rig.command("abort")
        rig.said("landed: ")
        assert rig.end(signal.SIGINT) == 0
        assert "pilot: " not in rig.log.read_text()
        rig.replay()
