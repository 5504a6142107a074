"""The others as this drone hears them: peers from their own words, vehicles from the ground station's ears.

Ages are counted on this drone's clock from when a message arrived; nobody's clock is compared with ours. A
peer that fell silent in the air stays an obstacle where it was last heard until somebody tells otherwise: its
agent may be dead while its vehicle hovers on.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import msgspec

from flightstack.swarm.admission import Message
from flightstack.swarm.incarnations import Incarnations
from flightstack.swarm.parting import Part, is_adrift, part_of
from flightstack.swarm.wire import (
    NO_ORDER,
    NO_TABLE,
    TAKING_PART,
    DroneState,
    GroundBeat,
    OrderState,
    Phase,
    TableState,
    Traffic,
    TrafficVehicle,
)
from mission.estimation.estimates import Scalar
from mission.geometry.frames import Vector3
from mission.strategies.contract import Neighbour

OBSTACLE_MEMORY_S = 3600.0
"""How long a silent flying peer is kept in mind as an obstacle: longer than a battery lasts."""

OUT_OF_OUR_HANDS = frozenset({Phase.RTL, Phase.PILOT, Phase.CRASHED})
"""The phases in which an agent can tell where its vehicle is and no more: it does not make way for anybody."""

STEADY_S = 2.0
"""Who has been heard for so long without a gap is in reach, and not just for a moment."""

FRESH_S = 1.0
"""A position this young is extended by its velocity; of an older one only the stretch is known that it lies on."""


class PeerFacts(msgspec.Struct, frozen=True):
    """What the table needs to know of another drone."""

    heard_s: float
    """When its newest state came."""
    taking_part: bool
    moving: bool
    """It is on its way to a slot, and the swarm holds for it."""
    position_ned_m: Vector3 | None
    incarnation: int = 0
    """Of the agent that speaks for it: another one has been started anew."""
    table_digest: int = NO_TABLE
    """Of its table of the swarm, when it told its newest state; who stands on the ground needs none."""
    order_digest: int = NO_ORDER
    """Of the order that counts for it, when it told its newest state."""


class Peer(msgspec.Struct):
    state: DroneState
    facts: PeerFacts
    placed: DroneState
    """The newest state that says where the drone is: an agent that was restarted in the air knows nothing of it until
    its autopilot has answered, and the vehicle is there all the same."""
    placed_s: float
    surveying_since_s: float = math.inf
    """Since when it has told without a gap that it takes part, in the air; infinite while it does not."""


class Peers:
    """What is known of the others. It is told admitted messages only (`flightstack.swarm.admission`)."""

    def __init__(self, drone: int) -> None:
        self.peers: dict[int, Peer] = {}
        self.ground_heard_s: float | None = None
        self._drone = drone
        self._facts: dict[int, PeerFacts] = {}
        self._incarnations: dict[int, Incarnations] = {}
        self._traffic: dict[int, tuple[TrafficVehicle, float]] = {}

    def hear(self, now_s: float, message: Message) -> None:
        match message:
            case DroneState():
                self._hear_state(now_s, message)
            case TableState():
                peer = self._knowing(message)
                if peer is not None and peer.facts.table_digest != message.digest:
                    peer.facts = msgspec.structs.replace(peer.facts, table_digest=message.digest)
                    self._facts[message.sender] = peer.facts
            case OrderState():
                peer = self._knowing(message)
                if peer is not None and peer.facts.order_digest != message.digest:
                    peer.facts = msgspec.structs.replace(peer.facts, order_digest=message.digest)
                    self._facts[message.sender] = peer.facts
            case Traffic():
                for vehicle in message.vehicles:
                    if vehicle.drone != self._drone:
                        self._traffic[vehicle.drone] = (vehicle, now_s - vehicle.age_s)
            case GroundBeat():
                self.ground_heard_s = now_s

    def speaks(self, drone: int, incarnation: int) -> bool:
        """Whether this agent of a drone is the one that counts, as far as is known."""
        known = self._incarnations.get(drone)
        return known is None or known.speaks(incarnation)

    def facts(self) -> Mapping[int, PeerFacts]:
        """What is known now; it changes with what is heard."""
        return self._facts

    def part(self, now_s: float, lost_after_s: float) -> Part:
        """What this drone belongs to: the whole swarm, or a part of one that has just come apart."""
        heard_s = {d: peer.facts.heard_s for d, peer in self.peers.items() if peer.facts.taking_part}
        return part_of(now_s, self._drone, heard_s, self.ground_heard_s, lost_after_s)

    def flies_on(self, now_s: float) -> bool:
        """Whether anybody who takes part, in the air, has been heard steadily up to now."""
        return any(
            now_s - peer.facts.heard_s < FRESH_S and peer.facts.heard_s - peer.surveying_since_s >= STEADY_S
            for peer in self.peers.values()
        )

    def neighbours(self, now_s: float) -> tuple[Neighbour, ...]:
        """Everybody worth keeping clear of or listening to, by ascending id."""
        found: dict[int, Neighbour] = {}
        for drone, peer in self.peers.items():
            state, silence_s = peer.placed, now_s - peer.placed_s
            position, velocity = state.position_ned_m, state.velocity_ned_mps
            if position is None or velocity is None or silence_s > OBSTACLE_MEMORY_S:
                continue
            found[drone] = Neighbour(
                drone,
                position,
                velocity,
                silence_s + state.position_age_s,
                state.airborne,
                _aged(state.excess_co2_ppm, silence_s),
                state.wind,
                is_adrift(now_s - peer.facts.heard_s) or peer.state.phase in OUT_OF_OUR_HANDS,
                state.word,
                state.home_ned_m,
            )
        for drone, (vehicle, at_s) in self._traffic.items():
            age_s = now_s - at_s
            known = found.get(drone)
            # What a drone says itself is better than what is heard of it, while it is young.
            if age_s <= OBSTACLE_MEMORY_S and (known is None or known.age_s > max(age_s, FRESH_S)):
                found[drone] = Neighbour(
                    drone,
                    vehicle.position_ned_m,
                    vehicle.velocity_ned_mps,
                    age_s,
                    vehicle.airborne,
                    adrift=True,
                    home_ned_m=known.home_ned_m if known else None,
                )
        return tuple(found[drone] for drone in sorted(found))

    def _knowing(self, message: TableState | OrderState) -> Peer | None:
        """The peer that tells what it knows of a survey, if it is one whose knowledge matters."""
        peer = self.peers.get(message.sender)
        if peer is None or peer.facts.table_digest == NO_TABLE:
            return None
        return peer if message.incarnation == peer.facts.incarnation else None

    def _hear_state(self, now_s: float, state: DroneState) -> None:
        sender = state.sender
        incarnations = self._incarnations.get(sender)
        if incarnations is None:
            incarnations = self._incarnations[sender] = Incarnations()
        if not incarnations.hear(now_s, state):
            return
        taking_part = state.phase in TAKING_PART
        facts = self._facts[sender] = PeerFacts(
            now_s,
            taking_part,
            state.healing,
            state.position_ned_m,
            state.incarnation,
            state.table_digest if taking_part or state.airborne else NO_TABLE,
            state.order_digest,
        )
        peer = self.peers.get(sender)
        if peer is None:
            since_s = now_s if taking_part and state.airborne else math.inf
            self.peers[sender] = Peer(state, facts, state, now_s, since_s)
            return
        if not (taking_part and state.airborne):
            peer.surveying_since_s = math.inf
        elif now_s - peer.facts.heard_s >= FRESH_S or peer.surveying_since_s > now_s:
            peer.surveying_since_s = now_s
        peer.state, peer.facts = state, facts
        if state.position_ned_m is not None:
            peer.placed, peer.placed_s = state, now_s


def _aged(estimate: Scalar | None, age_s: float) -> Scalar | None:
    if estimate is None:
        return None
    return Scalar(estimate.mean, estimate.variance, estimate.age_s + age_s)
