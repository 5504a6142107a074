"""Byte links to an autopilot or a ground station: UDP, TCP, serial, and a pair in memory.

A link is read and written once a tick and never waits. What breaks is opened again by itself, with growing pauses;
`problem` says what is wrong meanwhile. What the operating system does not take now waits in a small buffer, and what
does not fit there is dropped whole and counted.
"""

from __future__ import annotations

import functools
import re
import socket
import time
from collections.abc import Callable
from typing import Final, Protocol

from flightstack.errors import FlightstackError

READ_AT_MOST_BYTES: Final = 1 << 20
"""Of one call: a flood must not hold the tick."""
WRITE_BACKLOG_BYTES: Final = 1 << 16
_CHUNK_BYTES: Final = 1 << 16
_DATAGRAM_BYTES: Final = 1400
"""What fits through an Ethernet frame; a MAVLink receiver puts pieces together again."""
_SENDER_KEPT_S: Final = 30.0
_SENDERS_AT_MOST: Final = 32


class LinkError(FlightstackError):
    """A link that cannot be opened as it is written; one line that says what, and how to mend it."""


class ByteLink(Protocol):
    """A two-way stream of bytes that may lose some. None of its methods waits."""

    @property
    def describe(self) -> str:
        """The link as its owner wrote it."""
        ...

    @property
    def problem(self) -> str:
        """Why nothing can go through now, for a person; empty when all is well."""
        ...

    @property
    def reconnects(self) -> int:
        """How often the link was made again after it had been lost."""
        ...

    @property
    def dropped_bytes(self) -> int:
        """What could not be sent and was thrown away."""
        ...

    def read(self) -> bytes:
        """All that has come since the last call, at most 1 MiB."""
        ...

    def write(self, data: bytes) -> None:
        """Send, or keep for a moment, or drop all of `data` and count it."""
        ...

    def close(self) -> None: ...


def open_link(text: str) -> ByteLink:
    """The link that `text` names, as pymavlink writes it; `LinkError` where that cannot be.

    `udpin:HOST:PORT` waits for datagrams and answers to those who sent lately; `udpout:HOST:PORT` sends first;
    `tcp:HOST:PORT` connects, as often as needed; `tcpin:HOST:PORT` waits for one client, the newest;
    `PATH,BAUD` is a serial port, which must be there at the start and may come and go later.
    """
    return _opener(text)()


def check_link(text: str) -> None:
    """`LinkError` if `text` names no link; nothing is opened."""
    _opener(text)


def _opener(text: str) -> Callable[[], ByteLink]:
    from flightstack.mavlink.link_streams import SerialLink, TcpClientLink, TcpServerLink

    if match := re.fullmatch(r"(\w+):(.+):(\d{1,5})", text):
        kinds: dict[str, Callable[[str, str, int], ByteLink]] = {
            "udpin": UdpInLink,
            "udpout": UdpOutLink,
            "tcp": TcpClientLink,
            "tcpin": TcpServerLink,
        }
        kind, host, port = match[1], match[2].strip("[]"), int(match[3])
        if kind in kinds and 0 <= port <= 65535:
            return functools.partial(kinds[kind], text, host, port)
        if kind == "udp":
            raise LinkError(
                f"link {text!r}: say udpin:{host}:{port} to wait there, udpout:{host}:{port} to send"
            )
    elif match := re.fullmatch(r"([^,:]+),(\d{1,8})", text):
        return functools.partial(SerialLink, text, match[1], int(match[2]))
    elif text.startswith("/dev/"):
        raise LinkError(f"link {text!r}: the baud rate is missing; write it as {text.rstrip(',')},57600")
    raise LinkError(
        f"link {text!r} is none of udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT, PATH,BAUD"
    )


def resolve(
    text: str, host: str, port: int, kind: socket.SocketKind
) -> tuple[socket.AddressFamily, tuple[str, int]]:
    """Address family and address of `host`. Asked once: a name server may take seconds."""
    try:
        found = socket.getaddrinfo(host, port, type=kind)
    except OSError as error:
        raise LinkError(f"link {text!r}: no host is called {host!r} ({error.strerror})") from error
    # "localhost" may be ::1 first, where no autopilot waits.
    family, _, _, _, address = min(found, key=lambda entry: entry[0] != socket.AF_INET)
    return family, (str(address[0]), int(address[1]))


def bound_socket(text: str, host: str, port: int, kind: socket.SocketKind) -> socket.socket:
    """A non-blocking socket that waits on `host`:`port`."""
    family, address = resolve(text, host, port, kind)
    bound = socket.socket(family, kind)
    try:
        if kind is socket.SOCK_STREAM:
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind(address)
    except OSError as error:
        bound.close()
        raise LinkError(
            f"link {text!r}: cannot wait on port {port}: {error.strerror}; "
            "end the other process or choose another port or address"
        ) from error
    bound.setblocking(False)
    return bound


