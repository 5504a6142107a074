"""Every message of the dialect is read and packed as pymavlink does it."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.codec import MavlinkCodec
from flightstack.mavlink.fields import layout

KINDS = sorted(mavlink.mavlink_map)


def made_of(kind: int, filling: bytes) -> object:
    """pymavlink's message whose payload is `filling`, again and again."""
    definition = mavlink.mavlink_map[kind]
    size = definition.unpacker.size
    payload = (filling * (size // len(filling) + 1))[:size]
    packer = mavlink.MAVLink(None, srcSystem=9, srcComponent=8)
    header = struct.pack("<BBBBBBBHB", 0xFD, size, 0, 0, 0, 9, 8, kind & 0xFFFF, kind >> 16)
    crc = mavlink.x25crc(header[1:] + payload + bytes((definition.crc_extra,))).crc
    return packer.decode(bytearray(header + payload + struct.pack("<H", crc)))


def same(ours: object, theirs: object) -> bool:
    if isinstance(ours, tuple):
        return all(same(a, b) for a, b in zip(ours, theirs, strict=True))  # type: ignore[call-overload]
    return ours == theirs or (ours != ours and theirs != theirs)


@pytest.mark.parametrize("filling", [b"\x00", b"\x01\x02\x03", b"A\x00\xc3\x28", b"\xff"])
def test_every_kind_is_read_as_pymavlink_reads_it(filling: bytes) -> None:
    for kind in KINDS:
        theirs = made_of(kind, filling)
        ours = layout(kind).unpack(bytes(theirs.get_payload())[4:])  # type: ignore[attr-defined]
        for field in mavlink.mavlink_map[kind].fieldnames:
            if (layout(kind).name, field) == ("STATUSTEXT", "text"):
                raw = bytes(theirs.get_payload())[5:55].split(b"\0", 1)[0]  # type: ignore[attr-defined]
                assert ours.text == raw.decode("latin-1"), "a part of a text: its bytes, unread"
                continue
            assert same(getattr(ours, field), getattr(theirs, field)), (layout(kind).name, field)


def test_every_kind_is_packed_as_pymavlink_packs_it() -> None:
    codec = MavlinkCodec(9, 8)
    packer = mavlink.MAVLink(None, srcSystem=9, srcComponent=8)
    for sequence, kind in enumerate(KINDS):
        message = made_of(kind, b"\x05\x06\x07\x08")
        packer.seq = sequence % 256
        assert codec.encode(message) == message.pack(packer)  # type: ignore[attr-defined]


@given(
    text=st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=50), severity=st.integers(0, 7)
)
def test_what_is_sent_is_read_back(text: str, severity: int) -> None:
    sender, reader = MavlinkCodec(3, 1), MavlinkCodec(255, 190, events=mavlink.mavlink_map.keys())
    sent = sender.encode(mavlink.MAVLink_statustext_message(severity, text.encode(), 0, 0))
    (message,) = reader.receive(0.0, sent)
    assert (message.name, message.system, message.component) == ("STATUSTEXT", 3, 1)
    assert (message.fields.severity, message.fields.text) == (severity, text)


def test_what_is_missing_is_zero_and_what_is_new_is_left_out() -> None:
    heartbeat = layout(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
    assert tuple(heartbeat.unpack(b"\x04")) == (4, 0, 0, 0, 0, 0)
    assert tuple(heartbeat.unpack(b"\x04" + b"\0" * 8 + b"newer")) == (4, 0, 0, 0, 0, 0)
