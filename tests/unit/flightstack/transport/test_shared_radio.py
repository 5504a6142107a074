"""What a process of a simulated flight hears of the others: lost, late, out of reach, and the same again by seed."""

from __future__ import annotations

import contextlib
import pathlib
from collections.abc import Callable

import pytest

from flightstack.swarm.topics import COMMAND, EVENT, STATE, Topic
from flightstack.transport import TransportError
from flightstack.transport.memory import MemoryRadio
from flightstack.transport.node_places import NodePlaces
from flightstack.transport.radio_model import LinkBudget, RadioModel
from flightstack.transport.shared_radio import RadioEnd, SharedRadio, behind_radio
from flightstack.transport.terrain import Ridge
from mission.documents.yaml_file import DocumentError
from mission.documents.yaml_values import text_of


class Air:
    """Two nodes, 1 who sends and 2 who hears through the radio, and a network between them that loses nothing."""

    def __init__(self, model: RadioModel, *, seed: int = 1, places: str | None = None) -> None:
        self.network = MemoryRadio()
        self.sender = self.network.join(1)
        radio = SharedRadio(model=model, seed=seed, places=places, placed=(1, 2))
        self.ear = RadioEnd(self.network.join(2), 2, radio, lambda: self.network.now_s)

    def turn(self, *messages: tuple[Topic, bytes]) -> list[bytes]:
        """Send, and what has come 0.1 s later."""
        for topic, payload in messages:
            self.sender.publish(topic, payload)
        self.network.step(self.network.now_s + 0.1)
        return [message.payload for message in self.ear.receive()]


def heard(
    air: Air, topic: Topic, count: int, and_also: Callable[[int], tuple[tuple[Topic, bytes], ...]]
) -> list[int]:
    """Which of `count` messages of a topic came, one every 0.1 s."""
    came = []
    for number in range(count):
        payloads = air.turn((topic, b"%d" % number), *and_also(number))
        came += [int(payload) for payload in payloads if payload.isdigit()]
    return came


def nothing(_: int) -> tuple[tuple[Topic, bytes], ...]:
    return ()


def test_a_perfect_radio_changes_nothing() -> None:
    assert heard(Air(RadioModel()), STATE, 50, nothing) == list(range(50))


def test_a_share_of_what_is_best_effort_is_lost() -> None:
    came = heard(Air(RadioModel(loss=0.2)), STATE, 2000, nothing)
    assert len(came) == pytest.approx(1600, abs=60)
    assert came == sorted(set(came))


def test_who_hears_what_is_the_same_again_however_other_topics_mingle() -> None:
    def sometimes(number: int) -> tuple[tuple[Topic, bytes], ...]:
        return ((EVENT, b"event"),) if number % 3 == 0 else ()

    first = heard(Air(RadioModel(loss=0.3)), STATE, 200, nothing)
    assert heard(Air(RadioModel(loss=0.3)), STATE, 200, sometimes) == first
    assert heard(Air(RadioModel(loss=0.3), seed=2), STATE, 200, nothing) != first


def test_what_is_reliable_comes_late_and_in_order_and_is_never_lost() -> None:
    air = Air(RadioModel(loss=0.5))
    came = [air.turn((COMMAND, b"%d" % number)) for number in range(200)]
    came += [air.turn() for _ in range(100)]
    assert [int(payload) for payloads in came for payload in payloads] == list(range(200))
    assert came[0:200] != [[b"%d" % number] for number in range(200)], "a loss costs time"


def test_what_takes_longer_is_held_back() -> None:
    air = Air(RadioModel(delay_s=0.25))
    assert [air.turn((STATE, b"a")), air.turn(), air.turn(), air.turn()] == [[], [], [], [b"a"]]


def test_one_way_is_dead_and_the_other_is_not() -> None:
    assert heard(Air(RadioModel(dead_links=((1, 2),))), STATE, 5, nothing) == []
    assert heard(Air(RadioModel(dead_links=((2, 1),))), STATE, 5, nothing) == list(range(5))


@pytest.mark.parametrize(
    "model",
    [
        RadioModel(range_m=100.0),
        RadioModel(link_budget=LinkBudget(transmit_dbm=-20.0)),
        RadioModel(ridges=(Ridge(crest_ned_m=((50.0, -500.0, -90.0), (50.0, 500.0, -90.0))),)),
    ],
)
def test_who_flies_out_of_reach_is_not_heard_until_it_comes_back(
    model: RadioModel, tmp_path: pathlib.Path
) -> None:
    with contextlib.closing(NodePlaces.make(tmp_path / "places", 2)) as places:
        air = Air(model, places=str(tmp_path / "places"))
        assert air.turn((STATE, b"nowhere yet")) == [b"nowhere yet"]
        places.tell(0, (20.0, 0.0, -10.0))
        places.tell(1, (0.0, 0.0, -10.0))
        assert air.turn((STATE, b"near")) == [b"near"]
        places.tell(0, (900.0, 0.0, -10.0))
        assert air.turn((STATE, b"far"), (COMMAND, b"far, too")) == []
        places.tell(0, (20.0, 0.0, -10.0))
        assert air.turn((STATE, b"near again")) == [b"near again"]
        air.ear.close()


def test_places_for_too_few(tmp_path: pathlib.Path) -> None:
    NodePlaces.make(tmp_path / "places", 1).close()
    with pytest.raises(DocumentError, match="places of 1 nodes only"):
        Air(RadioModel(range_m=100.0), places=str(tmp_path / "places"))


def test_without_a_file_a_transport_stays_what_it_is() -> None:
    node = MemoryRadio().join(1)
    assert behind_radio(node, 1, None, lambda: 0.0) is node


def test_the_file_says_how_good_the_radio_is(
    tmp_path: pathlib.Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = tmp_path / "radio.yaml"
    file.write_text(text_of({"model": {"dead_links": [[1, 2]]}, "seed": 3}), encoding="utf-8")
    network = MemoryRadio()
    sender, ear = network.join(1), behind_radio(network.join(2), 2, str(file), lambda: network.now_s)
    assert "lost and late on purpose" in caplog.text
    sender.publish(STATE, b"unheard")
    network.step(1.0)
    assert ear.receive() == []


def test_a_file_that_cannot_be_used_closes_the_transport(tmp_path: pathlib.Path) -> None:
    file = tmp_path / "radio.yaml"
    file.write_text("model: {loss: 2.0}", encoding="utf-8")
    node = MemoryRadio().join(1)
    with pytest.raises(DocumentError, match=r"model\.loss"):
        behind_radio(node, 1, str(file), lambda: 0.0)
    with pytest.raises(TransportError, match="has left"):
        node.receive()
