"""The table of topics: what everything that travels has to agree with."""

from __future__ import annotations

import pytest

from flightstack.swarm.topics import COMMAND, EVENT, OUTCOME, TOPICS, Delivery


def test_every_topic_stands_under_its_name_with_a_type_of_its_own():
    assert all(name == topic.name for name, topic in TOPICS.items())
    assert len({topic.codec.kind for topic in TOPICS.values()}) == len(TOPICS)


@pytest.mark.parametrize("topic", TOPICS.values(), ids=lambda t: t.name)
def test_what_is_repeated_grows_stale_after_several_losses_and_the_rest_is_reliable(topic):
    if topic.rate_hz is None:
        assert topic.delivery is Delivery.RELIABLE
        assert topic.stale_s is None
    else:
        assert topic.delivery is Delivery.BEST_EFFORT
        assert topic.stale_s >= 4.0 / topic.rate_hz


def test_what_must_not_be_lost_is_reliable():
    assert {t.delivery for t in (COMMAND, OUTCOME, EVENT)} == {Delivery.RELIABLE}


def test_keys_are_distinct_by_swarm_topic_and_sender():
    keys = {
        t.key(swarm, sender) for t in TOPICS.values() for swarm in ("a", "b") for sender in (1, "ground", "*")
    }
    assert len(keys) == len(TOPICS) * 6
    assert COMMAND.key("rabaul", "*") == "flightstack/rabaul/command/*"
