"""What every transport promises: `flightstack.transport.Transport` over zenoh, over the in-process radio, and as a
process of a simulated flight hears it."""

from __future__ import annotations

import contextlib
import pathlib
from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

import msgspec
import pytest

from flightstack.swarm.topics import COMMAND, EVENT, OUTCOME, STATE, TABLE, Received, Topic
from flightstack.transport import Transport, TransportError
from flightstack.transport.backlog import KEPT_PER_SENDER
from flightstack.transport.memory import MemoryRadio, MemoryTransport
from flightstack.transport.node_places import NodePlaces
from flightstack.transport.radio_model import LinkBudget, RadioModel
from flightstack.transport.shared_radio import RadioEnd, SharedRadio
from flightstack.transport.zenoh_options import router_options
from flightstack.transport.zenoh_router import ZenohRouter
from flightstack.transport.zenoh_session import configured
from flightstack.transport.zenoh_transport import ZenohTransport

ALL = (STATE, TABLE, COMMAND, OUTCOME, EVENT)


class NodeUnderTest(Transport, Protocol):
    def alive(self) -> set[str]: ...


class NetworkUnderTest(Protocol):
    def join(self, name: int | str, receives: Sequence[Topic] = ALL) -> NodeUnderTest: ...

    def turn(self) -> None:
        """Let what is under way arrive, or come nearer to it."""
        ...


class RadioNetwork:
    def __init__(self, model: RadioModel | None = None) -> None:
        self._radio = MemoryRadio(seed=1, model=model)

    def join(self, name: int | str, receives: Sequence[Topic] = ALL) -> NodeUnderTest:
        self._radio.place(name, (0.0, 0.0, -10.0))
        return self._radio.join(name, receives)

    def turn(self) -> None:
        self._radio.step(self._radio.now_s + 0.1)


class HeardThroughRadio(RadioEnd):
    """A node of a simulated flight's process, on a network that loses nothing."""

    def __init__(self, node: MemoryTransport, radio: SharedRadio, now_s: Callable[[], float]) -> None:
        super().__init__(node, node.node, radio, now_s)
        self.alive = node.alive


class SharedRadioNetwork:
    """Near each other, places and all."""

    def __init__(self, directory: pathlib.Path) -> None:
        self._network = MemoryRadio()
        model = msgspec.structs.replace(NEAR_EACH_OTHER, bandwidth_bytes_per_s=None)
        places = directory / "places"
        self._radio = SharedRadio(model=model, places=str(places), placed=(1, 2, 3))
        with contextlib.closing(NodePlaces.make(places, 3)) as told:
            for node in range(3):
                told.tell(node, (10.0 * node, 0.0, -10.0))

    def join(self, name: int | str, receives: Sequence[Topic] = ALL) -> NodeUnderTest:
        return HeardThroughRadio(self._network.join(name, receives), self._radio, lambda: self._network.now_s)

    def turn(self) -> None:
        self._network.step(self._network.now_s + 0.1)


class ZenohNetwork:
    """All nodes connect to the first one; the rest is gossip."""

    def __init__(self, free_port: Callable[[], int]) -> None:
        self._free_port = free_port
        self._seed: tuple[str, ...] = ()
        self._nodes: list[NodeUnderTest] = []

    def join(self, name: int | str, receives: Sequence[Topic] = ALL) -> NodeUnderTest:
        endpoint = f"tcp/127.0.0.1:{self._free_port()}"
        node = ZenohTransport("contract", name, (endpoint,), self._seed, receives)
        self._seed = self._seed or (endpoint,)
        self._nodes.append(node)
        return node

    def turn(self) -> None:
        """zenoh's own threads carry the messages."""

    def close(self) -> None:
        for node in self._nodes:
            node.close()


class RouterNetwork:
    """Two sites by turns, and all that a node is told is where the router is: its site's others come by gossip."""

    def __init__(self, free_port: Callable[[], int]) -> None:
        self._free_port = free_port
        self._place = f"tcp/127.0.0.1:{free_port()}"
        self._router = ZenohRouter(configured(router_options((self._place,), ("rim", "valley"), "contract")))
        self._nodes: list[NodeUnderTest] = []

    def join(self, name: int | str, receives: Sequence[Topic] = ALL) -> NodeUnderTest:
        site = ("rim", "valley", "rim")[len(self._nodes) % 3]
        endpoint = f"tcp/127.0.0.1:{self._free_port()}"
        node = ZenohTransport("contract", name, (endpoint,), (self._place,), receives, site=site)
        self._nodes.append(node)
        return node

    def turn(self) -> None:
        self._router.look()

    def close(self) -> None:
        for node in self._nodes:
            node.close()
        self._router.close()


NEAR_EACH_OTHER = RadioModel(
    link_budget=LinkBudget(), range_m=100.0, delay_s=0.02, bandwidth_bytes_per_s=1e6, queue_bytes=1 << 20
)
"""Everything that a radio can have of its own, and nothing of it so bad that a promise cannot be kept."""


@pytest.fixture(params=["radio", "modelled radio", "shared radio", "zenoh", "zenoh router"])
def network(
    request: pytest.FixtureRequest, free_port: Callable[[], int], tmp_path: pathlib.Path
) -> Iterator[NetworkUnderTest]:
    if request.param == "radio":
        yield RadioNetwork()
        return
    if request.param == "modelled radio":
        yield RadioNetwork(NEAR_EACH_OTHER)
        return
    if request.param == "shared radio":
        yield SharedRadioNetwork(tmp_path)
        return
    zenoh = ZenohNetwork(free_port) if request.param == "zenoh" else RouterNetwork(free_port)
    yield zenoh
    zenoh.close()


