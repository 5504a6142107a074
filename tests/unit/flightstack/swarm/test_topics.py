"""What the table of topics promises, on a radio that keeps nothing else."""

from __future__ import annotations

import itertools

import pytest

from flightstack.swarm.topics import COMMAND, TOPICS, Topic
from flightstack.transport.memory import Conditions, MemoryRadio

REPEATED = [topic for topic in TOPICS.values() if topic.rate_hz is not None]
SAID_ONCE = [topic for topic in TOPICS.values() if topic.rate_hz is None]


@pytest.mark.parametrize("topic", REPEATED, ids=lambda t: t.name)
def test_at_its_rate_a_topic_is_not_taken_for_stale_because_one_in_ten_is_lost(topic: Topic) -> None:
    assert topic.rate_hz is not None
    assert topic.stale_s is not None
    radio = MemoryRadio(seed=1, conditions=Conditions(loss=0.1))
    speaker, listener = radio.join(1), radio.join(2)
    heard_s = [0.0]
    for tick in range(1, 1 + round(600.0 * topic.rate_hz)):
        speaker.publish(topic, b"%d" % tick)
        radio.step(tick / topic.rate_hz)
        heard_s += [radio.now_s] * bool(listener.receive())
    assert len(heard_s) < 0.95 * 600.0 * topic.rate_hz, "some were lost"
    assert max(late - early for early, late in itertools.pairwise(heard_s)) < topic.stale_s


@pytest.mark.parametrize("topic", SAID_ONCE, ids=lambda t: t.name)
def test_what_is_said_once_arrives_though_half_of_everything_is_lost(topic: Topic) -> None:
    radio = MemoryRadio(seed=1, conditions=Conditions(loss=0.5))
    speaker, listener = radio.join(1), radio.join(2)
    said = [b"%d" % n for n in range(100)]
    for payload in said:
        speaker.publish(topic, payload)
    radio.step(60.0)
    assert [received.payload for received in listener.receive()] == said


def test_keys_are_distinct_by_swarm_topic_and_sender() -> None:
    keys = {
        t.key(swarm, sender) for t in TOPICS.values() for swarm in ("a", "b") for sender in (1, "ground", "*")
    }
    assert len(keys) == len(TOPICS) * 6
    assert COMMAND.key("rabaul", "*") == "flightstack/rabaul/command/*"
