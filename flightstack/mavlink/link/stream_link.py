"""What links over streams share: they break and are made again, and a write may be taken in pieces."""

from __future__ import annotations

import logging
import os
import select
import time
from typing import Final

from flightstack.mavlink.link.byte_link import CHUNK_BYTES, READ_AT_MOST_BYTES

log = logging.getLogger(__name__)

WRITE_BACKLOG_BYTES: Final = 1 << 16
RETRY_FIRST_S: Final = 0.2
RETRY_LONGEST_S: Final = 3.0


class StreamLink:
    """A descriptor that may be absent, and bytes that wait to be sent.

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
                data = os.read(self._descriptor, CHUNK_BYTES)
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


class Backoff:
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


def _readable(descriptor: int) -> bool:
    """Whether a read would say something, be it the end. Not `select.select`, which fails above 1024 descriptors."""
    poll = select.poll()
    poll.register(descriptor, select.POLLIN)
    return bool(poll.poll(0))
