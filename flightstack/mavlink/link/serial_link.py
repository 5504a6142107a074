"""Links over a serial port."""

from __future__ import annotations

import errno
import logging
import termios
from collections.abc import Callable
from typing import Final

import serial

from flightstack.mavlink.link.byte_link import LinkError
from flightstack.mavlink.link.stream_link import Backoff, StreamLink
from sensors.serial.background_opening import BackgroundOpening

log = logging.getLogger(__name__)

_OPEN_ERRORS: Final = (OSError, ValueError, termios.error)
"""What pyserial lets through."""


class SerialLink(StreamLink):
    """A serial port. Absent at the start is an error; unplugged later it is opened again when it is back.

    That happens in the background: a device that is being plugged in may hold `open` for a second or more.
    """

    def __init__(
        self,
        text: str,
        path: str,
        baud: int,
        open_port: Callable[[str, int], serial.Serial] | None = None,
    ) -> None:
        """`open_port` opens (path, baud) and may block; by default pyserial. Here it is waited for."""
        super().__init__(text)
        self._path = path
        self._baud = baud
        self._port: serial.Serial | None = None
        self._backoff = Backoff()
        opens = open_port or _open
        self._opening: BackgroundOpening[serial.Serial] = BackgroundOpening(
            path, lambda: opens(path, baud), _close, _OPEN_ERRORS
        )
        try:
            self._take(opens(path, baud))
        except _OPEN_ERRORS as error:
            raise LinkError(f"link {text!r}: {_serial_reason(path, baud, error)}") from error

    def close(self) -> None:
        """Close for good, and wait until it is done, or 2 s where the device blocks."""
        super().close()
        self._opening.end()

    def _take(self, port: serial.Serial) -> None:
        self._port = port
        self._backoff.succeeded()
        self._opened(port.fileno())

    def _try_open(self) -> None:
        outcome = self._opening.result()
        if isinstance(outcome, Exception):
            self._backoff.failed()
            self.problem = f"{self.describe}: {_serial_reason(self._path, self._baud, outcome)}"
        elif outcome is not None:
            self._take(outcome)
        elif self._backoff.due():
            self._opening.begin()

    def _discard(self) -> None:
        port, self._port = self._port, None
        self._backoff.failed()
        if port is not None:
            self._opening.give_back(port)


def _open(path: str, baud: int) -> serial.Serial:
    return serial.Serial(path, baud, timeout=0, write_timeout=0, exclusive=True)


def _close(port: serial.Serial) -> None:
    try:
        port.close()
    except (OSError, termios.error) as error:  # the device behind it is gone already
        log.debug("closing %s: %s", port.name, error)


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
