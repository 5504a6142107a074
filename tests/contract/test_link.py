"""What every byte link promises, whatever carries it: `flightstack.mavlink.link.ByteLink`."""

from __future__ import annotations

import dataclasses
import os
import pathlib
import pty
import socket
import termios
import threading
import tty
from collections.abc import Callable, Iterator

import pytest
import serial
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flightstack.mavlink.link import ByteLink, LinkError, open_link
from flightstack.mavlink.link.byte_link import READ_AT_MOST_BYTES
from flightstack.mavlink.link.memory_link import memory_pair
from flightstack.mavlink.link.serial_link import SerialLink
from flightstack.mavlink.link.tcp_link import TcpServerLink
from flightstack.mavlink.link.udp_link import UdpInLink


@dataclasses.dataclass
class Pair:
    """A link and what stands at its other end."""

    link: ByteLink
    far: ByteLink
    reliable: bool = True
    """Whether more bytes than fit wait for their reader, instead of being dropped under way."""


@dataclasses.dataclass
class PtyEnd:
    """The device behind a serial port."""

    master: int
    describe: str = "pty"
    problem: str = ""
    reconnects: int = 0
    dropped_bytes: int = 0

    def read(self) -> bytes:
        try:
            return os.read(self.master, 65536)
        except OSError:  # nothing yet, or nobody has opened the port
            return b""

    def write(self, data: bytes) -> None:
        os.write(self.master, data)

    def close(self) -> None:
        if self.master >= 0:
            os.close(self.master)
            self.master = -1


def _open_pty() -> tuple[PtyEnd, str]:
    master, slave = pty.openpty()
    tty.setraw(slave, termios.TCSANOW)
    os.set_blocking(master, False)
    path = os.ttyname(slave)
    os.close(slave)
    return PtyEnd(master), path


KINDS = ["udpin", "udpout", "tcp", "tcpin", "serial", "memory"]


def _make(kind: str) -> Pair:
    if kind == "memory":
        return Pair(*memory_pair())
    if kind == "serial":
        end, path = _open_pty()
        return Pair(open_link(f"{path},115200"), end)
    if kind in ("udpin", "udpout"):
        server = open_link("udpin:127.0.0.1:0")
        assert isinstance(server, UdpInLink)
        client = open_link(f"udpout:127.0.0.1:{server.port}")
        return Pair(*((server, client) if kind == "udpin" else (client, server)), reliable=False)
    server = open_link("tcpin:127.0.0.1:0")
    assert isinstance(server, TcpServerLink)
    client = open_link(f"tcp:127.0.0.1:{server.port}")
    return Pair(*((server, client) if kind == "tcpin" else (client, server)))


@pytest.fixture(params=KINDS)
def pair(request: pytest.FixtureRequest, eventually: Callable[..., None]) -> Iterator[Pair]:
    pair = _make(request.param)
    _introduce(pair, eventually)
    yield pair
    pair.link.close()
    pair.far.close()


def _introduce(pair: Pair, eventually: Callable[..., None]) -> None:
    """Until each end has heard the other, and nothing of that is left."""
    heard = {"link": b"", "far": b""}

    def both_heard() -> bool:
        pair.link.write(b"?")
        pair.far.write(b"?")
        heard["link"] += pair.link.read()
        heard["far"] += pair.far.read()
        return bool(heard["link"] and heard["far"])

    eventually(both_heard)
    for writer, reader in ((pair.link, pair.far), (pair.far, pair.link)):
        writer.write(b"!")
        eventually(lambda reader=reader: reader.read().endswith(b"!"))


def _collect(reader: ByteLink, size: int, eventually: Callable[..., None]) -> bytes:
    got = bytearray()

    def enough() -> bool:
        got.extend(reader.read())
        return len(got) >= size

    eventually(enough)
    return bytes(got)


def test_reading_nothing_gives_nothing_and_does_not_wait(pair):
    assert pair.link.read() == b""
    assert pair.link.read() == b""


def test_bytes_arrive_unchanged_in_both_directions(pair, eventually):
    data = bytes(range(256)) * 4
    pair.link.write(data)
    assert _collect(pair.far, len(data), eventually) == data
    pair.far.write(data[::-1])
    assert _collect(pair.link, len(data), eventually) == data[::-1]


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(pieces=st.lists(st.binary(min_size=1, max_size=300), min_size=1, max_size=8))
def test_any_bytes_in_any_pieces_arrive_in_order(kind, pieces, eventually):
    pair = _make(kind)
    try:
        _introduce(pair, eventually)
        for piece in pieces:
            pair.link.write(piece)
        whole = b"".join(pieces)
        assert _collect(pair.far, len(whole), eventually) == whole
    finally:
        pair.link.close()
        pair.far.close()


