"""Sequence numbers of one sender: which frame is a repetition, which one comes after a newer one of its kind.

Two that use one sender's ids (a second vehicle with the same number, a program that borrows them) each count by
themselves: each is followed by its own numbers, so that neither makes the other's frames look late.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Set as AbstractSet

REORDERED_FRAMES = 64
"""A number at most this far behind the newest …"""
REORDERED_S = 1.0
"""… and not later than this after it belongs to a late or repeated frame, not to a link that lost nearly 256."""
NEXT_FRAMES = 32
"""A number at most this far ahead continues a count; one farther ahead begins another."""
COUNT_KEPT_S = 3.0
"""A count that was not continued for so long is over, unless it is the only one."""
COUNTS_AT_MOST = 3


class _Count:
    """Frames that were counted by one, on from their 8-bit numbers."""

    def __init__(self, now_s: float, sequence: int) -> None:
        self.newest = sequence
        """Counted on past 255."""
        self.newest_s = now_s
        self.newest_of: dict[int, int] = {}
        """Of each kind."""
        self.recent_events: deque[int] = deque(maxlen=REORDERED_FRAMES)


class SequenceFilter:
    """Follows a sender's frames; every one must be shown to it.

    States must not go back: an old heartbeat would look like a new mode. Of `events` (answers, texts) late ones
    count too, each once.
    """

    def __init__(self, events: AbstractSet[int]) -> None:
        self._events = events
        self._counts: list[_Count] = []
        """That continued last first."""

    @property
    def heard_s(self) -> float:
        """When its newest frame came; before all times if none has."""
        return self._counts[0].newest_s if self._counts else -math.inf

    def is_news(self, now_s: float, sequence: int, kind: int) -> bool:
        """Whether this frame, with this number, counts."""
        count, number = self._place(now_s, sequence)
        if kind in self._events:
            if number in count.recent_events:
                return False
            count.recent_events.append(number)
            return True
        if number <= count.newest_of.get(kind, -1):
            return False
        count.newest_of[kind] = number
        return True

    def _place(self, now_s: float, sequence: int) -> tuple[_Count, int]:
        """The count that this frame belongs to, and its number in it."""
        counts = self._counts
        found, nearest = None, NEXT_FRAMES + 1
        for count in counts:
            ahead = (sequence - count.newest) % 256
            if 0 < ahead < nearest:
                found, nearest = count, ahead
        if found is not None:
            found.newest += nearest
            found.newest_s = now_s
            if found is not counts[0]:
                counts.remove(found)
                counts.insert(0, found)
            return found, found.newest
        for count in counts:
            behind = (count.newest - sequence) % 256
            if behind < REORDERED_FRAMES and now_s - count.newest_s < REORDERED_S:
                return count, count.newest - behind
        begun = _Count(now_s, sequence)
        kept = [count for count in counts if now_s - count.newest_s < COUNT_KEPT_S]
        self._counts = [begun, *kept[: COUNTS_AT_MOST - 1]]
        return begun, sequence
