"""One MAVLink connection of a simulated autopilot: its parser, its sequence numbers, its message rates, its peers.

Everything that a real autopilot keeps per serial port or UDP connection is in here, so that nothing leaks from
one link to another.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from flightstack.mavlink.codec import MavlinkCodec
from flightstack.mavlink.fields import layout
from flightstack.mavlink.framing import FrameFinder, MavlinkFrame


class ChannelPeer(NamedTuple):
    """Whoever speaks to the autopilot: state is kept by all three."""

    link: int
    system: int
    component: int


_GROUND_HEARD_S = 3.0
"""After its last heartbeat a ground station counts as there for so long."""

Handler = Callable[["Channel", ChannelPeer, Any], None]
"""Takes a message that came in on a channel from a peer."""


@dataclasses.dataclass(slots=True)
class Stream:
    interval_s: float
    due_s: float


class Signatures(Protocol):
    """The vehicle's, on all links."""

    def believes(self, link: int, frame: MavlinkFrame) -> bool: ...

    def sign(self, link: int, frame: bytes) -> bytes: ...


class Channel:
    """Bytes in, messages out; messages in, bytes out. No sockets."""

    def __init__(self, link: int, system: int, signatures: Signatures) -> None:
        self.link = link
        self._signatures = signatures
        self._sender = MavlinkCodec(system, 1)
        self._finder = FrameFinder(known_only=True)
        self._out: list[bytes] = []
        self.streams: dict[int, Stream] = {}
        self.next_due_s = float("inf")
        self.ground_heard_s = float("-inf")
        """When a ground station's heartbeat came last."""
        self.peers: set[tuple[int, int]] = set()
        """(system, component) heard on this link: what is addressed to them is forwarded here."""

    def hears_ground(self, now_s: float) -> bool:
        return now_s - self.ground_heard_s <= _GROUND_HEARD_S

    def parse(self, data: bytes) -> list[tuple[MavlinkFrame, Any]]:
        """The whole frames that `data` completes, with their fields (`flightstack.mavlink.fields`).

        Damaged ones are dropped, as on the air, and so is what the dialect does not know and what is not believed.
        """
        return [
            (frame, layout(frame.kind).unpack(frame.payload))
            for frame in self._finder.find(data)
            if self._signatures.believes(self.link, frame)
        ]

    def send(self, message: Any) -> None:
        self._out.append(self._signatures.sign(self.link, self._sender.encode(message)))

    def pass_on(self, data: bytes) -> None:
        """A frame of another component of this vehicle, signed as the autopilot's own."""
        self._out.append(self._signatures.sign(self.link, data))

    def forward(self, frame: MavlinkFrame) -> None:
        """Pass on another component's message as it came, with its signature or without."""
        self._out.append(frame.data)

    def drain(self) -> list[bytes]:
        out, self._out = self._out, []
        return out

    def set_stream(self, message_id: int, interval_s: float | None, now_s: float) -> None:
        """Send a message every `interval_s` from now on, or no more (None)."""
        if interval_s is None:
            self.streams.pop(message_id, None)
        else:
            self.streams[message_id] = Stream(interval_s, now_s + interval_s)
        self.next_due_s = min((s.due_s for s in self.streams.values()), default=float("inf"))

    def take_due(self, now_s: float) -> list[int]:
        """Messages whose time has come; each is due again one interval later."""
        if now_s < self.next_due_s:
            return []
        due: list[int] = []
        next_due_s = float("inf")
        for message_id, stream in self.streams.items():
            if stream.due_s <= now_s + 1e-6:
                due.append(message_id)
                stream.due_s += stream.interval_s
                if stream.due_s <= now_s:  # a gap: go on from here instead of catching up with a burst
                    stream.due_s = now_s + stream.interval_s
            next_due_s = min(next_due_s, stream.due_s)
        self.next_due_s = next_due_s
        return due
