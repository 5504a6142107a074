"""Signatures, against a published frame, the specification computed by hand, and pymavlink as the other end."""

from __future__ import annotations

import hashlib

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.codec import MavlinkCodec
from flightstack.mavlink.framing import FrameFinder, MavlinkFrame, with_signed_flag
from flightstack.mavlink.signing import (
    LATE_AT_MOST,
    STAMP_AT_MOST,
    STAMPS_PER_S,
    STREAMS_AT_MOST,
    SignatureVerdict,
    Signing,
    key_of_passphrase,
    stamp_at,
)

KEY = bytes(range(100, 132))
OTHER = bytes(range(200, 232))
NOW = stamp_at(1_790_000_000.0)
PUBLISHED_KEY = bytes.fromhex("0001f2e3d4c5b6a79800707634320016224200ccff7a0052757374004d4156b3")
PUBLISHED = bytes.fromhex("fd090100ef0102000000050000000203590303c98b00ffffffffffff2718b168ccf5")
"""A signed HEARTBEAT and its key, from the tests of the Rust library (mavlink 0.18, tests/signing.rs)."""
HEARTBEAT = mavlink.MAVLink_heartbeat_message(2, 3, 89, 5, 3, 3)


def frame(data: bytes) -> MavlinkFrame:
    (found,) = FrameFinder().find(data)
    return found


def plain(system: int = 1, component: int = 1, message=HEARTBEAT) -> bytes:
    return MavlinkCodec(system, component).encode(message)


def peer(key: bytes = KEY, *, stamp: int = NOW, link: int = 0, system: int = 1, component: int = 1):
    """Another implementation."""
    mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    mav.signing.secret_key = key
    mav.signing.timestamp = stamp
    mav.signing.link_id = link
    mav.signing.sign_outgoing = True
    return mav


def test_a_published_frame_is_believed_with_its_key_and_no_other():
    assert Signing(PUBLISHED_KEY).judge(frame(PUBLISHED)) is SignatureVerdict.SIGNED
    assert Signing(KEY).judge(frame(PUBLISHED)) is SignatureVerdict.OTHER_KEY


def test_no_byte_of_what_is_signed_can_be_changed():
    """Not even by who mends the checksum afterwards. The first four bytes and the kind say what the frame is."""
    body, signature = PUBLISHED[:-15], PUBLISHED[-13:]
    for place in (4, 5, 6, *range(10, len(body))):
        changed = bytearray(body)
        changed[place] ^= 0x10
        forged = with_signed_flag(bytes(changed) + bytes(2)) + signature
        assert Signing(PUBLISHED_KEY).judge(frame(forged)) is SignatureVerdict.OTHER_KEY, place
    for place in range(len(PUBLISHED) - 13, len(PUBLISHED)):
        changed = bytearray(PUBLISHED)
        changed[place] ^= 0x10
        assert Signing(PUBLISHED_KEY).judge(frame(bytes(changed))) is SignatureVerdict.OTHER_KEY, place


def test_the_signature_is_what_the_specification_says():
    signing = Signing(KEY, NOW)
    data = signing.sign(plain(7, 191), 5)
    head, signature = data[:-13], data[-13:]
    assert head[2] == 1
    assert signature[0] == 5
    assert int.from_bytes(signature[1:7], "little") == NOW + 1
    assert signature[7:] == hashlib.sha256(KEY + head + signature[:7]).digest()[:6]


@pytest.mark.parametrize(
    "message",
    [
        HEARTBEAT,
        mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_param_set_message(1, 1, b"RTL_ALT", 1500.0, 9),
        mavlink.MAVLink_statustext_message(6, b"hello"),
    ],
)
def test_another_implementation_signs_the_same_and_believes_ours(message):
    theirs = bytes(message.pack(peer(stamp=NOW + 1, link=3)))
    assert Signing(KEY, NOW).sign(plain(message=message), 3) == theirs
    receiver = peer(system=9)
    (got,) = receiver.parse_buffer(Signing(KEY, NOW).sign(plain(2, 1, message), 3))
    assert (got.get_type(), got.get_signed()) == (message.get_type(), True)
    assert Signing(KEY, NOW).judge(frame(theirs)) is SignatureVerdict.SIGNED


def test_another_implementation_refuses_what_is_signed_with_another_key():
    receiver = peer(OTHER, system=9)
    receiver.robust_parsing = True
    (got,) = receiver.parse_buffer(Signing(KEY, NOW).sign(plain(), 3))
    assert got.get_type() == "BAD_DATA"


