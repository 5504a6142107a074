"""Key files, and timestamps that never go back whatever ends the process."""

from __future__ import annotations

import pathlib

import pytest

from flightstack.mavlink.codec import MavlinkCodec
from flightstack.mavlink.commands import heartbeat
from flightstack.mavlink.signing import STAMPS_PER_S, stamp_at
from flightstack.mavlink.signing_store import RESERVED, SigningKeyError, SigningStore, read_key, write_key

UNIX_S = 1_790_000_000.0
FRAME = MavlinkCodec(1, 191).encode(heartbeat(18))


@pytest.fixture
def key(tmp_path) -> pathlib.Path:
    write_key(tmp_path / "mavlink.key")
    return tmp_path / "mavlink.key"


def kept(key: pathlib.Path) -> int:
    return int((key.parent / "mavlink.key.stamp").read_text())


def test_a_key_is_random_and_its_owners_alone(tmp_path):
    files = [tmp_path / name for name in ("one", "two")]
    for file in files:
        write_key(file)
        assert file.stat().st_mode & 0o777 == 0o600
    assert read_key(files[0]) != read_key(files[1])
    assert len(read_key(files[0])) == 32


def test_a_key_is_not_overwritten(key):
    before = read_key(key)
    with pytest.raises(SigningKeyError, match="is there already"):
        write_key(key)
    assert read_key(key) == before


def test_a_key_that_others_can_read_is_none(key):
    key.chmod(0o640)
    with pytest.raises(SigningKeyError, match=f"chmod 600 {key}"):
        read_key(key)


@pytest.mark.parametrize("text", ["", "ab" * 31, "ab" * 33, "xy" * 32, "00" * 32, "é" * 64])
def test_what_is_no_key(key, text):
    key.write_text(text, encoding="utf-8")
    with pytest.raises(SigningKeyError, match="is no key"):
        read_key(key)


def test_a_key_that_is_not_there(tmp_path):
    with pytest.raises(SigningKeyError, match="cannot be read: No such file"):
        read_key(tmp_path / "absent")
    with pytest.raises(SigningKeyError, match="cannot be written"):
        write_key(tmp_path / "absent" / "key")


def test_timestamps_are_the_clocks(key):
    assert SigningStore(key, unix_s=lambda: UNIX_S).signing.stamp == stamp_at(UNIX_S)


def test_a_killed_process_on_a_computer_without_a_clock_goes_on_where_it_was(key):
    SigningStore(key, unix_s=lambda: UNIX_S).release()
    used = []
    for _ in range(3):
        store = SigningStore(key, unix_s=lambda: 3600.0)
        for _ in range(5):
            store.signing.sign(FRAME, 0)
            store.advance()
        used.append(store.signing.stamp)  # and no word more
    assert stamp_at(UNIX_S) < used[0] < used[1] < used[2]


def test_what_is_reserved_is_written_before_it_is_used(key):
    now = [UNIX_S]
    store = SigningStore(key, unix_s=lambda: now[0])
    for _ in range(400):
        now[0] += 1.0
        store.advance()
        if store._writing is not None:
            store._writing.join()
        assert store.signing.stamp < kept(key) <= store.signing.stamp + RESERVED + STAMPS_PER_S


def test_what_peers_say_is_reserved_too(key):
    store = SigningStore(key, unix_s=lambda: 3600.0)
    store.signing.follow(stamp_at(UNIX_S))
    store.advance()
    assert store._writing is not None
    store._writing.join()
    assert SigningStore(key, unix_s=lambda: 0.0).signing.stamp > stamp_at(UNIX_S)


def test_a_command_gives_back_what_it_does_not_need(key):
    for _ in range(20):
        store = SigningStore(key, unix_s=lambda: UNIX_S)
        store.signing.sign(FRAME, 0)
        store.release()
    assert kept(key) == stamp_at(UNIX_S) + 20


def test_one_that_ends_takes_nothing_from_another_that_runs(key):
    first = SigningStore(key, unix_s=lambda: UNIX_S)
    second = SigningStore(key, unix_s=lambda: UNIX_S)
    first.release()
    assert kept(key) > second.signing.stamp
    second.release()
    assert kept(key) == second.signing.stamp


def test_a_released_one_can_go_on(key):
    now = [UNIX_S]
    store = SigningStore(key, unix_s=lambda: now[0])
    store.release()
    now[0] += 1.0
    store.advance()
    assert store._writing is not None
    store._writing.join()
    assert kept(key) > store.signing.stamp


@pytest.mark.parametrize("text", ["x", "-1", "281474976710656", ""])
def test_damaged_timestamps_are_one_line(key, text):
    (key.parent / "mavlink.key.stamp").write_text(text)
    with pytest.raises(SigningKeyError, match="is damaged; remove it if this computer's clock is right"):
        SigningStore(key)


def test_timestamps_that_cannot_be_kept_are_told_at_the_start(key):
    (key.parent / "mavlink.key.stamp").mkdir()
    with pytest.raises(SigningKeyError, match="make its directory writable"):
        SigningStore(key)


def test_a_disk_that_fails_in_the_air_is_told_once_and_signing_goes_on(key, caplog):
    now = [UNIX_S]
    store = SigningStore(key, unix_s=lambda: now[0])
    file = key.parent / "mavlink.key.stamp"
    file.unlink()
    file.mkdir()
    for _ in range(5):
        now[0] += 61.0
        store.advance()
        assert store._writing is not None
        store._writing.join()
    assert [record.getMessage().partition(":")[0] for record in caplog.records] == [
        "timestamps of signatures are not kept"
    ]
    assert store.signing.stamp == stamp_at(now[0])
