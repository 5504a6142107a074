"""A link on which only signed frames go in and out, with pymavlink at the other end."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.codec import MavlinkCodec
from flightstack.mavlink.commands import heartbeat
from flightstack.mavlink.link.memory_link import memory_pair
from flightstack.mavlink.link.signed_link import OLD_FOR_S, SignedLink
from flightstack.mavlink.signing import stamp_at
from flightstack.mavlink.signing_store import SigningStore, read_key, write_key

UNIX_S = 1_790_000_000.0


class SignedEnds:
    def __init__(self, directory) -> None:
        self.key = directory / "mavlink.key"
        write_key(self.key)
        near, self.far = memory_pair()
        self.real_s = 0.0
        store = SigningStore(self.key, unix_s=lambda: UNIX_S)
        self.link = SignedLink(near, store, 4, real_s=lambda: self.real_s)
        self.vehicle = self.peer()

    def peer(self, system: int = 3, stamp: int | None = None, key: bytes | None = None):
        mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
        mav.robust_parsing = True
        mav.signing.secret_key = key or read_key(self.key)
        mav.signing.timestamp = stamp_at(UNIX_S) if stamp is None else stamp
        mav.signing.sign_outgoing = True
        return mav

    def heartbeat(self, mav=None) -> bytes:
        return bytes(heartbeat(2).pack(mav or self.vehicle))

    def unsigned(self, system: int = 3) -> bytes:
        return bytes(heartbeat(2).pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=1)))

    def hear(self, data: bytes) -> bytes:
        self.far.write(data)
        return self.link.read()


@pytest.fixture
def ends(tmp_path) -> SignedEnds:
    return SignedEnds(tmp_path)


def test_what_we_say_is_signed_whole_or_in_pieces(ends):
    codec = MavlinkCodec(3, 191)
    data = codec.encode(heartbeat(18)) + codec.encode(heartbeat(18))
    for piece in (data[:5], data[5:30], data[30:]):
        ends.link.write(piece)
    said = ends.vehicle.parse_buffer(ends.far.read())
    assert [(message.get_type(), message.get_signed()) for message in said] == [("HEARTBEAT", True)] * 2
    assert said[0].get_msgbuf()[-13] == 4


def test_an_old_frame_is_said_in_the_new_form(ends):
    old = mavlink.MAVLink(None, srcSystem=3, srcComponent=191)
    ends.link.write(bytes(heartbeat(18).pack(old, force_mavlink1=True)))
    (said,) = ends.vehicle.parse_buffer(ends.far.read())
    assert (said.get_type(), said.get_signed(), said.type) == ("HEARTBEAT", True, 18)


def test_only_what_is_signed_comes_in_as_it_was(ends):
    first, second = ends.heartbeat(), ends.heartbeat()
    assert ends.hear(ends.unsigned() + first + ends.unsigned(9) + second[:9]) == first
    assert ends.hear(second[9:]) == second
    assert ends.hear(first) == b""


def test_who_makes_up_messages_swallows_nobody_elses(ends):
    """Its length covers the vehicle's frame and ends where another one begins: nothing proves such a frame."""
    first, second = ends.heartbeat(), ends.heartbeat()
    made_up = b"\xfd" + bytes((len(first) - 2, 0, 0, 1, 66, 1)) + (60_000).to_bytes(3, "little")
    assert ends.hear(made_up + first + second) == first + second


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("unsigned", "system 3 does not sign, and is ignored; if it is ours, give it the key over a cable"),
        ("other key", "system 3 signs with another key than"),
    ],
)
def test_who_is_not_believed_is_told_once_in_one_line(ends, caplog, kind, words):
    stranger = ends.peer(key=bytes(range(32)))
    assert ends.link.problem == ""
    for _ in range(20):
        assert ends.hear(ends.unsigned() if kind == "unsigned" else ends.heartbeat(stranger)) == b""
    (record,) = caplog.records
    assert words in record.getMessage()
    assert f"gcs signing setup {ends.key} --drone 3" in record.getMessage()
    assert "\n" not in record.getMessage()
    assert words in ends.link.problem


def test_a_stranger_is_no_problem_of_a_link_that_works(ends):
    ends.hear(ends.heartbeat() + ends.unsigned(9))
    assert ends.link.problem == ""


def test_strangers_fill_no_memory(ends, caplog):
    for system in range(1, 256):
        ends.hear(ends.unsigned(system))
    assert len(caplog.records) == 64


def test_old_timestamps_are_told_only_if_they_stay(ends, caplog):
    behind = ends.peer(stamp=5)
    for ends.real_s in (0.0, 4.0, OLD_FOR_S):
        ends.hear(ends.heartbeat(behind))
    assert not caplog.records
    ends.real_s += 0.1
    ends.hear(ends.heartbeat(behind))
    (record,) = caplog.records
    assert "signs with timestamps that are past" in record.getMessage()


def test_a_vehicle_without_a_clock_is_believed_once_it_has_heard_us(ends, caplog):
    behind = ends.peer(stamp=5)
    assert ends.hear(ends.heartbeat(behind)) == b""
    ends.link.write(MavlinkCodec(3, 191).encode(heartbeat(18)))
    (said,) = behind.parse_buffer(ends.far.read())
    # What every receiver does with a newer timestamp (pymavlink's parser leaves it to its owner).
    behind.signing.timestamp = max(
        behind.signing.timestamp, int.from_bytes(said.get_msgbuf()[-12:-6], "little")
    )
    assert ends.hear(ends.heartbeat(behind)) != b""
    assert not caplog.records


def test_two_links_of_one_process_believe_a_frame_once(tmp_path):
    ends = SignedEnds(tmp_path)
    near, far = memory_pair()
    second = SignedLink(near, ends.link._store, 5)
    data = ends.heartbeat()
    assert ends.hear(data) == data
    far.write(data)
    assert second.read() == b""


def test_closing_keeps_the_timestamp_that_was_used(ends):
    ends.link.write(MavlinkCodec(3, 191).encode(heartbeat(18)))
    ends.link.close()
    assert int((ends.key.parent / "mavlink.key.stamp").read_text()) == stamp_at(UNIX_S) + 1
