"""What waits at a node until its radio has sent what came before."""

from __future__ import annotations

import collections
from collections.abc import Iterator
from typing import Final, NamedTuple

from flightstack.swarm.topics import Delivery, Received

HEADERS_BYTES: Final = 80
"""What goes over the air with every message: IP 20, TCP with time stamps 32, zenoh's frame and key about 28."""


class Copy(NamedTuple):
    """One message on its way to one receiver."""

    receiver: str
    message: Received

    @property
    def size_bytes(self) -> int:
        return len(self.message.payload) + HEADERS_BYTES


class TransmitQueue:
    """First in, first out, one copy after the other.

    Where more than `most_bytes` wait, the oldest best-effort copies are dropped: newer ones say the same and better.
    Reliable ones wait, however many they are. What is being sent is sent to its end.
    """

    def __init__(self, bandwidth_bytes_per_s: float, most_bytes: int) -> None:
        self._bandwidth_bytes_per_s = bandwidth_bytes_per_s
        self._most_bytes = most_bytes
        self._sending: tuple[float, Copy] | None = None
        """When it has left, and what."""
        self._waiting: collections.deque[Copy] = collections.deque()
        self._waiting_bytes = 0

    def put(self, now_s: float, copy: Copy) -> None:
        """Send `copy` when its turn comes. Whoever calls has taken what had left by `now_s`."""
        if self._sending is None:
            self._send(now_s, copy)
            return
        self._waiting.append(copy)
        self._waiting_bytes += copy.size_bytes
        while self._waiting_bytes > self._most_bytes and self._drop_oldest():
            pass

    def departed(self, now_s: float) -> Iterator[tuple[float, Copy]]:
        """What has left by `now_s`, with the time at which its last byte did, in order."""
        while self._sending is not None and self._sending[0] <= now_s:
            left_s, copy = self._sending
            self._sending = None
            if self._waiting:
                following = self._waiting.popleft()
                self._waiting_bytes -= following.size_bytes
                self._send(left_s, following)
            yield left_s, copy

    def _send(self, starts_s: float, copy: Copy) -> None:
        self._sending = (starts_s + copy.size_bytes / self._bandwidth_bytes_per_s, copy)

    def _drop_oldest(self) -> bool:
        """Whether there was a best-effort copy to drop."""
        for index, copy in enumerate(self._waiting):
            if copy.message.topic.delivery is Delivery.BEST_EFFORT:
                del self._waiting[index]
                self._waiting_bytes -= copy.size_bytes
                return True
        return False
