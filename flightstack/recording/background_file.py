"""A file that is written by a thread of its own, so that a slow or full disk never holds up a tick."""

from __future__ import annotations

import contextlib
import errno
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
_COPIED_BYTES: Final = 1 << 20

_FAULTS_OF_THE_DISK: Final = frozenset(
    (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EPERM, errno.EIO, errno.ENXIO, errno.ENODEV)
)


class RecordingError(FlightstackError):
    """A recording cannot be made or read; one line that says which and why."""


def is_fault_of_the_disk(error: OSError) -> bool:
    """Whether a disk that is full, read-only or failing is the reason, which may end by itself, and not a name that
    cannot be."""
    return error.errno in _FAULTS_OF_THE_DISK


def make_directory(directory: pathlib.Path) -> None:
    """Make it, if need be. OSError where it cannot be; a disk that cannot take it now is for the files to tell."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        if not is_fault_of_the_disk(error):
            raise


def _open_new(path: pathlib.Path) -> tuple[pathlib.Path, io.FileIO]:
    free, number = path, 1
    while True:
        try:
            return free, free.open("x+b", buffering=0)
        except FileExistsError:
            number += 1
            free = path.with_stem(f"{path.stem}-{number}")


class BackgroundFile:
    """Takes bytes at once and writes them half a second later.

    When the disk cannot take them, `problem` tells why, they wait in memory and are tried again: a disk that is
    freed, or a directory that is there again, has lost nothing. What no longer fits into the memory is not taken
    (`takes`), until all that was taken is written.
    """

    def __init__(self, path: pathlib.Path | str) -> None:
        """A new file at `path`, or next to it (NAME-2, NAME-3) where one is already: nothing is ever overwritten, and
        a start within the same second, or after the clock was set back, records as well. `RecordingError` if there
        can be no such file; where only the disk cannot take it now, `problem` tells."""
        self.problem = ""
        self.path = pathlib.Path(path)
        self._file: io.FileIO | None = None
        self._lock = threading.Lock()
        self._pending = bytearray()
        self._taken_bytes = 0
        self._overflowed = False
        """More came than fits into the memory, and since then nothing was taken."""
        self._unsynced = False
        self._closing = threading.Event()
        try:
            self.path, self._file = _open_new(self.path)
        except OSError as error:
            if not is_fault_of_the_disk(error):
                raise RecordingError(f"{path}: cannot be recorded to: {error.strerror}") from error
            self._fail(_reason(error))
        self._thread = threading.Thread(target=self._run, name=f"write {self.path.name}", daemon=True)
        self._thread.start()

    def takes(self, size_bytes: int) -> bool:
        """Whether `write` will take so much more now."""
        with self._lock:
            return self._takes(size_bytes)

    def _takes(self, size_bytes: int) -> bool:
        if self._overflowed and not self._pending and not self._closing.is_set():
            self._overflowed = False
            self._recover()
        if not self._overflowed and len(self._pending) + size_bytes > PENDING_AT_MOST_BYTES:
            self._overflowed = True
            if not self.problem:
                self._fail("the disk is too slow")
        return not self._overflowed and not self._closing.is_set()

    def write(self, data: bytes) -> int:
        """Take `data` whole, or not at all: a reader finds whole records."""
        with self._lock:
            if self._takes(len(data)):
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

    # -- the thread ------------------------------------------------------------------------------------------

    def _run(self) -> None:
        rounds = 0
        while not self._closing.wait(WRITE_EVERY_S):
            rounds += 1
            self._round(sync=rounds % SYNC_EVERY == 0)
        self._round(sync=True)
        if self._file is not None:
            self._file.close()

    def _round(self, *, sync: bool) -> None:
        """Write what waits, and find out whether it is where it should be."""
        with self._lock:
            data, self._pending = self._pending, bytearray()
        written = 0
        try:
            if self._file is None:
                self.path.parent.mkdir(parents=True, exist_ok=True)
                self.path, self._file = _open_new(self.path)
            view = memoryview(data)
            while written < len(data):
                written += self._file.write(view[written:])
                self._unsynced = True
            if sync and self._unsynced:
                os.fsync(self._file.fileno())
                self._unsynced = False
            if self._is_gone(self._file):
                self._move(self._file)
        except OSError as error:
            with self._lock:
                self._pending[:0] = data[written:]
                self._fail(_reason(error))
            return
        with self._lock:
            if not self._overflowed:
                self._recover()

    def _is_gone(self, file: io.FileIO) -> bool:
        """Whether the file that is written is not the one that stands under its name: somebody removed it."""
        there = os.fstat(file.fileno())
        try:
            named = self.path.stat()
        except FileNotFoundError:
            return True
        return (named.st_dev, named.st_ino) != (there.st_dev, there.st_ino)

    def _move(self, old: io.FileIO) -> None:
        """Go on in a new file that begins with all that the old one holds: its bytes live until it is closed."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        path, new = _open_new(self.path)
        try:
            at = 0
            while block := os.pread(old.fileno(), _COPIED_BYTES, at):
                done = 0
                while done < len(block):
                    done += new.write(block[done:])
                at += len(block)
            os.fsync(new.fileno())
        except OSError:
            new.close()
            with contextlib.suppress(OSError):  # it is gone as well
                path.unlink()
            raise
        self.path, self._file = path, new
        old.close()
        log.warning("%s: was removed while it was written; it is there again, whole", path)

    # -- what is told; with the lock held --------------------------------------------------------------------

    def _fail(self, reason: str) -> None:
        problem = f"{self.path}: recording has ended: {reason}"
        if problem != self.problem:
            self.problem = problem
            log.error("%s", problem)

    def _recover(self) -> None:
        if self.problem:
            self.problem = ""
            log.warning("%s: is recorded again", self.path)


def _reason(error: OSError) -> str:
    return error.strerror or str(error)
