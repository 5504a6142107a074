"""A signing key in a file, and beside it the timestamps that were used with it: they must not go back over a restart.

`KEY.stamp` holds a timestamp that nobody who uses the key has reached yet. It is written before it is needed, so
that a power cut loses nothing and a computer whose clock starts in 1970 goes on where it was.
"""

from __future__ import annotations

import contextlib
import fcntl
import logging
import os
import pathlib
import secrets
import stat
import threading
import time
from collections.abc import Callable, Iterator
from typing import Final

from flightstack.errors import FlightstackError
from flightstack.mavlink.signing import KEY_BYTES, STAMP_AT_MOST, STAMPS_PER_S, Signing, stamp_at

log = logging.getLogger(__name__)

RESERVED: Final = 60 * STAMPS_PER_S
"""So much is written ahead, and again when half of it is used up."""
_OTHERS: Final = stat.S_IRWXG | stat.S_IRWXO


class SigningKeyError(FlightstackError):
    """A key file that cannot be used; one line that says why, and how to mend it."""


def read_key(path: pathlib.Path) -> bytes:
    """The key in a file: 64 hexadecimal digits, which nobody but the file's owner may read."""
    try:
        mode, text = path.stat().st_mode, path.read_text(encoding="ascii", errors="replace").strip()
    except OSError as error:
        raise SigningKeyError(f"signing key {path}: cannot be read: {error.strerror}") from error
    if mode & _OTHERS:
        raise SigningKeyError(f"signing key {path}: others than its owner may read it; chmod 600 {path}")
    try:
        key = bytes.fromhex(text)
    except ValueError:
        key = b""
    if len(key) != KEY_BYTES or not any(key):
        raise SigningKeyError(
            f"signing key {path}: is no key ({2 * KEY_BYTES} hexadecimal digits); gcs signing make makes one"
        )
    return key


def write_key(path: pathlib.Path, key: bytes | None = None) -> None:
    """Write a key, a new random one if none is given, that only the owner can read. Nothing is overwritten."""
    text = (secrets.token_bytes(KEY_BYTES) if key is None else key).hex() + "\n"
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, stat.S_IRUSR | stat.S_IWUSR)
        with open(descriptor, "w", encoding="ascii") as file:
            file.write(text)
    except FileExistsError as error:
        raise SigningKeyError(
            f"signing key {path}: is there already; a key that vehicles may have is not overwritten"
        ) from error
    except OSError as error:
        raise SigningKeyError(f"signing key {path}: cannot be written: {error.strerror}") from error


class SigningStore:
    """The key of a file as one process uses it. Several processes of one computer may share the file."""

    def __init__(self, path: pathlib.Path, *, unix_s: Callable[[], float] = time.time) -> None:
        """`SigningKeyError` if the key cannot be used, or the timestamps cannot be kept."""
        self.path = path
        self._unix_s = unix_s
        self._stamp_file = path.with_name(f"{path.name}.stamp")
        self._writing: threading.Thread | None = None
        self._failure = ""
        key = read_key(path)
        try:
            with self._alone():
                self.signing = Signing(key, max(self._kept(), stamp_at(unix_s())))
                self._reserved = self.signing.stamp + RESERVED
                self._keep(self._reserved)
        except OSError as error:
            raise SigningKeyError(
                f"signing key {path}: {self._stamp_file} cannot be written ({error.strerror}); the timestamps of "
                "signatures are kept there: make its directory writable for this user"
            ) from error

    def advance(self) -> None:
        """Take the time from the clock. Never waits: what is reserved for later is written by a thread."""
        self.signing.follow(stamp_at(self._unix_s()))
        if self.signing.stamp <= self._reserved - RESERVED // 2:
            return
        if self._writing is None or not self._writing.is_alive():
            wanted = min(self.signing.stamp + RESERVED, STAMP_AT_MOST)
            if wanted > self._reserved:
                self._writing = threading.Thread(target=self._reserve, args=(wanted,), daemon=True)
                self._writing.start()

    def release(self) -> None:
        """Give back what was reserved and is not used; it may be used again afterwards."""
        if self._writing is not None:
            self._writing.join()
        try:
            with self._alone():
                if self._kept() == self._reserved:
                    self._keep(self.signing.stamp)
                    self._reserved = self.signing.stamp
        except (OSError, SigningKeyError) as error:
            log.debug("what was reserved in %s stays so: %s", self._stamp_file, error)

    def _reserve(self, wanted: int) -> None:
        try:
            with self._alone():
                self._keep(max(wanted, self._kept()))
            self._failure = ""
        except (OSError, SigningKeyError) as error:
            # In the air a frame without a signature is worse than a timestamp that may be used again.
            if not self._failure:
                log.warning("timestamps of signatures are not kept: %s: %s", self._stamp_file, error)
            self._failure = str(error)
        self._reserved = wanted

    @contextlib.contextmanager
    def _alone(self) -> Iterator[None]:
        """Between processes that share the file."""
        with self.path.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield

    def _kept(self) -> int:
        try:
            text = self._stamp_file.read_text(encoding="ascii", errors="replace").strip()
        except FileNotFoundError:
            return 0
        if not text.isdecimal() or int(text) > STAMP_AT_MOST:
            raise SigningKeyError(
                f"signing key {self.path}: {self._stamp_file} is damaged; remove it if this computer's clock is right"
            )
        return int(text)

    def _keep(self, stamp: int) -> None:
        """Whole or not at all, whenever the power goes."""
        new = self._stamp_file.with_name(f"{self._stamp_file.name}.new")
        with new.open("w", encoding="ascii") as file:
            file.write(f"{stamp}\n")
            file.flush()
            os.fsync(file.fileno())
        new.replace(self._stamp_file)
        directory = os.open(self._stamp_file.parent, os.O_RDONLY)
        try:
            os.fsync(directory)
        finally:
            os.close(directory)
