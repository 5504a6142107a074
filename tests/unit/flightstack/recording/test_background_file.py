"""A disk that is full, read-only or gone for a while: it is told, and what was measured is there in the end."""

from __future__ import annotations

import errno
import io
import logging
import os
import pathlib
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable

import pytest

from flightstack.recording import background_file
from flightstack.recording.background_file import BackgroundFile, RecordingError
from flightstack.recording.recorder import GAP, FlightRecorder, TlogWriter, read_recording

WAIT_S = 30.0
"""At most, for the thread: it takes a hundredth of a second."""


class Disk:
    """What the files of a test lie on: it can be full, and tells what it did."""

    def __init__(self) -> None:
        self.full = False
        self.room_bytes = 0
        """What a full disk still takes."""
        self.unopenable: int | None = None
        """The errno of opening anything."""
        self.refused = threading.Event()
        self.took = threading.Event()

    def open(self, path: pathlib.Path) -> io.FileIO:
        if self.unopenable is not None:
            self.refused.set()
            raise OSError(self.unopenable, os.strerror(self.unopenable))
        return _FileOfDisk(self, path)

    def fill(self, room_bytes: int = 0) -> None:
        self.refused.clear()
        self.full, self.room_bytes = True, room_bytes

    def free(self) -> None:
        self.took.clear()
        self.full, self.unopenable = False, None


class _FileOfDisk(io.FileIO):
    def __init__(self, disk: Disk, path: pathlib.Path) -> None:
        super().__init__(path, "x+b")
        self._disk = disk

    def write(self, data: object) -> int:
        view = memoryview(data)  # type: ignore[arg-type]
        if self._disk.full:
            room, self._disk.room_bytes = self._disk.room_bytes, 0
            if not room:
                self._disk.refused.set()
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            view = view[:room]
        written = super().write(view)
        assert written is not None
        self._disk.took.set()
        return written


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Disk:
    made = Disk()
    opened = pathlib.Path.open

    def open_on_disk(path: pathlib.Path, mode: str = "r", **options: object) -> object:
        return made.open(path) if mode == "x+b" else opened(path, mode, **options)  # type: ignore[call-overload]

    monkeypatch.setattr(pathlib.Path, "open", open_on_disk)
    monkeypatch.setattr(background_file, "WRITE_EVERY_S", 0.01)
    return made


def numbers(path: pathlib.Path) -> list[int]:
    return [record.message["n"] for record in read_recording(path) if record.topic == "/t"]


def record(recorder: FlightRecorder, first: int, last: int) -> None:
    for number in range(first, last):
        recorder.record("/t", float(number), {"n": number})


@pytest.mark.parametrize("room_bytes", [0, 1, 1000])
def test_a_disk_that_was_full_and_is_freed_has_lost_nothing(
    tmp_path: pathlib.Path, disk: Disk, caplog: pytest.LogCaptureFixture, room_bytes: int
) -> None:
    caplog.set_level(logging.WARNING)
    recorder = FlightRecorder(tmp_path / "f.mcap")
    record(recorder, 0, 50)
    assert disk.took.wait(WAIT_S)
    disk.fill(room_bytes)
    record(recorder, 50, 100)
    assert disk.refused.wait(WAIT_S)
    disk.refused.clear()
    assert disk.refused.wait(WAIT_S), "it is tried again"
    assert recorder.problem == f"{recorder.path}: recording has ended: No space left on device"
    disk.free()
    record(recorder, 100, 150)
    recorder.close()
    assert recorder.problem == ""
    assert numbers(recorder.path) == list(range(150))
    assert [r.message for r in caplog.records] == [
        f"{recorder.path}: recording has ended: No space left on device",
        f"{recorder.path}: is recorded again",
    ]


def test_what_is_on_the_disk_can_be_read_while_it_is_full(tmp_path: pathlib.Path, disk: Disk) -> None:
    recorder = FlightRecorder(tmp_path / "f.mcap")
    record(recorder, 0, 50)
    assert disk.took.wait(WAIT_S)
    disk.fill(room_bytes=2000)
    record(recorder, 50, 100)
    assert disk.refused.wait(WAIT_S)
    read = numbers(recorder.path)
    assert read == list(range(len(read)))
    assert 50 <= len(read) < 100
    recorder.close()
    assert numbers(recorder.path) == read, "the end is missing, and nothing else"
    assert "No space left" in recorder.problem


