"""Clocks: the wall's goes with its factor, the simulated one only when told."""

from __future__ import annotations

import time

import pytest

from flightstack.recording.clock import SimulatedClock, WallClock


def test_the_walls_clock_is_the_monotonic_one_times_its_factor():
    clock = WallClock(4.0)
    before_s = time.monotonic()
    now_s = clock.now_s()
    after_s = time.monotonic()
    assert 4.0 * before_s <= now_s <= 4.0 * after_s


def test_sleeping_until_reaches_the_deadline_and_a_past_one_is_no_wait():
    clock = WallClock(100.0)
    deadline_s = clock.now_s() + 1.0
    clock.sleep_until(deadline_s)
    assert clock.now_s() >= deadline_s
    clock.sleep_until(0.0)


@pytest.mark.parametrize("factor", [0.0, -1.0, 100.5, float("nan")])
def test_a_factor_that_cannot_be_is_refused(factor):
    with pytest.raises(ValueError, match="speedup"):
        WallClock(factor)


def test_simulated_time_passes_when_it_is_waited_for_and_never_goes_back():
    clock = SimulatedClock(5.0)
    clock.sleep_until(7.5)
    clock.sleep_until(6.0)
    assert clock.now_s() == 7.5
