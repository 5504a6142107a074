"""Every instrument behind a real port, read by the real command: pyserial over a socket and over a
pseudo-terminal."""

from __future__ import annotations

import contextlib
import functools
import json
import os
import pty
import select
import socket
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from sensors.instruments.registry import INSTRUMENTS
from sensors.instruments.samples import Quantity
from simvehicle.instruments import EMULATORS, Air, Emulator, make_emulator

pytestmark = pytest.mark.system

AIR = Air(co2_ppm=642.0, wind_body_mps=(3.0, -4.0, 0.0))


def emulate(
    emulator: Emulator, receive: Callable[[], bytes], send: Callable[[bytes], object], end: threading.Event
) -> None:
    """Play an instrument until it is unplugged."""
    began = time.monotonic()
    while not end.is_set():
        now_s = time.monotonic() - began
        try:
            emulator.receive(now_s, receive())
            send(emulator.step(now_s, AIR))
        except OSError:
            return
        end.wait(0.02)


@contextlib.contextmanager
def on_socket(kind: str) -> Iterator[str]:
    """The instrument behind socket://, one caller at a time."""
    end = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(0.1)

        def serve() -> None:
            emulator = make_emulator(kind, np.random.default_rng(3))
            while not end.is_set():
                try:
                    peer, _ = server.accept()
                except TimeoutError:
                    continue
                with peer:
                    peer.setblocking(False)
                    emulate(emulator, functools.partial(_received, peer), peer.sendall, end)

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield f"socket://127.0.0.1:{server.getsockname()[1]}"
        finally:
            end.set()
            thread.join()


def _received(peer: socket.socket) -> bytes:
    try:
        data = peer.recv(4096)
    except BlockingIOError:
        return b""
    if not data:
        raise ConnectionResetError
    return data


@contextlib.contextmanager
def on_terminal(kind: str) -> Iterator[str]:
    """The instrument behind a pseudo-terminal, which pyserial opens as a serial device."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    end = threading.Event()

    def receive() -> bytes:
        ready, _, _ = select.select([master], [], [], 0)
        return os.read(master, 4096) if ready else b""

    emulator = make_emulator(kind, np.random.default_rng(3))
    thread = threading.Thread(target=emulate, args=(emulator, receive, lambda b: os.write(master, b), end))
    thread.start()
    try:
        yield os.ttyname(slave)
    finally:
        end.set()
        thread.join()
        os.close(slave)
        os.close(master)


def flightstack(*arguments: str, timeout_s: float = 90.0) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "flightstack.cli", "sensors", *arguments],
        capture_output=True,
        text=True,
        timeout=timeout_s,
        stdin=subprocess.DEVNULL,
    )


def entries(text: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in text.splitlines()]


@pytest.mark.parametrize("place", [on_socket, on_terminal])
@pytest.mark.parametrize("kind", EMULATORS)
def test_read_shows_what_the_instrument_says(kind: str, place: Callable[[str], Any]) -> None:
    with place(kind) as port:
        result = flightstack("read", "--port", port, "--type", kind, "--seconds", "3", "--json")
    assert result.returncode == 0, result.stderr
    found = entries(result.stdout)
    measured = [entry for entry in found if entry["state"] == "measuring"]
    assert measured, found
    if INSTRUMENTS[kind].quantity is Quantity.CO2:
        assert np.mean([m["co2_ppm"] for m in measured]) == pytest.approx(642.0, abs=60.0)
    else:
        forward, right, _ = np.mean([m["wind_body_mps"] for m in measured], axis=0)
        assert (forward, right) == pytest.approx((3.0, -4.0), abs=0.8)


@pytest.mark.parametrize("kind", ["sba5", "windsonic"])
def test_doctor_finds_who_answers(kind: str) -> None:
    with on_terminal(kind) as port:
        result = flightstack("doctor", "--port", port, "--seconds", "1.5", "--json")
    assert result.returncode == 0, result.stdout + result.stderr
    (found,) = entries(result.stdout)
    assert found["type"] == kind
    assert found["baud"] is not None


def test_doctor_says_that_a_silent_port_is_silent() -> None:
    master, slave = pty.openpty()
    try:
        port = os.ttyname(slave)
        result = flightstack("doctor", "--port", port, "--seconds", "0.3", "--json")
    finally:
        os.close(slave)
        os.close(master)
    assert result.returncode == 1
    (found,) = entries(result.stdout)
    assert (found["type"], "silent" in found["detail"]) == (None, True)


def test_a_port_that_is_absent_ends_with_one_line() -> None:
    result = flightstack("read", "--port", "/dev/no-such-tty", "--type", "sba5", "--seconds", "1", "--json")
    assert result.returncode == 1
    assert "no such device" in result.stderr
    assert "Traceback" not in result.stderr
    assert all(entry["state"] == "silent" for entry in entries(result.stdout))


def test_a_mistyped_type_ends_with_one_line_and_2() -> None:
    result = flightstack("read", "--port", "/dev/null", "--type", "sba6")
    assert result.returncode == 2
    assert result.stderr.count("\n") == 1
    assert "did you mean sba5" in result.stderr


def test_unplugging_and_replugging_while_reading() -> None:
    """A reader outlives the instrument, says that it is gone, and reads on when it is back on the same
    port."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(60.0)
        port = f"socket://127.0.0.1:{server.getsockname()[1]}"
        command = [sys.executable, "-m", "flightstack.cli", "sensors"]
        reader = subprocess.Popen(
            [*command, "read", "--port", port, "--type", "windsonic", "--json"],
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            assert reader.stdout is not None
            for _ in range(2):
                peer, _ = server.accept()
                end = threading.Event()
                emulator = make_emulator("windsonic", np.random.default_rng(3))
                wind = threading.Thread(target=emulate, args=(emulator, bytes, peer.sendall, end))
                wind.start()
                assert json.loads(reader.stdout.readline())["state"] == "measuring"
                end.set()
                wind.join()
                peer.close()
                said = json.loads(reader.stdout.readline())
                while said["state"] == "measuring":
                    said = json.loads(reader.stdout.readline())
                assert (said["state"], "closed the connection" in said["reason"]) == ("silent", True)
        finally:
            reader.kill()
            reader.wait()
            if reader.stdout is not None:
                reader.stdout.close()
