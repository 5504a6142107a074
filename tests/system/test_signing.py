"""MAVLink signing with real processes: who has no key moves nobody; keys are given, changed and taken away."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import pathlib
import re
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import yaml
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.signing import stamp_at
from flightstack.mavlink.signing_store import read_key
from simvehicle.survey.ports import free_ports

pytestmark = pytest.mark.system

SPEEDUP = 4.0
LIMIT_S = 90.0
ORIGIN = {"latitude_deg": -5.06, "longitude_deg": 151.3, "amsl_m": 500.0}
PROGRAMS = pathlib.Path(sys.executable).parent
PLAN = pathlib.Path(__file__).parents[1] / "data" / "plans" / "crater.plan"


def run(*words: object, code: int = 0, typed: str | None = None) -> str:
    """What one of our commands says; it must end with `code`."""
    command = [str(PROGRAMS / str(words[0])), *map(str, words[1:])]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, input=typed)
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout + done.stderr


def until(condition: Callable[[], object], what: Callable[[], str]) -> None:
    end_s = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < end_s, f"not within {LIMIT_S} s: {what()}"
        time.sleep(0.05)


class Programs:
    """Our programs with their files in one directory."""

    def __init__(self, directory: pathlib.Path) -> None:
        self.directory = directory
        self._running: list[subprocess.Popen[bytes]] = []

    def write(self, name: str, document: dict[str, Any]) -> pathlib.Path:
        file = self.directory / name
        file.write_text(yaml.safe_dump(document))
        return file

    def start(self, *words: object) -> pathlib.Path:
        """A program that goes on; returns its log."""
        log = self.directory / f"{words[0]}.log"
        command = [str(PROGRAMS / str(words[0])), *map(str, words[1:])]
        with log.open("ab") as file:
            process = subprocess.Popen(
                command, stdout=file, stderr=file, env={**os.environ, "PYTHONUNBUFFERED": "1"}
            )
        self._running.append(process)
        return log

    def end(self) -> None:
        for process in self._running:
            process.terminate()
        for process in self._running:
            try:
                process.wait(20.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


@pytest.fixture
def programs(tmp_path) -> Iterator[Programs]:
    started = Programs(tmp_path)
    try:
        yield started
    finally:
        started.end()


class Forger:
    """Says in others' names what would stop them, to whoever listens at a port."""

    def __init__(self, key: bytes | None = None) -> None:
        self.said = 0
        self._key = key
        self._over = threading.Event()
        self._threads: list[threading.Thread] = []

    def pack(self, messages: list[Any], system: int, component: int) -> list[bytes]:
        mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        if self._key is not None:
            mav.signing.secret_key = self._key
            mav.signing.timestamp = stamp_at(time.time())
            mav.signing.link_id = 77
            mav.signing.sign_outgoing = True
        return [bytes(message.pack(mav)) for message in messages]

    def attack(self, port: int, messages: list[Any], system: int, component: int) -> None:
        def talk() -> None:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
                while not self._over.wait(0.05):
                    for data in self.pack(messages, system, component):
                        with contextlib.suppress(ConnectionRefusedError):
                            sender.sendto(data, ("127.0.0.1", port))
                    self.said += 1

        thread = threading.Thread(target=talk)
        self._threads.append(thread)
        thread.start()

    def end(self) -> None:
        self._over.set()
        for thread in self._threads:
            thread.join()


def command(number: int, *parameters: float) -> Any:
    return mavlink.MAVLink_command_long_message(1, 1, number, 0, *parameters, *(0.0,) * (7 - len(parameters)))


ORDERS = [
    mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3),
    command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, 9.0),
    command(mavlink.MAV_CMD_NAV_LAND),
    command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, 21196.0),
    mavlink.MAVLink_param_set_message(1, 1, b"FENCE_ENABLE", 0.0, 2),
    mavlink.MAVLink_mission_clear_all_message(1, 1, 0),
    mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 1, 0x9C7, 0, 0, 0, 20.0, 0, 5.0, 0, 0, 0, 0, 0
    ),
    mavlink.MAVLink_setup_signing_message(1, 1, list(range(32)), 5),
]
"""To the vehicle, as the ground station and as the companion."""
LIES = [
    mavlink.MAVLink_heartbeat_message(2, 3, 81, 9, 3, 3),
    mavlink.MAVLink_statustext_message(0, b"forged"),
    mavlink.MAVLink_global_position_int_message(1, -60600000, 1413000000, 0, 90000, 0, 0, 0, 0),
    mavlink.MAVLink_extended_sys_state_message(0, 1),
]
"""From the vehicle, to companion and ground station: disarmed, in LAND, on the ground, somewhere else."""


