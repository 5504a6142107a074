"""The ground station and simulated vehicles, as processes: an orphan comes home; plans, fences, parameters."""

from __future__ import annotations

import contextlib
import itertools
import json
import pathlib
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator

import msgspec
import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.recording.recorder import read_recording
from flightstack.swarm import topics
from flightstack.swarm.wire import DroneState, Phase
from flightstack.transport.zenoh_transport import ZenohTransport
from mission.geometry.frames import Geodetic, LocalFrame
from simvehicle.survey.ports import free_port

pytestmark = pytest.mark.system

ORIGIN = Geodetic(-5.06, 151.3, 500.0)
SPEEDUP = 3.0


@contextlib.contextmanager
def running(*command: str) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(
        [sys.executable, "-m", *command], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        yield process
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait(20)


def vehicles(count: int, flavour: str, companion: int, ground: int, speedup: float) -> list[str]:
    command = ["simvehicle.cli.main", "run", "--count", str(count), "--flavour", flavour]
    command += ["--companion-port", str(companion), "--ground-port", str(ground)]
    return [*command, "--speedup", str(speedup), "--ready-after-s", "3"]


class Companion:
    """Flies one vehicle as its agent would, and says so to the swarm until it is killed."""

    def __init__(self, port: int, endpoint: str) -> None:
        self.link = mavutil.mavlink_connection(
            f"udpin:127.0.0.1:{port}", source_system=1, source_component=191
        )
        self.nodes = {
            drone: ZenohTransport(
                "test", drone, [f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"], [endpoint], []
            )
            for drone in (1, 2)
        }
        self.talking = {2}
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._talk)
        self._thread.start()

    def _talk(self) -> None:
        sequence = 0
        while not self._stop.wait(0.1):
            sequence += 1
            for drone in self.talking:
                flies = drone == 1
                state = DroneState(
                    sender=drone,
                    incarnation=drone,
                    sequence=sequence,
                    frame=LocalFrame(ORIGIN).identity,
                    phase=Phase.SEARCHING if flies else Phase.DISARMED,
                    position_ned_m=(0.0, 0.0, -10.0),
                    velocity_ned_mps=None,
                    heading_rad=None,
                    home_ned_m=(0.0, 0.0, 0.0),
                    armed=flies,
                    airborne=flies,
                    mode="GUIDED",
                    battery_fraction=None,
                    co2_ppm=None,
                    excess_co2_ppm=None,
                    wind=None,
                    epoch=0,
                    slot=None,
                    parent=None,
                    healing=False,
                    tracking_best_ppm=None,
                )
                self.nodes[drone].publish(topics.STATE, topics.STATE.codec.encode(state))

    def take_off(self, height_m: float) -> None:
        self._until(lambda m: m.get_type() == "HEARTBEAT", lambda: None)
        guided = (mavlink.MAV_CMD_DO_SET_MODE, 1.0, 4.0)
        self._until(
            lambda m: m.get_type() == "HEARTBEAT" and m.custom_mode == 4, lambda: self._command(*guided)
        )
        arm = (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
        self._until(lambda m: m.get_type() == "HEARTBEAT" and m.base_mode & 128, lambda: self._command(*arm))
        self._command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 33.0, 250_000.0)
        climb = (mavlink.MAV_CMD_NAV_TAKEOFF, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, height_m)
        self._command(*climb)
        high = 800.0 * height_m
        self._until(
            lambda m: m.get_type() == "GLOBAL_POSITION_INT" and m.relative_alt > high, lambda: None, 60.0
        )

    def wait_for(self, condition, seconds: float = 90.0) -> None:
        self._until(condition, lambda: None, seconds)

    def _until(self, condition, ask, seconds: float = 60.0) -> None:
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            ask()
            end = time.monotonic() + 1.0
            while time.monotonic() < end:
                message = self.link.recv_match(blocking=True, timeout=0.2)
                if message is not None and message.get_srcComponent() == 1 and condition(message):
                    return
        raise AssertionError("the vehicle never did it")

    def _command(self, command: int, *parameters: float) -> None:
        padded = (*parameters, *(0.0,) * (7 - len(parameters)))
        self.link.mav.command_long_send(1, 1, command, 0, *padded)

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        for node in self.nodes.values():
            node.close()
        self.link.close()


def test_an_orphan_is_brought_home(tmp_path):
    companion, ground = free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_DGRAM)
    endpoint = f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    config = tmp_path / "ground.yaml"
    config.write_text(
        json.dumps(
            {
                "swarm": {"name": "test", "members": [1, 2], "listen": [endpoint]},
                "origin": msgspec.to_builtins(ORIGIN),
                "mavlink": {"links": [f"udpin:127.0.0.1:{ground}"]},
                "record_to": str(tmp_path / "flights"),
                "speedup": SPEEDUP,
                "orphans": {"grace_s": 10.0},
            }
        )
    )
    with (
        running(*vehicles(1, "ardupilot", companion, ground, SPEEDUP)),
        running("gcs.cli.main", "serve", "--config", str(config)) as station,
        contextlib.closing(Companion(companion, endpoint)) as pilot,
    ):
        pilot.take_off(10.0)
        pilot.talking = {1, 2}
        beats = itertools.count()  # one a simulated second
        pilot.wait_for(lambda m: m.get_type() == "HEARTBEAT" and next(beats) >= 3.0 * SPEEDUP)
        pilot.wait_for(lambda m: m.get_type() == "HEARTBEAT" and m.custom_mode == 4)
        pilot.talking = {2}
        pilot.wait_for(lambda m: m.get_type() == "HEARTBEAT" and m.custom_mode == 6)
        pilot.wait_for(lambda m: m.get_type() == "HEARTBEAT" and not m.base_mode & 128)
        status = subprocess.run(
            [
                sys.executable,
                "-m",
                "gcs.cli.main",
                "status",
                "--config",
                str(config),
                "--json",
                "--seconds",
                "3",
            ],
            capture_output=True,
            text=True,
            timeout=60,
        )
        (row,) = [row for row in json.loads(status.stdout)["drones"] if row["drone"] == 1]
        # The agent fell silent before this command listened, so to it the agent was never heard.
        assert (row["agent"], row["vehicle"], row["mode"], row["armed"]) == ("never", "live", "RTL", False)
        (timeline,) = (tmp_path / "flights").glob("swarm-*.mcap")
        wait_until(lambda: len(actions_of(timeline)) >= 3)
        station.send_signal(signal.SIGTERM)
        assert station.wait(20) == 0
    records = list(read_recording(timeline))
    actions = actions_of(timeline)
    assert "commanded to return" in actions[0]
    assert "is in RTL" in actions[1]
    assert "on the ground" in actions[2]
    assert any(record.topic == "/traffic/ground" for record in records)
    (tlog,) = (tmp_path / "flights").glob("vehicle-1-*.tlog")
    log = mavutil.mavlink_connection(str(tlog))
    kinds = set()
    while (message := log.recv_match()) is not None:
        kinds.add((message.get_srcSystem(), message.get_type()))
    log.close()
    assert {(1, "HEARTBEAT"), (1, "GLOBAL_POSITION_INT"), (255, "COMMAND_LONG"), (1, "COMMAND_ACK")} <= kinds


