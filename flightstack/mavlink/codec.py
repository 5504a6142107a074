"""One end of one MAVLink link, without the link: bytes to messages, messages to bytes.

Agent and ground station each have one for every link. It knows who we are, numbers what we send, steps over what
nobody asked for, and hands out of every sender each state only if it is newer and each event only once. Time is an
argument.
"""

from __future__ import annotations

from collections.abc import Set as AbstractSet
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.fields import layout
from flightstack.mavlink.framing import FrameFinder, MavlinkFrame, is_signed, pack_frame
from flightstack.mavlink.sequence import SequenceFilter

SENDERS_AT_MOST = 1024
"""More than any radio carries: a fault that makes up ids must not fill the memory."""


class MavlinkMessage(NamedTuple):
    """One message that counts."""

    kind: int
    """Message id."""
    system: int
    component: int
    fields: Any
    """The payload's values by the dialect's names."""

    @property
    def name(self) -> str:
        """As the dialect writes it: HEARTBEAT."""
        return layout(self.kind).name


class Reception(NamedTuple):
    """A frame, and the message in it if somebody wants it and it is new."""

    frame: MavlinkFrame
    message: MavlinkMessage | None


class MavlinkCodec:
    """Decoder and encoder of one link."""

    def __init__(
        self,
        system: int,
        component: int,
        states: AbstractSet[int] = frozenset(),
        events: AbstractSet[int] = frozenset(),
        *,
        only_system: int | None = None,
    ) -> None:
        """`system` and `component` are ours. What is read is told by message ids: of `states` a newer one replaces an
        older one, of `events` every one counts. With `only_system` nothing of other systems is read, but for
        heartbeats.
        """
        self._system = system
        self._component = component
        self._events = frozenset(events)
        self._wanted = frozenset(states) | self._events
        self._only_system = only_system
        self._finder = FrameFinder()
        self._senders: dict[tuple[int, int], SequenceFilter] = {}
        self._packer = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self.signers: set[tuple[int, int]] = set()
        """System and component of who signs what they say, with whatever key."""
        self.late_frames = 0
        """Wanted frames that came twice, or after a newer one."""

    @property
    def bad_frames(self) -> int:
        """What looked like a frame and was none, or was damaged on the way."""
        return self._finder.bad_frames

    def receive(self, now_s: float, data: bytes) -> list[MavlinkMessage]:
        """The wanted messages completed by `data`, in order."""
        found = (self._message(now_s, whole) for whole in self._finder.find(data))
        return [message for message in found if message is not None]

    def receive_frames(self, now_s: float, data: bytes) -> list[Reception]:
        """As `receive`, with every frame that came, for a log."""
        return [Reception(found, self._message(now_s, found)) for found in self._finder.find(data)]

    def _message(self, now_s: float, whole: MavlinkFrame) -> MavlinkMessage | None:
        kind, sequence, system, component, payload, data = whole
        foreign = self._only_system is not None and system != self._only_system
        if foreign and kind != mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            return None
        sender = self._senders.get((system, component))
        if sender is None:
            if len(self._senders) >= SENDERS_AT_MOST:
                self._forget_one()
            sender = self._senders[system, component] = SequenceFilter(self._events)
        if is_signed(data):
            self.signers.add((system, component))
        is_news = sender.is_news(now_s, sequence, kind)
        if kind not in self._wanted:
            return None
        if not is_news:
            self.late_frames += 1
            return None
        return MavlinkMessage(kind, system, component, layout(kind).unpack(payload))

    def _forget_one(self) -> None:
        """The sender that was heard longest ago."""
        oldest = min(self._senders, key=lambda ids: self._senders[ids].heard_s)
        del self._senders[oldest]
        self.signers.discard(oldest)

    def is_answer_to_us(self, message: MavlinkMessage) -> bool:
        """Whether a COMMAND_ACK is for us. Without the extension fields (MAVLink 1) nobody knows whom it answers."""
        target = (message.fields.target_system, message.fields.target_component)
        return target in ((0, 0), (self._system, self._component))

    def encode(self, message: Any) -> bytes:
        """The frame of one of pymavlink's messages, with our ids and the next sequence number."""
        packer, plan = self._packer, layout(message.get_msgId())
        if plan.is_plain:
            payload = plan.pack(message)
            data = pack_frame(message.get_msgId(), packer.seq, self._system, self._component, payload)
        else:
            data = bytes(message.pack(packer))
        packer.seq = (packer.seq + 1) % 256
        return data