class SignedFlight(Programs):
    """One drone that searches, its ground station, and a radio that anybody can speak on."""

    def __init__(self, directory: pathlib.Path) -> None:
        super().__init__(directory)
        self.companion, self.station, self.radio = free_ports(socket.SOCK_DGRAM, 3)
        swarm, ground, instrument = free_ports(socket.SOCK_STREAM, 3)
        self.key = directory / "mavlink.key"
        run("gcs", "signing", "make", self.key)
        self.truth = directory / "truth.csv"
        endpoints = [f"tcp/127.0.0.1:{port}" for port in (swarm, ground)]
        fleet = {
            "origin": ORIGIN,
            "speedup": SPEEDUP,
            "ready_after_s": 6,
            "truth": str(self.truth),
            "vehicles": [
                {
                    "id": 1,
                    "signing_key": "mavlink.key",
                    "links": [
                        f"udpout:127.0.0.1:{self.companion}",
                        f"udpout:127.0.0.1:{self.station}",
                        f"udpin:127.0.0.1:{self.radio}",
                    ],
                    "instruments": [{"name": "co2", "type": "sba5", "port": f"127.0.0.1:{instrument}"}],
                }
            ],
        }
        drone = {
            "drone": 1,
            "swarm": {"name": "alone", "members": [1], "listen": endpoints[:1], "connect": endpoints},
            "origin": ORIGIN,
            "autopilot": {"link": f"udpin:127.0.0.1:{self.companion}", "signing_key": "mavlink.key"},
            "instruments": [{"name": "co2", "type": "sba5", "port": f"socket://127.0.0.1:{instrument}"}],
            "geofence": {
                "inclusion_circles": [{"latitude_deg": -5.06, "longitude_deg": 151.3, "radius_m": 300.0}]
            },
            "speedup": SPEEDUP,
            "record_to": str(directory / "flights"),
        }
        station = {
            "swarm": {"name": "alone", "members": [1], "listen": endpoints[1:], "connect": endpoints},
            "origin": ORIGIN,
            "mavlink": {"links": [f"udpin:127.0.0.1:{self.station}"], "signing_key": "mavlink.key"},
            "speedup": SPEEDUP,
            "record_to": str(directory / "flights"),
        }
        self.ground_file = self.write("ground.yaml", station)
        self.start("simvehicle", "run", "--config", self.write("fleet.yaml", fleet))
        self.agent_log = self.start("flightstack", "run", "--config", self.write("drone.yaml", drone))
        self.station_log = self.start("gcs", "serve", "--config", self.ground_file)

    def newest(self) -> dict[str, str]:
        with self.truth.open() as file:  # the last row may still be half written
            return [row for row in csv.DictReader(file) if row["battery_fraction"]][-1]

    def search(self) -> None:
        self.agent_says("drone 1 ready: autopilot on")
        run("gcs", "survey", "start", "--config", self.ground_file, "--deadline", "60")
        self.agent_says("searching: in formation")

    def agent_says(self, words: str) -> None:
        until(lambda: words in self.agent_log.read_text(), self.agent_log.read_text)

    def pass_s(self, seconds: float) -> list[str]:
        """Let so many simulated seconds pass; the modes that the vehicle was in."""
        end_s = float(self.newest()["time_s"]) + seconds
        until(lambda: float(self.newest()["time_s"]) >= end_s, lambda: str(self.newest()))
        with self.truth.open() as file:
            rows = [row for row in csv.DictReader(file) if row["battery_fraction"]]
        return [row["mode"] for row in rows if float(row["time_s"]) > end_s - seconds]

    def status(self) -> dict[str, Any]:
        return dict(json.loads(run("gcs", "status", "--config", self.ground_file, "--json")))


def attacked(flight: SignedFlight, forger: Forger) -> None:
    forger.attack(flight.radio, ORDERS, 255, 190)
    forger.attack(flight.radio, ORDERS, 1, 191)
    forger.attack(flight.companion, LIES, 1, 1)
    forger.attack(flight.station, LIES, 1, 1)