def test_what_is_not_signed_is_refused_and_counted():
    signing = Signing(KEY, NOW)
    old = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    v1 = bytes(HEARTBEAT.pack(old, force_mavlink1=True))
    assert [signing.judge(frame(data)) for data in (plain(), v1)] == [SignatureVerdict.UNSIGNED] * 2
    assert signing.refused == {SignatureVerdict.UNSIGNED: 2}


def test_telemetry_radios_need_no_key_but_have_no_other_name():
    signing = Signing(KEY, NOW)
    status = mavlink.MAVLink_radio_status_message(1, 2, 3, 4, 5, 6, 7)
    assert signing.judge(frame(plain(51, 68, status))) is SignatureVerdict.EXEMPT
    assert signing.judge(frame(bytes(HEARTBEAT.pack(peer())))) is SignatureVerdict.SIGNED
    assert signing.judge(frame(plain(1, 1, status))) is SignatureVerdict.UNSIGNED
    assert signing.judge(frame(plain(51, 68))) is SignatureVerdict.UNSIGNED


def test_what_was_recorded_is_worth_nothing():
    signing, sender = Signing(KEY, NOW), peer()
    first, second = (frame(bytes(HEARTBEAT.pack(sender))) for _ in range(2))
    assert [signing.judge(each) for each in (first, second, second, first)] == [
        SignatureVerdict.SIGNED,
        SignatureVerdict.SIGNED,
        SignatureVerdict.REPEATED,
        SignatureVerdict.REPEATED,
    ]


def test_links_and_components_count_by_themselves():
    signing = Signing(KEY, NOW)
    for link, component in ((0, 1), (1, 1), (0, 191)):
        data = bytes(HEARTBEAT.pack(peer(link=link, component=component)))
        assert signing.judge(frame(data)) is SignatureVerdict.SIGNED


@pytest.mark.parametrize(
    ("behind", "verdict"),
    [(LATE_AT_MOST, SignatureVerdict.SIGNED), (LATE_AT_MOST + 1, SignatureVerdict.STALE)],
)
def test_a_new_stream_is_at_most_a_minute_old(behind, verdict):
    data = bytes(HEARTBEAT.pack(peer(stamp=NOW - behind)))
    assert Signing(KEY, NOW).judge(frame(data)) is verdict


def test_we_follow_whoever_is_ahead_and_never_go_back():
    signing = Signing(KEY, 5)
    signing.judge(frame(bytes(HEARTBEAT.pack(peer(stamp=NOW)))))
    assert signing.stamp == NOW
    signing.follow(7)
    ours = frame(signing.sign(plain(2), 0))
    assert Signing(KEY, NOW).judge(ours) is SignatureVerdict.SIGNED


def test_who_cannot_sign_moves_no_clock_of_ours():
    signing = Signing(KEY, NOW)
    ahead = bytes(HEARTBEAT.pack(peer(OTHER, stamp=NOW + 10**9)))
    assert signing.judge(frame(ahead)) is SignatureVerdict.OTHER_KEY
    assert signing.stamp == NOW


def test_the_end_of_all_timestamps_is_no_error():
    signing = Signing(PUBLISHED_KEY)
    signing.judge(frame(PUBLISHED))
    assert signing.stamp == STAMP_AT_MOST
    assert frame(signing.sign(plain(), 0)).kind == 0


def test_what_others_have_signed_goes_on_as_it_is():
    theirs = bytes(HEARTBEAT.pack(peer(OTHER)))
    assert Signing(KEY, NOW).sign(theirs, 0) == theirs


def test_streams_fill_no_memory_and_forgotten_ones_are_not_repeated():
    signing, first = Signing(KEY, NOW), frame(bytes(HEARTBEAT.pack(peer())))
    assert signing.judge(first) is SignatureVerdict.SIGNED
    for number in range(STREAMS_AT_MOST + 5):
        late = peer(stamp=NOW + LATE_AT_MOST + 10 + number, system=number // 250 + 2, component=number % 250)
        assert signing.judge(frame(bytes(HEARTBEAT.pack(late)))) is SignatureVerdict.SIGNED
    assert len(signing._streams) == STREAMS_AT_MOST
    assert signing.judge(first) is SignatureVerdict.STALE


def test_times_of_the_calendar():
    assert stamp_at(1_420_070_400.0) == 0
    assert stamp_at(1_420_070_401.5) == 1.5 * STAMPS_PER_S
    assert stamp_at(3600.0) == 0
    assert stamp_at(1e12) == STAMP_AT_MOST


def test_a_passphrase_is_the_key_that_others_make_of_it():
    # SHA-256 of "abc": FIPS 180-2, appendix B.1
    expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert key_of_passphrase("abc").hex() == expected


def test_a_key_of_another_length_is_none():
    with pytest.raises(ValueError, match="32 bytes"):
        Signing(b"short")
