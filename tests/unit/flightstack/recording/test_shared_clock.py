"""The shared clock: followers read it, promise, and are waited for by the pace that makes it."""

from __future__ import annotations

import math
import pathlib
import threading
import time

import pytest

from flightstack.config import SharedClockConfig
from flightstack.recording.clock import WallClock, make_clock
from flightstack.recording.shared_clock import ClockCells, SharedClock
from mission.documents.yaml_file import DocumentError


@pytest.fixture
def path(tmp_path: pathlib.Path) -> pathlib.Path:
    ClockCells.make(tmp_path / "clock", followers=2).close()
    return tmp_path / "clock"


def test_a_new_clock_stands_at_nothing(path: pathlib.Path) -> None:
    cells = ClockCells(path)
    assert list(cells.values) == [0.0, 0.0, 0.0]
    cells.close()


def test_two_processes_would_see_the_same_time(path: pathlib.Path) -> None:
    maker, follower = ClockCells(path), SharedClock(path, 1, 1.0)
    maker.values[0] = 12.5
    assert follower.now_s() == 12.5


def test_sleeping_promises_and_wakes_when_the_time_has_come(path: pathlib.Path) -> None:
    maker, follower = ClockCells(path), SharedClock(path, 2, 10.0)
    maker.values[0] = 1.0
    sleeper = threading.Thread(target=follower.sleep_until, args=(1.1,))
    sleeper.start()
    while maker.values[2] != 1.1:
        time.sleep(0.001)
    assert sleeper.is_alive()
    maker.values[0] = 1.1
    sleeper.join(timeout=10.0)
    assert not sleeper.is_alive()


def test_a_sleeper_does_not_hang_with_a_clock_that_stands_still(path: pathlib.Path) -> None:
    SharedClock(path, 1, 1.0).sleep_until(1e9)


def test_who_leaves_is_not_waited_for(path: pathlib.Path) -> None:
    cells = ClockCells(path)
    cells.leave(1)
    assert cells.values[1] == math.inf


def test_a_clock_that_is_not_there(tmp_path: pathlib.Path) -> None:
    with pytest.raises(DocumentError, match="no clock to follow"):
        ClockCells(tmp_path / "none")


@pytest.mark.parametrize("slot", [0, 3])
def test_a_slot_that_is_not_there(path: pathlib.Path, slot: int) -> None:
    with pytest.raises(DocumentError, match="only 1 to 2"):
        SharedClock(path, slot, 1.0)


def test_the_configuration_chooses_the_clock(path: pathlib.Path) -> None:
    assert isinstance(make_clock(2.0, None), WallClock)
    assert isinstance(make_clock(2.0, SharedClockConfig(file=str(path), slot=1)), SharedClock)
