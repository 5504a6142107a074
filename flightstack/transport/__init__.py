"""Messages between drones and ground stations: one small interface, two implementations.

`flightstack.transport.zenoh_transport.ZenohTransport` between processes and machines,
`flightstack.transport.memory.MemoryRadio` inside one process, as good as a `RadioModel` says.
`tests/contract/test_transport.py` holds both to the same behaviour.
"""

from __future__ import annotations

from typing import Protocol

from flightstack.swarm.topics import Received, Topic


class TransportError(RuntimeError):
    """The network cannot be set up as configured; one line that says what and where."""


class Transport(Protocol):
    """A node's connection to the swarm. None of its methods waits for a peer."""

    def publish(self, topic: Topic, payload: bytes) -> None:
        """Send to everybody who listens to `topic`, as this node. The node does not hear itself."""
        ...

    def receive(self) -> list[Received]:
        """Everything that has come since the last call, oldest first.

        Of a best-effort topic only the newest few messages of each sender are kept between two calls; reliable
        topics keep all.
        """
        ...

    def close(self) -> None: ...
