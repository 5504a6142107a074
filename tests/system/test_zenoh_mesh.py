"""Zenoh nodes in processes of their own: a mesh from one endpoint, and what dead, hung and late peers do to it."""

from __future__ import annotations

import collections
import contextlib
import json
import pathlib
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence

import pytest

from simvehicle.survey.ports import free_port

pytestmark = pytest.mark.system

NODE = pathlib.Path(__file__).with_name("zenoh_node.py")
LIMIT_S = 60.0


class NodeProcess:
    """A node and the last things that it said."""

    def __init__(self, name: str, listen: str, connect: Sequence[str], wrap: Sequence[str] = ()) -> None:
        self.name = name
        self._process = subprocess.Popen(
            [*wrap, sys.executable, str(NODE), name, listen, ",".join(connect)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.said: collections.deque[dict[str, list[str]]] = collections.deque(maxlen=10)
        self.ticks = 0
        self.longest_silence: collections.Counter[str] = collections.Counter()
        """By peer: how many ticks in a row it was not heard."""
        self._silence: collections.Counter[str] = collections.Counter()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            said = json.loads(line)
            for name in {*self._silence, *said["heard"]}:
                self._silence[name] = 0 if name in said["heard"] else self._silence[name] + 1
                self.longest_silence[name] = max(self.longest_silence[name], self._silence[name])
            self.said.append(said)
            self.ticks += 1

    def hears(self, names: set[str]) -> bool:
        """Whether it has heard exactly `names` in its last ticks."""
        said = list(self.said)
        return len(said) == self.said.maxlen and set().union(*(set(s["heard"]) for s in said)) == names

    def alive(self) -> set[str]:
        return set(self.said[-1]["alive"]) if self.said else set()

    def send(self, number: signal.Signals) -> None:
        self._process.send_signal(number)

    def end(self) -> int:
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGCONT)
            assert self._process.stdin is not None
            with contextlib.suppress(BrokenPipeError):
                self._process.stdin.write("end\n")
                self._process.stdin.close()
            try:
                self._process.wait(20.0)
            except subprocess.TimeoutExpired:
                self._process.kill()
        code = self._process.wait()
        self._reader.join()
        for stream in (self._process.stdin, self._process.stdout):
            with contextlib.suppress(BrokenPipeError):
                stream.close()
        return code


Start = Callable[..., NodeProcess]


@pytest.fixture
def start() -> Iterator[Start]:
    with contextlib.ExitStack() as stack:

        def start_one(name: str, listen: str, connect: Sequence[str] = ()) -> NodeProcess:
            node = NodeProcess(name, listen, connect)
            stack.callback(node.end)
            return node

        yield start_one


def until(condition: Callable[[], object], what: str) -> None:
    end_s = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < end_s, f"not within {LIMIT_S} s: {what}"
        time.sleep(0.02)


def whole_mesh(nodes: Sequence[NodeProcess]) -> bool:
    names = {node.name for node in nodes}
    return all(node.hears(names - {node.name}) and node.alive() == names - {node.name} for node in nodes)


def test_one_known_endpoint_makes_a_full_mesh_that_survives_its_loss(start):
    seed = f"tcp/127.0.0.1:{free_port()}"
    nodes = [start("ground", seed)]
    nodes += [start(str(n), f"tcp/127.0.0.1:{free_port()}", [seed]) for n in range(1, 5)]
    until(lambda: whole_mesh(nodes), "everybody hears everybody")
    nodes[0].send(signal.SIGKILL)
    until(lambda: whole_mesh(nodes[1:]), "the others go on without the first")


def test_a_killed_node_is_missed_and_its_successor_is_heard(start):
    endpoints = [f"tcp/127.0.0.1:{free_port()}" for _ in range(3)]
    nodes = [start(str(n), endpoint, endpoints) for n, endpoint in enumerate(endpoints)]
    until(lambda: whole_mesh(nodes), "everybody hears everybody")
    nodes[2].send(signal.SIGKILL)
    until(lambda: whole_mesh(nodes[:2]), "the dead one is gone")
    nodes[2] = start("2", endpoints[2], endpoints)
    until(lambda: whole_mesh(nodes), "its successor is heard")


def test_a_hung_node_is_missed_holds_nobody_up_and_comes_back(start):
    endpoints = [f"tcp/127.0.0.1:{free_port()}" for _ in range(3)]
    nodes = [start(str(n), endpoint, endpoints) for n, endpoint in enumerate(endpoints)]
    until(lambda: whole_mesh(nodes), "everybody hears everybody")
    nodes[2].send(signal.SIGSTOP)
    until(lambda: whole_mesh(nodes[:2]), "the lease ran out, the others hear each other")
    nodes[2].send(signal.SIGCONT)
    until(lambda: whole_mesh(nodes), "everybody is back")


def test_a_node_waits_for_peers_that_are_not_there_yet(start):
    endpoints = [f"tcp/127.0.0.1:{free_port()}" for _ in range(2)]
    first = start("1", endpoints[0], [endpoints[1], "tcp/no-such-host.invalid:7447", "tcp/192.0.2.1:7447"])
    until(lambda: first.ticks > 10, "it ticks alone")
    second = start("2", endpoints[1])
    until(lambda: whole_mesh([first, second]), "they found each other")
    assert first.end() == 0
    assert second.end() == 0
