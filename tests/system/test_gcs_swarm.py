"""The operator's commands as processes, on a real network, against stand-ins for the agents."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator

import msgspec
import pytest

from flightstack.swarm import topics
from flightstack.swarm.wire import Command, CommandOutcome, DroneState, Phase, Result
from flightstack.transport.zenoh_transport import ZenohTransport
from mission.estimation.estimates import Scalar, Wind
from mission.geometry.frames import Geodetic, LocalFrame
from simvehicle.survey.ports import free_port

pytestmark = pytest.mark.system

ORIGIN = Geodetic(-5.06, 151.3, 500.0)
FRAME = LocalFrame(ORIGIN)


class StandIns:
    """Agents that say they fly, and answer commands, from one thread."""

    def __init__(self, drones: tuple[int, ...], ground: str, refusing: tuple[int, ...] = ()) -> None:
        self.heard: list[tuple[int, Command]] = []
        self.silent: set[int] = set()
        self._refusing = refusing
        self._nodes = {
            drone: ZenohTransport(
                "test", drone, [f"tcp/127.0.0.1:{free_port()}"], [ground], [topics.COMMAND], None
            )
            for drone in drones
        }
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        sequence = 0
        while not self._stop.wait(0.1):
            sequence += 1
            for drone, node in self._nodes.items():
                for received in node.receive():
                    command = topics.COMMAND.codec.decode(received.payload)
                    if command.target in (0, drone) and drone not in self.silent:
                        self.heard.append((drone, command))
                        refused = drone in self._refusing
                        outcome = CommandOutcome(
                            command.identity,
                            drone,
                            Result.REFUSED if refused else Result.ACCEPTED,
                            "not ready: zeroing" if refused else "",
                        )
                        node.publish(topics.OUTCOME, topics.OUTCOME.codec.encode(outcome))
                if drone not in self.silent:
                    node.publish(topics.STATE, topics.STATE.codec.encode(self._state(drone, sequence)))

    def _state(self, drone: int, sequence: int) -> DroneState:
        return DroneState(
            sender=drone,
            incarnation=drone,
            sequence=sequence,
            frame=FRAME.identity,
            phase=Phase.SEARCHING,
            position_ned_m=(10.0 * drone, 0.0, -10.0 - drone),
            velocity_ned_mps=(0.0, 0.0, 0.0),
            heading_rad=0.0,
            home_ned_m=(0.0, 0.0, 0.0),
            armed=True,
            airborne=True,
            mode="GUIDED",
            battery_fraction=0.2 if drone == 2 else 0.9,
            co2_ppm=460.0,
            excess_co2_ppm=Scalar(40.0 + drone, 4.0, 0.1),
            wind=Wind((-3.0, 0.0, 0.0), 0.2, 0.1),
            epoch=2,
            slot=drone - 1,
            parent=None if drone == 1 else 1,
            healing=False,
            tracking_best_ppm=50.0,
            ticks=sequence,
        )

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        for node in self._nodes.values():
            node.close()


@pytest.fixture
def site(tmp_path):
    """A ground.yaml for three members, with the ground station's endpoint."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    config = {
        "swarm": {"name": "test", "members": [1, 2, 3], "listen": [endpoint]},
        "origin": msgspec.to_builtins(ORIGIN),
        "record_to": str(tmp_path / "flights"),
    }
    path = tmp_path / "ground.yaml"
    path.write_text(json.dumps(config))
    return path, endpoint


@contextlib.contextmanager
def serving(path) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        [sys.executable, "-m", "gcs.cli.main", "serve", "--config", str(path)],
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
        process.communicate(timeout=20)


@contextlib.contextmanager
def agents(endpoint, drones=(1, 2, 3), refusing=()) -> Iterator[StandIns]:
    swarm = StandIns(drones, endpoint, refusing)
    try:
        yield swarm
    finally:
        swarm.close()


def gcs(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "gcs.cli.main", *arguments], capture_output=True, text=True, timeout=60
    )


def test_a_command_that_everybody_accepts(site):
    path, endpoint = site
    with serving(path), agents(endpoint) as swarm:
        done = gcs("survey", "start", "--config", str(path), "--deadline", "15")
        assert done.returncode == 0, done.stderr
        assert done.stdout.splitlines() == [f"drone {n}: accepted" for n in (1, 2, 3)]
        identities = {command.identity for _, command in swarm.heard}
        assert len(identities) == 1
        assert {command.name for _, command in swarm.heard} == {"start"}


def test_refusals_silence_and_absence_are_told_apart(site):
    path, endpoint = site
    with serving(path), agents(endpoint, drones=(1, 2), refusing=(2,)):
        done = gcs("survey", "pause", "--config", str(path), "--deadline", "15", "--json")
        assert done.returncode == 1
        report = json.loads(done.stdout)
        assert report["accepted"] is False
        assert [(d["drone"], d["result"]) for d in report["drones"]] == [
            (1, "accepted"),
            (2, "refused"),
            (3, "not heard"),
        ]
        assert report["drones"][1]["reason"] == "not ready: zeroing"


def test_one_drone_by_name_without_a_file(site):
    path, endpoint = site
    with serving(path), agents(endpoint) as swarm:
        done = gcs(
            "survey", "land", "--drone", "2", "--swarm", "test", "--connect", endpoint, "--deadline", "15"
        )
        assert done.returncode == 0, done.stderr
        assert done.stdout == "drone 2: accepted\n"
        assert {drone for drone, _ in swarm.heard} == {2}


