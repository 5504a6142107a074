"""The radio of a simulated flight whose nodes are processes: between them nothing is lost, so each receiver loses it.

What a node would not have heard it drops when it comes, and what would have come later it holds back until then: as
`RadioModel` says, with the randomness of the radio in one process (`memory`), seeded for each sender, topic and
receiver. Bandwidth is the sender's and is not modelled here. All nodes of a flight read one file, which its launcher
writes. A real flight has a radio of its own and no such file.
"""

from __future__ import annotations

import heapq
import itertools
import logging
import math
from collections.abc import Callable, Iterator

from flightstack.config import Section, SharedClockConfig
from flightstack.swarm.topics import Received, Topic
from flightstack.transport import Transport
from flightstack.transport.backlog import trimmed
from flightstack.transport.memory import LossyLink, conditions_of
from flightstack.transport.node_places import NodePlaces
from flightstack.transport.radio_model import NodeName, RadioModel
from mission.documents.yaml_file import DocumentError, parse, read_text

log = logging.getLogger(__name__)


class SharedRadio(Section, frozen=True, kw_only=True):
    """The file that all nodes of a simulated flight read."""

    model: RadioModel
    seed: int = 0
    places: str | None = None
    """A file with where the nodes are (`flightstack.transport.node_places`); None: near each other."""
    placed: tuple[NodeName, ...] = ()
    """Whose places are in it, in this order. Who has none is near everybody."""


class RadioEnd:
    """A node's transport, as the node hears through the shared radio. What the node says goes out as it is."""

    def __init__(
        self, transport: Transport, node: int | str, radio: SharedRadio, now_s: Callable[[], float]
    ) -> None:
        """`now_s`: the flight's simulated time. `DocumentError` where the places cannot be read."""
        self._transport = transport
        self._node = str(node)
        self._model = radio.model
        self._seed = radio.seed
        self._now_s = now_s
        self._conditions = conditions_of(radio.model)
        self._unheard = {
            str(sender) for sender, receiver in radio.model.dead_links if str(receiver) == self._node
        }
        self._places = None if radio.places is None else NodePlaces(radio.places)
        self._indices = {str(name): index for index, name in enumerate(radio.placed)}
        if self._places is not None and len(self._places) < len(self._indices):
            raise DocumentError(str(radio.places), f"holds the places of {len(self._places)} nodes only")
        self._links: dict[tuple[str, str], LossyLink] = {}
        self._order = itertools.count()
        self._in_flight: list[tuple[float, int, Received]] = []

    def publish(self, topic: Topic, payload: bytes) -> None:
        self._transport.publish(topic, payload)

    def receive(self) -> list[Received]:
        now_s = self._now_s()
        for message in self._transport.receive():
            for due_s in self._arrivals_s(now_s, message):
                heapq.heappush(self._in_flight, (due_s, next(self._order), message))
        arrived = []
        while self._in_flight and self._in_flight[0][0] <= now_s:
            _, _, message = heapq.heappop(self._in_flight)
            arrived.append(message)
        return trimmed(arrived)

    def close(self) -> None:
        self._transport.close()
        if self._places is not None:
            self._places.close()
            self._places = None

    def _arrivals_s(self, now_s: float, message: Received) -> tuple[float, ...]:
        sender, topic = message.sender, message.topic
        if sender in self._unheard:
            return ()
        lost: float | None = self._loss_on_the_way(sender)
        if self._model.link_budget is None:
            if lost == 1.0:
                return ()
            lost = None
        link = self._links.get((sender, topic.name))
        if link is None:
            # A sequence for each topic: how those of several mingle on a network is not the same again.
            link = self._links[sender, topic.name] = LossyLink(
                self._seed, sender, f"{self._node}/{topic.name}"
            )
        return link.arrivals_s(now_s, self._conditions, topic.delivery, lost)

    def _loss_on_the_way(self, sender: str) -> float:
        """Probability that where the two are costs a message; 1: out of reach."""
        there, here = self._place(sender), self._place(self._node)
        if there is None or here is None:
            return 0.0
        if self._model.range_m is not None and math.dist(there, here) > self._model.range_m:
            return 1.0
        return self._model.loss_between(there, here)

    def _place(self, node: str) -> tuple[float, float, float] | None:
        index = self._indices.get(node)
        return None if index is None or self._places is None else self._places.of(index)


def behind_radio(
    transport: Transport, node: int | str, file: str | None, now_s: Callable[[], float]
) -> Transport:
    """`transport` as `node` hears through the radio of a simulated flight; the same if there is no `file` of one.

    `DocumentError` where the file cannot be used; `transport` is closed then.
    """
    if file is None:
        return transport
    try:
        end = RadioEnd(transport, node, parse(read_text(file), SharedRadio, file), now_s)
    except DocumentError:
        transport.close()
        raise
    log.warning("simulated radio (%s): messages are lost and late on purpose", file)
    return end


def radio_problems(radio: str | None, clock: SharedClockConfig | None) -> Iterator[tuple[str, str]]:
    """What is wrong with the radio of a configuration file: (field, what and how to mend it)."""
    if radio is not None and clock is None:
        yield (
            "radio",
            "loses messages on purpose; only a simulated flight, with a shared clock, has it: remove it",
        )
