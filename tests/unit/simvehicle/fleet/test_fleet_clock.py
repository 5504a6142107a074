"""The pace of a fleet: as fast as asked for, and never past its slowest follower."""

from __future__ import annotations

import math
import pathlib

import pytest

from flightstack.recording.shared_clock import ClockCells
from simvehicle.fleet import fleet_clock as module
from simvehicle.fleet.fleet_clock import AHEAD_S, MOST_AT_ONCE_S, STUCK_WALL_S, FleetClock


class Wall:
    """The machine's clock, set by the test."""

    def __init__(self) -> None:
        self.now_s = 5000.0

    def monotonic(self) -> float:
        return self.now_s


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> Wall:
    wall = Wall()
    monkeypatch.setattr(module, "time", wall)
    return wall


@pytest.fixture
def cells(tmp_path: pathlib.Path) -> ClockCells:
    return ClockCells.make(tmp_path / "clock", followers=2)


def test_alone_it_is_the_wall_clock_times_the_speedup(wall: Wall) -> None:
    pace = FleetClock(4.0)
    assert pace.advance() == 0.0
    for _ in range(25):
        wall.now_s += 0.1
        reached_s = pace.advance()
    assert reached_s == pytest.approx(10.0)


def test_what_the_process_slept_through_does_not_pass(wall: Wall) -> None:
    pace = FleetClock(5.0)
    pace.advance()
    wall.now_s += 60.0
    assert pace.advance() == MOST_AT_ONCE_S
    wall.now_s += 0.1
    assert pace.advance() == pytest.approx(MOST_AT_ONCE_S + 0.5)


def test_who_has_not_begun_is_not_waited_for(wall: Wall, cells: ClockCells) -> None:
    pace = FleetClock(4.0, cells)
    pace.advance()
    wall.now_s += 1.0
    assert pace.advance() == pytest.approx(4.0)
    assert cells.values[0] == 0.0
    pace.publish()
    assert cells.values[0] == pytest.approx(4.0)


def test_the_slowest_promise_holds_the_time_back_without_a_jump_after(wall: Wall, cells: ClockCells) -> None:
    pace = FleetClock(4.0, cells)
    pace.advance()
    cells.values[1], cells.values[2] = 1.0, 0.3
    wall.now_s += 1.0
    assert pace.advance() == pytest.approx(0.3 + AHEAD_S)
    cells.values[2] = 10.0
    cells.values[1] = 10.0
    wall.now_s += 0.1
    assert pace.advance() == pytest.approx(0.3 + AHEAD_S + 0.4), "lost time is lost, not made up for"


def test_the_time_never_goes_back(wall: Wall, cells: ClockCells) -> None:
    pace = FleetClock(4.0, cells)
    pace.advance()
    wall.now_s += 1.0
    assert pace.advance() == pytest.approx(4.0)
    cells.values[1] = 0.5
    assert pace.advance() == pytest.approx(4.0)


def test_who_hangs_is_waited_for_for_a_while_only(wall: Wall, cells: ClockCells) -> None:
    pace = FleetClock(1.0, cells)
    pace.advance()
    cells.values[1] = 0.1
    wall.now_s += 1.0
    held_s = pace.advance()
    wall.now_s += STUCK_WALL_S - 0.1
    assert pace.advance() == held_s
    wall.now_s += 0.2
    assert pace.advance() > held_s
    cells.values[1] = 0.2
    wall.now_s += 1.0
    held_s = pace.advance()
    wall.now_s += 1.0
    assert pace.advance() == held_s, "it moves again and is waited for again"


def test_who_has_left_is_forgotten(wall: Wall, cells: ClockCells) -> None:
    pace = FleetClock(1.0, cells)
    pace.advance()
    cells.values[1] = 0.1
    cells.leave(1)
    wall.now_s += 1.0
    assert pace.advance() == pytest.approx(1.0)
    assert math.isinf(cells.values[1])
