"""MAVProxy, the field's command-line ground station, reads parameters, loads lists and flies the ArduPilot flavour.

It is installed into an environment of its own under the user's cache directory, once.
"""

from __future__ import annotations

import math
import os
import pathlib
import queue
import shutil
import socket
import subprocess
import threading
import time
import venv
from collections.abc import Callable, Iterator

import pytest

from flightstack.mavlink.signing import key_of_passphrase
from mission.geometry.frames import Geodetic
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.drone.simulated_vehicle import SimulatedVehicle
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.fleet.process import Fleet, run
from simvehicle.survey.ports import free_port

pytestmark = [pytest.mark.system, pytest.mark.optional, pytest.mark.timeout(600)]

VERSION = "1.8.75"
MODULES = "link,param,wp,fence,rally,mode,arm,cmdlong,misc"


@pytest.fixture(scope="module")
def mavproxy() -> list[str]:
    """The command; the test is skipped where it cannot be installed."""
    cache = pathlib.Path(os.environ.get("XDG_CACHE_HOME", pathlib.Path.home() / ".cache"))
    home = cache / "flightstack-tests" / f"mavproxy-{VERSION}"
    done = home / "installed"
    python = home / "bin" / "python"
    if not done.exists():
        shutil.rmtree(home, ignore_errors=True)
        try:
            venv.create(home, with_pip=True)
            command = [str(python), "-m", "pip", "install", "-q", f"MAVProxy=={VERSION}"]
            subprocess.run(command, check=True, capture_output=True, text=True, timeout=300)
        except (OSError, subprocess.SubprocessError) as error:
            reason = (getattr(error, "stderr", "") or str(error)).strip().splitlines()[-1]
            pytest.skip(f"MAVProxy cannot be installed: {reason}")
        done.touch()
    return [str(python), str(home / "bin" / "mavproxy.py")]