def test_status_reports_everybody(site):
    path, endpoint = site
    with serving(path), agents(endpoint):
        done = gcs("status", "--config", str(path), "--seconds", "4", "--json")
        assert done.returncode == 0, done.stderr
        report = json.loads(done.stdout)
        assert report["station"] == "ground"
        assert [d["drone"] for d in report["drones"]] == [1, 2, 3]
        one = report["drones"][0]
        assert (one["agent"], one["phase"], one["mode"], one["slot"]) == ("live", "searching", "GUIDED", 0)
        where = FRAME.to_geodetic((10.0, 0.0, -11.0))
        assert one["latitude_deg"] == pytest.approx(where.latitude_deg, abs=1e-9)
        assert one["above_home_m"] == pytest.approx(11.0)
        assert one["excess_co2_ppm"] == pytest.approx(41.0)
        assert one["wind_from_deg"] == pytest.approx(0.0)
        assert one["agent_age_s"] < 2.0
        text = gcs("status", "--config", str(path), "--seconds", "4").stdout
        assert "3 of 3 live" in text
        assert "WARN battery" in text


def test_status_when_nobody_is_there(site):
    done = gcs("status", "--swarm", "test", "--connect", site[1], "--seconds", "0.5")
    assert done.returncode == 1
    assert "no drone heard" in done.stderr


def test_the_station_records_the_swarm_and_ends_cleanly(site, tmp_path):
    from flightstack.recording.recorder import read_recording

    path, endpoint = site
    with serving(path) as station, agents(endpoint):
        assert gcs("survey", "pause", "--config", str(path), "--deadline", "15").returncode == 0
        station.send_signal(signal.SIGINT)
        _, log = station.communicate(timeout=20)
    assert station.returncode == 0
    assert "stopped" in log
    assert "Traceback" not in log
    (timeline,) = (tmp_path / "flights").glob("swarm-*.mcap")
    heard = {record.topic for record in read_recording(timeline)}
    assert {"/config", "/state/1", "/state/2", "/state/3", "/outcome/1", "/outcome/3"} <= heard
    assert any(topic.startswith("/command/") for topic in heard)


def test_watch_draws_the_swarm_and_ends_with_ctrl_c(site, open_terminal):
    path, endpoint = site
    with serving(path), agents(endpoint) as swarm:
        terminal = open_terminal(sys.executable, "-m", "gcs.cli.main", "watch", "--config", str(path))
        frame = terminal.wait_for("3 of 3 live")
        assert len(frame) <= 24
        assert max(map(len, frame)) <= 80
        (row,) = [line for line in frame if re.match(r"  3 [A-Z]", line)]
        for word in ("LIVE", "searching", "GUIDED", "13.0", "43", "3.0/000", "90%", "2<1"):
            assert word in row.split(), word
        swarm.silent.add(3)
        frame = terminal.wait_for("CRIT lost")
        (row,) = [line for line in frame if re.match(r"  3 [A-Z]", line)]
        assert "SILENT" in row
        os.killpg(terminal.process.pid, signal.SIGINT)
        assert terminal.finish() == 0
        assert b"Traceback" not in terminal.output
        assert b"\x1b[?25h" in terminal.output, "the cursor is given back"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["status"], "which swarm?"),
        (["status", "--swarm", "x"], "--connect"),
        (["status", "--swarm", "x", "--connect", "nonsense"], "endpoint"),
        (["survey", "start", "--config", "/absent/ground.yaml"], "cannot be read"),
        (["serve", "--config", "/absent/ground.yaml"], "cannot be read"),
        (["watch", "--swarm", "x", "--connect", "tcp/127.0.0.1:1"], "needs a terminal"),
        (["plan", "check", "/absent/x.plan"], "cannot be read"),
        (["param", "list", "--drone", "1"], "which link?"),
        (["param", "list", "--drone", "1", "--link", "nonsense"], "nonsense"),
        (["param", "list", "--drone", "1", "--link", "/dev/absent,57600"], "/dev/absent"),
    ],
)
def test_what_a_user_gets_wrong_is_one_line_and_exit_code_2(arguments, words):
    done = gcs(*arguments)
    assert done.returncode == 2, done.stderr
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert words in done.stderr


def test_a_station_whose_link_is_taken_says_so_and_leaves_nothing_open(site):
    path, _ = site
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        link = f"udpin:127.0.0.1:{taken.getsockname()[1]}"
        config = json.loads(path.read_text()) | {"mavlink": {"links": [link]}}
        path.write_text(json.dumps(config))
        done = gcs("serve", "--config", str(path))
    assert done.returncode == 2
    assert link in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("record_to", "/dev/null/flights", "record_to"),
        ("mavlink", {"links": ["udp:127.0.0.1:1"]}, "udpin"),
        ("plan", "absent.plan", "absent.plan"),
    ],
)
def test_a_station_that_cannot_start_says_why(site, field, value, words):
    path, _ = site
    path.write_text(json.dumps(json.loads(path.read_text()) | {field: value}))
    done = gcs("serve", "--config", str(path))
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert words in done.stderr


def test_two_stations_on_one_endpoint(site):
    path, endpoint = site
    with socket.socket() as taken:
        host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
        taken.bind((host, int(port)))
        taken.listen()
        done = gcs("serve", "--config", str(path))
    assert done.returncode == 2
    assert endpoint in done.stderr
