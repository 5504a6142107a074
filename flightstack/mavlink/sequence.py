"""Sequence numbers of one sender: which frame is a repetition, which one comes after a newer one of its kind."""

from __future__ import annotations

from collections import deque
from collections.abc import Set as AbstractSet

REORDERED_FRAMES = 64
"""A number at most this far behind the newest …"""
REORDERED_S = 1.0
"""… and not later than this after it belongs to a late or repeated frame, not to a link that lost nearly 256."""


class SequenceFilter:
    """Counts a sender's frames on from the 8-bit numbers that they carry; every frame must be shown to it.

    States must not go back: an old heartbeat would look like a new mode. Of `events` (answers, texts) late ones
    count too, each once.
    """

    def __init__(self, events: AbstractSet[int]) -> None:
        self._events = events
        self._newest = -1
        """Counted on past 255; -1 before the first frame."""
        self._newest_s = 0.0
        self._newest_of: dict[int, int] = {}
        self._recent_events: deque[int] = deque(maxlen=REORDERED_FRAMES)

    def is_news(self, now_s: float, sequence: int, kind: int) -> bool:
        """Whether this frame, with this number, counts."""
        number = self._count(now_s, sequence)
        if kind in self._events:
            if number in self._recent_events:
                return False
            self._recent_events.append(number)
            return True
        if number <= self._newest_of.get(kind, -1):
            return False
        self._newest_of[kind] = number
        return True

    def _count(self, now_s: float, sequence: int) -> int:
        """The number of this frame, counted on past 255."""
        behind = (self._newest - sequence) % 256
        if self._newest >= 0 and behind < REORDERED_FRAMES and now_s - self._newest_s < REORDERED_S:
            return self._newest - behind
        self._newest += 256 - behind
        self._newest_s = now_s
        return self._newest