def test_a_disk_that_is_full_for_too_long_leaves_a_gap_that_is_told(
    tmp_path: pathlib.Path, disk: Disk, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(background_file, "PENDING_AT_MOST_BYTES", 9000)
    recorder = FlightRecorder(tmp_path / "f.mcap")
    record(recorder, 0, 5)
    assert disk.took.wait(WAIT_S)
    disk.fill()
    record(recorder, 5, 500)
    assert disk.refused.wait(WAIT_S)
    disk.free()
    assert disk.took.wait(WAIT_S)
    number = 500
    for _ in range(10_000):
        recorder.record("/new topic", 0.0, {})
        if not recorder.problem:
            break
        disk.took.wait(0.01)
    record(recorder, number, 510)
    recorder.close()
    assert recorder.problem == ""
    read = numbers(recorder.path)
    kept = read.index(500)
    assert read == [*range(kept), *range(500, 510)]
    topics = [record.topic for record in read_recording(recorder.path)]
    (gap,) = [record for record in read_recording(recorder.path) if record.topic == GAP]
    assert gap.message["records"] >= 500 - kept
    assert topics.index(GAP) == kept
    assert topics[kept + 1] == "/new topic"


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EACCES])
def test_a_disk_that_takes_nothing_at_the_start_is_told_and_tried_again(
    tmp_path: pathlib.Path, disk: Disk, number: int
) -> None:
    disk.unopenable = number
    recorder = FlightRecorder(tmp_path / "f.mcap")
    assert os.strerror(number) in recorder.problem
    record(recorder, 0, 20)
    disk.refused.clear()
    assert disk.refused.wait(WAIT_S)
    disk.free()
    recorder.close()
    assert recorder.problem == ""
    assert numbers(recorder.path) == list(range(20))


def test_a_name_that_cannot_be_is_an_error_at_once(tmp_path: pathlib.Path, disk: Disk) -> None:
    disk.unopenable = errno.ENOTDIR
    with pytest.raises(RecordingError, match="cannot be recorded to: Not a directory"):
        BackgroundFile(tmp_path / "f")


@pytest.mark.parametrize("remove", [shutil.rmtree, lambda directory: (directory / "f.mcap").unlink()])
def test_a_file_that_is_removed_while_it_is_written_is_there_again_whole(
    tmp_path: pathlib.Path, disk: Disk, remove: Callable[[pathlib.Path], None]
) -> None:
    directory = tmp_path / "flights"
    directory.mkdir()
    recorder = FlightRecorder(directory / "f.mcap")
    record(recorder, 0, 50)
    assert disk.took.wait(WAIT_S)
    remove(directory)
    record(recorder, 50, 100)
    recorder.close()
    assert recorder.problem == ""
    assert numbers(recorder.path) == list(range(100))


def test_a_removed_file_that_cannot_be_made_again_is_told(tmp_path: pathlib.Path, disk: Disk) -> None:
    directory = tmp_path / "flights"
    directory.mkdir()
    log = TlogWriter(directory / "f.tlog", 0.0)
    log.write(0.0, b"frame")
    assert disk.took.wait(WAIT_S)
    shutil.rmtree(directory)
    directory.write_text("in the way")
    log.write(1.0, b"frame")
    log.close()
    assert "f.tlog: recording has ended: " in log.problem


LIMITED = """
import resource, sys
from flightstack.recording.recorder import FlightRecorder
_, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, hard))
recorder = FlightRecorder(sys.argv[1])
for number in range(1000):
    recorder.record("/t", float(number), {"n": number})
print("recorded", flush=True)
sys.stdin.readline()
print(recorder.problem, flush=True)
sys.stdin.readline()
resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
recorder.close()
print(recorder.problem, flush=True)
"""


def test_a_process_whose_files_may_not_grow_goes_on_and_loses_nothing_once_they_may(
    tmp_path: pathlib.Path,
) -> None:
    path = tmp_path / "f.mcap"
    process = subprocess.Popen(
        [sys.executable, "-c", LIMITED, path],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        bufsize=1,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == "recorded\n"
        problem = ""
        while path.stat().st_size < 20_000:
            os.sched_yield()
        process.stdin.write("\n")
        problem = process.stdout.readline()
        process.stdin.write("\n")
        after = process.stdout.readline()
        assert process.wait(WAIT_S) == 0
    finally:
        process.kill()
        process.communicate()
    assert "File too large" in problem
    assert after == "\n"
    assert numbers(path) == list(range(1000))