def test_all_is_well_while_it_works(pair):
    assert pair.link.problem == ""
    assert pair.link.reconnects == 0
    assert pair.link.dropped_bytes == 0
    assert pair.link.describe


def test_writing_to_a_reader_that_stalls_never_waits_and_counts_what_is_dropped(pair, eventually):
    """More than any kernel's buffers hold: what does not fit is dropped, whole writes at a time."""
    data = bytes(range(1, 251)) * 4
    written = 0
    while written < (1 << 25) and pair.link.dropped_bytes == 0:
        pair.link.write(data)
        written += len(data)
    if pair.reliable:
        assert pair.link.dropped_bytes > 0
        assert pair.link.dropped_bytes % len(data) == 0
        got = _collect(pair.far, 1000, eventually)
        assert got == (data * (len(got) // len(data) + 1))[: len(got)]


def test_closing_twice_is_no_error(pair):
    pair.link.close()
    pair.link.close()


def test_a_closed_link_drops_what_is_written(pair):
    pair.link.close()
    if pair.reliable:
        pair.link.write(b"late")
        assert pair.link.dropped_bytes >= 4
        assert pair.link.read() == b""


def test_one_read_is_bounded():
    near, far = memory_pair(capacity_bytes=3 * READ_AT_MOST_BYTES)
    near.write(b"x" * (2 * READ_AT_MOST_BYTES))
    assert len(far.read()) == READ_AT_MOST_BYTES
    assert len(far.read()) == READ_AT_MOST_BYTES


# -- coming and going ----------------------------------------------------------------------------------------------


def test_tcp_connects_as_soon_as_the_server_is_there(free_port, eventually):
    port = free_port()
    link = open_link(f"tcp:127.0.0.1:{port}")
    eventually(lambda: link.read() or "refused" in link.problem)
    server = open_link(f"tcpin:127.0.0.1:{port}")
    _introduce(Pair(link, server), eventually)
    assert (link.problem, link.reconnects) == ("", 0)
    link.close()
    server.close()


def test_tcp_reconnects_after_the_server_restarted(free_port, eventually):
    port = free_port()
    server = open_link(f"tcpin:127.0.0.1:{port}")
    link = open_link(f"tcp:127.0.0.1:{port}")
    _introduce(Pair(link, server), eventually)
    server.close()
    eventually(lambda: link.read() or link.problem)
    assert str(port) in link.problem
    server = open_link(f"tcpin:127.0.0.1:{port}")
    _introduce(Pair(link, server), eventually)
    assert (link.problem, link.reconnects) == ("", 1)
    link.close()
    server.close()


def test_a_new_tcp_client_takes_the_place_of_the_old(eventually):
    server = open_link("tcpin:127.0.0.1:0")
    first = open_link(f"tcp:127.0.0.1:{server.port}")
    _introduce(Pair(first, server), eventually)
    with socket.create_connection(("127.0.0.1", server.port)) as second:
        second.sendall(b"second")
        assert _collect(server, 6, eventually)[-6:] == b"second"
        server.write(b"hello")
        assert second.recv(5) == b"hello"
    assert server.reconnects == 1
    first.close()
    server.close()


def test_udp_answers_everybody_who_sent(eventually):
    server = open_link("udpin:127.0.0.1:0")
    assert "nobody has sent" in server.problem
    clients = [open_link(f"udpout:127.0.0.1:{server.port}") for _ in range(3)]
    for client in clients:
        client.write(b"x")
    _collect(server, 3, eventually)
    server.write(b"all")
    assert [_collect(client, 3, eventually) for client in clients] == [b"all"] * 3
    for link in (server, *clients):
        link.close()


def test_udp_goes_on_when_its_peer_was_not_there_yet(free_port, eventually):
    port = free_port(socket.SOCK_DGRAM)
    link = open_link(f"udpout:127.0.0.1:{port}")
    eventually(lambda: link.write(b"x") or link.read() or link.problem)
    assert "refused" in link.problem
    server = open_link(f"udpin:127.0.0.1:{port}")
    _introduce(Pair(link, server), eventually)
    assert link.problem == ""
    link.close()
    server.close()


def test_a_serial_port_may_be_unplugged_and_come_back(tmp_path, eventually):
    end, path = _open_pty()
    port = tmp_path / "ttypixhawk"
    port.symlink_to(path)
    link = open_link(f"{port},57600")
    _introduce(Pair(link, end), eventually)
    end.close()
    port.unlink()
    eventually(lambda: link.read() or "no port" in link.problem)
    link.write(b"lost")
    assert link.dropped_bytes == 4
    end, path = _open_pty()
    port.symlink_to(path)
    _introduce(Pair(link, end), eventually)
    assert (link.problem, link.reconnects) == ("", 1)
    link.close()
    end.close()


class SlowPort:
    """Opens at once the first time; later it takes until the test lets it."""

    def __init__(self) -> None:
        self.may_open = threading.Event()
        self.attempts = 0

    def open(self, path: str, baud: int) -> serial.Serial:
        self.attempts += 1
        if self.attempts > 1:
            assert self.may_open.wait(20.0)
        return serial.Serial(path, baud, timeout=0, write_timeout=0, exclusive=True)


def test_no_tick_waits_for_a_serial_port_that_is_slow_to_come_back(tmp_path, eventually):
    end, path = _open_pty()
    port = tmp_path / "ttypixhawk"
    port.symlink_to(path)
    slow = SlowPort()
    link = SerialLink("pixhawk", str(port), 57600, slow.open)
    _introduce(Pair(link, end), eventually)
    end.close()
    port.unlink()
    eventually(lambda: link.read() or link.problem)
    end, path = _open_pty()
    port.symlink_to(path)
    eventually(lambda: link.read() or slow.attempts == 2)
    told = link.problem
    for _ in range(1000):
        assert link.read() == b""
        link.write(b"setpoint")
    assert (slow.attempts, link.problem, link.reconnects) == (2, told, 0)
    assert link.dropped_bytes >= 8000
    slow.may_open.set()
    _introduce(Pair(link, end), eventually)
    assert (link.problem, link.reconnects) == ("", 1)
    link.close()
    end.close()


def test_a_serial_link_that_is_closed_while_it_opens_leaves_nothing_open(tmp_path, eventually):
    end, path = _open_pty()
    port = tmp_path / "ttypixhawk"
    port.symlink_to(path)
    slow = SlowPort()
    link = SerialLink("pixhawk", str(port), 57600, slow.open)
    _introduce(Pair(link, end), eventually)
    end.close()
    eventually(lambda: link.read() or slow.attempts == 2)
    slow.may_open.set()
    link.close()
    assert [thread for thread in threading.enumerate() if str(port) in thread.name] == []
    assert link.read() == b""
    assert slow.attempts == 2


# -- what a person may write ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "mend"),
    [
        ("", "none of udpin"),
        ("udpin:127.0.0.1", "none of udpin"),
        ("udpin:127.0.0.1:99999", "none of udpin"),
        ("udp:127.0.0.1:14550", "say udpin:127.0.0.1:14550"),
        ("carrier:pigeon:1", "none of udpin"),
        ("/dev/ttyUSB0", "baud rate is missing"),
        ("/dev/there-is-no-such-port,57600", "plugged in"),
        ("/dev/null,57600", "serial port"),
        ("udpout:no-such-host.invalid:14550", "no host is called"),
        ("tcpin:192.0.2.1:5760", "cannot wait on port 5760"),
    ],
)
def test_a_wrong_link_is_one_line_that_names_it_and_the_mend(text, mend):
    with pytest.raises(LinkError) as caught:
        open_link(text)
    assert "\n" not in str(caught.value)
    assert repr(text) in str(caught.value)
    assert mend in str(caught.value)


@pytest.mark.parametrize(("kind", "type_"), [("udpin", socket.SOCK_DGRAM), ("tcpin", socket.SOCK_STREAM)])
def test_a_port_in_use_is_named(kind, type_):
    with socket.socket(socket.AF_INET, type_) as taken:
        taken.bind(("127.0.0.1", 0))
        if type_ is socket.SOCK_STREAM:
            taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(LinkError, match=f"cannot wait on port {port}.*in use"):
            open_link(f"{kind}:127.0.0.1:{port}")


def test_a_serial_port_in_use_is_named():
    end, path = _open_pty()
    first = open_link(f"{path},57600")
    with pytest.raises(LinkError, match="in use"):
        open_link(f"{path},57600")
    first.close()
    end.close()


def test_a_directory_is_no_serial_port(tmp_path: pathlib.Path):
    with pytest.raises(LinkError, match="serial port"):
        open_link(f"{tmp_path},57600")
