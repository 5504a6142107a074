"""The shell of the running ground station: its recordings."""

from __future__ import annotations

import contextlib
import datetime
import shutil

import pytest

from gcs.serve import Recordings
from gcs.station import Frame, StationOutputs, TimelineEntry

NOW = datetime.datetime(2026, 11, 22, 5, 47, 26, tzinfo=datetime.UTC)


def outputs(word: str) -> StationOutputs:
    entry = TimelineEntry("/alarm", {"word": word})
    return StationOutputs((), (), (entry,), (Frame(1, word.encode()), Frame(2, word.encode())), ())


@pytest.fixture
def opened():
    with contextlib.ExitStack() as stack:

        def record(directory, word: str) -> Recordings:
            recordings = stack.enter_context(contextlib.closing(Recordings(directory, NOW, 0.0)))
            recordings.write(0.0, outputs(word))
            return recordings

        yield record


def test_stations_of_one_second_record_into_files_of_their_own(tmp_path, opened):
    words = [f"station-{n}" for n in range(5)]
    every = [opened(tmp_path, word) for word in words]
    stamps = [recordings.timeline.path.stem.removeprefix("swarm-") for recordings in every]
    for recordings in every:
        assert recordings.problems() == set()
        recordings.close()
    assert stamps == ["20261122T054726Z", *(f"20261122T054726Z-{n}" for n in (2, 3, 4, 5))]
    for stamp, word in zip(stamps, words, strict=True):
        for vehicle in (1, 2):
            log = tmp_path / f"vehicle-{vehicle}-{stamp}.tlog"
            assert log.read_bytes()[8:] == word.encode()


def test_a_vehicles_log_that_was_left_behind_is_kept(tmp_path, opened):
    first = opened(tmp_path, "first")
    first.close()
    first.timeline.path.unlink()
    left = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    second = opened(tmp_path, "second")
    second.close()
    assert second.problems() == set()
    assert {name: (tmp_path / name).read_bytes() for name in left} == left


def test_a_directory_that_vanishes_is_made_again(tmp_path, opened):
    directory = tmp_path / "flights"
    directory.mkdir()
    recordings = opened(directory, "first")
    shutil.rmtree(directory)
    recordings.write(1.0, StationOutputs((), (), (), (Frame(3, b"late"),), ()))
    recordings.close()
    assert recordings.problems() == set()
    assert recordings.timeline.path.exists()
    assert {path.name.split("-")[1] for path in directory.glob("vehicle-*.tlog")} == {"1", "2", "3"}
