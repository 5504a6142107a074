"""Table and order are told where digests differ, and seldom where they do not."""

from __future__ import annotations

import pytest

from flightstack.swarm.exchange import DIGEST_S, PERIOD_S, REFRESH_S, SHOWN_S, Exchange, OrderExchange
from flightstack.swarm.peers import PeerFacts

TICK_S = 0.1


def said(digest: int) -> PeerFacts:
    return PeerFacts(0.0, True, False, None, 1, digest)


def tellings(exchange: Exchange, digests: list[int], peers: dict[int, PeerFacts]) -> list[int]:
    """The ticks in which the table is told."""
    return [tick for tick, own in enumerate(digests) if exchange.is_due(tick * TICK_S, own, peers)]


def test_at_rest_it_is_said_once_and_then_seldom() -> None:
    ticks = tellings(Exchange(TICK_S), [7] * 101, {2: said(7)})
    assert ticks == [0, 50, 100]
    assert REFRESH_S == 50 * TICK_S


def test_where_somebody_knows_another_one_it_is_said_at_the_full_rate_while_that_one_is_heard() -> None:
    ticks = tellings(Exchange(TICK_S), [7] * 40, {2: said(8), 3: said(7)})
    assert ticks == list(range(0, round(DIGEST_S / TICK_S), round(PERIOD_S / TICK_S)))


def test_what_is_new_is_said_at_once_and_a_change_a_tick_does_not_flood() -> None:
    assert tellings(Exchange(TICK_S), [7] * 10 + [8] * 10, {}) == [0, 10]
    assert tellings(Exchange(TICK_S), list(range(10)), {}) == [0, 1, 2, 4, 6, 8]


def test_news_do_not_wait_for_each_other() -> None:
    """A refutation follows a suspicion, and a claim one that was told twice."""
    assert tellings(Exchange(TICK_S), [7, 7, 7, 8, 9, 9], {}) == [0, 3, 4]
    assert tellings(Exchange(TICK_S), [7, 7, 7, 8, 8, 8, 8], {2: said(9)}) == [0, 2, 3, 5]


def test_who_is_counted_in_is_shown_within_a_second_though_nobody_has_to_know() -> None:
    exchange = Exchange(TICK_S)
    assert exchange.is_due(0.0, 7, {}, {1: 0, 2: 1})
    due = [tick for tick in range(1, 40) if exchange.is_due(tick * TICK_S, 7, {}, {1: 0})]
    assert due == [round(SHOWN_S / TICK_S)]


def test_an_order_is_told_again_to_whoever_has_since_said_that_it_knows_another() -> None:
    """At 0.3 s a peer says that it knows the order of before; at 0.5 s it has heard."""
    exchange = OrderExchange(TICK_S)
    told = []
    for tick in range(20):
        now_s = tick * TICK_S
        said_s = 0.3 if now_s < 0.5 else 0.5
        peers = {2: PeerFacts(said_s, True, False, None, 1, 7, 9 if now_s >= 0.5 else 8)} if tick > 2 else {}
        if exchange.is_due(now_s, 9, peers):
            told.append(tick)
    assert told == [0, 3]


@pytest.mark.parametrize(
    "facts",
    [
        pytest.param(PeerFacts(0.1, True, False, None, 1, 7, 8), id="said before the order can have come"),
        pytest.param(PeerFacts(0.3, True, False, None, 1, 0, 8), id="knows of no survey"),
    ],
)
def test_what_a_peer_knew_before_it_was_told_is_no_reason_to_tell_an_order_again(facts: PeerFacts) -> None:
    exchange = OrderExchange(TICK_S)
    assert [tick for tick in range(20) if exchange.is_due(tick * TICK_S, 9, {2: facts})] == [0]


def test_who_knows_of_no_order_is_told_it_for_as_long_as_it_says_so() -> None:
    exchange = OrderExchange(TICK_S)
    states = [PeerFacts(tick * TICK_S, True, False, None, 1, 7) for tick in range(9)]
    told = [tick for tick, facts in enumerate(states) if exchange.is_due(facts.heard_s, 9, {2: facts})]
    assert told == [0, 2, 4, 6, 8]
