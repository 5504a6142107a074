"""Status texts longer than one message (50 characters) come in parts that are put together here."""

from __future__ import annotations

import msgspec

PART_LENGTH = 50
PATIENCE_S = 1.0
"""How long to wait for the rest of a text; what has come is then given out as it is."""


class StatusText(msgspec.Struct, frozen=True):
    severity: int
    """MAV_SEVERITY: 0 emergency … 2 critical, 4 warning, 6 information, 7 debug."""
    text: str


class TextAssembler:
    """Parts of STATUSTEXT (severity, text, id, chunk_seq) to whole texts."""

    def __init__(self) -> None:
        self._identity = 0
        self._severity = 0
        self._parts: dict[int, str] = {}
        self._since_s = 0.0

    def add(self, now_s: float, severity: int, text: str, identity: int, part: int) -> list[StatusText]:
        """The texts completed by this message: none, one, or also an unfinished one that it cuts off."""
        whole: list[StatusText] = []
        if self._parts and identity != self._identity:
            whole += self._finish()
        if identity == 0:
            return [*whole, StatusText(severity, _clean(text))]
        if not self._parts:
            self._since_s = now_s
        self._identity, self._severity = identity, severity
        self._parts[part] = text
        if len(text) < PART_LENGTH:
            whole += self._finish()
        return whole

    def expire(self, now_s: float) -> list[StatusText]:
        """The text whose rest has not come in time, if there is one."""
        if self._parts and now_s - self._since_s > PATIENCE_S:
            return self._finish()
        return []

    def _finish(self) -> list[StatusText]:
        text = "".join(self._parts[part] for part in sorted(self._parts))
        self._parts = {}
        return [StatusText(self._severity, _clean(text))]


def _clean(text: str) -> str:
    """PX4 ends texts with a tab that are also sent as events."""
    return text.strip()
