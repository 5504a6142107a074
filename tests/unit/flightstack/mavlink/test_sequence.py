"""Sequence numbers: late, repeated, begun anew, and of two that use one sender's ids."""

from __future__ import annotations

import random

import pytest

from flightstack.mavlink.sequence import COUNTS_AT_MOST, REORDERED_FRAMES, SequenceFilter

STATE, EVENT = 1, 2


@pytest.fixture
def sender() -> SequenceFilter:
    return SequenceFilter(frozenset((EVENT,)))


def test_a_steady_count_goes_round_and_every_frame_is_news(sender: SequenceFilter) -> None:
    assert all(sender.is_news(0.01 * n, n % 256, STATE) for n in range(2000))


def test_late_and_repeated_states_are_none(sender: SequenceFilter) -> None:
    for number in range(100, 400):
        assert sender.is_news(0.01 * number, number % 256, STATE)
        for behind in (0, 1, 10, REORDERED_FRAMES - 1):
            if behind <= number - 100:
                assert not sender.is_news(0.01 * number, (number - behind) % 256, STATE)


def test_of_late_events_each_counts_once(sender: SequenceFilter) -> None:
    order = list(range(40))
    random.Random(1).shuffle(order)
    assert [sender.is_news(0.0, n, EVENT) for n in order].count(True) == 40
    assert not any(sender.is_news(0.1, n, EVENT) for n in order)


@pytest.mark.parametrize("lost", [1, 31, 32, 33, 100, 191, 200, 255, 300])
def test_after_any_loss_what_comes_next_is_news(sender: SequenceFilter, lost: int) -> None:
    for number in range(50):
        sender.is_news(0.01 * number, number, STATE)
    later_s = 0.5 + 0.01 * lost
    news = [sender.is_news(later_s + 0.01 * n, (50 + lost + n) % 256, STATE) for n in range(300)]
    # A link that lost nearly a whole round within a second looks like one that repeats itself.
    assert all(news) if lost < 256 - REORDERED_FRAMES else news.count(True) > 200


@pytest.mark.parametrize("offset", range(0, 256, 16))
def test_another_that_uses_the_ids_makes_nobodys_frames_late(sender: SequenceFilter, offset: int) -> None:
    """The vehicle sends 25 frames a second, the other one a second, and their numbers cross."""
    dropped = 0
    for tick in range(25 * 60):
        now_s = 0.04 * tick
        dropped += not sender.is_news(now_s, tick % 256, STATE)
        if tick % 25 == 13:
            sender.is_news(now_s, (tick // 25 + offset) % 256, STATE)
    assert dropped <= 40, "where the other begins within the vehicle's next numbers, once"


def test_two_that_count_alike_fast_are_both_followed(sender: SequenceFilter) -> None:
    news = 0
    for tick in range(1000):
        news += sender.is_news(0.05 * tick, tick % 256, STATE)
        news += sender.is_news(0.05 * tick, (tick + 128) % 256, STATE)
    assert news == 2000


def test_any_numbers_are_survived_within_bounds(sender: SequenceFilter) -> None:
    chance = random.Random(7)
    for tick in range(5000):
        sender.is_news(0.001 * tick, chance.randrange(256), chance.choice((STATE, EVENT)))
        assert len(sender._counts) <= COUNTS_AT_MOST
    assert sender.is_news(60.0, 9, STATE)
