"""Which messages are for a simulated autopilot, who handles them, and what it passes on to its other links."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from flightstack.mavlink.framing import MavlinkFrame
from simvehicle.autopilot.channel import Channel, ChannelPeer, Handler

_KEPT = ("SETUP_SIGNING",)
"""Never handed on: it holds the key."""
_FORWARDED_TO_ALL = ("HEARTBEAT", "STATUSTEXT", "NAMED_VALUE_FLOAT")
"""Broadcasts that are handed to the other links. (Real autopilots hand on all of them; the rest is not needed.)"""


class MessageRouter:
    """One per vehicle."""

    def __init__(
        self, system: int, channels: Sequence[Channel], handlers: Mapping[str, Handler], others: Handler
    ) -> None:
        """`handlers` by message type; `others` gets what none of them takes."""
        self._system = system
        self._channels = channels
        self._handlers = handlers
        self._others = others

    def receive(self, channel: Channel, data: bytes) -> None:
        for frame, message in channel.parse(data):
            peer = ChannelPeer(channel.link, frame.system, frame.component)
            if (peer.system, peer.component) == (self._system, 1):
                continue  # our own words, looped back by a link
            channel.peers.add((peer.system, peer.component))
            self._route(channel, peer, frame, message)

    def _route(self, channel: Channel, peer: ChannelPeer, frame: MavlinkFrame, message: Any) -> None:
        target = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        own, name = target == self._system, message.get_type()
        if target == 0 or (own and component in (0, 1)):
            self._handlers.get(name, self._others)(channel, peer, message)
        if name in _KEPT:
            return
        if target != 0 and not (own and component == 1):
            for other in self._channels:
                if other is not channel and any(
                    system == target and component in (0, each) for system, each in other.peers
                ):
                    other.forward(frame)
        elif target == 0 and name in _FORWARDED_TO_ALL:
            for other in self._channels:
                if other is not channel and other.peers:
                    other.forward(frame)
