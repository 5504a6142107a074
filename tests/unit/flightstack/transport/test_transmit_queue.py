"""The queue before a node's radio: order, waiting, dropping."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightstack.swarm.topics import EVENT, STATE, Delivery, Received, Topic
from flightstack.transport.transmit_queue import HEADERS_BYTES, Copy, TransmitQueue


def a_copy(number: int, size_bytes: int = 100, topic: Topic = STATE) -> Copy:
    return Copy("2", Received(topic, "1", str(number).encode().rjust(size_bytes - HEADERS_BYTES)))


def number(copy: Copy) -> int:
    return int(copy.message.payload)


def test_one_after_the_other_each_as_long_as_its_bytes_take() -> None:
    queue = TransmitQueue(1000.0, 10_000)
    for n, size_bytes in enumerate((100, 200, 300)):
        queue.put(5.0, a_copy(n, size_bytes))
    assert list(queue.departed(5.0)) == []
    assert [(when_s, number(copy)) for when_s, copy in queue.departed(5.35)] == [
        (pytest.approx(5.1), 0),
        (pytest.approx(5.3), 1),
    ]
    assert [(when_s, number(copy)) for when_s, copy in queue.departed(9.0)] == [(pytest.approx(5.6), 2)]
    queue.put(9.0, a_copy(3))
    assert [when_s for when_s, _ in queue.departed(10.0)] == [pytest.approx(9.1)]


def test_the_oldest_best_effort_copies_make_room_and_what_is_being_sent_stays() -> None:
    queue = TransmitQueue(1000.0, 300)
    for n in range(6):  # 0 is being sent, three of the others may wait
        queue.put(0.0, a_copy(n))
    assert [number(copy) for _, copy in queue.departed(10.0)] == [0, 3, 4, 5]


def test_reliable_copies_wait_however_many_they_are_and_take_the_others_room() -> None:
    queue = TransmitQueue(1000.0, 300)
    for n in range(10):
        queue.put(0.0, a_copy(n, topic=STATE if n % 5 == 1 else EVENT))
    assert [number(copy) for _, copy in queue.departed(10.0)] == [0, 2, 3, 4, 5, 7, 8, 9]


def test_without_a_queue_only_what_is_being_sent_is_sent() -> None:
    queue = TransmitQueue(1000.0, 0)
    for n in range(3):
        queue.put(0.0, a_copy(n))
    assert [number(copy) for _, copy in queue.departed(10.0)] == [0]


sent = st.lists(
    st.tuples(st.sampled_from([0.0, 0.05, 0.5]), st.integers(100, 900), st.sampled_from([STATE, EVENT])),
    max_size=40,
)


@given(
    sent=sent, most_bytes=st.integers(0, 3000), bandwidth_bytes_per_s=st.sampled_from([500.0, 1000.0, 9000.0])
)
def test_order_is_kept_reliable_ones_all_leave_and_no_byte_is_faster_than_the_radio(
    sent: list[tuple[float, int, Topic]], most_bytes: int, bandwidth_bytes_per_s: float
) -> None:
    queue = TransmitQueue(bandwidth_bytes_per_s, most_bytes)
    now_s, left, put_at_s = 0.0, [], []
    for n, (later_s, size_bytes, topic) in enumerate(sent):
        now_s += later_s
        left += queue.departed(now_s)
        queue.put(now_s, a_copy(n, size_bytes, topic))
        put_at_s.append(now_s)
    left += queue.departed(now_s + 1000.0)
    numbers = [number(copy) for _, copy in left]
    assert numbers == sorted(set(numbers))
    assert {n for n, (_, _, topic) in enumerate(sent) if topic.delivery is Delivery.RELIABLE} <= set(numbers)
    for when_s, copy in left:
        assert when_s >= put_at_s[number(copy)] + copy.size_bytes / bandwidth_bytes_per_s - 1e-9
    for (before_s, _), (after_s, copy) in itertools.pairwise(left):
        assert after_s - before_s >= copy.size_bytes / bandwidth_bytes_per_s - 1e-9
