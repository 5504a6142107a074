"""The in-process radio's faults: each does what it says, and all of it again with the same seed."""

from __future__ import annotations

import collections

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightstack.swarm.topics import COMMAND, EVENT, STATE
from flightstack.transport import TransportError
from flightstack.transport.backlog import KEPT_PER_SENDER
from flightstack.transport.memory import Conditions, MemoryRadio, MemoryTransport


def send_and_hear(
    radio: MemoryRadio, sender: MemoryTransport, receiver: MemoryTransport, count: int, topic=STATE
) -> list[tuple[float, int]]:
    """Send numbers every 0.1 s and note when each is heard; then listen for another 10 s."""
    heard = []
    for n in range(count + 100):
        if n < count:
            sender.publish(topic, str(n).encode())
        radio.step(radio.now_s + 0.1)
        heard += [(radio.now_s, int(message.payload)) for message in receiver.receive()]
    return heard


def test_a_perfect_radio_delivers_at_the_next_step():
    radio = MemoryRadio()
    a, b = radio.join(1), radio.join(2)
    a.publish(STATE, b"x")
    assert b.receive() == []
    radio.step(0.0)
    assert [m.payload for m in b.receive()] == [b"x"]


def test_loss_takes_its_share_of_best_effort_messages():
    radio = MemoryRadio(seed=3, conditions=Conditions(loss=0.3))
    heard = send_and_hear(radio, radio.join(1), radio.join(2), 1000)
    assert 640 < len(heard) < 760


def test_loss_only_delays_reliable_messages_and_keeps_their_order():
    radio = MemoryRadio(seed=3, conditions=Conditions(loss=0.5, jitter_s=0.2))
    heard = send_and_hear(radio, radio.join(1), radio.join(2), 300, EVENT)
    assert [n for _, n in heard] == list(range(300))
    assert max(when_s - 0.1 * (n + 1) for when_s, n in heard) > 0.5


def test_delay_and_jitter_hold_messages_back_in_order():
    radio = MemoryRadio(seed=3, conditions=Conditions(delay_s=0.5, jitter_s=0.3))
    heard = send_and_hear(radio, radio.join(1), radio.join(2), 300)
    late_s = [when_s - 0.1 * n for when_s, n in heard]
    assert min(late_s) >= 0.5
    assert 0.7 < sum(late_s) / len(late_s) < 1.3
    assert [n for _, n in heard] == sorted(n for _, n in heard)


def test_duplication_and_reordering_touch_best_effort_messages_only():
    conditions = Conditions(duplication=0.3, reordering=0.3)
    radio = MemoryRadio(seed=3, conditions=conditions)
    states = [n for _, n in send_and_hear(radio, radio.join(1), radio.join(2), 300)]
    assert set(states) == set(range(300))
    assert 50 < sum(count > 1 for count in collections.Counter(states).values()) < 130
    assert states != sorted(states)
    radio = MemoryRadio(seed=3, conditions=conditions)
    events = [n for _, n in send_and_hear(radio, radio.join(1), radio.join(2), 300, EVENT)]
    assert events == list(range(300))


def test_range_is_judged_where_the_nodes_are_when_it_arrives():
    radio = MemoryRadio(range_m=100.0)
    where = {"north_m": 50.0}
    a, b = radio.join(1), radio.join(2, position=lambda: (where["north_m"], 0.0, -10.0))
    radio.place(1, (0.0, 0.0, -10.0))
    a.publish(STATE, b"near")
    radio.step(0.1)
    where["north_m"] = 100.1
    a.publish(STATE, b"far")
    radio.step(0.2)
    assert [m.payload for m in b.receive()] == [b"near"]
    assert b.alive() == set()
    where["north_m"] = 99.9
    a.publish(STATE, b"near again")
    where["north_m"] = 100.1
    radio.step(0.3)
    assert b.receive() == []


def test_partitions_have_names_and_may_overlap():
    radio = MemoryRadio()
    nodes = {n: radio.join(n) for n in (1, 2, 3, "ground")}
    radio.cut("crater wall", [1, 2])
    radio.cut("ground lost", ["ground"])
    assert nodes[1].alive() == {"2"}
    assert nodes[3].alive() == set()
    radio.mend("crater wall")
    assert nodes[1].alive() == {"2", "3"}
    nodes[1].publish(EVENT, b"x")
    radio.step(0.1)
    assert [len(nodes[n].receive()) for n in (2, 3, "ground")] == [1, 1, 0]
    radio.mend("ground lost")
    assert nodes["ground"].alive() == {"1", "2", "3"}
    with pytest.raises(ValueError, match="no partition is named 'crater wall'"):
        radio.mend("crater wall")