def actions_of(timeline: pathlib.Path) -> list[str]:
    """What the station has told so far of what it does."""
    return [record.message["text"] for record in read_recording(timeline) if record.topic == "/action"]


def wait_until(condition: Callable[[], object], limit_s: float = 60.0) -> None:
    deadline_s = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < deadline_s, "it never happened"
        time.sleep(0.1)


PLAN = pathlib.Path(__file__).parents[1] / "data" / "plans" / "crater.plan"


@pytest.fixture(scope="module", params=["ardupilot", "px4"])
def link(request) -> Iterator[tuple[str, str]]:
    """The flavour of two simulated vehicles, and the link to talk to them on."""
    companion, ground = free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_DGRAM)
    with running(*vehicles(2, request.param, companion, ground, 1.0)):
        yield request.param, f"udpin:127.0.0.1:{ground}"


def gcs(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "gcs.cli.main", *arguments], capture_output=True, text=True, timeout=90
    )


def test_a_plan_goes_up_and_comes_back(link, tmp_path):
    flavour, text = link
    back = tmp_path / "back.plan"
    done = gcs("plan", "upload", str(PLAN), "--drone", "2", "--link", text, "--json")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert (report["items"], report["rally_points"]) == (3, 1)
    if flavour == "ardupilot":
        assert report["parameters"]["FENCE_ENABLE"] == 1.0
    else:
        assert report["parameters"] == {"GF_ACTION": 3.0}
    done = gcs("plan", "download", str(back), "--drone", "2", "--link", text, "--json")
    assert done.returncode == 0, done.stderr
    checked = json.loads(gcs("plan", "check", str(back), "--json").stdout)
    assert (checked["items"], checked["fence_areas"], checked["rally_points"]) == (3, 2, 1)
    assert checked["errors"] == []
    items = json.loads(back.read_text())["mission"]["items"]
    assert [item["command"] for item in items] == [22, 16, 16]
    assert items[1]["params"][4:6] == pytest.approx([-5.0597, 151.3003], abs=1e-6)


def test_a_fence_is_set_to_act(link):
    flavour, text = link
    done = gcs("fence", "upload", str(PLAN), "--drone", "1", "--link", text, "--action", "land", "--json")
    assert done.returncode == 0, done.stderr
    name, value = ("FENCE_ACTION", 2.0) if flavour == "ardupilot" else ("GF_ACTION", 5.0)
    done = gcs("param", "get", name, "--drone", "1", "--link", text, "--json")
    assert json.loads(done.stdout) == {"drone": 1, "name": name, "value": value}


def test_parameters_are_read_set_and_saved(link, tmp_path):
    flavour, text = link
    name, value = ("RTL_ALT", 2500.0) if flavour == "ardupilot" else ("RTL_RETURN_ALT", 25.0)
    done = gcs("param", "set", name, str(value), "--drone", "1", "--link", text)
    assert (done.returncode, done.stdout) == (0, f"{name} {value:g}\n"), done.stderr
    file = tmp_path / "all.param"
    assert gcs("param", "save", str(file), "--drone", "1", "--link", text).returncode == 0
    saved = dict(line.split() for line in file.read_text().splitlines())
    assert float(saved[name]) == value
    assert len(saved) > 50
    listed = json.loads(
        gcs("param", "list", "--match", "rtl", "--drone", "1", "--link", text, "--json").stdout
    )
    assert listed[name] == value
    assert all("RTL" in other for other in listed)


def test_what_a_vehicle_refuses_is_one_line_and_exit_code_1(link):
    _, text = link
    for arguments, words in (
        (["param", "get", "NO_SUCH_THING", "--drone", "1"], "NO_SUCH_THING"),
        (["param", "list", "--drone", "9"], "drone 9"),
    ):
        done = gcs(*arguments, "--link", text)
        assert done.returncode == 1
        assert done.stdout == ""
        assert len(done.stderr.splitlines()) == 1, done.stderr
        assert words in done.stderr


def test_a_link_that_a_running_station_holds_is_not_shared(link):
    _, text = link
    host, _, port = text.removeprefix("udpin:").rpartition(":")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind((host, int(port)))
        done = gcs("param", "list", "--drone", "1", "--link", text)
    assert done.returncode == 2
    assert text in done.stderr
