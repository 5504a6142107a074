"""Status texts of autopilots: those longer than one message (50 bytes) come in parts that are put together here.

Each part carries the text's number and its own; the last one is shorter than 50 bytes, empty if need be (MAVLink
STATUSTEXT). Parts come in any order and get lost. Nobody says how the bytes are to be read: ArduPilot's and PX4's
are ASCII, what scripts on them send is UTF-8 at best.
"""

from __future__ import annotations

from typing import Final

import msgspec

from mission.documents.printable import printable

PART_LENGTH: Final = 50
PATIENCE_S: Final = 1.0
"""How long to wait for another part of a text; what has come is then given out with a mark where it has holes."""
OPEN_AT_MOST: Final = 16
"""Texts that wait for parts at a time."""
MISSING: Final = "[part missing]"


class StatusText(msgspec.Struct, frozen=True):
    severity: int
    """MAV_SEVERITY: 0 emergency … 2 critical, 4 warning, 6 information, 7 debug."""
    text: str
    """Visible characters only."""


class _OpenText:
    """A text of which parts have come."""

    def __init__(self, severity: int) -> None:
        self.severity = severity
        self.parts: dict[int, bytes] = {}
        self.newest_s = 0.0

    def is_whole(self) -> bool:
        end = self._end()
        return end is not None and all(number in self.parts for number in range(end))

    def _end(self) -> int | None:
        """Number of the last part, if it has come."""
        return min((number for number, part in self.parts.items() if len(part) < PART_LENGTH), default=None)

    def status(self) -> StatusText:
        """What has come, in order. Parts that touch are read together: a character may lie across both."""
        stretches: list[bytes] = []
        expected = 0
        for number in sorted(self.parts):
            if number == expected and stretches:
                stretches[-1] += self.parts[number]
            else:
                stretches.append(self.parts[number])
            expected = number + 1
        words = [readable(stretch) for stretch in stretches]
        if min(self.parts) > 0:
            words.insert(0, "")
        if self._end() is None:
            words.append("")
        return StatusText(self.severity, f" {MISSING} ".join(words).strip())


class TextAssembler:
    """Parts of STATUSTEXT (severity, text, id, chunk_seq) to whole texts."""

    def __init__(self) -> None:
        self._open: dict[int, _OpenText] = {}
        """By number, that begun longest ago first."""

    def add(self, now_s: float, severity: int, text: str, identity: int, part: int) -> list[StatusText]:
        """The texts completed by this message: none, one, or also an unfinished one whose number is used again.

        `text`: one character a byte, as `MessageLayout` reads it.
        """
        raw = text.encode("latin-1", "replace")
        if identity == 0:
            return [StatusText(severity, readable(raw))]
        given_up: list[StatusText] = []
        known = self._open.get(identity)
        if known is not None and known.parts.get(part, raw) != raw:
            given_up.append(self._open.pop(identity).status())
            known = None
        if known is None:
            known = self._open[identity] = _OpenText(severity)
            if len(self._open) > OPEN_AT_MOST:
                given_up.append(self._open.pop(next(iter(self._open))).status())
        if part not in known.parts:  # one that comes twice, by two links say, brings the others no nearer
            known.parts[part] = raw
            known.newest_s = now_s
        known.severity = min(known.severity, severity)
        return [*given_up, self._open.pop(identity).status()] if known.is_whole() else given_up

    def expire(self, now_s: float) -> list[StatusText]:
        """The texts whose missing parts have not come in time."""
        late = [identity for identity, text in self._open.items() if now_s - text.newest_s > PATIENCE_S]
        return [self._open.pop(identity).status() for identity in late]


def readable(raw: bytes) -> str:
    """The bytes of a text as a person may see them. PX4 ends texts with a tab that are also sent as events."""
    return printable(raw.decode("utf-8", "backslashreplace").strip())