def test_unsigned_mavlink_moves_stops_and_blinds_nobody(tmp_path):
    """The last lines are the proof that the same words would have done it: they are signed there."""
    with contextlib.ExitStack() as stack:
        flight = SignedFlight(tmp_path)
        stack.callback(flight.end)
        flight.search()
        for key in (None, bytes(range(32))):
            forger = Forger(key)
            attacked(flight, forger)
            said = forger.said
            modes = flight.pass_s(15.0)
            until(lambda forger=forger, said=said: forger.said > said + 100, lambda: "the forger talks")
            forger.end()
            assert set(modes) == {"GUIDED"}
        newest = flight.newest()
        assert (newest["airborne"], newest["armed"]) == ("1", "1")
        assert -60.0 < float(newest["down_m"]) < -5.0
        (row,) = flight.status()["drones"]
        assert (row["phase"], row["mode"], row["agent"], row["vehicle"]) == (
            "searching",
            "GUIDED",
            "live",
            "live",
        )
        agent, station = flight.agent_log.read_text(), flight.station_log.read_text()
        for log in (agent, station):
            assert len(re.findall("system 1 does not sign, and is ignored", log)) == 1
            assert len(re.findall("system 1 signs with another key than", log)) == 1
            assert "forged" not in log
            assert "Traceback" not in log
        assert "phase: pilot" not in agent
        signed = Forger(read_key(flight.key))
        signed.attack(flight.radio, ORDERS[:3], 255, 190)
        until(lambda: flight.newest()["mode"] == "LAND", lambda: str(flight.newest()))
        signed.end()
    replayed = run("flightstack", "replay", *(tmp_path / "flights").glob("drone-1-*.mcap"))
    assert "all outputs the same" in replayed


@pytest.fixture
def vehicle(programs) -> tuple[str, str]:
    """A simulated vehicle without a key: its USB port, and its radio."""
    usb, radio = (f"tcpin:127.0.0.1:{port}" for port in free_ports(socket.SOCK_STREAM, 2))
    fleet = {"origin": ORIGIN, "vehicles": [{"id": 1, "links": [usb, radio], "usb_links": [0]}]}
    programs.start("simvehicle", "run", "--config", programs.write("fleet.yaml", fleet))
    return usb.replace("tcpin", "tcp"), radio.replace("tcpin", "tcp")


def test_a_key_is_given_used_changed_and_taken_away(programs, vehicle):
    usb, radio = vehicle
    at_radio = ("--drone", 1, "--link", radio)
    keys = [programs.directory / name for name in ("one.key", "two.key")]
    for key in keys:
        run("gcs", "signing", "make", key)
    files = [
        programs.write(f"{key.stem}.yaml", {
            "swarm": {"name": "alone", "members": [1]},
            "origin": ORIGIN,
            "mavlink": {"links": [radio], "signing_key": key.name},
        })
        for key in keys
    ]  # fmt: skip
    assert "does not sign" in run(
        "gcs", "param", "get", "RTL_ALT", "--drone", 1, "--config", files[0], code=1
    )

    run("gcs", "signing", "setup", keys[0], "--drone", 1, "--link", usb)
    assert "RTL_ALT" in run("gcs", "param", "get", "RTL_ALT", "--drone", 1, "--config", files[0])
    unsigned = run("gcs", "param", "get", "RTL_ALT", *at_radio, code=1)
    assert "drone 1 signs, and may obey nobody without its key" in unsigned
    other = run("gcs", "param", "get", "RTL_ALT", "--drone", 1, "--config", files[1], code=1)
    assert "system 1 signs with another key than" in other
    assert "gcs signing setup" in other

    # MAVSDK cannot sign: what it says and hears passes through our link.
    run("gcs", "plan", "upload", PLAN, "--drone", 1, "--config", files[0])
    back = programs.directory / "back.plan"
    run("gcs", "plan", "download", back, "--drone", 1, "--config", files[0])
    assert len(json.loads(back.read_text())["mission"]["items"]) == 3

    locked = run("gcs", "signing", "setup", keys[1], *at_radio, code=1)
    assert "it has a signing key, and nothing was changed" in locked
    run("gcs", "signing", "setup", keys[1], *at_radio, "--old-key", keys[0])
    assert "RTL_ALT" in run("gcs", "param", "get", "RTL_ALT", "--drone", 1, "--config", files[1])

    run("gcs", "signing", "disable", "--drone", 1, "--link", usb)
    assert "RTL_ALT" in run("gcs", "param", "get", "RTL_ALT", *at_radio)
