"""How a PX4 speaks: events on every link, and for ground stations the same in texts.

https://mavlink.io/en/services/events.html: an event has a number (24 bits of the FNV-1a hash of its name), arguments,
and a place in a sequence by which whoever missed it asks for it again. Texts that an event says too end in a tab.
"""

from __future__ import annotations

from collections import deque
from typing import Any

from flightstack.mavlink.dialect import (
    CurrentEventSequenceMessage,
    EventMessage,
    ResponseEventErrorMessage,
)
from flightstack.mavlink.px4_event_table import event_id
from simvehicle.autopilot.announcer import Announcer
from simvehicle.autopilot.channel import Channel, ChannelPeer, Handler
from simvehicle.autopilot.flight import Flight

_SEQUENCE_S = 3.0
_KEPT = 20
_FIRST = 65527
"""The recorded one counts from there: whoever listens must cope with the turn to 0."""
PROTOCOL = 8
"""The severity of what is for programs only."""
_RESET = 1


class Px4Voice:
    def __init__(self, flight: Flight, announcer: Announcer) -> None:
        self._flight = flight
        self._announcer = announcer
        self._sequence = _FIRST - 1
        self._kept: deque[EventMessage] = deque(maxlen=_KEPT)
        self._told_s = 0.0

    def say(self, severity: int, text: str) -> None:
        """A text that no event says."""
        self._announcer.say(severity, text)

    def tell(
        self,
        name: str,
        severity: int,
        arguments: bytes = b"",
        *,
        text: str = "",
        text_severity: int | None = None,
    ) -> None:
        """An event, and the text that says the same to ground stations, where there is one."""
        if text:
            self._announcer.say(severity if text_severity is None else text_severity, text + "\t")
        self._sequence = (self._sequence + 1) % 65536
        message = EventMessage(
            destination_component=0,
            destination_system=0,
            id=event_id(name),
            event_time_boot_ms=int(self._flight.time_s * 1000),
            sequence=self._sequence,
            log_levels=severity << 4 | severity,
            arguments=tuple(arguments.ljust(40, b"\0")),
        )
        self._kept.append(message)
        self._announcer.post(message)

    def step(self, now_s: float) -> None:
        if now_s - self._told_s >= _SEQUENCE_S:
            self._told_s = now_s
            flags = 0 if self._kept else _RESET
            self._announcer.broadcast(CurrentEventSequenceMessage(sequence=self._sequence, flags=flags))

    def handlers(self) -> dict[str, Handler]:
        return {"REQUEST_EVENT": self._again}

    def _again(self, channel: Channel, peer: ChannelPeer, message: Any) -> None:
        wanted = (message.last_sequence - message.first_sequence) % 65536 + 1
        kept = {event.sequence: event for event in self._kept}
        for step in range(min(wanted, 2 * _KEPT)):
            sequence = (message.first_sequence + step) % 65536
            event = kept.get(sequence)
            if event is None:
                event = ResponseEventErrorMessage(
                    target_system=peer.system,
                    target_component=peer.component,
                    sequence=sequence,
                    sequence_oldest_available=min(kept, default=self._sequence),
                    reason=0,
                )
            channel.send(event)
