"""Links over UDP: to whoever sends to us, and to one address."""

from __future__ import annotations

import socket
import time
from typing import Final

from flightstack.mavlink.link.byte_link import CHUNK_BYTES, READ_AT_MOST_BYTES, LinkError
from flightstack.mavlink.link.host_address import bound_socket, resolve

_DATAGRAM_BYTES: Final = 1400
"""What fits through an Ethernet frame; a MAVLink receiver puts pieces together again."""
_SENDER_KEPT_S: Final = 30.0
_SENDERS_AT_MOST: Final = 32


class UdpInLink:
    """Waits for datagrams and answers to everybody who has sent in the last 30 s."""

    def __init__(self, text: str, host: str, port: int) -> None:
        self.describe = text
        self.reconnects = 0
        self.dropped_bytes = 0
        self._socket = bound_socket(text, host, port, socket.SOCK_DGRAM)
        self._heard_s: dict[tuple[str, int], float] = {}
        self._was_sent_to = False

    @property
    def problem(self) -> str:
        if self._senders():
            return ""
        since = f"for {_SENDER_KEPT_S:.0f} s" if self._was_sent_to else "yet"
        return f"nobody has sent to {self.describe} {since}"

    @property
    def port(self) -> int:
        """The port in use, when port 0 was asked for."""
        return int(self._socket.getsockname()[1])

    def read(self) -> bytes:
        pieces = bytearray()
        while len(pieces) < READ_AT_MOST_BYTES:
            try:
                data, sender = self._socket.recvfrom(CHUNK_BYTES)
            except BlockingIOError:
                break
            except ConnectionError:  # a former peer's port is closed (Windows tells that here)
                continue
            pieces += data
            self._was_sent_to = True
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
                pieces += self._socket.recv(CHUNK_BYTES)
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
