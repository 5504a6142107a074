"""Two sites that a router joins, as processes: agents on simulated vehicles, a ground station, and `gcs router`."""

from __future__ import annotations

import contextlib
import json
import pathlib
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import pytest
import yaml

from simvehicle.survey.ports import free_ports

pytestmark = pytest.mark.system

LIMIT_S = 120.0
"""For what a quiet machine does in seconds: no test may fail because others use the machine as well."""
PROGRAMS = pathlib.Path(sys.executable).parent
ORIGIN = {"latitude_deg": -5.06, "longitude_deg": 151.3, "amsl_m": 500.0}
FENCE = {"inclusion_circles": [{"latitude_deg": -5.06, "longitude_deg": 151.3, "radius_m": 300.0}]}
DRONES = (1, 2, 3)


def until(condition: Callable[[], object], what: str) -> None:
    end_s = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < end_s, f"not within {LIMIT_S} s: {what}"
        time.sleep(0.2)


def gcs(*words: object, code: int | None = 0) -> str:
    """What a command says; it must end with `code`, if one is given."""
    done = subprocess.run(
        [str(PROGRAMS / "gcs"), *map(str, words)], capture_output=True, text=True, timeout=LIMIT_S
    )
    assert code is None or done.returncode == code, done.stdout + done.stderr
    return done.stdout


class Crater:
    """Drones 1 and 2 on the rim, drone 3 and the ground station in the valley, all with files of `gcs fleet`."""

    def __init__(self, directory: pathlib.Path) -> None:
        self.directory = directory
        self.fleet = directory / "crater"
        port, router_port = free_ports(socket.SOCK_STREAM, 2)
        gcs(
            *("fleet", "init", self.fleet, "--swarm", "crater", "--port", port, "--router-port", router_port),
            *("--drones", "1,2", "--first-address", "127.0.0.2"),
            *("--site", "rim", "--router", "relay=127.0.0.9"),
        )
        gcs(
            *("fleet", "add", self.fleet, "--drones", "3", "--first-address", "127.0.0.4"),
            *("--station", "ground=127.0.0.1", "--site", "valley"),
        )
        router = self.fleet / "relay" / "zenohd.json5"
        router.write_text(router.read_text().replace("[::]", "127.0.0.9"))
        self._write()
        self.processes: dict[str, subprocess.Popen[bytes]] = {}

    def _write(self) -> None:
        links = free_ports(socket.SOCK_DGRAM, len(DRONES))
        instruments = free_ports(socket.SOCK_STREAM, len(DRONES))
        vehicles = []
        for drone, udp, tcp in zip(DRONES, links, instruments, strict=True):
            co2 = {"name": "co2", "type": "sba5"}
            vehicles.append(
                {
                    "id": drone,
                    "flavour": "ardupilot",
                    "links": [f"udpout:127.0.0.1:{udp}"],
                    "instruments": [co2 | {"port": f"127.0.0.1:{tcp}"}],
                }
            )
            self._write_node(
                f"drone-{drone}",
                drone=drone,
                autopilot={"link": f"udpin:127.0.0.1:{udp}", "flavour": "ardupilot"},
                instruments=[co2 | {"port": f"socket://127.0.0.1:{tcp}"}],
            )
        self._write_node("ground", station="ground")
        (self.directory / "fleet.yaml").write_text(yaml.safe_dump({"origin": ORIGIN, "vehicles": vehicles}))

    def _write_node(self, name: str, **facts: object) -> None:
        swarm = yaml.safe_load((self.fleet / name / "swarm.yaml").read_text())
        common = {"origin": ORIGIN, "geofence": FENCE, "record_to": str(self.directory / name)}
        self.file(name).write_text(yaml.safe_dump(facts | common | swarm))

    def file(self, name: str) -> pathlib.Path:
        return self.fleet / name / "node.yaml"

    def start(self, name: str, *words: object) -> None:
        with (self.directory / f"{name}.log").open("ab") as log:
            self.processes[name] = subprocess.Popen(
                [str(PROGRAMS / str(words[0])), *map(str, words[1:])], stdout=log, stderr=log
            )

    def start_router(self) -> None:
        self.start("relay", "gcs", "router", "--config", self.fleet / "relay" / "zenohd.json5")

    def kill_router(self) -> None:
        process = self.processes.pop("relay")
        process.kill()
        process.wait()

    def log(self, name: str) -> str:
        return (self.directory / f"{name}.log").read_text()

    def live(self) -> set[int]:
        """Whose agents the operator sees."""
        report = json.loads(
            gcs("status", "--config", self.file("ground"), "--seconds", 4, "--json", code=None)
        )
        return {drone["drone"] for drone in report["drones"] if drone["agent"] == "live"}

    def close(self) -> None:
        for process in self.processes.values():
            process.send_signal(signal.SIGTERM)
        for process in self.processes.values():
            try:
                process.wait(20.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


@pytest.fixture
def crater(tmp_path: pathlib.Path) -> Iterator[Crater]:
    with contextlib.closing(Crater(tmp_path)) as crater:
        crater.start("vehicles", "simvehicle", "run", "--config", tmp_path / "fleet.yaml")
        crater.start_router()
        for drone in DRONES:
            name = f"drone-{drone}"
            crater.start(name, "flightstack", "run", "--config", crater.file(name))
        crater.start("ground", "gcs", "serve", "--config", crater.file("ground"))
        yield crater


def test_two_sites_are_one_swarm_until_the_router_dies_and_again_when_it_is_back(crater):
    until(lambda: crater.live() == {*DRONES}, "the operator in the valley sees all drones")
    outcome = gcs(
        *("survey", "rtl", "--drone", 1, "--config", crater.file("ground"), "--deadline", 30, "--json"),
        code=None,
    )
    assert json.loads(outcome)["drones"][0]["result"] in ("accepted", "refused")

    crater.kill_router()
    until(lambda: crater.live() == {3}, "the rim is not heard any more")
    for name in ("ground", "drone-1", "drone-2", "drone-3"):
        until(lambda name=name: "no router since" in crater.log(name), f"{name} tells it")

    crater.start_router()
    until(lambda: crater.live() == {*DRONES}, "the operator sees all drones again")
    for name in ("ground", "drone-1", "drone-2", "drone-3"):
        until(lambda name=name: "the router is there" in crater.log(name), f"{name} tells it")
    assert all(process.poll() is None for process in crater.processes.values())
    assert all(f"drone-{drone} is connected" in crater.log("relay") for drone in DRONES)
