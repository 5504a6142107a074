"""The swarm's network: zenoh peers that connect to each other directly, at endpoints that are written down.

No multicast (many radios have none) and no broker (its loss would silence everybody). Every node listens where its
configuration says and connects to the endpoints that it is told, for ever; gossip adds peers that are not written
down. A connection made by gossip alone is *not* made again after it broke while the rest of the mesh stayed up.

So the best `connect` is one list of all nodes' endpoints, the same on every node: each pair then has one connection,
made and made again by the later one in the list, and gossip is not needed. A single endpoint is enough for a
mesh whose nodes all come and stay.

Swarms of several sites are joined by a zenoh router, which stands first in the list (docs/sites.md): the nodes of a
site are such a mesh among themselves, and the router relays between one site and another, never within one.
"""

from __future__ import annotations

import logging
import queue
import re
import threading
import time
from collections.abc import Iterable, Sequence
from typing import Final

import zenoh

from flightstack.config import TlsConfig
from flightstack.swarm.topics import Delivery, Received, Topic
from flightstack.transport import TransportError
from flightstack.transport.access_rules import ALIVE, access_rules
from flightstack.transport.backlog import trimmed
from flightstack.transport.certificates import check_readable
from flightstack.transport.inbox import Inbox, drained, last_word
from flightstack.transport.linger import stop_lingering
from flightstack.transport.router_watch import RouterWatch
from flightstack.transport.zenoh_options import peer_options
from flightstack.transport.zenoh_session import (
    CLOSE_WITHIN_S,
    close_session,
    configured,
    open_session,
    zenoh_reason,
)

log = logging.getLogger(__name__)

_NEWS_AT_MOST: Final = 4096
"""Of connections and of who is there, between two looks."""
_WORD: Final = re.compile(r"[A-Za-z0-9_-]+")


class ZenohTransport:
    """One node of the swarm, as `flightstack.transport.Transport` describes it. Opening does not wait for peers."""

    def __init__(
        self,
        swarm: str,
        node: int | str,
        listen: Sequence[str],
        connect: Sequence[str],
        receives: Iterable[Topic],
        tls: TlsConfig | None = None,
        members: Iterable[int] = (),
        site: str | None = None,
    ) -> None:
        """Open the session and subscribe to `receives`.

        `listen` and `connect` are zenoh endpoints ("tcp/10.0.0.3:7447"). A node that listens nowhere reaches
        only the nodes that it connects to. With `tls` every endpoint is "tls/…", both ends of a connection show a
        certificate of the swarm's authority, and of drones only `members` are listened to, each in its own name.

        Raises `TransportError` for a bad endpoint, one that cannot be listened on, or certificates that nobody
        would believe.
        """
        self.node = str(node)
        for what, word in (("swarm", swarm), ("node", self.node)):
            if not _WORD.fullmatch(word):
                raise TransportError(f"{what} name {word!r}: use letters, digits, - and _ only")
        drones = tuple(members)
        self._swarm = swarm
        self._closed = False
        options = peer_options(listen, connect, tls, site)
        if tls is not None:
            check_readable(tls)
            options["access_control"] = access_rules(swarm, drones, tls)
        self._session = open_session(configured(options), listen)
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._inbox = Inbox(self._session, swarm, receives, drones, tls)
        self._links = self._session.info.declare_link_events_listener(
            zenoh.handlers.RingChannel(_NEWS_AT_MOST), history=True
        )
        self._alive: set[str] = set()
        liveliness = self._session.liveliness()
        self._presence = liveliness.declare_subscriber(
            f"flightstack/{swarm}/{ALIVE}/*", zenoh.handlers.RingChannel(_NEWS_AT_MOST), history=True
        )
        self._token = liveliness.declare_token(f"flightstack/{swarm}/{ALIVE}/{self.node}")
        self._router = None if site is None else RouterWatch(self._has_router, site)
        self._outbox = _Outbox()
        self._failing: set[str] = set()

    def publish(self, topic: Topic, payload: bytes) -> None:
        if self._closed:
            raise TransportError(f"node {self.node} has left the swarm's network")
        publisher = self._publishers.get(topic.name)
        if publisher is None:
            publisher = self._publishers[topic.name] = self._declare(topic)
        if topic.delivery is Delivery.RELIABLE:
            self._outbox.put(publisher, payload)
        else:
            self._put(topic, publisher, payload)

    def receive(self) -> list[Received]:
        if self._closed:
            raise TransportError(f"node {self.node} has left the swarm's network")
        if drained(self._links):
            stop_lingering()
        if self._router is not None:
            self._router.look(time.monotonic())
        return trimmed(self._inbox.take())

    def alive(self) -> set[str]:
        """The other nodes whose processes are connected, by name: a hint that comes before their silence shows.

        A live process is not yet a live agent: only its messages prove that.
        """
        for sample in drained(self._presence):
            name = last_word(sample.key_expr)
            if sample.kind == zenoh.SampleKind.PUT:
                self._alive.add(name)
            else:
                self._alive.discard(name)
        return self._alive - {self.node}

    def close(self) -> None:
        """Leave the network. What is still queued of reliable topics is sent first, if that takes no time."""
        if self._closed:
            return
        self._closed = True
        self._outbox.close()
        close_session(self._session, "leaving the swarm's network")

    def _has_router(self) -> bool:
        return bool(self._session.info.routers_zid())

    def _put(self, topic: Topic, publisher: zenoh.Publisher, payload: bytes) -> None:
        """Send at once. A network that fails must not end a flight: it is told once and the drone flies on."""
        try:
            publisher.put(payload)
        except zenoh.ZError as error:
            if topic.name not in self._failing:
                self._failing.add(topic.name)
                log.error("%s messages cannot be sent: %s", topic.name, zenoh_reason(error))
        else:
            self._failing.discard(topic.name)

    def _declare(self, topic: Topic) -> zenoh.Publisher:
        reliable = topic.delivery is Delivery.RELIABLE
        return self._session.declare_publisher(
            topic.key(self._swarm, self.node),
            congestion_control=zenoh.CongestionControl.BLOCK if reliable else zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.INTERACTIVE_HIGH if reliable else zenoh.Priority.DATA,
            reliability=zenoh.Reliability.RELIABLE if reliable else zenoh.Reliability.BEST_EFFORT,
            express=reliable,
        )


class _Outbox:
    """Sends reliable messages from a thread of its own: a put may wait for a stalled peer, a tick must not."""

    CAPACITY: Final = 1000

    def __init__(self) -> None:
        self._queue: queue.Queue[tuple[zenoh.Publisher, bytes] | None] = queue.Queue(self.CAPACITY)
        self._thread: threading.Thread | None = None

    def put(self, publisher: zenoh.Publisher, payload: bytes) -> None:
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="zenoh-outbox", daemon=True)
            self._thread.start()
        try:
            self._queue.put_nowait((publisher, payload))
        except queue.Full:
            log.error("a message on %s is lost: %d wait unsent", publisher.key_expr, self.CAPACITY)

    def close(self) -> None:
        if self._thread is None:
            return
        try:
            self._queue.put_nowait(None)
        except queue.Full:
            return  # the thread is stuck and a daemon; what it holds cannot be sent
        self._thread.join(CLOSE_WITHIN_S)

    def _run(self) -> None:
        while (item := self._queue.get()) is not None:
            publisher, payload = item
            try:
                publisher.put(payload)
            except zenoh.ZError as error:
                log.error("a message on %s is lost: %s", publisher.key_expr, zenoh_reason(error))
