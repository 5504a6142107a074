"""A file that is written by a thread of its own, so that a slow disk never holds up a tick."""

from __future__ import annotations

import io
import logging
import os
import pathlib
import threading
from typing import Final

from flightstack.errors import FlightstackError

log = logging.getLogger(__name__)

WRITE_EVERY_S: Final = 0.5
"""What a killed process loses at most; it is also the wear of a memory card."""
SYNC_EVERY: Final = 4
"""Every so many writes the disk is told to keep them: what a power cut loses at most is four times as much."""
PENDING_AT_MOST_BYTES: Final = 32 << 20
_CLOSE_WITHIN_S: Final = 10.0


class RecordingError(FlightstackError):
    """A recording cannot be made or read; one line that says which and why."""


def _open_new(path: pathlib.Path) -> tuple[pathlib.Path, io.FileIO]:
    free, number = path, 1
    while True:
        try:
            return free, free.open("xb", buffering=0)
        except FileExistsError:
            number += 1
            free = path.with_stem(f"{path.stem}-{number}")
        except OSError as error:
            raise RecordingError(f"{free}: cannot be recorded to: {error.strerror}") from error


class BackgroundFile:
    """Takes bytes at once and writes them half a second later.

    When the disk is full or too slow it says so once, takes no more, and the flight goes on: `problem` tells why.
    """

    def __init__(self, path: pathlib.Path | str) -> None:
        """A new file at `path`, or next to it (NAME-2, NAME-3) where one is already: nothing is ever overwritten, and
        a start within the same second, or after the clock was set back, records as well. `RecordingError` if no
        file can be made."""
        self.problem = ""
        self.path, self._file = _open_new(pathlib.Path(path))
        self._lock = threading.Lock()
        self._pending = bytearray()
        self._taken_bytes = 0
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"write {self.path.name}", daemon=True)
        self._thread.start()

    def write(self, data: bytes) -> int:
        """Take `data` whole, or nothing more of it ever: a reader must not find a hole."""
        with self._lock:
            if not self.problem and not self._closing.is_set():
                if len(self._pending) + len(data) > PENDING_AT_MOST_BYTES:
                    self._give_up("the disk is too slow")
                else:
                    self._pending += data
                    self._taken_bytes += len(data)
        return len(data)

    def tell(self) -> int:
        return self._taken_bytes

    def close(self) -> None:
        """Write what is left. A disk that hangs is waited for 10 s, then left to its thread."""
        self._closing.set()
        self._thread.join(_CLOSE_WITHIN_S)
        if self._thread.is_alive():
            log.error("%s: the disk does not answer; the end of the recording may be missing", self.path)

    def _run(self) -> None:
        rounds = 0
        with self._file:
            while not self._closing.wait(WRITE_EVERY_S):
                wrote = self._write_pending()
                rounds += wrote
                if wrote and rounds % SYNC_EVERY == 0:
                    self._sync()
            self._write_pending()
            self._sync()

    def _write_pending(self) -> bool:
        with self._lock:
            data, self._pending = self._pending, bytearray()
            failed = bool(self.problem)
        if failed or not data:
            return False
        try:
            view = memoryview(data)
            while view:
                view = view[self._file.write(view) :]
        except OSError as error:
            with self._lock:
                self._give_up(error.strerror or str(error))
            return False
        return True

    def _sync(self) -> None:
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            with self._lock:
                self._give_up(error.strerror or str(error))

    def _give_up(self, reason: str) -> None:
        """Say it once. Called with the lock held."""
        if not self.problem:
            self.problem = f"{self.path}: recording has ended: {reason}"
            self._pending.clear()
            log.error("%s", self.problem)
