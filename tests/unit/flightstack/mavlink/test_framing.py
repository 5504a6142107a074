"""Frames in bytes: each sound one is found once, unread, whatever surrounds or splits it."""

from __future__ import annotations

import itertools

from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.framing import FrameFinder, MavlinkFrame, pack_frame

MAGIC = b"\xfd\xfe"
LONGEST = 280
UNKNOWN_KIND = 0xABCDEF


def sound(sequence: int, *, v1: bool = False) -> bytes:
    packer = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    packer.seq = sequence % 256
    return bytes(mavlink.MAVLink_vfr_hud_message(1, 2, 3, 4, 5, 6).pack(packer, force_mavlink1=v1))


def unknown(payload: bytes) -> bytes:
    """A frame of a kind that no dialect of ours has: its checksum cannot be proven."""
    header = bytes((0xFD, len(payload), 0, 0, 7, 1, 1)) + UNKNOWN_KIND.to_bytes(3, "little")
    return header + payload + b"\x12\x34"


def in_pieces(data: bytes, cuts: list[int]) -> list[bytes]:
    edges = sorted({0, len(data), *(cut % (len(data) + 1) for cut in cuts)})
    return [data[a:b] for a, b in itertools.pairwise(edges)]


def found(data: bytes, cuts: list[int] | None = None) -> list[MavlinkFrame]:
    finder = FrameFinder()
    return [whole for piece in in_pieces(data, cuts or []) for whole in finder.find(piece)]


@given(
    garbage=st.lists(st.binary(max_size=40), min_size=1, max_size=6),
    cuts=st.lists(st.integers(0, 4000), max_size=12),
    v1=st.booleans(),
)
def test_no_garbage_costs_a_frame_of_a_known_kind_and_no_cut_changes_anything(
    garbage: list[bytes], cuts: list[int], v1: bool
) -> None:
    """Also garbage that begins like a frame, unless it claims to be of a kind that nobody knows."""
    sounds = [sound(index, v1=v1) for index in range(len(garbage))]
    # At the end as much as the longest false start may claim.
    data = b"".join(g + s for g, s in zip(garbage, sounds, strict=True)) + b"\0" * LONGEST
    whole = found(data, cuts)
    assert whole == found(data)
    known = [one.data for one in whole if one.kind == mavlink.MAVLINK_MSG_ID_VFR_HUD]
    if all(one.kind in mavlink.mavlink_map for one in whole):
        assert known == sounds
    else:
        assert set(known) <= set(sounds)


@given(data=st.binary(max_size=600), cuts=st.lists(st.integers(0, 600), max_size=8))
def test_whatever_is_found_in_noise_is_the_same_in_any_pieces_and_in_order(
    data: bytes, cuts: list[int]
) -> None:
    whole = found(data, cuts)
    assert whole == found(data)
    at = 0
    for one in whole:
        at = data.index(one.data, at) + len(one.data)


def test_a_frame_tells_who_sent_it() -> None:
    (one,) = found(pack_frame(mavlink.MAVLINK_MSG_ID_HEARTBEAT, 200, 3, 191, b"\x01"))
    assert (one.kind, one.sequence, one.system, one.component, one.payload) == (0, 200, 3, 191, b"\x01")


def test_every_checksum_is_proven_also_of_what_nobody_will_read() -> None:
    bad = bytearray(sound(1))
    bad[14] ^= 0x01
    finder = FrameFinder()
    assert [one.sequence for one in finder.find(sound(0) + bytes(bad) + sound(2))] == [0, 2]
    assert finder.bad_frames >= 1


def test_a_frame_of_an_unknown_kind_is_stepped_over_when_another_one_follows() -> None:
    inside = sound(9)  # would be found if the unknown frame were not believed
    kinds = [one.kind for one in found(unknown(b"x" + inside) + sound(1))]
    assert kinds == [UNKNOWN_KIND, mavlink.MAVLINK_MSG_ID_VFR_HUD]


def test_what_only_looks_like_an_unknown_frame_does_not_swallow_a_real_one() -> None:
    assert [one.sequence for one in found(unknown(b"x" + sound(9)) + b"\0" + sound(1))] == [9, 1]


def test_a_signature_belongs_to_its_frame() -> None:
    packer = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    packer.signing.secret_key = bytes(range(32))
    packer.signing.sign_outgoing = True
    signed = bytes(mavlink.MAVLink_vfr_hud_message(1, 2, 3, 4, 5, 6).pack(packer))
    assert [one.data for one in found(signed + sound(1))] == [signed, sound(1)]


def test_an_unknown_incompatibility_flag_is_not_interpreted() -> None:
    strange = bytearray(sound(0))
    strange[2] |= 0x02
    assert [one.sequence for one in found(bytes(strange) + sound(1))] == [1]
