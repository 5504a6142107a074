"""Recordings: what is written comes back, whatever happens to the writer and to the disk."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import pathlib
import random
import signal
import subprocess
import sys
import time

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.recording import named_json
from flightstack.recording.background_file import BackgroundFile
from flightstack.recording.recorder import (
    FlightRecorder,
    Record,
    RecordingError,
    TlogWriter,
    read_recording,
    restore,
    unused,
)
from flightstack.swarm.wire import DroneState, MemberRegister, OrderState, Phase, TableState
from mission.estimation.estimates import Scalar, Wind
from mission.strategies.contract import Order, Stage
from mission.tree.slot_registers import SlotRegister

STATE = DroneState(
    sender=3,
    incarnation=77,
    sequence=5,
    frame=123,
    phase=Phase.TRACKING,
    position_ned_m=(1.5, -2.25, -10.0),
    velocity_ned_mps=None,
    heading_rad=0.1,
    home_ned_m=(0.0, 0.0, 0.0),
    armed=True,
    airborne=True,
    mode="GUIDED",
    battery_fraction=0.75,
    co2_ppm=431.0,
    excess_co2_ppm=Scalar(11.0, 2.0, 0.1),
    wind=Wind((3.0, 0.5, 0.0), 0.2, 0.3),
    epoch=2,
    slot=0,
    parent=None,
    healing=False,
    tracking_best_ppm=None,
    notes=("co2: zeroing 12 of 25",),
)
TABLE = TableState(
    sender=3,
    incarnation=77,
    sequence=4,
    frame=123,
    survey="survey",
    slots=((0, SlotRegister(0, 1)), (1, SlotRegister(2, 3, 2))),
    members=((2, MemberRegister(0, 0)),),
    absent=(2,),
)
ORDERED = OrderState(
    3, 77, 4, 123, "survey", Order(4, Stage.TRACK, (1.0, 2.0, -3.0), 0.5), SlotRegister(0, 1)
)


class Tick(msgspec.Struct, frozen=True, array_like=True):
    """Shaped like what the runner records: bytes, structs in tuples, optional structs, tables."""

    data: bytes = b""
    states: tuple[DroneState, ...] = ()
    pair: tuple[str, bytes] | None = None
    best: Scalar | None = None
    table: dict[str, Scalar] = {}
    numbers: tuple[float, ...] = ()


def _write(path: pathlib.Path, *entries: tuple[str, float, object]) -> list[Record]:
    recorder = FlightRecorder(path)
    for entry in entries:
        recorder.record(*entry)
    recorder.close()
    return list(read_recording(path))


def test_records_come_back_in_order_with_their_exact_times(tmp_path):
    times_s = [123456.789012345678, 0.1 + 0.2, 1e-3, 7.0]
    began_s = time.time()
    records = _write(tmp_path / "f.mcap", *((f"/t/{n % 2}", t, {"n": n}) for n, t in enumerate(times_s)))
    assert [(r.topic, r.time_s, r.message) for r in records] == [
        (f"/t/{n % 2}", t, {"n": n}) for n, t in enumerate(times_s)
    ]
    assert all(began_s - 1.0 <= r.wall_s <= time.time() + 1.0 for r in records)


@pytest.mark.parametrize(
    "message", [STATE, TABLE, ORDERED, Tick(b"\x00\xff", (STATE,), ("a", b"b"), None, {"x": Scalar(1, 2, 3)})]
)
def test_structs_are_objects_in_the_file_and_structs_again_afterwards(tmp_path, message):
    (record,) = _write(tmp_path / "f.mcap", ("/m", 1.0, message))
    assert set(record.message) == set(message.__struct_fields__)
    assert restore(record.message, type(message)) == message


def test_a_person_can_read_the_fields(tmp_path):
    (record,) = _write(tmp_path / "f.mcap", ("/state/3", 1.0, STATE))
    assert record.message["phase"] == "tracking"
    assert record.message["excess_co2_ppm"] == {"mean": 11.0, "variance": 2.0, "age_s": 0.1}


def test_a_message_without_fields(tmp_path):
    (record,) = _write(tmp_path / "f.mcap", ("/empty", 2.5, {}))
    assert (record.time_s, record.message) == (2.5, {})


def test_an_older_recording_lacks_the_newest_fields():
    message = json.loads(named_json.encode(STATE))
    fields = DroneState.__struct_fields__
    for field in fields[fields.index("notes") :]:
        del message[field]
    assert restore(message, DroneState) == msgspec.structs.replace(STATE, notes=())


finite = st.floats(allow_nan=False, allow_infinity=False)
scalars = st.builds(Scalar, finite, finite, finite)


@settings(max_examples=60, deadline=None)
@given(
    st.builds(
        Tick,
        data=st.binary(max_size=40),
        states=st.lists(st.just(STATE), max_size=2).map(tuple),
        pair=st.none() | st.tuples(st.text(max_size=5), st.binary(max_size=5)),
        best=st.none() | scalars,
        table=st.dictionaries(st.text(max_size=5), scalars, max_size=3),
        numbers=st.lists(finite, max_size=4).map(tuple),
    )
)
def test_every_value_survives_json(tick):
    assert restore(json.loads(named_json.encode(tick)), Tick) == tick


def test_other_mcap_readers_can_read_it_and_find_its_index(tmp_path):
    path = tmp_path / "f.mcap"
    _write(path, ("/state/3", 12.5, STATE), ("/event", 13.0, {"text": "heal"}))
    with path.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        messages = list(reader.iter_messages())
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 2
    assert [(channel.topic, channel.message_encoding) for _, channel, _ in messages] == [
        ("/state/3", "json"),
        ("/event", "json"),
    ]
    assert [message.log_time for _, _, message in messages] == [12_500_000_000, 13_000_000_000]


HEADER_BYTES = 8 + 9 + 4 + len("") + 4 + len("flightstack")
"""Magic, opcode and length, profile, library."""


@pytest.fixture(scope="module")
def whole_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("whole") / "whole.mcap"
    records = _write(path, *((f"/t/{n % 3}", n / 10.0, {"n": n, "data": b"x" * n}) for n in range(30)))
    return path.read_bytes(), records


@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_a_file_cut_anywhere_gives_its_first_records(whole_file, tmp_path_factory, data):
    content, records = whole_file
    size = data.draw(st.integers(0, len(content)))
    path = tmp_path_factory.mktemp("cut") / "cut.mcap"
    path.write_bytes(content[:size])
    if size < HEADER_BYTES:
        with pytest.raises(RecordingError, match="no MCAP file"):
            list(read_recording(path))
        return
    read = list(read_recording(path))
    assert read == records[: len(read)]
    assert len(read) >= len(records) * size // len(content) - 10


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=300), st.booleans())
def test_garbage_is_an_error_or_nothing(tmp_path_factory, garbage, magic):
    path = tmp_path_factory.mktemp("garbage") / "garbage.mcap"
    path.write_bytes((b"\x89MCAP0\r\n" if magic else b"") + garbage)
    with contextlib.suppress(RecordingError):
        assert list(read_recording(path)) == []


def test_a_recording_is_never_overwritten_and_the_next_one_finds_a_free_name(tmp_path):
    path = tmp_path / "f.1.mcap"
    for n in (1, 2, 3):
        _write(path, ("/t", 1.0, {"n": n}))
    written = {file.name: [r.message for r in read_recording(file)] for file in tmp_path.iterdir()}
    assert written == {"f.1.mcap": [{"n": 1}], "f.1-2.mcap": [{"n": 2}], "f.1-3.mcap": [{"n": 3}]}


def test_a_time_that_is_none_ends_what_can_be_read(tmp_path, caplog):
    path = tmp_path / "f.mcap"
    assert len(_write(path, ("/t", 1.25, {"n": 1}), ("/t", 2.75, {"n": 2}))) == 2
    path.write_bytes(path.read_bytes().replace(b'"_time_s":2.75', b'"_time_s":null'))
    assert [record.message for record in read_recording(path)] == [{"n": 1}]
    assert "breaks off" in caplog.text


def test_a_missing_directory_or_file_is_one_clear_line(tmp_path):
    with pytest.raises(RecordingError, match="cannot be recorded to: No such file"):
        FlightRecorder(tmp_path / "none" / "f.mcap")
    with pytest.raises(RecordingError, match="cannot be read: No such file"):
        list(read_recording(tmp_path / "none.mcap"))


def test_records_after_closing_are_ignored_and_closing_twice_is_no_error(tmp_path):
    recorder = FlightRecorder(tmp_path / "f.mcap")
    recorder.close()
    recorder.record("/t", 1.0, {})
    recorder.close()
    assert list(read_recording(tmp_path / "f.mcap")) == []


WRITE_UNTIL_KILLED = """
import sys, time
from flightstack.recording.recorder import FlightRecorder
recorder = FlightRecorder(sys.argv[1])
n = 0
while True:
    recorder.record("/tick", time.monotonic(), {"n": n})
    n += 1
    print(n, flush=True)
    time.sleep(0.05)
