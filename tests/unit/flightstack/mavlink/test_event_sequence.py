"""Lost events are asked for again, each a few times; an autopilot that restarts is not asked for its past."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightstack.mavlink.event_sequence import KEPT, TRIES, EventArrival, EventSequence


def asked(events: EventSequence, now_s: float) -> list[tuple[int, int]]:
    return [(m.first_sequence, m.last_sequence) for m in events.requests(now_s, 3, 1)]


def test_nothing_is_asked_for_while_nothing_is_lost() -> None:
    events = EventSequence()
    for number in (65534, 65535, 0, 1):
        assert events.take(number) is EventArrival.NEW
    events.told(1)
    assert asked(events, 0.0) == []
    assert events.take(1) is EventArrival.KNOWN
    assert events.take(65535) is EventArrival.KNOWN


def test_what_lies_between_is_asked_for_over_the_turn_of_the_numbers() -> None:
    events = EventSequence()
    events.take(65533)
    assert events.take(1) is EventArrival.NEW
    assert asked(events, 0.0) == [(65534, 0)]
    assert asked(events, 0.5) == [], "not so soon again"
    assert events.take(65535) is EventArrival.LATE
    assert asked(events, 1.0) == [(65534, 65534), (0, 0)]


def test_the_last_one_is_missed_by_the_number_that_is_told() -> None:
    events = EventSequence()
    events.take(10)
    events.told(12)
    assert asked(events, 0.0) == [(11, 12)]
    assert events.take(12) is EventArrival.LATE


def test_it_is_not_asked_for_ever() -> None:
    events = EventSequence()
    events.take(10)
    events.take(12)
    assert [bool(asked(events, float(second))) for second in range(TRIES + 2)] == [True] * TRIES + [False] * 2


def test_a_restart_is_no_loss_and_neither_is_the_past() -> None:
    events = EventSequence()
    events.told(500)
    assert asked(events, 0.0) == []
    assert events.take(501) is EventArrival.NEW
    assert events.take(3) is EventArrival.NEW
    assert asked(events, 1.0) == []


@given(
    numbers=st.lists(st.integers(0, 65535), max_size=200), told=st.lists(st.integers(0, 65535), max_size=50)
)
def test_whatever_comes_little_is_kept(numbers: list[int], told: list[int]) -> None:
    events = EventSequence()
    for number in numbers:
        events.take(number)
    for number in told:
        events.told(number)
    assert sum(1 + (last - first) % 65536 for first, last in asked(events, 0.0)) <= KEPT


@pytest.mark.parametrize("lost", [1, 5, KEPT - 1])
def test_all_that_was_lost_in_a_row_is_asked_for_at_once(lost: int) -> None:
    events = EventSequence()
    events.take(100)
    events.take(101 + lost)
    assert asked(events, 0.0) == [(101, 100 + lost)]
