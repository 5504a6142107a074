"""Bytes to messages: whatever surrounds or splits them, a sound wanted frame comes out once and no other does."""

from __future__ import annotations

import itertools

from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.codec import SENDERS_AT_MOST, MavlinkCodec

WANTED = {mavlink.MAVLINK_MSG_ID_HEARTBEAT, mavlink.MAVLINK_MSG_ID_ATTITUDE}
EVENTS = {mavlink.MAVLINK_MSG_ID_STATUSTEXT}


def reader() -> MavlinkCodec:
    return MavlinkCodec(1, 191, WANTED, EVENTS, only_system=1)


def encoder(system: int = 1, component: int = 1) -> mavlink.MAVLink:
    return mavlink.MAVLink(None, srcSystem=system, srcComponent=component)


def attitude(link: mavlink.MAVLink, yaw_rad: float = 0.5, *, v1: bool = False) -> bytes:
    data = mavlink.MAVLink_attitude_message(1, 0.1, 0.2, yaw_rad, 0, 0, 0).pack(link, force_mavlink1=v1)
    link.seq = (link.seq + 1) % 256
    return bytes(data)


def vfr_hud(link: mavlink.MAVLink) -> bytes:
    data = mavlink.MAVLink_vfr_hud_message(1, 2, 3, 4, 5, 6).pack(link)
    link.seq = (link.seq + 1) % 256
    return bytes(data)


def in_pieces(data: bytes, cuts: list[int]) -> list[bytes]:
    edges = sorted({0, len(data), *(cut % (len(data) + 1) for cut in cuts)})
    return [data[a:b] for a, b in itertools.pairwise(edges)]


@settings(max_examples=60, deadline=None)
@given(
    # Garbage without a byte that begins a frame: with one, a frame behind it may have to wait for more bytes.
    garbage=st.lists(
        st.binary(max_size=30).map(lambda b: b.replace(b"\xfd", b"").replace(b"\xfe", b"")), max_size=8
    ),
    cuts=st.lists(st.integers(0, 2000), max_size=12),
    v1=st.booleans(),
)
def test_every_wanted_frame_comes_out_whatever_the_pieces(garbage, cuts, v1):
    link = encoder()
    data = b"".join(g + attitude(link, i * 0.1, v1=v1) + vfr_hud(link) for i, g in enumerate(garbage))
    codec = reader()
    messages = [m for piece in in_pieces(data, cuts) for m in codec.receive(0.0, piece)]
    assert len(messages) == len(garbage)
    assert [round(m.fields.yaw, 3) for m in messages] == [round(i * 0.1, 3) for i in range(len(garbage))]


@settings(max_examples=100, deadline=None)
@given(data=st.binary(max_size=400), cuts=st.lists(st.integers(0, 400), max_size=5))
def test_any_bytes_are_survived_and_a_frame_is_found_behind_them(data, cuts):
    codec = reader()
    for piece in in_pieces(data, cuts):
        codec.receive(0.0, piece)
    link = encoder()
    # A false start may claim up to 280 bytes: after as many, sound frames must have come through.
    messages = [m for _ in range(20) for m in codec.receive(0.0, attitude(link))]
    assert len(messages) >= 10


def test_a_bad_checksum_costs_one_frame_only():
    link = encoder()
    good, bad, after = attitude(link), bytearray(attitude(link)), attitude(link)
    bad[15] ^= 0xFF
    codec = reader()
    assert len(codec.receive(0.0, good + bytes(bad) + after)) == 2
    assert codec.bad_frames >= 1


def test_an_unknown_incompatibility_flag_is_not_interpreted():
    data = bytearray(attitude(encoder()))
    data[2] |= 0x02
    assert reader().receive(0.0, bytes(data)) == []


def test_a_signed_frame_is_read():
    link = encoder()
    link.signing.secret_key = bytes(range(32))
    link.signing.sign_outgoing = True
    data = attitude(link)
    assert len(data) > 40
    assert len(reader().receive(0.0, data)) == 1


def test_late_and_repeated_frames_are_dropped():
    link = encoder()
    one, two, three = attitude(link, 0.1), attitude(link, 0.2), attitude(link, 0.3)
    codec = reader()
    messages = codec.receive(0.0, one + three + two + three)
    assert [round(m.fields.yaw, 1) for m in messages] == [0.1, 0.3]
    assert codec.late_frames == 2


def test_of_late_events_each_counts_once():
    link = encoder()

    def say(text: bytes) -> bytes:
        data = mavlink.MAVLink_statustext_message(4, text).pack(link)
        link.seq = (link.seq + 1) % 256
        return bytes(data)

    one, two, state = say(b"one"), say(b"two"), attitude(link)
    messages = reader().receive(0.0, state + two + one + two + one)
    assert [m.name for m in messages] == ["ATTITUDE", "STATUSTEXT", "STATUSTEXT"]


def test_a_late_heartbeat_counts_while_it_is_the_newest_heartbeat():
    link = encoder()
    heartbeat = mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3).pack(link)
    link.seq += 1
    newer = attitude(link)
    messages = reader().receive(0.0, newer + heartbeat + heartbeat)
    assert [m.name for m in messages] == ["ATTITUDE", "HEARTBEAT"]


def test_many_unwanted_frames_between_do_not_make_a_frame_late():
    link = encoder()
    codec = reader()
    assert len(codec.receive(0.0, attitude(link))) == 1
    codec.receive(0.1, b"".join(vfr_hud(link) for _ in range(220)))
    assert len(codec.receive(0.2, attitude(link))) == 1


def test_a_sequence_that_begins_anew_after_a_pause_is_believed():
    codec = reader()
    link = encoder()
    for _ in range(10):
        codec.receive(0.0, attitude(link))
    assert len(codec.receive(5.0, attitude(encoder()))) == 1


def test_other_systems_count_only_by_their_heartbeats():
    link = encoder(system=9)
    heartbeat = mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3).pack(link)
    messages = reader().receive(0.0, attitude(link) + heartbeat)
    assert [m.name for m in messages] == ["HEARTBEAT"]


def test_made_up_senders_do_not_fill_the_memory():
    codec = MavlinkCodec(255, 190, WANTED, EVENTS)
    link = encoder()
    codec.receive(0.0, attitude(link))
    for number in range(3 * SENDERS_AT_MOST):
        now_s = 0.001 * number
        codec.receive(now_s, attitude(encoder(system=2 + number // 256, component=number % 256)))
        codec.receive(now_s, vfr_hud(link))
    assert len(codec._senders) <= SENDERS_AT_MOST
    assert (1, 1) in codec._senders, "who is heard is not forgotten"
