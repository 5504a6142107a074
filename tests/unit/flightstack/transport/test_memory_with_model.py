"""The in-process radio as a `RadioModel` says it: distance, terrain, dead links, bandwidth."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightstack.swarm.topics import EVENT, STATE, Topic
from flightstack.transport.memory import Conditions, MemoryRadio, MemoryTransport
from flightstack.transport.radio_model import LinkBudget, RadioModel
from flightstack.transport.terrain import Ridge
from flightstack.transport.transmit_queue import HEADERS_BYTES


def two_apart(
    model: RadioModel, away_m: float, seed: int = 1
) -> tuple[MemoryRadio, MemoryTransport, MemoryTransport]:
    radio = MemoryRadio(seed, model=model)
    a, b = radio.join(1), radio.join(2)
    radio.place(1, (0.0, 0.0, -10.0))
    radio.place(2, (away_m, 0.0, -10.0))
    return radio, a, b


def numbers_heard(
    radio: MemoryRadio, sender: MemoryTransport, receiver: MemoryTransport, count: int, topic: Topic = STATE
) -> list[int]:
    heard = []
    for n in range(count + 100):
        if n < count:
            sender.publish(topic, str(n).encode())
        radio.step(radio.now_s + 0.1)
        heard += [int(message.payload) for message in receiver.receive()]
    return heard


def states_of(radio: MemoryRadio) -> list[object]:
    return [link._random.getstate() for links in radio._links.values() for link in links.values()]


def test_a_perfect_model_is_the_perfect_radio_and_draws_nothing():
    radio, a, b = two_apart(RadioModel(), 1e6)
    fresh = MemoryRadio(1)
    other, _ = fresh.join(1), fresh.join(2)
    other.publish(STATE, b"x")
    untouched = states_of(fresh)
    assert numbers_heard(radio, a, b, 20) == list(range(20))
    assert states_of(radio) == untouched


def test_conditions_and_range_stand_in_place_of_the_models():
    model = RadioModel(loss=0.5, delay_s=2.0, range_m=100.0)
    assert MemoryRadio(model=model).conditions == Conditions(loss=0.5, delay_s=2.0)
    radio = MemoryRadio(0, Conditions(loss=0.1), 50.0, model=model)
    assert (radio.conditions, radio.range_m) == (Conditions(loss=0.1), 50.0)


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 1000),
    loss=st.floats(0.0, 0.9),
    jitter_s=st.floats(0.0, 1.0),
    duplication=st.floats(0.0, 1.0),
    reordering=st.floats(0.0, 1.0),
    topic=st.sampled_from([STATE, EVENT]),
)
def test_a_model_without_distances_delivers_what_its_conditions_deliver(
    seed, loss, jitter_s, duplication, reordering, topic
):
    values = {"loss": loss, "jitter_s": jitter_s, "duplication": duplication, "reordering": reordering}
    radio, a, b = two_apart(RadioModel(**values), 50.0, seed)
    as_before = MemoryRadio(seed, Conditions(**values))
    c, d = as_before.join(1), as_before.join(2)
    assert numbers_heard(radio, a, b, 30, topic) == numbers_heard(as_before, c, d, 30, topic)


def test_the_share_that_is_lost_is_the_budgets():
    budget = LinkBudget()
    for away_m in (100.0, 700.0, 1000.0):
        radio, a, b = two_apart(RadioModel(link_budget=budget), away_m)
        share = len(numbers_heard(radio, a, b, 1000)) / 1000
        assert share == pytest.approx(1.0 - budget.loss(away_m), abs=0.05)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 1000), near_m=st.floats(1.0, 3000.0), farther_m=st.floats(0.0, 3000.0))
def test_who_is_farther_away_hears_a_part_of_what_the_nearer_hears_and_chance_is_the_same(
    seed, near_m, farther_m
):
    model = RadioModel(link_budget=LinkBudget(), loss=0.1)
    near, a, b = two_apart(model, near_m, seed)
    far, c, d = two_apart(model, near_m + farther_m, seed)
    assert set(numbers_heard(far, c, d, 40)) <= set(numbers_heard(near, a, b, 40))
    assert states_of(near) == states_of(far)


def test_who_leaves_and_comes_back_hears_what_it_would_have_heard():
    model = RadioModel(link_budget=LinkBudget(), loss=0.4)
    stays, a, b = two_apart(model, 100.0)
    moves, c, d = two_apart(model, 100.0)
    heard: tuple[list[int], list[int]] = ([], [])
    for n in range(60):
        moves.place(2, (1e5 if 20 <= n < 40 else 100.0, 0.0, -10.0))
        for (radio, sender, receiver), numbers in zip(((stays, a, b), (moves, c, d)), heard, strict=True):
            sender.publish(STATE, str(n).encode())
            radio.step(radio.now_s + 0.1)
            numbers += [int(message.payload) for message in receiver.receive()]
    assert heard[1] == [n for n in heard[0] if not 20 <= n < 40]
    assert any(20 <= n < 40 for n in heard[0])


def test_reliable_messages_come_late_from_far_and_not_at_all_from_out_of_reach():
    model = RadioModel(link_budget=LinkBudget())
    radio, a, b = two_apart(model, 1000.0)
    assert numbers_heard(radio, a, b, 50, EVENT) == list(range(50))
    radio, a, b = two_apart(model, 1e4)
    assert numbers_heard(radio, a, b, 50, EVENT) == []
    assert radio.audible("2") == set()


def test_a_ridge_hides_and_who_climbs_is_heard():
    ridge = Ridge(crest_ned_m=((50.0, -200.0, -40.0), (50.0, 200.0, -40.0)))
    radio, a, b = two_apart(RadioModel(ridges=(ridge,)), 100.0)
    a.publish(EVENT, b"hidden")
    radio.step(0.1)
    assert (b.receive(), radio.audible("1"), radio.audible("2")) == ([], set(), set())
    radio.place(1, (0.0, 0.0, -80.0))
    a.publish(EVENT, b"above")
    radio.step(0.2)
    assert [message.payload for message in b.receive()] == [b"above"]


def test_dead_links_are_dead_one_way_and_can_be_mended():
    radio = MemoryRadio(model=RadioModel(dead_links=((1, 2), (2, "ground"))))
    nodes = {name: radio.join(name) for name in (1, 2, "ground")}
    for node in nodes.values():
        node.publish(EVENT, b"x")
    radio.step(0.1)
    heard = {name: [message.sender for message in node.receive()] for name, node in nodes.items()}
    assert heard == {1: ["2", "ground"], 2: ["ground"], "ground": ["1"]}
    radio.unblock(1, 2)
    assert radio.audible("2") == {"1", "ground"}


def test_bandwidth_is_shared_by_all_receivers_that_want_it_and_are_in_reach():
    copy_bytes = 20 + HEADERS_BYTES
    radio = MemoryRadio(model=RadioModel(bandwidth_bytes_per_s=copy_bytes, delay_s=0.25, range_m=100.0))
    a, b, c = radio.join(1), radio.join(2), radio.join(3)
    deaf, far = radio.join(4, (EVENT,)), radio.join(5)
    for n in range(1, 5):
        radio.place(n, (float(n), 0.0, 0.0))
    radio.place(5, (1000.0, 0.0, 0.0))
    for payload in (b"1", b"2"):
        a.publish(STATE, payload.rjust(20))
    heard = []
    for _ in range(100):
        radio.step(radio.now_s + 0.125)
        for node in (b, c, deaf, far):
            heard += [(radio.now_s, node.node, message.payload.strip()) for message in node.receive()]
    assert heard == [(1.25, "2", b"1"), (2.25, "3", b"1"), (3.25, "2", b"2"), (4.25, "3", b"2")]


def test_a_crowded_node_drops_its_oldest_states_and_keeps_its_events():
    radio, a, b = two_apart(RadioModel(bandwidth_bytes_per_s=1000.0, queue_bytes=2000), 10.0)
    for n in range(100):
        a.publish(STATE, str(n).encode())
        a.publish(EVENT, str(n).encode())
    heard: dict[str, list[int]] = {STATE.name: [], EVENT.name: []}
    for _ in range(1000):
        radio.step(radio.now_s + 0.1)
        for message in b.receive():
            heard[message.topic.name].append(int(message.payload))
    assert heard[EVENT.name] == list(range(100))
    assert heard[STATE.name][0] == 0
    assert len(heard[STATE.name]) < 20


def test_what_waits_at_a_node_is_sent_after_it_left_and_lost_with_its_radio():
    model = RadioModel(bandwidth_bytes_per_s=100.0)
    radio, a, b = two_apart(model, 10.0)
    for n in range(3):
        a.publish(EVENT, str(n).encode())
    a.close()
    radio.step(10.0)
    assert [message.payload for message in b.receive()] == [b"0", b"1", b"2"]
    radio, a, b = two_apart(model, 10.0)
    for n in range(3):
        a.publish(EVENT, str(n).encode())
    radio.step(1.0)
    radio.switch_off(1)
    radio.step(10.0)
    assert [message.payload for message in b.receive()] == [b"0"]


models = st.builds(
    RadioModel,
    loss=st.floats(0.0, 0.8),
    link_budget=st.sampled_from([None, LinkBudget()]),
    delay_s=st.floats(0.0, 0.5),
    jitter_s=st.floats(0.0, 0.5),
    duplication=st.floats(0.0, 1.0),
    reordering=st.floats(0.0, 1.0),
    bandwidth_bytes_per_s=st.sampled_from([None, 500.0, 5000.0]),
    queue_bytes=st.sampled_from([0, 500, 32_768]),
)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 1000), model=models, away_m=st.floats(0.0, 1500.0))
def test_the_same_seed_and_model_give_the_same_flight_and_reliable_messages_all_arrive_in_order(
    seed, model, away_m
):
    def flight() -> tuple[list[int], list[int]]:
        radio, a, b = two_apart(model, away_m, seed)
        states = numbers_heard(radio, a, b, 20)
        events = numbers_heard(radio, a, b, 20, EVENT)
        for _ in range(400):
            radio.step(radio.now_s + 1.0)
            events += [int(message.payload) for message in b.receive() if message.topic is EVENT]
        return states, events

    first = flight()
    assert flight() == first
    if LinkBudget().loss(away_m) < 0.9 or model.link_budget is None:
        assert first[1] == list(range(20))