class UdpInLink:
    """Waits for datagrams and answers to everybody who has sent in the last 30 s."""

    def __init__(self, text: str, host: str, port: int) -> None:
        self.describe = text
        self.reconnects = 0
        self.dropped_bytes = 0
        self._socket = bound_socket(text, host, port, socket.SOCK_DGRAM)
        self._heard_s: dict[tuple[str, int], float] = {}

    @property
    def problem(self) -> str:
        return "" if self._senders() else f"nobody has sent to {self.describe} lately"

    @property
    def port(self) -> int:
        """The port in use, when port 0 was asked for."""
        return int(self._socket.getsockname()[1])

    def read(self) -> bytes:
        pieces = bytearray()
        while len(pieces) < READ_AT_MOST_BYTES:
            try:
                data, sender = self._socket.recvfrom(_CHUNK_BYTES)
            except BlockingIOError:
                break
            except ConnectionError:  # a former peer's port is closed (Windows tells that here)
                continue
            pieces += data
            self._heard_s.pop(sender, None)  # to the end, so that the first are the longest silent
            self._heard_s[sender] = time.monotonic()
        while len(self._heard_s) > _SENDERS_AT_MOST:
            del self._heard_s[next(iter(self._heard_s))]
        return bytes(pieces)

    def write(self, data: bytes) -> None:
        for sender in self._senders():
            for start in range(0, len(data), _DATAGRAM_BYTES):
                piece = data[start : start + _DATAGRAM_BYTES]
                try:
                    self._socket.sendto(piece, sender)
                except OSError:  # full, or no way there: UDP promises nothing
                    self.dropped_bytes += len(piece)

    def close(self) -> None:
        self._socket.close()

    def _senders(self) -> list[tuple[str, int]]:
        oldest_s = time.monotonic() - _SENDER_KEPT_S
        return [sender for sender, heard_s in self._heard_s.items() if heard_s >= oldest_s]


class UdpOutLink:
    """Sends to one address and hears only that address."""

    def __init__(self, text: str, host: str, port: int) -> None:
        self.describe = text
        self.problem = ""
        self.reconnects = 0
        self.dropped_bytes = 0
        family, address = resolve(text, host, port, socket.SOCK_DGRAM)
        self._heard = False
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.connect(address)
        except OSError as error:
            self._socket.close()
            raise LinkError(f"link {text!r}: no way to {host}: {error.strerror}") from error

    def read(self) -> bytes:
        pieces = bytearray()
        while len(pieces) < READ_AT_MOST_BYTES:
            try:
                pieces += self._socket.recv(_CHUNK_BYTES)
            except BlockingIOError:
                break
            except OSError as error:
                # Refused: nobody waits at the other end, yet. The error is taken off the socket by this.
                self._failed(error)
                break
            self._works()
        return bytes(pieces)

    def write(self, data: bytes) -> None:
        for start in range(0, len(data), _DATAGRAM_BYTES):
            piece = data[start : start + _DATAGRAM_BYTES]
            try:
                self._socket.send(piece)
            except BlockingIOError:
                self.dropped_bytes += len(piece)
            except OSError as error:
                self.dropped_bytes += len(piece)
                self._failed(error)

    def close(self) -> None:
        self._socket.close()

    def _failed(self, error: OSError) -> None:
        self.problem = f"{self.describe}: {error.strerror}"

    def _works(self) -> None:
        if self.problem:
            self.problem = ""
            self.reconnects += self._heard
        self._heard = True


class _Pipe:
    """What is under way in one direction of a pair."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.closed = False


class MemoryLink:
    """One end of a pair inside one process, for simulations and tests."""

    def __init__(self, name: str, incoming: _Pipe, outgoing: _Pipe, capacity_bytes: int) -> None:
        self.describe = name
        self.reconnects = 0
        self.dropped_bytes = 0
        self._incoming = incoming
        self._outgoing = outgoing
        self._capacity_bytes = capacity_bytes

    @property
    def problem(self) -> str:
        return f"{self.describe}: an end is closed" if self._outgoing.closed else ""

    def read(self) -> bytes:
        data = bytes(self._incoming.data[:READ_AT_MOST_BYTES])
        del self._incoming.data[: len(data)]
        return data

    def write(self, data: bytes) -> None:
        if self._outgoing.closed or len(self._outgoing.data) + len(data) > self._capacity_bytes:
            self.dropped_bytes += len(data)
        else:
            self._outgoing.data += data

    def close(self) -> None:
        self._incoming.closed = self._outgoing.closed = True
        self._incoming.data.clear()


def memory_pair(capacity_bytes: int = READ_AT_MOST_BYTES) -> tuple[MemoryLink, MemoryLink]:
    """Two ends: what is written to one is read from the other; more than `capacity_bytes` unread is dropped."""
    there, back = _Pipe(), _Pipe()
    return (
        MemoryLink("memory:near", back, there, capacity_bytes),
        MemoryLink("memory:far", there, back, capacity_bytes),
    )
