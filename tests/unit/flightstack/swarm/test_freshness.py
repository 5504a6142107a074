"""What counts once: windows of numbers, starts that rise, and two agents with one number."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightstack.swarm.freshness import INCARNATIONS_AT_MOST, SENDERS_AT_MOST, Freshness, MessageMemory
from flightstack.swarm.topics import COMMAND, GROUND, TRAFFIC, Received, Topic
from flightstack.swarm.wire import Command, CommandName, GroundBeat, Traffic

NEW, REPEATED, PAST = Freshness.NEW, Freshness.REPEATED, Freshness.PAST


def hear(
    memory: MessageMemory, start: int, number: int, sender: str = "ground", topic: Topic = GROUND
) -> Freshness:
    message: GroundBeat | Traffic | Command = GroundBeat(sender, number, 255, start)
    if topic is COMMAND:
        message = Command("id", sender, 0, CommandName.START, incarnation=start, sequence=number)
    elif topic is TRAFFIC:
        message = Traffic(sender, 0, (), start, number)
    return memory.judge(Received(topic, sender, b""), message)


def test_a_message_counts_once_in_whatever_order():
    memory = MessageMemory()
    assert [hear(memory, 5, number) for number in (1, 3, 2, 2, 3, 1, 4)] == [
        NEW,
        NEW,
        NEW,
        REPEATED,
        REPEATED,
        REPEATED,
        NEW,
    ]


@pytest.mark.parametrize(("topic", "width"), [(GROUND, 64), (COMMAND, 1024)])
def test_what_is_too_late_to_know_was_heard(topic, width):
    memory = MessageMemory()
    assert hear(memory, 5, 5000, topic=topic) is NEW
    assert hear(memory, 5, 5001 - width, topic=topic) is NEW
    assert hear(memory, 5, 5000 - width, topic=topic) is REPEATED


def test_a_new_start_begins_anew_and_the_old_one_s_words_are_past():
    memory = MessageMemory()
    hear(memory, 6, 100)
    assert hear(memory, 7, 1) is NEW
    assert hear(memory, 5, 101) is PAST


def test_of_two_that_run_with_one_name_both_are_heard_but_nothing_twice():
    """The elder was known before; its words of before are not believed again."""
    memory = MessageMemory()
    hear(memory, 6, 1)
    for number in range(1, 50):
        assert hear(memory, 7, number) is NEW
        assert hear(memory, 6, number + 1) is NEW
    assert hear(memory, 6, 30) is REPEATED


def test_kinds_and_senders_count_by_themselves_and_starts_do_not():
    memory = MessageMemory()
    assert hear(memory, 7, 9) is NEW
    assert hear(memory, 7, 9, topic=TRAFFIC) is NEW
    assert hear(memory, 7, 9, sender="other") is NEW
    assert hear(memory, 6, 10, topic=COMMAND) is PAST


def test_who_does_not_count_is_not_counted():
    memory = MessageMemory()
    assert [hear(memory, 0, 0) for _ in range(3)] == [NEW] * 3


def test_memory_is_bounded():
    memory = MessageMemory()
    for start in range(1, 1000):
        assert hear(memory, start, 1) is NEW
    for index in range(2 * SENDERS_AT_MOST):
        hear(memory, 1, 1, sender=f"ground-command-{index}", topic=COMMAND)
    assert len(memory._senders) == SENDERS_AT_MOST
    assert all(len(starts.known) <= INCARNATIONS_AT_MOST for starts in memory._senders.values())


@given(st.lists(st.tuples(st.integers(1, 3), st.integers(1, 200)), max_size=200), st.integers(0, 1 << 30))
def test_nothing_counts_twice_whatever_comes(heard, seed):
    memory, counted = MessageMemory(), set()
    order = heard * 2
    random.Random(seed).shuffle(order)
    for start, number in order:
        if hear(memory, start, number) is NEW:
            assert (start, number) not in counted
            counted.add((start, number))
    for start, number in order:
        assert hear(memory, start, number) is not NEW or (start, number) not in counted
