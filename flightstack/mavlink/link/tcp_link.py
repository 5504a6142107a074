"""Links over TCP: to a server, and for one client."""

from __future__ import annotations

import errno
import logging
import os
import select
import socket
import time
from typing import Final

from flightstack.mavlink.link.host_address import bound_socket, resolve
from flightstack.mavlink.link.stream_link import Backoff, StreamLink

log = logging.getLogger(__name__)

CONNECT_WITHIN_S: Final = 5.0


class TcpClientLink(StreamLink):
    """Connects to a server, and again whenever it refuses or goes away."""

    def __init__(self, text: str, host: str, port: int) -> None:
        super().__init__(text)
        self._family, self._address = resolve(text, host, port, socket.SOCK_STREAM)
        self._socket: socket.socket | None = None
        self._give_up_at_s = 0.0
        self._backoff = Backoff()
        self._try_open()

    def _try_open(self) -> None:
        if self._socket is None:
            if not self._backoff.due():
                return
            self._socket = socket.socket(self._family, socket.SOCK_STREAM)
            self._socket.setblocking(False)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._give_up_at_s = time.monotonic() + CONNECT_WITHIN_S
            code = self._socket.connect_ex(self._address)
            if code == errno.EINPROGRESS:
                return
        elif _writable(self._socket.fileno()):
            code = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        elif time.monotonic() > self._give_up_at_s:
            code = errno.ETIMEDOUT
        else:
            return
        if code == 0:
            self._backoff.succeeded()
            self._opened(self._socket.fileno())
        else:
            self._discard()
            self.problem = f"{self.describe}: {os.strerror(code)}"

    def _discard(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None
        self._backoff.failed()


class TcpServerLink(StreamLink):
    """Waits for one client. A new one takes the place of the old, whose end may have died without a word."""

    def __init__(self, text: str, host: str, port: int) -> None:
        super().__init__(text)
        self._client: socket.socket | None = None
        self._server = bound_socket(text, host, port, socket.SOCK_STREAM)
        self._server.listen(4)
        self.problem = f"{text}: nobody has connected"

    @property
    def port(self) -> int:
        """The port in use, when port 0 was asked for."""
        return int(self._server.getsockname()[1])

    def close(self) -> None:
        super().close()
        self._server.close()

    def _ready(self) -> bool:
        if not self._closed:
            self._try_open()
        return self._descriptor is not None

    def _try_open(self) -> None:
        while True:
            try:
                client, address = self._server.accept()
            except BlockingIOError:
                return
            except OSError as error:  # the client gave up while it waited, or descriptors ran out
                log.warning("link %s: a client could not be accepted: %s", self.describe, error.strerror)
                return
            if self._client is not None:
                self._lose(f"{address[0]} has taken its place")
            client.setblocking(False)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._client = client
            self._opened(client.fileno())

    def _discard(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None


def _writable(descriptor: int) -> bool:
    poll = select.poll()
    poll.register(descriptor, select.POLLOUT)
    return bool(poll.poll(0))