def test_what_is_under_way_when_the_link_breaks_is_lost():
    radio = MemoryRadio(conditions=Conditions(delay_s=1.0))
    a, b = radio.join(1), radio.join(2)
    a.publish(EVENT, b"x")
    radio.cut("gone", [2])
    radio.step(2.0)
    radio.mend("gone")
    radio.step(3.0)
    assert b.receive() == []


def test_a_node_that_is_off_neither_hears_nor_is_heard_and_forgets():
    radio = MemoryRadio()
    a, b = radio.join(1), radio.join(2)
    a.publish(EVENT, b"before")
    radio.step(0.1)
    radio.switch_off(2)
    a.publish(EVENT, b"to it")
    b.publish(EVENT, b"from it")
    radio.step(0.2)
    radio.switch_on(2)
    assert (a.receive(), b.receive()) == ([], [])
    a.publish(EVENT, b"after")
    radio.step(0.3)
    assert [m.payload for m in b.receive()] == [b"after"]


def test_one_direction_may_be_worse_than_the_other():
    radio = MemoryRadio()
    a, b = radio.join(1), radio.join(2)
    radio.set_link(1, 2, Conditions(delay_s=5.0), both_ways=False)
    a.publish(EVENT, b"there")
    b.publish(EVENT, b"back")
    radio.step(0.1)
    assert [m.payload for m in a.receive()] == [b"back"]
    assert b.receive() == []


def test_a_node_that_nobody_empties_stays_small():
    radio = MemoryRadio()
    a, b = radio.join(1), radio.join(2)
    for n in range(10_000):
        a.publish(STATE, b"s")
        if n < 5_000:
            a.publish(COMMAND, b"c")
    radio.step(0.1)
    received = b.receive()
    assert sum(m.topic is STATE for m in received) == KEPT_PER_SENDER
    assert sum(m.topic is COMMAND for m in received) == 4096


def test_names_and_times_that_cannot_be_are_refused():
    radio = MemoryRadio()
    radio.join(1)
    with pytest.raises(TransportError, match="node 1 is on the radio already"):
        radio.join("1")
    radio.step(1.0)
    with pytest.raises(ValueError, match="time goes back"):
        radio.step(0.5)
    for bad in ({"loss": 1.5}, {"loss": 1.0}, {"duplication": -0.1}, {"delay_s": -1.0}):
        with pytest.raises(ValueError, match=r"probability|partition|negative"):
            Conditions(**bad)


conditions = st.builds(
    Conditions,
    loss=st.floats(0.0, 0.9),
    delay_s=st.floats(0.0, 1.0),
    jitter_s=st.floats(0.0, 1.0),
    duplication=st.floats(0.0, 1.0),
    reordering=st.floats(0.0, 1.0),
)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 1000), conditions=conditions, others=st.integers(0, 3))
def test_the_same_seed_gives_the_same_deliveries_whoever_else_is_there(seed, conditions, others):
    def flight(bystanders: int) -> list[tuple[float, int]]:
        radio = MemoryRadio(seed, conditions)
        a, b = radio.join(1), radio.join(2)
        for n in range(bystanders):
            radio.join(10 + n).publish(EVENT, b"-1")
        return [item for item in send_and_hear(radio, a, b, 30) if item[1] >= 0]

    assert flight(others) == flight(0)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 1000), conditions=conditions)
def test_reliable_messages_always_arrive_once_in_order_and_never_early(seed, conditions):
    radio = MemoryRadio(seed, conditions)
    a, b = radio.join(1), radio.join(2)
    heard = send_and_hear(radio, a, b, 20, EVENT)
    for _ in range(500):
        radio.step(radio.now_s + 0.5)
        heard += [(radio.now_s, int(m.payload)) for m in b.receive()]
    assert [n for _, n in heard] == list(range(20))
    assert all(when_s >= 0.1 * n + conditions.delay_s - 1e-9 for when_s, n in heard)
