"""MAVLink bytes to the few messages that are wanted, in any chunking and between any garbage.

An autopilot's link may carry hundreds of messages a second of which the agent needs a few dozen. Frames of other
kinds are stepped over by their header; only wanted ones are checked and decoded (by pymavlink), which keeps a
tick cheap on a small computer.
"""

from __future__ import annotations

from collections.abc import Set as AbstractSet
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.sequence import SequenceFilter

V1_MAGIC = 0xFE
V2_MAGIC = 0xFD
V1_OVERHEAD = 8
"""Header (6) and checksum (2) of MAVLink 1."""
V2_OVERHEAD = 12
SIGNATURE_LENGTH = 13
SIGNED = 0x01
"""The only incompatibility flag there is; a frame with another one must not be interpreted."""


class FrameReader:
    """Decodes the messages of one `system` whose id is in `states` or `events`, and any system's heartbeats.

    Of a state only newer messages come out; of events every one, once (`sequence`).
    """

    def __init__(self, system: int, states: AbstractSet[int], events: AbstractSet[int]) -> None:
        self._system = system
        self._wanted = frozenset(states | events)
        self._events = frozenset(events)
        self._senders: dict[int, SequenceFilter] = {}
        """By component of our system."""
        self._buffer = bytearray()
        self._decoder = mavlink.MAVLink(None)
        self.decoded = 0
        self.skipped = 0
        """Frames of kinds nobody wants."""
        self.bad_frames = 0
        """Frames of a wanted kind whose checksum was wrong."""
        self.late_frames = 0
        """Wanted frames that came twice, or after a newer one."""

    def read(self, now_s: float, data: bytes) -> list[Any]:
        """The wanted messages completed by `data`, in order. An incomplete frame waits for the next call."""
        buffer = self._buffer
        buffer += data
        messages: list[Any] = []
        start, end = 0, len(buffer)
        while True:
            start = self._next_magic(start)
            if start < 0:
                start = end
                break
            left = end - start
            if left < V1_OVERHEAD:
                break
            is_v2 = buffer[start] == V2_MAGIC
            if is_v2 and left < V2_OVERHEAD:
                break
            length, kind = self._header(start, is_v2)
            if length == 0:
                start += 1
                continue
            if left < length:
                break
            sequence, system, component = self._identity(start, is_v2)
            ours = system == self._system
            if kind not in self._wanted or not (ours or kind == mavlink.MAVLINK_MSG_ID_HEARTBEAT):
                if not self._is_frame(start, length, end):
                    start += 1
                    continue
                self.skipped += 1
                if ours:
                    self._sender(component).count(now_s, sequence)
            else:
                message = self._decode(start, length)
                if message is None:
                    start += 1
                    continue
                if ours and not self._counts(now_s, component, sequence, kind):
                    self.late_frames += 1
                else:
                    self.decoded += 1
                    messages.append(message)
            start += length
        del buffer[:start]
        return messages

    def _next_magic(self, start: int) -> int:
        """Index of the next byte that may begin a frame, -1 if there is none."""
        v2 = self._buffer.find(V2_MAGIC, start)
        v1 = self._buffer.find(V1_MAGIC, start, v2 if v2 >= 0 else len(self._buffer))
        return v1 if v1 >= 0 else v2

    def _header(self, start: int, is_v2: bool) -> tuple[int, int]:
        """(length of the whole frame, message id); length 0 for a header that cannot be one."""
        buffer = self._buffer
        if not is_v2:
            return buffer[start + 1] + V1_OVERHEAD, buffer[start + 5]
        flags = buffer[start + 2]
        if flags & ~SIGNED:
            return 0, 0
        signature = SIGNATURE_LENGTH if flags & SIGNED else 0
        kind = buffer[start + 7] | buffer[start + 8] << 8 | buffer[start + 9] << 16
        return buffer[start + 1] + V2_OVERHEAD + signature, kind

    def _identity(self, start: int, is_v2: bool) -> tuple[int, int, int]:
        """(sequence number, system, component)."""
        at = start + (4 if is_v2 else 2)
        return self._buffer[at], self._buffer[at + 1], self._buffer[at + 2]

    def _sender(self, component: int) -> SequenceFilter:
        sender = self._senders.get(component)
        if sender is None:
            sender = self._senders[component] = SequenceFilter(self._events)
        return sender

    def _counts(self, now_s: float, component: int, sequence: int, kind: int) -> bool:
        sender = self._sender(component)
        return sender.is_new(sender.count(now_s, sequence), kind)

    def _is_frame(self, start: int, length: int, end: int) -> bool:
        """Whether the unwanted frame at `start` is one: a false start could swallow a real frame.

        It is believed unchecked if another one follows it at once, or nothing yet.
        """
        follows = start + length
        if follows == end or self._buffer[follows] in (V1_MAGIC, V2_MAGIC):
            return True
        try:
            self._decoder.decode(self._buffer[start : start + length])
        except mavlink.MAVError:
            return False
        return True

    def _decode(self, start: int, length: int) -> Any | None:
        try:
            message = self._decoder.decode(self._buffer[start : start + length])
        except mavlink.MAVError:
            self.bad_frames += 1
            return None
        return message