@pytest.fixture
def until(
    network: NetworkUnderTest, eventually: Callable[..., None]
) -> Callable[[Callable[[], object]], None]:
    def wait(condition: Callable[[], object]) -> None:
        def turned() -> object:
            network.turn()
            return condition()

        eventually(turned)

    return wait


class Ear:
    """Everything that a node has received so far."""

    def __init__(self, node: NodeUnderTest) -> None:
        self.node = node
        self.heard: list[Received] = []

    def listen(self) -> list[Received]:
        self.heard += self.node.receive()
        return self.heard

    def payloads(self, topic: Topic) -> list[bytes]:
        return [message.payload for message in self.listen() if message.topic is topic]


def _introduce(until: Callable[[Callable[[], object]], None], *nodes: NodeUnderTest) -> None:
    """Wait until every node has heard every other one, and nothing of that is left."""
    ears = [Ear(node) for node in nodes]

    def all_heard() -> bool:
        for node in nodes:
            node.publish(EVENT, b"hello")
        return all(len({message.sender for message in ear.listen()}) >= len(nodes) - 1 for ear in ears)

    until(all_heard)
    for node in nodes:
        node.publish(EVENT, b"end")
    ends = [Ear(node) for node in nodes]
    until(lambda: all(ear.payloads(EVENT).count(b"end") >= len(nodes) - 1 for ear in ends))


def test_a_message_reaches_all_others_and_not_its_sender(network, until):
    a, b, c = network.join(1), network.join(2), network.join("ground")
    _introduce(until, a, b, c)
    a.publish(COMMAND, b"take off")
    ears = [Ear(b), Ear(c)]
    until(lambda: all(ear.payloads(COMMAND) for ear in ears))
    assert [ear.heard for ear in ears] == [[Received(COMMAND, "1", b"take off")]] * 2
    assert a.receive() == []


def test_only_topics_asked_for_are_received(network, until):
    a, b = network.join(1), network.join(2, (EVENT, STATE))
    ear = Ear(b)
    until(
        lambda: (
            a.publish(STATE, b"s") or a.publish(TABLE, b"t") or a.publish(EVENT, b"e") or ear.payloads(EVENT)
        )
    )
    assert {message.topic.name for message in ear.heard} <= {"state", "event"}


def test_reliable_messages_all_arrive_once_and_in_order(network, until):
    a, b = network.join(1), network.join(2)
    _introduce(until, a, b)
    sent = [b"%d" % n for n in range(500)]
    for payload in sent:
        a.publish(EVENT, payload)
    ear = Ear(b)
    until(lambda: len(ear.payloads(EVENT)) >= len(sent))
    network.turn()
    assert ear.payloads(EVENT) == sent


def test_of_best_effort_topics_the_newest_few_of_each_sender_are_kept(network, until):
    a, b, c = network.join(1), network.join(2), network.join(3)
    _introduce(until, a, b, c)
    seen: set[bytes] = set()

    def loud_and_quiet_heard() -> bool:
        for n in range(100):
            a.publish(STATE, b"loud %02d" % n)
        b.publish(STATE, b"quiet")
        a.publish(TABLE, b"table")
        network.turn()
        received = c.receive()
        for topic, sender in ((STATE, "1"), (STATE, "2"), (TABLE, "1")):
            assert sum((m.topic, m.sender) == (topic, sender) for m in received) <= KEPT_PER_SENDER
        seen.update(message.payload for message in received)
        return {b"loud 99", b"quiet", b"table"} <= seen

    until(loud_and_quiet_heard)


def test_empty_and_large_payloads_arrive_whole(network, until):
    a, b = network.join(1), network.join(2)
    _introduce(until, a, b)
    large = bytes(range(256)) * 400
    a.publish(EVENT, b"")
    a.publish(EVENT, large)
    ear = Ear(b)
    until(lambda: len(ear.payloads(EVENT)) >= 2)
    assert ear.payloads(EVENT) == [b"", large]


def test_nothing_from_before_joining_is_received(network, until):
    a, b = network.join(1), network.join(2)
    _introduce(until, a, b)
    a.publish(COMMAND, b"old")
    ear = Ear(b)
    until(lambda: ear.payloads(COMMAND))
    c = Ear(network.join(3))
    until(lambda: a.publish(EVENT, b"new") or c.payloads(EVENT))
    assert c.payloads(COMMAND) == []


def test_who_is_there_is_known_and_who_left(network, until):
    a, b, c = network.join(1), network.join(2), network.join("ground")
    until(lambda: a.alive() == {"2", "ground"} and c.alive() == {"1", "2"})
    b.close()
    until(lambda: a.alive() == {"ground"})


def test_a_node_that_left_refuses_to_be_used_and_closes_twice(network):
    node = network.join(1)
    node.close()
    node.close()
    with pytest.raises(TransportError, match="node 1 has left"):
        node.publish(STATE, b"x")
    with pytest.raises(TransportError, match="node 1 has left"):
        node.receive()


def test_a_node_may_come_back_under_its_name(network, until):
    a, b = network.join(1), network.join(2)
    _introduce(until, a, b)
    b.close()
    again = network.join(2)
    _introduce(until, a, again)


def test_two_swarms_share_ports_and_do_not_hear_each_other(free_port, eventually):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    nodes = [
        ZenohTransport("red", 1, (endpoint,), (), ALL),
        ZenohTransport("blue", 2, (), (endpoint,), ALL),
        ZenohTransport("red", 3, (), (endpoint,), ALL),
    ]
    try:
        red, blue = Ear(nodes[2]), Ear(nodes[1])
        eventually(lambda: nodes[0].publish(EVENT, b"x") or red.payloads(EVENT))
        assert blue.payloads(EVENT) == []
        assert nodes[1].alive() == set()
    finally:
        for node in nodes:
            node.close()
