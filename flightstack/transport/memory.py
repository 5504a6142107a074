"""A radio inside one process, on simulated time: what `RadioModel` says of it, and partitions and dead nodes.

The same seed, calls and times give the same deliveries. Every directed link has a random sequence of its own, so a
fault on one link does not change what happens on the others.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
import random
from collections.abc import Callable, Collection, Iterable
from typing import Final

from flightstack.swarm.topics import TOPICS, Delivery, Received, Topic
from flightstack.transport import TransportError
from flightstack.transport.backlog import KEPT_PER_SENDER, trimmed
from flightstack.transport.radio_model import RadioModel
from flightstack.transport.transmit_queue import Copy, TransmitQueue
from mission.geometry.frames import Vector3

_RESEND_S: Final = 0.2
"""What each loss costs a reliable message: TCP's smallest retransmission time."""
_RELIABLE_BACKLOG: Final = 4096
"""Also what a node that nobody empties, a dead agent's, may hold."""
_UNTRIMMED: Final = 1024
"""What has come to a node is looked through when it is so much."""


@dataclasses.dataclass(frozen=True)
class Conditions:
    """How one directed link treats messages. Probabilities are per message."""

    loss: float = 0.0
    """Best-effort messages vanish; reliable ones come late instead."""
    delay_s: float = 0.0
    jitter_s: float = 0.0
    """Mean of an exponential delay added to `delay_s`; it does not reorder."""
    duplication: float = 0.0
    reordering: float = 0.0
    """A best-effort message is held back so that later ones overtake it."""
    held_back_s: float = 0.3

    def __post_init__(self) -> None:
        for name in ("loss", "duplication", "reordering"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name} {getattr(self, name)} is not a probability")
        if self.loss == 1.0:
            raise ValueError("a link that loses everything is a partition: use `cut`")
        if min(self.delay_s, self.jitter_s, self.held_back_s) < 0.0:
            raise ValueError("a delay is negative")

    @functools.cached_property
    def certain(self) -> bool:
        """Every message arrives once and after the same time."""
        return not (self.loss or self.jitter_s or self.duplication or self.reordering)


class LossyLink:
    """One direction between two nodes: its randomness, and when it delivers."""

    def __init__(self, seed: int, sender: str, receiver: str) -> None:
        self._random = random.Random(f"{seed}/{sender}/{receiver}")
        self._latest_s = self._latest_reliable_s = -math.inf
        """A link keeps the order of what it delivers, separately for each kind of delivery."""

    def arrivals_s(
        self, now_s: float, conditions: Conditions, delivery: Delivery, loss_on_the_way: float | None = None
    ) -> tuple[float, ...]:
        """When a message sent now arrives: never, once, or twice. Where nothing is left to chance, none is drawn.

        `loss_on_the_way`, 1 for one who is out of reach, comes on top of the conditions' (None: chance has no part in
        it). A best-effort message draws as often whatever it is: a node that moves changes what is lost, not what
        chance has in store for later messages.
        """
        loss = conditions.loss
        if loss_on_the_way is not None:
            loss = 1.0 - (1.0 - loss) * (1.0 - loss_on_the_way)
        elif conditions.certain:
            return (self._in_order_s(now_s + conditions.delay_s, delivery),)
        draw = self._random.random
        lost, repeated, overtaken = draw(), draw(), draw()
        late = draw()
        jitter_s = -math.log(1.0 - late) * conditions.jitter_s if conditions.jitter_s else 0.0
        due_s = now_s + conditions.delay_s + jitter_s
        if delivery is Delivery.RELIABLE:
            if loss == 1.0:
                return ()
            while lost < loss:
                due_s += _RESEND_S
                lost = draw()
            return (self._in_order_s(due_s, delivery),)
        if lost < loss:
            return ()
        if overtaken < conditions.reordering:
            due_s += conditions.held_back_s
        elif due_s > self._latest_s:
            self._latest_s = due_s
        else:
            due_s = self._latest_s
        return (due_s, due_s) if repeated < conditions.duplication else (due_s,)

    def _in_order_s(self, due_s: float, delivery: Delivery) -> float:
        if delivery is Delivery.RELIABLE:
            self._latest_reliable_s = due_s = max(due_s, self._latest_reliable_s)
        else:
            self._latest_s = due_s = max(due_s, self._latest_s)
        return due_s


