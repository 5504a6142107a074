"""MAVLink frames in bytes, in any chunking and between any garbage: found by header, proven by checksum.

Nothing is unpacked here: what a frame is about stands in its header, and most frames on a link are about what nobody
asked for.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.dialect import MESSAGES

V1_MAGIC = 0xFE
V2_MAGIC = 0xFD
V1_HEADER_LENGTH = 6
V2_HEADER_LENGTH = 10
CHECKSUM_LENGTH = 2
SIGNATURE_LENGTH = 13
SIGNED = 0x01
"""The only incompatibility flag there is; a frame with another one must not be interpreted."""

_CHECKSUM_SEEDS = {kind: bytes((message.crc_extra,)) for kind, message in MESSAGES.items()}
"""The byte that stands for a message's definition in its checksum, by message id."""

_MCRF4XX: Final[Callable[[bytes], int] | None] = getattr(mavlink, "mcrf4xx", None)
_V2_HEADER: Final = struct.Struct("<BBBBBBBHB")


class MavlinkFrame(NamedTuple):
    """One whole frame. Its checksum is right, or it is of a kind that is not in the dialect."""

    kind: int
    """Message id."""
    sequence: int
    system: int
    component: int
    payload: bytes
    """As it came: MAVLink 2 leaves out zeros at its end."""
    data: bytes
    """All of it, as it came."""


class FrameFinder:
    """Cuts the bytes of one link into frames; `bad_frames` counts what looked like one and was none."""

    def __init__(self, *, known_only: bool = False) -> None:
        """`known_only`: what the dialect does not know is no frame. It has no checksum that can be proven, so
        that who makes one up takes with it what others say next."""
        self._known_only = known_only
        self._rest = b""
        self.bad_frames = 0

    def find(self, data: bytes) -> list[MavlinkFrame]:
        """The frames completed by `data`, in order. An incomplete frame waits for the next call."""
        buffer = self._rest + data if self._rest else data
        frames: list[MavlinkFrame] = []
        start, end = _next_magic(buffer, 0), len(buffer)
        while start < end:
            if end - start < V1_HEADER_LENGTH:
                break
            if buffer[start] == V2_MAGIC:
                if end - start < V2_HEADER_LENGTH:
                    break
                body, signed = start + V2_HEADER_LENGTH, buffer[start + 2]
                after_body = body + buffer[start + 1]
                stop = after_body + CHECKSUM_LENGTH + (SIGNATURE_LENGTH if signed else 0)
                sound = not signed & ~SIGNED
                kind = buffer[start + 7] | buffer[start + 8] << 8 | buffer[start + 9] << 16
                identity = start + 4
            else:
                body, sound = start + V1_HEADER_LENGTH, True
                after_body = body + buffer[start + 1]
                stop = after_body + CHECKSUM_LENGTH
                kind = buffer[start + 5]
                identity = start + 2
            unknown = kind not in _CHECKSUM_SEEDS
            sound = sound and not (unknown and self._known_only)
            if sound and stop > end - unknown:  # of the unknown the next byte must be seen
                break
            if sound and _is_frame(buffer, start, after_body, stop, kind):
                sequence, system, component = buffer[identity : identity + 3]
                payload = buffer[body:after_body]
                frames.append(MavlinkFrame(kind, sequence, system, component, payload, buffer[start:stop]))
            else:
                # Go on just behind its first byte: a false start may have covered a real frame.
                self.bad_frames += 1
                stop = start + 1
            start = _next_magic(buffer, stop)
        self._rest = buffer[start:]
        return frames


def _next_magic(buffer: bytes, start: int) -> int:
    """Index of the next byte that may begin a frame, the buffer's length if there is none."""
    if start >= len(buffer) or buffer[start] == V2_MAGIC:
        return start
    v2 = buffer.find(V2_MAGIC, start)
    v1 = buffer.find(V1_MAGIC, start, v2 if v2 >= 0 else len(buffer))
    if v1 >= 0:
        return v1
    return v2 if v2 >= 0 else len(buffer)


def _is_frame(buffer: bytes, start: int, after_body: int, stop: int, kind: int) -> bool:
    """Whether the checksum is right. Without a definition nobody can tell: then the next byte must begin a frame."""
    seed = _CHECKSUM_SEEDS.get(kind)
    if seed is None:
        return buffer[stop] in (V1_MAGIC, V2_MAGIC)
    return _checksum(buffer[start + 1 : after_body], seed) == buffer[after_body] | buffer[after_body + 1] << 8


def _checksum(covered: bytes, seed: bytes) -> int:
    # The function under pymavlink's class, where it is installed: on a link every frame is summed at both ends, and
    # the class takes four times as long.
    checksum: int = _MCRF4XX(covered + seed) if _MCRF4XX else mavlink.x25crc(covered + seed).crc
    return checksum


def pack_frame(kind: int, sequence: int, system: int, component: int, payload: bytes) -> bytes:
    """An unsigned MAVLink 2 frame. KeyError if the dialect has no message of this kind."""
    header = _V2_HEADER.pack(
        V2_MAGIC, len(payload), 0, 0, sequence, system, component, kind & 0xFFFF, kind >> 16
    )
    return _closed(kind, header + payload)


def is_signed(frame: bytes) -> bool:
    """Whether a frame has a signature, be it right or wrong. MAVLink 1 has none."""
    return frame[0] == V2_MAGIC and bool(frame[2] & SIGNED)


def with_signed_flag(frame: bytes) -> bytes:
    """An unsigned MAVLink 2 frame as it stands before its signature: told to have one, and summed up again.

    KeyError if the dialect has no message of its kind.
    """
    body = bytearray(frame[:-CHECKSUM_LENGTH])
    body[2] |= SIGNED
    return _closed(int.from_bytes(frame[7:10], "little"), bytes(body))


def _closed(kind: int, body: bytes) -> bytes:
    """A frame's header and payload, and their checksum."""
    return body + _checksum(body[1:], _CHECKSUM_SEEDS[kind]).to_bytes(CHECKSUM_LENGTH, "little")
