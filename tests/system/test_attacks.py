"""Attacks on an encrypted swarm, by processes that have no, another fleet's or a member's certificate."""

from __future__ import annotations

import collections
import contextlib
import json
import pathlib
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator

import psutil
import pytest
import yaml

from flightstack.swarm.topics import COMMAND
from flightstack.swarm.wire import Command, CommandName
from simvehicle.survey.ports import free_ports

pytestmark = pytest.mark.system

HERE = pathlib.Path(__file__).parent
EXAMPLES = HERE.parents[1] / "examples"
PROGRAMS = pathlib.Path(sys.executable).parent
LIMIT_S = 60.0
SWARM = "crater"


class Talker:
    """A process that says a line of JSON a turn, and ends when its input does."""

    def __init__(self, script: str, *arguments: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, str(HERE / script), *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.said: collections.deque[dict[str, object]] = collections.deque(maxlen=20)
        self.ever_heard: set[str] = set()
        self.turns = 0
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            said = json.loads(line)
            self.ever_heard |= set(said["heard"])
            self.said.append(said)
            self.turns += 1

    def last(self, what: str) -> object:
        return self.said[-1][what] if self.said else None

    def memory_bytes(self) -> int:
        return psutil.Process(self._process.pid).memory_info().rss

    def tell(self, line: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()

    def end(self) -> None:
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.close()
        try:
            self._process.wait(20.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join()
        assert self._process.stdout is not None
        self._process.stdout.close()


def run(*words: object, code: int = 0) -> str:
    """What one of our commands says; it must end with `code`."""
    done = subprocess.run(
        [str(PROGRAMS / str(words[0])), *map(str, words[1:])], capture_output=True, text=True, timeout=LIMIT_S
    )
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout + done.stderr


def until(condition: Callable[[], object], what: str) -> None:
    end_s = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < end_s, f"not within {LIMIT_S} s: {what}"
        time.sleep(0.02)


@pytest.fixture(scope="module")
def fleets(tmp_path_factory) -> pathlib.Path:
    """The fleets `own` and `other`, made as a person makes them, then brought to this machine's loopback."""
    directory = tmp_path_factory.mktemp("fleets")
    ports = free_ports(socket.SOCK_STREAM, 3)
    for fleet in ("own", "other"):
        places = ["--drones", "1-3", "--first-address", "127.0.0.2", "--station", "ground=127.0.0.1"]
        run("gcs", "fleet", "init", directory / fleet, "--swarm", SWARM, *places)
        endpoints = [f"tls/127.0.0.1:{port}" for port in ports]
        for name, endpoint in zip(("ground", "drone-1", "drone-2"), endpoints, strict=True):
            file = directory / fleet / name / "swarm.yaml"
            document = yaml.safe_load(file.read_text())
            document["swarm"] |= {"members": [1, 2], "listen": [endpoint], "connect": endpoints}
            file.write_text(yaml.safe_dump(document))
    return directory


@pytest.fixture
def start() -> Iterator[Callable[..., Talker]]:
    with contextlib.ExitStack() as stack:

        def start_one(*arguments: str) -> Talker:
            talker = Talker(*arguments)
            stack.callback(talker.end)
            return talker

        yield start_one


@pytest.fixture
def swarm(fleets, start) -> list[Talker]:
    """The ground station and two drones, each in its own process, who all hear each other."""
    names = {"ground": "ground", "drone-1": "1", "drone-2": "2"}
    nodes = [
        start("zenoh_node.py", node, str(fleets / "own" / name / "swarm.yaml"))
        for name, node in names.items()
    ]
    until(lambda: all_well(nodes), "everybody hears everybody")
    return nodes


def all_well(nodes: list[Talker]) -> bool:
    """Whether everybody has heard everybody else, and nobody but them, in its newest turns."""
    everybody = {"ground", "1", "2"}
    return all(
        len(node.said) == node.said.maxlen
        and set().union(*(set(said["heard"]) for said in node.said)) | {me} == everybody
        and set(node.said[-1]["alive"]) | {me} == everybody
        for me, node in zip(("ground", "1", "2"), nodes, strict=True)
    )


def intruder(
    start: Callable[..., Talker],
    fleets: pathlib.Path,
    certificate: str | None,
    keys: list[str],
    period_s: float = 0.05,
    size: int = 6,
) -> Talker:
    """A process that connects to everybody, with the certificate "FLEET/NAME" or with none."""
    orders = {
        "options": strangers_options(fleets, certificate),
        "listens": f"flightstack/{SWARM}/**",
        "keys": [f"flightstack/{SWARM}/{key}" for key in keys],
        "period_s": period_s,
        "bytes": size,
    }
    return start("intruder.py", json.dumps(orders))


def strangers_options(fleets: pathlib.Path, certificate: str | None) -> dict[str, object]:
    """zenoh's configuration of a node that connects to everybody and is not ours."""
    section = yaml.safe_load((fleets / "own" / "ground" / "swarm.yaml").read_text())["swarm"]
    tls = {
        "root_ca_certificate": str(fleets / "own" / "ground" / "authority.pem"),
        "verify_name_on_connect": False,
    }
    if certificate is not None:
        files = str(fleets / certificate / certificate.partition("/")[2])
        tls |= {
            "enable_mtls": True,
            "connect_private_key": f"{files}.key",
            "connect_certificate": f"{files}.pem",
        }
    return {
        "mode": "peer",
        "listen": {"endpoints": []},
        "connect": {"endpoints": section["connect"], "timeout_ms": -1, "exit_on_failure": False},
        "scouting/multicast/enabled": False,
        "transport/link/tls": tls,
    }


def long_enough(nodes: list[Talker], attacker: Talker) -> None:
    """A hundred turns of everybody: what was to be heard has been heard."""
    goals = [(talker, talker.turns + 100) for talker in (*nodes, attacker)]
    until(lambda: all(talker.turns >= goal for talker, goal in goals), "a hundred turns")


FORGED = [
    "state/1",
    "state/2",
    "state/3",
    "state/*",
    "event/ground",
    "event/1",
    "command/ground",
    "alive/1",
    "**",
]


@pytest.mark.parametrize("certificate", [None, "other/drone-1", "other/ground"])
def test_who_has_no_certificate_of_the_fleet_hears_and_says_nothing(fleets, start, swarm, certificate):
    attacker = intruder(start, fleets, certificate, FORGED)
    until(lambda: attacker.turns, "the attacker talks")
    long_enough(swarm, attacker)
    assert attacker.ever_heard == set()
    assert all_well(swarm)
    assert set().union(*(node.ever_heard for node in swarm)) == {"ground", "1", "2"}
    assert {name for node in swarm for name in node.last("forged")} == set()


@pytest.mark.parametrize("owner", ["drone-1", "ground"])
def test_a_member_that_speaks_in_others_names_is_heard_in_its_own_alone(fleets, start, swarm, owner):
    attacker = intruder(start, fleets, f"own/{owner}", FORGED)
    until(lambda: attacker.last("connected") == 3, "the attacker is connected to everybody")
    long_enough(swarm, attacker)
    assert attacker.ever_heard != set()
    assert all_well(swarm)
    own = owner.removeprefix("drone-")
    assert {name for node in swarm for name in node.last("forged")} == {own}


def test_a_certificate_of_the_fleet_that_is_no_member_hears_and_says_nothing(fleets, start, swarm):
    attacker = intruder(start, fleets, "own/drone-3", FORGED)
    until(lambda: attacker.last("connected") == 3, "the attacker is connected to everybody")
    long_enough(swarm, attacker)
    assert attacker.ever_heard == set()
    assert all_well(swarm)
    assert {name for node in swarm for name in node.last("forged")} == set()


def test_a_member_that_floods_in_its_own_name_takes_nothing_from_the_others(fleets, start, swarm):
    """More than every ring holds, of what is reliable too: the others hear each other, without a gap."""
    attacker = intruder(start, fleets, "own/drone-1", ["state/1", "event/1", "outcome/1"] * 300, 0.0, 20_000)
    until(lambda: attacker.last("connected") == 3, "the attacker is connected to everybody")
    long_enough(swarm, attacker)
    before = [node.memory_bytes() for node in swarm]
    lost = [missing(node) for node in swarm]
    long_enough(swarm, attacker)
    assert all_well(swarm)
    assert {name for node in swarm for name in node.last("forged")} == {"1"}
    assert [missing(node) for node in swarm] == lost
    assert all(
        node.memory_bytes() - start_bytes < 100e6 for node, start_bytes in zip(swarm, before, strict=True)
    )


def missing(node: Talker) -> dict[str, int]:
    """Events that never came, of those whose names are not flooded."""
    return {name: count for name, count in dict(node.last("missing")).items() if name != "1"}


def test_a_flood_in_others_names_stops_nobody(fleets, start, swarm):
    attacker = intruder(start, fleets, "own/drone-1", ["state/2", "state/ground", "event/2"] * 100, 0.0)
    until(lambda: attacker.last("connected") == 3, "the attacker is connected to everybody")
    long_enough(swarm, attacker)
    assert all_well(swarm)
    assert {name for node in swarm for name in node.last("forged")} == set()


@pytest.fixture
def agent(fleets, tmp_path) -> Iterator[pathlib.Path]:
    """Drone 1 with its own certificate, on no vehicle; its log."""
    document = yaml.safe_load((EXAMPLES / "drone.yaml").read_text())
    document |= yaml.safe_load((fleets / "own" / "drone-1" / "swarm.yaml").read_text())
    port = free_ports(socket.SOCK_DGRAM, 1)[0]
    document |= {
        "autopilot": {"link": f"udpin:127.0.0.1:{port}", "answer_timeout_s": 900.0},
        "instruments": [],
        "record_to": str(tmp_path / "flights"),
    }
    file, log = fleets / "own" / "drone-1" / "drone.yaml", tmp_path / "agent.log"
    file.write_text(yaml.safe_dump(document))
    with log.open("wb") as output:
        process = subprocess.Popen(
            [str(PROGRAMS / "flightstack"), "run", "--config", str(file)], stdout=output, stderr=output
        )
    try:
        until(
            lambda: "ready: autopilot on" in log.read_text() or process.poll() is not None, "the agent runs"
        )
        assert process.poll() is None, log.read_text()
        yield log
    finally:
        process.terminate()
        process.wait(20.0)


def order(identity: str, start: int, number: int) -> tuple[str, str]:
    """A command as a station's program says it: to hold, which a drone on the ground refuses."""
    said = Command(identity, "ground-tool", 1, CommandName.PAUSE, incarnation=start, sequence=number)
    return f"flightstack/{SWARM}/command/ground-tool", COMMAND.codec.encode(said).hex()


def test_commands_that_were_recorded_are_not_obeyed_again(fleets, start, agent):
    """Even with a station's certificate, and after more of them than a drone remembers by their identity."""
    recorded = [order(f"c{number}", 1000, number) for number in range(1, 101)]
    older = [order("older", 999, 1000)]
    orders = {
        "options": strangers_options(fleets, "own/ground"),
        "listens": f"flightstack/{SWARM}/outcome/1",
        "rounds": [[order("first", 1000, 0)], recorded, recorded + older, [order("last", 1000, 101)]],
    }
    attacker = start("replayer.py", json.dumps(orders))
    until(lambda: attacker.last("connected") == 1, "the attacker is connected")

    def answers() -> dict[str, int]:
        return dict(attacker.last("answers"))

    attacker.tell("first")
    until(lambda: answers().get("first") == 1, "it is heard")
    attacker.tell("say")
    until(lambda: attacker.last("said") == 101, "all is said")
    until(lambda: len(answers()) == 101, "everything is answered")
    attacker.tell("say it again")
    until(lambda: attacker.last("said") == 202, "all is said again")
    attacker.tell("something new")
    until(lambda: answers().get("last") == 1, "what is new is answered")
    assert set(answers().values()) == {1}
    assert "older" not in answers()
    assert agent.read_text().count("it was started before the one that was heard") == 1


def damaged(fleets: pathlib.Path, how: str, name: str) -> tuple[pathlib.Path, str]:
    """A node's configuration file whose certificates are no good, and what must be said of them."""
    bundle, other = fleets / "own" / name, fleets / "other" / name
    example = "ground.yaml" if name == "ground" else "drone.yaml"
    document = yaml.safe_load((EXAMPLES / example).read_text())
    document |= yaml.safe_load((bundle / "swarm.yaml").read_text())
    tls = document["swarm"]["tls"]
    if how == "of another fleet":
        tls |= {"certificate": str(other / f"{name}.pem"), "private_key": str(other / f"{name}.key")}
        text = "is not signed by the authority in"
    elif how == "key of another":
        tls["private_key"] = str(other / f"{name}.key")
        text = "does not belong to the certificate in"
    elif how == "expired":
        files = _expired(fleets, name)
        tls |= {field: str(files / file) for field, file in _FILES.items()}
        text = "has expired on"
    else:
        tls["private_key"] = str(bundle)
        text = "cannot read"
    file = bundle / f"{how.replace(' ', '-')}.yaml"
    file.write_text(yaml.safe_dump(document))
    return file, text


_FILES = {"authority": "authority.pem", "certificate": "node.pem", "private_key": "node.key"}


def _expired(fleets: pathlib.Path, name: str) -> pathlib.Path:
    import datetime

    from gcs.keys.authority import new_authority, sign

    directory = fleets / f"expired-{name}"
    directory.mkdir(exist_ok=True)
    begun = datetime.datetime.now(datetime.UTC) - datetime.timedelta(days=10)
    authority = new_authority(SWARM, begun)
    pair = sign(authority, name, begun, datetime.timedelta(days=9))
    (directory / "authority.pem").write_bytes(authority.certificate)
    (directory / "node.pem").write_bytes(pair.certificate)
    (directory / "node.key").write_bytes(pair.private_key)
    return directory


@pytest.mark.parametrize("how", ["of another fleet", "key of another", "expired", "unreadable"])
@pytest.mark.parametrize(
    ("program", "name"),
    [("flightstack check", "drone-1"), ("flightstack run", "drone-1"), ("gcs serve", "ground")],
)
def test_certificates_that_nobody_would_believe_are_one_line_before_take_off(fleets, how, program, name):
    file, text = damaged(fleets, how, name)
    said = run(*program.split(), "--config", file, code=2)
    assert text in said
    assert "swarm.tls" in said
    assert len(said.strip().splitlines()) == 1
