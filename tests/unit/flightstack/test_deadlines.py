"""When ticks are due, and which count as missed."""

from __future__ import annotations

import pytest

from flightstack.deadlines import Deadlines


def test_ticks_in_time_follow_each_other_by_the_period() -> None:
    deadlines = Deadlines(0.1)
    due_s = 5.0
    for _ in range(10):
        due_s = deadlines.next_due_s(due_s, due_s + 0.09)
    assert due_s == pytest.approx(6.0)
    assert (deadlines.ticks, deadlines.late) == (10, 0)
    assert deadlines.worst_s == pytest.approx(0.09)


def test_ticks_that_were_missed_are_counted_and_not_made_up() -> None:
    deadlines = Deadlines(0.1)
    assert deadlines.next_due_s(5.0, 5.35) == pytest.approx(5.4)
    assert (deadlines.ticks, deadlines.late) == (4, 3)
    assert deadlines.next_due_s(5.4, 5.41) == pytest.approx(5.5)
    assert (deadlines.ticks, deadlines.late) == (5, 3)
    assert deadlines.worst_s == pytest.approx(0.35)


def test_a_clock_that_stands_still_does_not_make_a_tick_early() -> None:
    assert Deadlines(0.1).next_due_s(5.0, 4.9) == pytest.approx(5.1)