class MemoryTransport:
    """One node on a `MemoryRadio`, as `flightstack.transport.Transport` describes it."""

    def __init__(self, radio: MemoryRadio, node: str, receives: Iterable[Topic]) -> None:
        self.node = node
        self._radio = radio
        self._receives = frozenset(topic.name for topic in receives)
        self._closed = False
        self._arrived: list[Received] = []
        """What has come, oldest first."""
        self._trimmed_at = _UNTRIMMED

    def publish(self, topic: Topic, payload: bytes) -> None:
        self._check_open()
        self._radio.send(self.node, topic, payload)

    def receive(self) -> list[Received]:
        self._check_open()
        arrived = self._arrived
        self.forget()
        if len(arrived) <= KEPT_PER_SENDER:
            return arrived
        sources = {(message.topic.name, message.sender) for message in arrived}
        repeated = len(arrived) - len(sources)
        return arrived if repeated < KEPT_PER_SENDER else _kept(arrived)

    def alive(self) -> set[str]:
        """The other nodes that this one could hear now."""
        return self._radio.audible(self.node)

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            self._radio.leave(self.node)

    def deliver(self, message: Received) -> None:
        """The radio's side: a message has arrived."""
        if message.topic.name not in self._receives:
            return
        self._arrived.append(message)
        if len(self._arrived) >= self._trimmed_at:
            self._arrived = _kept(self._arrived)
            self._trimmed_at = max(_UNTRIMMED, 2 * len(self._arrived))

    def wants(self, topic: Topic) -> bool:
        return topic.name in self._receives

    def forget(self) -> None:
        """Drop what has come and was not received."""
        self._arrived = []
        self._trimmed_at = _UNTRIMMED

    def _check_open(self) -> None:
        if self._closed:
            raise TransportError(f"node {self.node} has left the swarm's network")


def _kept(messages: list[Received]) -> list[Received]:
    """The newest few of each sender's best-effort topics, and of the reliable ones as many as a node may hold."""
    kept = trimmed(messages)
    spare = sum(message.topic.delivery is Delivery.RELIABLE for message in kept) - _RELIABLE_BACKLOG
    if spare <= 0:
        return kept
    reliable = (message for message in kept if message.topic.delivery is Delivery.RELIABLE)
    dropped = {id(message) for message in itertools.islice(reliable, spare)}
    return [message for message in kept if id(message) not in dropped]