class Console:
    """A person at MAVProxy: types commands and reads what it prints."""

    def __init__(self, command: list[str], port: int, directory: pathlib.Path) -> None:
        options = (
            f"--master=udpin:127.0.0.1:{port}",
            f"--default-modules={MODULES}",
            f"--state-basedir={directory}",
            f"--logfile={directory / 'mav.tlog'}",
        )
        self.process = subprocess.Popen(
            [*command, *options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=directory,
            env={**os.environ, "HOME": str(directory), "PYTHONUNBUFFERED": "1"},
        )
        self.said = ""
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._lines.put(line)

    def type(self, text: str) -> None:
        assert self.process.stdin is not None
        self.said = ""
        self.process.stdin.write(text + "\n")
        self.process.stdin.flush()

    def until(self, what: str, done: Callable[[str], bool], limit_s: float = 45.0) -> None:
        """Wait (wall seconds) for something that it prints since the last command, or that comes true."""
        end_s = time.monotonic() + limit_s
        while not done(self.said):
            assert time.monotonic() < end_s, f"never came true: {what}; it said:\n{self.said}"
            try:
                self.said += self._lines.get(timeout=0.1)
            except queue.Empty:
                assert self.process.poll() is None, f"MAVProxy ended: {self.said}"

    def close(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.terminate()
        try:
            self.process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._reader.join()
        assert self.process.stdout is not None
        self.process.stdout.close()


@pytest.fixture
def port() -> int:
    return free_port(socket.SOCK_DGRAM)


@pytest.fixture
def vehicle(port: int) -> Iterator[SimulatedVehicle]:
    spec = VehicleSpec(
        id=1, links=(f"udpout:127.0.0.1:{port}",), parameters={"RTL_LOIT_TIME": 500.0, "LAND_SPEED": 150.0}
    )
    fleet = Fleet(
        FleetConfig(origin=Geodetic(-5.06, 151.3, 500.0), vehicles=(spec,), speedup=4.0, ready_after_s=8.0)
    )
    stop = threading.Event()
    thread = threading.Thread(target=run, args=(fleet, stop))
    thread.start()
    yield fleet.drones.by_id[1].vehicle
    stop.set()
    thread.join()


def test_mavproxy_flies_it(
    mavproxy: list[str], vehicle: SimulatedVehicle, port: int, tmp_path: pathlib.Path
) -> None:
    console = Console(mavproxy, port, tmp_path)
    try:
        # Not by its texts: a slow MAVProxy comes after the last of them.
        console.until("discovery, parameters", lambda said: "Received" in said and vehicle.ready)
        _parameters(console, vehicle)
        _lists(console, vehicle, tmp_path)
        _flight(console, vehicle)
    finally:
        console.close()
    assert (tmp_path / "mav.tlog").stat().st_size > 1000


def test_mavproxy_gives_it_a_key_and_is_obeyed(
    mavproxy: list[str], vehicle: SimulatedVehicle, port: int, tmp_path: pathlib.Path
) -> None:
    console = Console(mavproxy, port, tmp_path)
    try:
        console.until("discovery, parameters", lambda said: "Received" in said and vehicle.ready)
        console.type("module load signing")
        console.until("its module", lambda said: "Loaded module signing" in said)
        console.type("signing setup swordfish")
        console.until("the key", lambda _: vehicle.autopilot.signing_key == key_of_passphrase("swordfish"))
        console.type("param set WPNAV_SPEED 700")
        console.until("a set parameter", lambda _: vehicle.autopilot.parameters["WPNAV_SPEED"] == 700.0)
        console.type("mode guided")
        console.until("GUIDED in signed words", lambda said: vehicle.mode == "GUIDED" and "GUIDED" in said)
    finally:
        console.close()


def _parameters(console: Console, vehicle: SimulatedVehicle) -> None:
    console.type("param show RTL_ALT")
    console.until("a parameter", lambda said: "RTL_ALT" in said and "1500" in said)
    console.type("param set WPNAV_SPEED 600")
    console.until("a set parameter", lambda _: vehicle.autopilot.parameters["WPNAV_SPEED"] == 600.0)


def _lists(console: Console, vehicle: SimulatedVehicle, directory: pathlib.Path) -> None:
    mission = directory / "mission.txt"
    rows = [
        "0 1 0 16 0 0 0 0 -5.06 151.3 500 1",
        "1 0 3 22 0 0 0 0 -5.06 151.3 10 1",
        "2 0 3 16 0 0 0 0 -5.0598 151.3 10 1",
        "3 0 3 16 0 0 0 0 -5.0598 151.3002 12 1",
    ]
    mission.write_text("QGC WPL 110\n" + "".join(row.replace(" ", "\t") + "\n" for row in rows))
    console.type(f"wp load {mission}")
    console.until("the mission loaded", lambda _: len(vehicle.autopilot.lists[0]) == 4)
    console.type("wp list")
    console.until("the mission listed", lambda said: "-5.05980" in said and "12.0" in said)
    fence = directory / "fence.txt"
    corners = [(-5.0590, 151.2990), (-5.0590, 151.3010), (-5.0610, 151.3010), (-5.0610, 151.2990)]
    vertices = [f"{n} 0 3 5001 4 0 0 0 {lat} {lon} 0 1" for n, (lat, lon) in enumerate(corners)]
    fence.write_text("QGC WPL 110\n" + "".join(row.replace(" ", "\t") + "\n" for row in vertices))
    console.type(f"fence load {fence}")
    console.until("the fence loaded", lambda _: len(vehicle.autopilot.fence.areas) == 1)
    assert vehicle.autopilot.fence.areas[0].contains(0.0, 0.0)


def _flight(console: Console, vehicle: SimulatedVehicle) -> None:
    console.type("mode guided")
    console.until("GUIDED", lambda _: vehicle.mode == "GUIDED")
    console.type("arm throttle")
    console.until("armed", lambda said: vehicle.armed and "ARMED" in said)
    console.type("takeoff 10")
    console.until("at 10 m", lambda _: math.dist(vehicle.position_ned_m, (0.0, 0.0, -10.0)) < 1.0)
    console.type("guided -5.0599 151.3 14")
    console.until("11 m north", lambda _: math.dist(vehicle.position_ned_m, (11.1, 0.0, -14.0)) < 1.2)
    console.type("mode auto")
    console.until("the last waypoint", lambda said: "Reached command #3" in said)
    console.type("mode rtl")
    console.until("home", lambda said: not vehicle.armed and "DISARMED" in said, limit_s=90.0)
    assert math.dist(vehicle.position_ned_m, (0.0, 0.0, 0.0)) < 1.5
