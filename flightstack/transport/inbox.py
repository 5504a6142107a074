"""What has come over zenoh since it was looked at last, in a ring for every sender that may speak.

A sender that floods pushes out its own messages and nobody else's. Who may speak is known where the network is
encrypted (`access_rules`); elsewhere everybody has any name, and all share one ring a topic.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from typing import Any, Final

import zenoh

from flightstack.config import TlsConfig
from flightstack.swarm.topics import Delivery, Received, Topic
from flightstack.transport.access_rules import speakers_of

log = logging.getLogger(__name__)

_OF_ONE: Final = {Delivery.BEST_EFFORT: 64, Delivery.RELIABLE: 512}
"""Samples of one topic of one sender: of states seconds, of which only the newest few are read."""
_OF_ALL: Final = {Delivery.BEST_EFFORT: 1024, Delivery.RELIABLE: 4096}
"""Of one topic where everybody shares one: ten seconds of twenty senders at 5 Hz."""
_BYTES_OF_ONE: Final = 1 << 18
"""Of one sender's ring at once: all that is read is decoded and recorded, too."""
_BYTES_OF_ALL: Final = 1 << 22
_ANYBODY: Final = "*"


class Inbox:
    def __init__(
        self,
        session: zenoh.Session,
        swarm: str,
        receives: Iterable[Topic],
        members: Iterable[int],
        tls: TlsConfig | None,
    ) -> None:
        drones = tuple(members)
        self._rings: list[tuple[Topic, str, int, Any]] = []
        self._told: set[tuple[str, str]] = set()
        for topic in receives:
            for name in [_ANYBODY] if tls is None else speakers_of(topic, drones, tls):
                size = (_OF_ALL if name == _ANYBODY else _OF_ONE)[topic.delivery]
                # Ring buffers, because a full FIFO stops zenoh's own thread and with it all other topics; polled,
                # because a callback costs a thread's wake-up for every message and its exceptions go nowhere.
                ring = session.declare_subscriber(
                    topic.key(swarm, name),
                    zenoh.handlers.RingChannel(size),
                    allowed_origin=zenoh.Locality.REMOTE,
                )
                self._rings.append((topic, name, size, ring))

    def take(self) -> list[Received]:
        """All that is there, of each topic and sender oldest first."""
        messages: list[Received] = []
        for topic, name, size, ring in self._rings:
            samples = drained(ring)
            kept = _newest(samples, _BYTES_OF_ALL if name == _ANYBODY else _BYTES_OF_ONE)
            overflown = len(samples) >= size and topic.delivery is Delivery.RELIABLE
            if overflown or len(kept) < len(samples):
                self._tell(topic, name, len(samples))
            messages += [Received(topic, word, payload) for word, payload in kept]
        return messages

    def _tell(self, topic: Topic, name: str, count: int) -> None:
        """Once: who floods does not fill the log either."""
        if (topic.name, name) not in self._told:
            self._told.add((topic.name, name))
            whose = "" if name == _ANYBODY else f" of {name}"
            log.error("%d %s messages%s came at once: older ones may be lost", count, topic.name, whose)


def _newest(samples: Sequence[Any], most_bytes: int) -> list[tuple[str, bytes]]:
    """Senders and payloads, oldest first, of as many of the newest as fit, and of one at least."""
    kept: list[tuple[str, bytes]] = []
    total = 0
    for sample in reversed(samples):
        payload = sample.payload.to_bytes()
        total += len(payload)
        if kept and total > most_bytes:
            break
        kept.append((last_word(sample.key_expr), payload))
    kept.reverse()
    return kept


def drained(source: Any) -> list[Any]:
    samples = []
    while (sample := source.try_recv()) is not None:
        samples.append(sample)
    return samples


def last_word(key: zenoh.KeyExpr) -> str:
    return str(key).rpartition("/")[2]
