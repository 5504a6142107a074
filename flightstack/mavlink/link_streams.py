"""Links over streams that break and are made again: TCP in both directions, and serial ports."""

from __future__ import annotations

import errno
import logging
import os
import select
import socket
import termios
import time
from typing import Final

import serial

from flightstack.mavlink.link import (
    READ_AT_MOST_BYTES,
    WRITE_BACKLOG_BYTES,
    LinkError,
    bound_socket,
    resolve,
)

log = logging.getLogger(__name__)

RETRY_FIRST_S: Final = 0.2
RETRY_LONGEST_S: Final = 3.0
CONNECT_WITHIN_S: Final = 5.0
_CHUNK_BYTES: Final = 1 << 16
_OPEN_ERRORS: Final = (OSError, ValueError, termios.error)
"""What pyserial lets through."""


class _StreamLink:
    """What TCP and serial links share: a descriptor that may be absent, and bytes that wait to be sent.

    Subclasses say how a descriptor comes about (`_try_open`) and how it is given up (`_discard`).
    """

    def __init__(self, text: str) -> None:
        self.describe = text
        self.problem = f"{text}: not connected yet"
        self.reconnects = 0
        self.dropped_bytes = 0
        self._descriptor: int | None = None
        self._unsent = bytearray()
        self._was_open = False
        self._closed = False

    def read(self) -> bytes:
        pieces = bytearray()
        if self._ready():
            self._flush()
        while self._descriptor is not None and len(pieces) < READ_AT_MOST_BYTES:
            if not _readable(self._descriptor):
                break
            try:
                data = os.read(self._descriptor, _CHUNK_BYTES)
            except BlockingIOError:
                break
            except OSError as error:
                self._lose(error.strerror or str(error))
                break
            if not data:
                self._lose("the other end has closed it")
                break
            pieces += data
        return bytes(pieces)

    def write(self, data: bytes) -> None:
        if not self._ready() or len(self._unsent) + len(data) > WRITE_BACKLOG_BYTES:
            self.dropped_bytes += len(data)
            return
        # A frame is cut short on a full buffer, so its rest has to follow before anything else.
        self._unsent += data
        self._flush()

    def close(self) -> None:
        self._closed = True
        self._give_up()

    def _ready(self) -> bool:
        if self._descriptor is None and not self._closed:
            self._try_open()
        return self._descriptor is not None

    def _flush(self) -> None:
        while self._unsent and self._descriptor is not None:
            try:
                sent = os.write(self._descriptor, self._unsent)
            except BlockingIOError:
                return
            except OSError as error:
                self._lose(error.strerror or str(error))
                return
            if sent == 0:  # a serial port's way to say full
                return
            del self._unsent[:sent]

    def _opened(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self.problem = ""
        if self._was_open:
            self.reconnects += 1
            log.info("link %s is back", self.describe)
        self._was_open = True

    def _lose(self, reason: str) -> None:
        self._give_up()
        self.problem = f"{self.describe}: {reason}"
        log.warning("link %s is lost: %s; trying again", self.describe, reason)

    def _give_up(self) -> None:
        self.dropped_bytes += len(self._unsent)
        self._unsent.clear()
        self._descriptor = None
        self._discard()

    def _try_open(self) -> None:
        raise NotImplementedError

    def _discard(self) -> None:
        raise NotImplementedError


class _Backoff:
    """When to try again: soon at first, then less and less often."""

    def __init__(self) -> None:
        self._pause_s = RETRY_FIRST_S
        self._next_s = 0.0

    def due(self) -> bool:
        return time.monotonic() >= self._next_s

    def failed(self) -> None:
        self._next_s = time.monotonic() + self._pause_s
        self._pause_s = min(2.0 * self._pause_s, RETRY_LONGEST_S)

    def succeeded(self) -> None:
        self._pause_s = RETRY_FIRST_S


class TcpClientLink(_StreamLink):
    """Connects to a server, and again whenever it refuses or goes away."""

    def __init__(self, text: str, host: str, port: int) -> None:
        super().__init__(text)
        self._family, self._address = resolve(text, host, port, socket.SOCK_STREAM)
        self._socket: socket.socket | None = None
        self._give_up_at_s = 0.0
        self._backoff = _Backoff()
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


class TcpServerLink(_StreamLink):
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


class SerialLink(_StreamLink):
    """A serial port. Absent at the start is an error; unplugged later it is opened again when it is back."""

    def __init__(self, text: str, path: str, baud: int) -> None:
        super().__init__(text)
        self._path = path
        self._baud = baud
        self._port: serial.Serial | None = None
        self._backoff = _Backoff()
        try:
            self._open()
        except _OPEN_ERRORS as error:
            raise LinkError(f"link {text!r}: {_serial_reason(path, baud, error)}") from error

    def _open(self) -> None:
        self._port = serial.Serial(self._path, self._baud, timeout=0, write_timeout=0, exclusive=True)
        self._backoff.succeeded()
        self._opened(self._port.fileno())

    def _try_open(self) -> None:
        if not self._backoff.due():
            return
        try:
            self._open()
        except _OPEN_ERRORS as error:
            self._backoff.failed()
            self.problem = f"{self.describe}: {_serial_reason(self._path, self._baud, error)}"

    def _discard(self) -> None:
        port, self._port = self._port, None
        self._backoff.failed()
        if port is None:
            return
        try:
            port.close()
        except (OSError, termios.error) as error:  # the device behind it is gone already
            log.debug("closing %s: %s", self._path, error)


def _serial_reason(path: str, baud: int, error: Exception) -> str:
    code = getattr(error, "errno", None)
    if isinstance(error, ValueError):
        return f"{baud} baud is not possible there; autopilots mostly have 57600, 115200 or 921600"
    if code == errno.ENOENT:
        return f"there is no port {path}; is the device plugged in and switched on?"
    if code in (errno.EACCES, errno.EPERM):
        return f"{path} may not be opened; add this user to the group that owns it (mostly dialout)"
    if code in (errno.EBUSY, errno.EAGAIN):
        return f"{path} is in use by another process; end that one"
    return f"{path} cannot be opened as a serial port ({error})"


def _readable(descriptor: int) -> bool:
    """Whether a read would say something, be it the end. Not `select.select`, which fails above 1024 descriptors."""
    poll = select.poll()
    poll.register(descriptor, select.POLLIN)
    return bool(poll.poll(0))


def _writable(descriptor: int) -> bool:
    poll = select.poll()
    poll.register(descriptor, select.POLLOUT)
    return bool(poll.poll(0))
