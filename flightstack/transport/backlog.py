"""What a node keeps of the messages that came between two calls of `receive`."""

from __future__ import annotations

import collections
from collections.abc import Iterable
from typing import Final

from flightstack.swarm.topics import Delivery, Received

KEPT_PER_SENDER: Final = 4
"""Newest messages of one best-effort topic kept of each sender: after a stall, old states are only work."""


def trimmed(messages: Iterable[Received]) -> list[Received]:
    """`messages` (oldest first) without the best-effort ones that newer ones of their sender have overtaken."""
    kept: list[Received] = []
    counts: collections.Counter[tuple[str, str]] = collections.Counter()
    for message in reversed(list(messages)):
        if message.topic.delivery is Delivery.BEST_EFFORT:
            source = (message.topic.name, message.sender)
            counts[source] += 1
            if counts[source] > KEPT_PER_SENDER:
                continue
        kept.append(message)
    kept.reverse()
    return kept