"""


def test_a_killed_process_leaves_all_but_its_last_moment(tmp_path):
    path = tmp_path / "killed.mcap"
    process = subprocess.Popen(
        [sys.executable, "-c", WRITE_UNTIL_KILLED, path], stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        written = 0
        # Twice, what was written by now gets to the disk while the process goes on.
        for _ in range(2):
            wanted = written = int(process.stdout.readline())
            while len(list(read_recording(path)) if path.stat().st_size else ()) < wanted:
                written = int(process.stdout.readline())
        process.send_signal(signal.SIGKILL)
    finally:
        process.kill()
        process.communicate()
    records = list(read_recording(path))
    assert [r.message["n"] for r in records] == list(range(len(records)))
    assert len(records) >= wanted
    assert written >= wanted


@pytest.mark.skipif(not pathlib.Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_a_full_disk_is_told_once_and_does_not_stop_the_flight(tmp_path, caplog, monkeypatch):
    original = pathlib.Path.open

    def open_full(self, *args, **kwargs):
        return original(pathlib.Path("/dev/full"), "wb", buffering=0)

    monkeypatch.setattr(pathlib.Path, "open", open_full)
    with caplog.at_level(logging.ERROR):
        recorder = FlightRecorder(tmp_path / "f.mcap")
        recorder.record("/t", 1.0, {"n": 1})
        for n in range(200):
            recorder.record("/t", 1.0, {"n": n})
        recorder.close()
    assert "recording has ended: No space left on device" in recorder.problem
    assert [r.message for r in caplog.records] == [recorder.problem]


def test_a_disk_that_is_too_slow_ends_the_recording_at_a_whole_record(tmp_path, caplog, monkeypatch):
    monkeypatch.setattr("flightstack.recording.background_file.PENDING_AT_MOST_BYTES", 1000)
    file = BackgroundFile(tmp_path / "f")
    for _ in range(10):
        file.write(b"x" * 300)
    file.close()
    assert "too slow" in file.problem
    assert len(caplog.records) == 1
    assert os.path.getsize(file.path) % 300 == 0


# -- MAVLink logs --------------------------------------------------------------------------------------------------


def _frames(count: int) -> list[bytes]:
    sender = mavlink.MAVLink(None, srcSystem=3, srcComponent=1)
    frames = []
    for n in range(count):
        message = mavlink.MAVLink_system_time_message(n, n)
        frames.append(bytes(message.pack(sender)))
        sender.seq = (sender.seq + 1) % 256
    return frames


def _read_tlog(path: pathlib.Path) -> list[tuple[float, int]]:
    log = mavutil.mavlink_connection(str(path))
    try:
        messages = []
        while (message := log.recv_msg()) is not None:
            messages.append((message._timestamp, message.time_boot_ms))
        return messages
    finally:
        log.close()


def test_pymavlink_reads_the_log_with_its_times(tmp_path):
    path = tmp_path / "f.tlog"
    writer = TlogWriter(path, unix_at_zero_s=1.7e9)
    for n, frame in enumerate(_frames(20)):
        writer.write(100.0 + 0.25 * n, frame)
    writer.close()
    assert _read_tlog(path) == [(pytest.approx(1.7e9 + 100.0 + 0.25 * n, abs=1e-5), n) for n in range(20)]


def test_the_first_frame_is_now(tmp_path):
    path = tmp_path / "f.tlog"
    writer = TlogWriter(path)
    for n, frame in enumerate(_frames(2)):
        writer.write(5000.0 + n, frame)
    writer.close()
    (first_s, _), (second_s, _) = _read_tlog(path)
    assert abs(first_s - time.time()) < 60.0
    assert second_s - first_s == pytest.approx(1.0, abs=1e-5)


def test_a_log_cut_short_is_read_up_to_there(tmp_path):
    path = tmp_path / "f.tlog"
    writer = TlogWriter(path)
    for frame in _frames(10):
        writer.write(1.0, frame)
    writer.close()
    content = path.read_bytes()
    path.write_bytes(content[: -random.Random(1).randint(1, 15)])
    assert [n for _, n in _read_tlog(path)] == list(range(9))


def test_a_name_that_is_taken_never_stops_a_recording(tmp_path: pathlib.Path) -> None:
    first = tmp_path / "drone-3-0000002a.mcap"
    assert unused(first) == first
    first.touch()
    (tmp_path / "drone-3-0000002a-2.mcap").symlink_to(tmp_path / "gone")  # not there, and yet taken
    path = unused(first)
    assert path.name == "drone-3-0000002a-3.mcap"
    FlightRecorder(path).close()
    assert first.stat().st_size == 0
