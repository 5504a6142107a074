"""MAVLink 2 signing: the signature on what we send, and which of what comes is believed. No I/O and no clock.

A frame is signed with a key of 32 bytes that both ends have, and a timestamp that rises from frame to frame, so that
a recorded frame is worth nothing later (https://mavlink.io/en/guide/message_signing.html).
"""

from __future__ import annotations

import enum
import hashlib
import hmac
import struct
from collections import Counter
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.framing import SIGNATURE_LENGTH, MavlinkFrame, is_signed, with_signed_flag

KEY_BYTES: Final = 32
STAMPS_PER_S: Final = 100_000
"""A timestamp counts 10 microseconds …"""
_EPOCH_UNIX_S: Final = 1_420_070_400
"""… from 2015-01-01 on."""
STAMP_AT_MOST: Final = (1 << 48) - 1
LATE_AT_MOST: Final = 60 * STAMPS_PER_S
"""A stream that was not heard before may be this much behind the newest timestamp, not more."""
STREAMS_AT_MOST: Final = 1024
"""Only who has the key begins one; a fault of such a one must not fill the memory."""
_STAMP: Final = struct.Struct("<BIH")
"""Link, and a timestamp of 48 bits."""
_PROOF_BYTES: Final = 6


class SignatureVerdict(enum.Enum):
    """What a frame's signature says."""

    SIGNED = "signed"
    EXEMPT = "exempt"
    """RADIO_STATUS is put in by telemetry radios, which have no key."""
    UNSIGNED = "unsigned"
    OTHER_KEY = "other key"
    REPEATED = "repeated"
    """Its timestamp is not newer than another's of the same stream."""
    STALE = "stale"
    """The first of its stream, and more than a minute old."""

    @property
    def is_good(self) -> bool:
        return self in (SignatureVerdict.SIGNED, SignatureVerdict.EXEMPT)


def stamp_at(unix_s: float) -> int:
    """The timestamp of a time of the calendar; 0 before 2015."""
    return min(max(int((unix_s - _EPOCH_UNIX_S) * STAMPS_PER_S), 0), STAMP_AT_MOST)


def key_of_passphrase(passphrase: str) -> bytes:
    """The key that MAVProxy and Mission Planner make of a passphrase: its SHA-256."""
    return hashlib.sha256(passphrase.encode()).digest()


class Signing:
    """One key at one end, for all of its links together: what came over one must not be repeated on another."""

    def __init__(self, key: bytes, newest_stamp: int = 0) -> None:
        """`newest_stamp` is the last that was used with this key."""
        if len(key) != KEY_BYTES:
            raise ValueError(f"a signing key has {KEY_BYTES} bytes, not {len(key)}")
        self.key = key
        self.stamp = newest_stamp
        """The newest that was used or believed."""
        self.refused: Counter[SignatureVerdict] = Counter()
        """How many frames were not believed, and why."""
        self._streams: dict[tuple[int, int, int], int] = {}
        """The newest timestamp of each system, component and link number."""
        self._signers: set[tuple[int, int]] = set()

    def follow(self, stamp: int) -> None:
        """Our clock says that it is so late."""
        self.stamp = min(max(self.stamp, stamp), STAMP_AT_MOST)

    def sign(self, frame: bytes, link: int) -> bytes:
        """A frame of ours as it goes out on our link number `link`. One that has a signature goes out as it is.

        KeyError for a message that the dialect does not know.
        """
        if is_signed(frame):
            return frame
        self.stamp = min(self.stamp + 1, STAMP_AT_MOST)
        stamped = with_signed_flag(frame) + _STAMP.pack(link, self.stamp & 0xFFFFFFFF, self.stamp >> 32)
        return stamped + self._proof(stamped)

    def judge(self, frame: MavlinkFrame) -> SignatureVerdict:
        """Whether a frame is believed. Each is to be shown once, in the order of arrival."""
        verdict = self._verdict(frame)
        if not verdict.is_good:
            self.refused[verdict] += 1
        return verdict

    def _verdict(self, frame: MavlinkFrame) -> SignatureVerdict:
        data, sender = frame.data, (frame.system, frame.component)
        if not is_signed(data):
            # Who has the key signs everything: nobody else gets a word in under its name.
            exempt = frame.kind == mavlink.MAVLINK_MSG_ID_RADIO_STATUS and sender not in self._signers
            return SignatureVerdict.EXEMPT if exempt else SignatureVerdict.UNSIGNED
        if not hmac.compare_digest(data[-_PROOF_BYTES:], self._proof(data[:-_PROOF_BYTES])):
            return SignatureVerdict.OTHER_KEY
        link, low, high = _STAMP.unpack(data[-SIGNATURE_LENGTH:-_PROOF_BYTES])
        stamp, stream = low | high << 32, (*sender, link)
        before = self._streams.get(stream)
        if before is None:
            if stamp < self.stamp - LATE_AT_MOST:
                return SignatureVerdict.STALE
            if len(self._streams) >= STREAMS_AT_MOST:
                del self._streams[min(self._streams, key=lambda known: self._streams[known])]
        elif stamp <= before:
            return SignatureVerdict.REPEATED
        self._streams[stream] = stamp
        self._signers.add(sender)
        self.follow(stamp)
        return SignatureVerdict.SIGNED

    def _proof(self, stamped: bytes) -> bytes:
        return hashlib.sha256(self.key + stamped).digest()[:_PROOF_BYTES]