class MemoryRadio:
    """The air between the nodes of one process. Time is what `step` is told; nothing arrives between steps."""

    def __init__(
        self,
        seed: int = 0,
        conditions: Conditions | None = None,
        range_m: float | None = None,
        *,
        model: RadioModel | None = None,
    ) -> None:
        """A radio as `model` says (None: perfect); all links have the same conditions until `set_link`.

        `conditions` and `range_m`, where given, stand in place of the model's.
        """
        model = model or RadioModel()
        self.conditions = conditions or conditions_of(model)
        self.range_m = model.range_m if range_m is None else range_m
        self.now_s = 0.0
        self._seed = seed
        self._nodes: dict[str, MemoryTransport] = {}
        self._positions: dict[str, Callable[[], Vector3]] = {}
        self._links: dict[str, dict[str, LossyLink]] = {}
        """By sender and receiver."""
        self._special: dict[tuple[str, str], Conditions] = {}
        self._cuts: dict[str, frozenset[str]] = {}
        self._off: set[str] = set()
        self._unheard: set[tuple[str, str]] = set()
        self._audience: dict[str, dict[str, None]] = {}
        """By sender: the nodes that would hear it wherever they are, in the order in which they joined; made anew
        when nodes come or go, or a fault begins or ends."""
        self._order = itertools.count()
        self._in_flight: list[tuple[float, int, str, Received]] = []
        """(when it arrives, in which order it was sent, receiver, message)."""
        self._next_s = math.inf
        """When the next of them arrives."""
        self._model = model
        self._queues: dict[str, TransmitQueue] = {}
        """What each node has still to send, where bandwidth is limited; also of a node that has left since."""
        for sender, receiver in model.dead_links:
            self.block(sender, receiver)

    # -- nodes ---------------------------------------------------------------------------------------------------

    def join(
        self,
        node: int | str,
        receives: Iterable[Topic] = tuple(TOPICS.values()),
        position: Callable[[], Vector3] | None = None,
    ) -> MemoryTransport:
        """A new node; `position` tells where it is (NED, m) whenever the way to it must be judged."""
        name = str(node)
        if name in self._nodes:
            raise TransportError(f"node {name} is on the radio already; close it first")
        self._nodes[name] = transport = MemoryTransport(self, name, receives)
        self._audience.clear()
        if position is not None:
            self._positions[name] = position
        return transport

    def leave(self, node: str) -> None:
        """The node is gone, and what it said last still comes from its place; `MemoryTransport.close` calls this."""
        self._nodes.pop(node, None)
        self._audience.clear()

    def place(self, node: int | str, position_ned_m: Vector3) -> None:
        """Where `node` is from now on."""
        self._positions[str(node)] = lambda: position_ned_m

    # -- faults --------------------------------------------------------------------------------------------------

    def set_link(
        self, sender: int | str, receiver: int | str, conditions: Conditions, *, both_ways: bool = True
    ) -> None:
        self._special[str(sender), str(receiver)] = conditions
        if both_ways:
            self._special[str(receiver), str(sender)] = conditions

    def cut(self, name: str, group: Collection[int | str]) -> None:
        """Partition: nobody in `group` hears anybody outside it, until `mend(name)`."""
        self._cuts[name] = frozenset(str(node) for node in group)
        self._audience.clear()

    def mend(self, name: str) -> None:
        if self._cuts.pop(name, None) is None:
            raise ValueError(f"no partition is named {name!r}")
        self._audience.clear()

    def switch_off(self, node: int | str) -> None:
        """The node's radio is dead: it sends nothing, hears nothing and forgets what it had heard."""
        self._off.add(str(node))
        self._audience.clear()
        if str(node) in self._nodes:
            self._nodes[str(node)].forget()

    def switch_on(self, node: int | str) -> None:
        self._off.discard(str(node))
        self._audience.clear()

    def block(self, sender: int | str, receiver: int | str) -> None:
        """One way: `receiver` does not hear `sender`, until `unblock`; the other direction stays as it is."""
        self._unheard.add((str(sender), str(receiver)))
        self._audience.clear()

    def unblock(self, sender: int | str, receiver: int | str) -> None:
        self._unheard.discard((str(sender), str(receiver)))
        self._audience.clear()

    # -- traffic -------------------------------------------------------------------------------------------------

    def send(self, sender: str, topic: Topic, payload: bytes) -> None:
        """Put a message on the air; `MemoryTransport.publish` calls this."""
        message = Received(topic, sender, bytes(payload))
        bandwidth_bytes_per_s = self._model.bandwidth_bytes_per_s
        if bandwidth_bytes_per_s is None:
            self._launch(self.now_s, self._heard_by(sender), message)
            return
        for receiver in self._heard_by(sender):
            if self._nodes[receiver].wants(topic) and self._connected(sender, receiver):
                self._queue(sender, bandwidth_bytes_per_s).put(self.now_s, Copy(receiver, message))

    def step(self, now_s: float) -> None:
        """Deliver what is due by `now_s`. A message whose link has broken on its way is lost."""
        if now_s < self.now_s:
            raise ValueError(f"time goes back from {self.now_s} s to {now_s} s")
        self.now_s = now_s
        for sender, queue in self._queues.items():
            for left_s, (receiver, message) in queue.departed(now_s):
                if receiver in self._heard_by(sender):
                    self._launch(left_s, (receiver,), message)
        if self._next_s > now_s:
            return
        due = [item for item in self._in_flight if item[0] <= now_s]
        self._in_flight = [item for item in self._in_flight if item[0] > now_s]
        self._next_s = min((item[0] for item in self._in_flight), default=math.inf)
        due.sort()
        nodes, places_matter, known = self._nodes, self._places_matter, self._audience
        for _, _, receiver, message in due:
            sender = message.sender
            if receiver not in (known[sender] if sender in known else self._heard_by(sender)):
                continue
            if not places_matter or self._loss_on_the_way(sender, receiver) < 1.0:
                nodes[receiver].deliver(message)

    def audible(self, node: str) -> set[str]:
        """The nodes that `node` could hear now."""
        return {other for other in self._nodes if other != node and self._connected(other, node)}

    @property
    def _places_matter(self) -> bool:
        return self.range_m is not None or self._model.link_budget is not None or bool(self._model.ridges)

    def _heard_by(self, sender: str) -> dict[str, None]:
        """The nodes that hear `sender`, wherever they are."""
        audience = self._audience.get(sender)
        if audience is None:
            heard = (node for node in self._nodes if node != sender and self._works(sender, node))
            audience = self._audience[sender] = dict.fromkeys(heard)
        return audience

    def _connected(self, sender: str, receiver: str) -> bool:
        return self._works(sender, receiver) and self._loss_on_the_way(sender, receiver) < 1.0

    def _works(self, sender: str, receiver: str) -> bool:
        """Whether the two hear each other, wherever they are."""
        if sender in self._off or receiver in self._off or (sender, receiver) in self._unheard:
            return False
        return not any((sender in group) != (receiver in group) for group in self._cuts.values())

    def _loss_on_the_way(self, sender: str, receiver: str) -> float:
        """Probability that where the two are costs a message; 1: out of reach. Who has no place is near everybody."""
        if not self._places_matter:
            return 0.0
        if sender not in self._positions or receiver not in self._positions:
            return 0.0
        there, here = self._positions[sender](), self._positions[receiver]()
        if self.range_m is not None and math.dist(there, here) > self.range_m:
            return 1.0
        return self._model.loss_between(there, here)

    def _launch(self, now_s: float, receivers: Iterable[str], message: Received) -> None:
        """A message leaves its sender at `now_s`."""
        sender, delivery = message.sender, message.topic.delivery
        places_matter, special, in_flight = self._places_matter, self._special, self._in_flight
        links = self._links.setdefault(sender, {})
        conditions, lost = self.conditions, None
        for receiver in receivers:
            if places_matter:
                lost = self._loss_on_the_way(sender, receiver)
                if self._model.link_budget is None:
                    if lost == 1.0:
                        continue
                    lost = None
            link = links.get(receiver)
            if link is None:
                link = links[receiver] = LossyLink(self._seed, sender, receiver)
            if special:
                conditions = special.get((sender, receiver), self.conditions)
            for due_s in link.arrivals_s(now_s, conditions, delivery, lost):
                in_flight.append((due_s, next(self._order), receiver, message))
                if due_s < self._next_s:
                    self._next_s = due_s

    def _queue(self, sender: str, bandwidth_bytes_per_s: float) -> TransmitQueue:
        if sender not in self._queues:
            self._queues[sender] = TransmitQueue(bandwidth_bytes_per_s, self._model.queue_bytes)
        return self._queues[sender]


def conditions_of(model: RadioModel) -> Conditions:
    """What `model` says of every link, wherever its ends are."""
    return Conditions(
        loss=model.loss,
        delay_s=model.delay_s,
        jitter_s=model.jitter_s,
        duplication=model.duplication,
        reordering=model.reordering,
        held_back_s=model.held_back_s,
    )
