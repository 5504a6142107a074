"""A zenoh router in this process, between the sites of a swarm: what `zenohd` does, and no lingering connections.

A router whose connection to one node hangs must not keep the others waiting for ten seconds (`linger`).
"""

from __future__ import annotations

import json
import logging

import zenoh

from flightstack.transport.linger import stop_lingering
from flightstack.transport.zenoh_session import close_session, open_session

log = logging.getLogger(__name__)


class ZenohRouter:
    """Relays from the moment it is made until it is closed; `look` now and then."""

    def __init__(self, config: zenoh.Config) -> None:
        """`config`: as of `zenoh_options.router_options`, or of its file. `TransportError` if it cannot listen."""
        self._session = open_session(config, json.loads(config.get_json("listen/endpoints")))
        self._links = self._session.info.declare_link_events_listener(
            zenoh.handlers.RingChannel(1024), history=True
        )

    def look(self) -> None:
        """Tell in the log who came and who went."""
        changed = False
        while (event := self._links.try_recv()) is not None:
            changed = True
            came = event.kind == zenoh.SampleKind.PUT
            who = event.link.auth_identifier or "a node"
            log.info("%s %s (%s)", who, "is connected" if came else "is gone", event.link.dst)
        if changed:
            stop_lingering()

    def close(self) -> None:
        """Leave everybody."""
        close_session(self._session, "closing the router")
