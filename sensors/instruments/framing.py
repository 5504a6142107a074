"""Cutting a byte stream into messages, whatever the chunks in which it comes and whatever is mixed into
it."""

from __future__ import annotations

import re
from typing import Protocol

LINE_LIMIT_BYTES = 512
"""No instrument here sends longer lines; more without a line end is another device or the wrong baud rate."""

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)", re.ASCII)


class Framer(Protocol):
    """Cuts bytes into candidate messages. The result depends on the bytes only, never on their chunks."""

    def feed(self, data: bytes) -> list[bytes | None]:
        """Complete candidates in order; None stands for a stretch of bytes that can be no message at all."""
        ...

    def end(self) -> list[bytes | None]:
        """What is left where the stream is over, as in `feed`."""
        ...

    def clear(self) -> None:
        """Forget partial input."""
        ...


class LineFramer:
    """Lines ended by LF, CR, or both; empty lines are dropped, endless ones reported once and skipped."""

    def __init__(self, limit_bytes: int = LINE_LIMIT_BYTES) -> None:
        self._limit = limit_bytes
        self._partial = bytearray()
        self._skipping = False

    def clear(self) -> None:
        self._partial.clear()
        self._skipping = False

    def feed(self, data: bytes) -> list[bytes | None]:
        found: list[bytes | None] = []
        *ended, rest = data.replace(b"\r", b"\n").split(b"\n")
        for piece in ended:
            self._append(piece, found)
            if not self._skipping and self._partial.strip():
                found.append(bytes(self._partial))
            self.clear()
        self._append(rest, found)
        return found

    def end(self) -> list[bytes | None]:
        """A line that was cut off is still a line."""
        return self.feed(b"\n")

    def _append(self, piece: bytes, found: list[bytes | None]) -> None:
        if self._skipping:
            return
        self._partial += piece
        if len(self._partial) > self._limit:
            self._partial.clear()
            self._skipping = True
            found.append(None)


def number(text: str) -> float | None:
    """The plain decimal number that `text` is, None for anything else: no exponents, "nan", "inf" or
    blanks."""
    return float(text) if len(text) <= 16 and _NUMBER.fullmatch(text) else None


def printable(frame: bytes, limit: int = 40) -> str:
    """A short, safe rendering of a message for a reason that a person reads."""
    text = frame[:limit].decode("ascii", "replace")
    return f'"{legible(text)}{"…" if len(frame) > limit else ""}"'


def legible(text: str) -> str:
    """`text` of an instrument as a terminal may show it: what is no printable character is a "?"."""
    return "".join(c if c.isprintable() else "?" for c in text.replace("�", "?"))
