"""The one shell around serial ports: bytes in, bytes out, and word of every connection made and lost."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import os
import select
import sys
import urllib.parse
from collections.abc import Callable
from typing import Any, Final

import serial

from sensors.instruments.sensor_error import SensorError
from sensors.serial.background_opening import BackgroundOpening

_OPEN_ERRORS: tuple[type[Exception], ...] = (serial.SerialException, OSError, ValueError)
"""What pyserial lets through."""
if sys.platform != "win32":
    import termios

    _OPEN_ERRORS += (termios.error,)

RETRY_FIRST_S: Final = 0.5
RETRY_LONGEST_S: Final = 5.0
_READ_BYTES: Final = 4096
_WRITE_TIMEOUT_S: Final = 0.05
_TIMEOUTS_AT_MOST: Final = 3
"""So many writes in a row may take too long. One says little: a busy machine that stops this process between
handing the bytes over and looking at the clock looks the same as a device that does not take them."""


@dataclasses.dataclass(frozen=True)
class PortEvent:
    """A connection made, or lost, or again not made; `reason` says why not."""

    time_s: float
    connected: bool
    reason: str = ""


class InstrumentPort:
    """A serial port (or anything else that pyserial's `serial_for_url` opens) that may come and go.

    No call waits, `close` excepted: opening and closing are done in the background, reading and writing do not
    block. A port that cannot be opened is tried again after 0.5 s, 1 s, 2 s, … at most 5 s, in the time of `now_s`,
    which may run faster than the wall's.
    """

    def __init__(
        self,
        port: str,
        baud: int,
        now_s: Callable[[], float],
        open_port: Callable[[str, int], serial.SerialBase] | None = None,
    ) -> None:
        """`SensorError` as `check_port` says. `open_port` opens (port, baud) and may block; by default pyserial."""
        check_port(port, baud)
        self.port = port
        self.baud = baud
        self._now_s = now_s
        self._serial: serial.SerialBase | None = None
        opens = open_port or _open
        self._opening: BackgroundOpening[serial.SerialBase] = BackgroundOpening(
            port, lambda: opens(port, baud), _close, _OPEN_ERRORS
        )
        self._retry_s = RETRY_FIRST_S
        self._try_at_s = now_s()
        self._events: list[PortEvent] = []
        self._timeouts = 0
        self._closed = False

    @property
    def connected(self) -> bool:
        return self._serial is not None

    def read(self) -> bytes:
        """What has come since the last call, and the care of the connection: call it every tick."""
        self._connect()
        if self._serial is None:
            return b""
        try:
            return bytes(self._serial.read(_READ_BYTES))
        except (serial.SerialException, OSError) as error:
            self._lose(error)
            return b""

    def write(self, data: bytes) -> None:
        """Send `data`, or nothing while the port is gone: what was meant for then is of no use later."""
        if self._serial is None or not data:
            return
        try:
            if _is_full(self._serial):
                raise serial.SerialTimeoutException("Write timeout")
            sent = self._serial.write(data)
        except serial.SerialTimeoutException as error:
            self._timeouts += 1
            if self._timeouts >= _TIMEOUTS_AT_MOST:
                self._lose(error)
            return
        except (serial.SerialException, OSError) as error:
            self._lose(error)
            return
        self._timeouts = 0
        if sent is not None and sent < len(data):
            self._lose(OSError("the device does not take what is sent"))

    def events(self) -> list[PortEvent]:
        """What happened to the connection since the last call, oldest first."""
        events, self._events = self._events, []
        return events

    def close(self) -> None:
        """Close for good, and wait until it is done, or 2 s where a device blocks."""
        self._closed = True
        port, self._serial = self._serial, None
        if port is not None:
            self._opening.give_back(port)
        self._opening.end()

    def _connect(self) -> None:
        if self._serial is not None or self._closed:
            return
        outcome = self._opening.result()
        now_s = self._now_s()
        if isinstance(outcome, Exception):
            self._fail(outcome)
        elif outcome is not None:
            self._serial = outcome
            self._timeouts = 0
            self._retry_s = RETRY_FIRST_S
            self._events.append(PortEvent(now_s, True))
        elif now_s >= self._try_at_s or self._try_at_s - now_s > RETRY_LONGEST_S:
            # The second condition: the clock was set back, and the time to try again is out of reach.
            self._opening.begin()

    def _lose(self, error: Exception) -> None:
        port, self._serial = self._serial, None
        if port is not None:
            self._opening.give_back(port)
        self._fail(error)

    def _fail(self, error: Exception) -> None:
        now_s = self._now_s()
        self._events.append(PortEvent(now_s, False, f"{self.port}: {plain_reason(error)}"))
        self._try_at_s = now_s + self._retry_s
        self._retry_s = min(2.0 * self._retry_s, RETRY_LONGEST_S)


def plain_reason(error: Exception) -> str:
    """Why a port could not be opened or was lost, in one line without pyserial's wrapping."""
    text = str(error).splitlines()[0] if str(error) else type(error).__name__
    known = {
        "No such file": "no such device: is it plugged in?",
        "Permission denied": "permission denied: add the user to the group dialout",
        "Connection refused": "connection refused: nobody listens there",
        "timed out": "no answer to the connection",
        "exclusively lock": "another process has it open",
        "Resource temporarily unavailable": "another process has it open",
        "socket disconnected": "the other side closed the connection",
        "returned no data": "unplugged",
        "Input/output error": "unplugged",
        "Write timeout": "the device does not take what is sent",
    }
    return next((plain for part, plain in known.items() if part in text), text)


def check_port(port: str, baud: int) -> None:
    """`SensorError` if `port` can never be opened: a URL of unknown kind, a baud rate that is none."""
    if baud <= 0:
        raise SensorError(f"port {port}: the baud rate {baud} is not positive")
    if port.startswith("socket://"):
        try:
            parts = urllib.parse.urlsplit(port)
            complete = bool(parts.hostname) and parts.port is not None
        except ValueError:
            complete = False
        if not complete:
            raise SensorError(f"port {port}: write it as socket://HOST:PORT")
    try:
        serial.serial_for_url(port, baudrate=baud, do_not_open=True)
    except (ValueError, serial.SerialException) as error:
        raise SensorError(f"port {port}: {error}") from error


def _open(port: str, baud: int) -> serial.SerialBase:
    # A write timeout of zero would make pyserial's sockets spin while the other side does not read.
    options: dict[str, Any] = {"timeout": 0, "write_timeout": _WRITE_TIMEOUT_S, "baudrate": baud}
    if os.name == "posix" and "://" not in port:
        options["exclusive"] = True  # two readers of one port would each get half of every line
    return serial.serial_for_url(port, **options)


def _is_full(port: serial.SerialBase) -> bool:
    """Whether a write would have to wait, as far as the port can tell."""
    with contextlib.suppress(AttributeError, io.UnsupportedOperation):
        poll = select.poll()
        poll.register(port.fileno(), select.POLLOUT)
        return not poll.poll(0)
    return False


def _close(port: serial.SerialBase) -> None:
    # pyserial forgets to close a socket whose connection is already broken.
    sock = getattr(port, "_socket", None)
    try:
        port.close()
    except (serial.SerialException, OSError):
        return  # the device is gone: there is nothing left to close
    finally:
        if sock is not None:
            sock.close()
