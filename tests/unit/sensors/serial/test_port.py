"""The serial shell: absent ports, back-off, unplugging and replugging, on real sockets and
pseudo-terminals."""

from __future__ import annotations

import contextlib
import os
import pty
import socket
import threading
import time
import tty
from collections.abc import Iterator

import pytest
import serial

from sensors.instruments.registry import make_instrument
from sensors.instruments.samples import InstrumentState
from sensors.instruments.sensor_error import SensorError
from sensors.serial.attached import AttachedInstrument
from sensors.serial.port import InstrumentPort, plain_reason

PATIENCE_S = 10.0


class Clock:
    def __init__(self) -> None:
        self.time_s = 0.0

    def now_s(self) -> float:
        return self.time_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(PATIENCE_S)
        yield server


@contextlib.contextmanager
def opened(port: str, clock: Clock) -> Iterator[InstrumentPort]:
    it = InstrumentPort(port, 9600, clock.now_s)
    try:
        yield it
    finally:
        it.close()


def url(server: socket.socket) -> str:
    return f"socket://127.0.0.1:{server.getsockname()[1]}"


def outcome(port: InstrumentPort) -> tuple[bool, str]:
    """The next thing that happens to the connection; opening runs in a thread of its own."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        port.read()
        for event in port.events():
            return event.connected, event.reason
        time.sleep(0.005)
    raise AssertionError("nothing happened to the port")


def received(port: InstrumentPort, wanted: bytes) -> bytes:
    data, deadline = b"", time.monotonic() + PATIENCE_S
    while wanted not in data and time.monotonic() < deadline:
        data += port.read()
        time.sleep(0.005)
    return data


def test_an_absent_port_is_a_state_and_is_tried_again_ever_less_often(clock: Clock, tmp_path: object) -> None:
    with opened(f"{tmp_path}/nothing", clock) as port:
        assert port.read() == b""
        port.write(b"into the void")
        for wait_s in (0.5, 1.0, 2.0, 4.0, 5.0, 5.0):
            connected, reason = outcome(port)
            assert not connected
            assert "no such device" in reason
            clock.time_s += wait_s - 0.01
            assert port.read() == b""
            assert port.events() == []
            clock.time_s += 0.02


def test_bytes_go_both_ways_over_a_socket(clock: Clock, listener: socket.socket) -> None:
    with opened(url(listener), clock) as port:
        port.read()
        peer, _ = listener.accept()
        with peer:
            peer.settimeout(PATIENCE_S)
            assert outcome(port) == (True, "")
            port.write(b"M")
            assert peer.recv(10) == b"M"
            peer.sendall(b"W,50.0\r\n")
            assert received(port, b"\n") == b"W,50.0\r\n"


def test_one_write_that_takes_too_long_is_no_loss_and_three_in_a_row_are(
    clock: Clock, listener: socket.socket
) -> None:
    with opened(url(listener), clock) as port:
        port.read()
        peer, _ = listener.accept()
        with peer:
            assert outcome(port) == (True, "")
            flood = bytes(16 << 20)  # more than the buffers of a connection hold
            port.write(flood)
            port.write(flood)
            assert port.connected
            port.write(flood)
            assert not port.connected
            assert outcome(port)[0] is False


def test_a_lost_connection_is_told_and_made_again(clock: Clock, listener: socket.socket) -> None:
    with opened(url(listener), clock) as port:
        port.read()
        first, _ = listener.accept()
        assert outcome(port) == (True, "")
        first.close()
        connected, reason = outcome(port)
        assert (connected, "closed the connection" in reason) == (False, True)
        assert not port.connected
        clock.time_s += 0.6
        port.read()
        second, _ = listener.accept()
        with second:
            assert outcome(port) == (True, "")
            second.sendall(b"again")
            assert received(port, b"again") == b"again"


def test_a_pseudo_terminal_that_is_unplugged(clock: Clock) -> None:
    master, slave = pty.openpty()
    tty.setraw(slave)
    name = os.ttyname(slave)
    with opened(name, clock) as port:
        assert outcome(port) == (True, "")
        os.write(master, b"Z,1 of 25\r\n")
        assert received(port, b"\n") == b"Z,1 of 25\r\n"
        port.write(b"M")
        assert os.read(master, 10) == b"M"
        os.close(slave)
        os.close(master)
        connected, reason = outcome(port)
        assert not connected
        assert name in reason


def test_a_second_reader_of_a_serial_port_is_refused(clock: Clock) -> None:
    master, slave = pty.openpty()
    try:
        with opened(os.ttyname(slave), clock) as one, opened(os.ttyname(slave), clock) as two:
            assert outcome(one) == (True, "")
            connected, reason = outcome(two)
            assert not connected
            assert "another process has it open" in reason
    finally:
        os.close(master)
        os.close(slave)


def test_an_attached_instrument_starts_over_after_replugging(clock: Clock, listener: socket.socket) -> None:
    with opened(url(listener), clock) as port:
        attached = AttachedInstrument(make_instrument("sba5"), port)
        attached.step(clock.now_s())
        peer, _ = listener.accept()
        peer.settimeout(PATIENCE_S)
        deadline = time.monotonic() + PATIENCE_S
        while not port.connected and time.monotonic() < deadline:
            attached.step(clock.now_s())
            time.sleep(0.005)
        assert peer.recv(100).startswith(b"!C2\rP1\rA120\r")
        peer.close()
        samples = []
        while not samples and time.monotonic() < deadline:
            samples = attached.step(clock.now_s())
            time.sleep(0.005)
        assert samples[-1].state is InstrumentState.SILENT
        assert "closed the connection" in samples[-1].reason
        clock.time_s += 1.0
        attached.step(clock.now_s())
        again, _ = listener.accept()
        with again:
            again.settimeout(PATIENCE_S)
            while not port.connected and time.monotonic() < deadline:
                attached.step(clock.now_s())
                time.sleep(0.005)
            assert again.recv(100).startswith(b"!C2\r")


@pytest.mark.parametrize(
    ("port", "baud", "words"),
    [
        ("socket://127.0.0.1", 9600, "write it as socket://HOST:PORT"),
        ("socket://:x", 9600, "write it as socket://HOST:PORT"),
        ("carrier-pigeon://loft", 9600, "carrier-pigeon"),
        ("/dev/ttyUSB0", 0, "baud rate 0 is not positive"),
    ],
)
def test_what_can_never_be_opened_is_refused_at_once(port: str, baud: int, words: str, clock: Clock) -> None:
    with pytest.raises(SensorError, match=words):
        InstrumentPort(port, baud, clock.now_s)


def test_reasons_are_plain() -> None:
    assert "dialout" in plain_reason(OSError(13, "Permission denied"))
    assert plain_reason(OSError("something odd\nsecond line")) == "something odd"


class SlowDevice:
    """A pseudo-terminal whose opening lasts until the test lets it."""

    def __init__(self) -> None:
        self.master, self.slave = pty.openpty()
        tty.setraw(self.slave)
        self.may_open = threading.Event()
        self.begun = threading.Event()
        self.attempts = 0

    def open(self, port: str, baud: int) -> serial.Serial:
        self.attempts += 1
        self.begun.set()
        assert self.may_open.wait(PATIENCE_S)
        return serial.Serial(port, baud, timeout=0, write_timeout=0.05)

    def close(self) -> None:
        os.close(self.slave)
        os.close(self.master)


@pytest.fixture
def slow() -> Iterator[SlowDevice]:
    device = SlowDevice()
    yield device
    device.may_open.set()
    device.close()


def test_no_tick_waits_for_a_device_that_is_slow_to_open(clock: Clock, slow: SlowDevice) -> None:
    port = InstrumentPort(os.ttyname(slow.slave), 9600, clock.now_s, slow.open)
    try:
        port.read()
        assert slow.begun.wait(PATIENCE_S)
        for _ in range(100):  # ten seconds of ticks, all of them while it is being opened
            clock.time_s += 0.1
            assert port.read() == b""
            port.write(b"M")
        assert (slow.attempts, port.events(), port.connected) == (1, [], False)
        slow.may_open.set()
        assert outcome(port) == (True, "")
        os.write(slow.master, b"W,50.0\r\n")
        assert received(port, b"\n") == b"W,50.0\r\n"
    finally:
        port.close()


def test_a_port_that_is_closed_while_it_opens_leaves_nothing_open(clock: Clock, slow: SlowDevice) -> None:
    name = os.ttyname(slow.slave)
    port = InstrumentPort(name, 9600, clock.now_s, slow.open)
    port.read()
    assert slow.begun.wait(PATIENCE_S)
    slow.may_open.set()
    port.close()
    assert [thread for thread in threading.enumerate() if name in thread.name] == []
    assert sorted(opened_files(name)) == [slow.slave]


def opened_files(name: str) -> list[int]:
    """This process' descriptors of a device."""
    found = []
    for number in os.listdir("/proc/self/fd"):
        with contextlib.suppress(OSError):
            if os.readlink(f"/proc/self/fd/{number}") == name:
                found.append(int(number))
    return found
