"""What this drone believes of the others: peers from their own words, vehicles from the ground station's ears.

Ages are counted on this drone's clock from when a message arrived; nobody's clock is compared with ours. A
peer that fell silent in the air stays an obstacle where it was last heard until somebody tells otherwise: its
agent may be dead while its vehicle hovers on.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

from flightstack.flight.guidance import FRESH_S
from flightstack.flight.phase import TAKING_PART
from flightstack.swarm import topics
from flightstack.swarm.admission import is_bounded_word, is_estimate, is_vehicle, is_wind, refusal
from flightstack.swarm.wire import (
    Command,
    DroneState,
    GroundBeat,
    Traffic,
    TrafficVehicle,
    TreeState,
    WireError,
)
from flightstack.transport import Received
from mission.geometry.frames import LocalFrame
from mission.strategies.contract import Neighbour, Scalar

ADRIFT_S = 5.0
"""A peer whose agent has been silent for so long does not make way any more."""

TOGETHER_S = 2.0
"""Nodes whose last words came within this time fell silent together."""

PARTING_S = 20.0
"""So long after it was noticed a parting of the swarm decides who goes home; later the tree has healed around it."""

OBSTACLE_MEMORY_S = 3600.0
"""How long a silent flying peer is kept in mind as an obstacle: longer than a battery lasts."""


@dataclasses.dataclass(slots=True)
class Peer:
    state: DroneState
    heard_s: float


@dataclasses.dataclass(frozen=True, slots=True)
class HeardMessages:
    """What the network brought in one tick, decoded and checked."""

    commands: tuple[Command, ...]
    trees: tuple[TreeState, ...]
    problems: tuple[str, ...]


class Belief:
    def __init__(self, drone: int, members: Sequence[int], frame: LocalFrame) -> None:
        self.peers: dict[int, Peer] = {}
        self.ground_heard_s: float | None = None
        self.twin: DroneState | None = None
        """What another node said that also claims to be this drone."""
        self._drone = drone
        self._all = frozenset(members)
        self._members = self._all - {drone}
        self._frame = frame
        self._traffic: dict[int, tuple[TrafficVehicle, float]] = {}
        self._told: set[str] = set()

    def update(self, now_s: float, received: Iterable[Received]) -> HeardMessages:
        commands: list[Command] = []
        trees: list[TreeState] = []
        problems: list[str] = []
        for item in received:
            try:
                message = item.topic.codec.decode(item.payload)
            except WireError as error:
                self._tell(problems, f"{item.topic.name} from {item.sender}: {error}")
                continue
            problem = self._misplaced(item.sender, message)
            if problem:
                self._tell(problems, problem)
                continue
            match message:
                case DroneState():
                    self._hear(now_s, message)
                case TreeState():
                    trees.append(message)
                case Command():
                    commands.append(message)
                case Traffic():
                    for vehicle in message.vehicles:
                        if vehicle.drone != self._drone and is_vehicle(vehicle):
                            self._traffic[vehicle.drone] = (vehicle, now_s - vehicle.age_s)
                case GroundBeat():
                    self.ground_heard_s = now_s
        return HeardMessages(tuple(commands), tuple(trees), tuple(problems))

    def cut_off(self, now_s: float, lost_after_s: float) -> bool:
        """Whether this drone has just lost the larger part of the swarm to a failed radio or a ridge between.

        Several nodes that fall silent together, drones that took part or the ground station, have not all failed.
        Then two parts that cannot hear each other would fly the same search on the same points; so only the larger
        one goes on, of equal ones that of the lowest id. While the ground station is heard, it tells each part where
        the other is.
        """
        if self.ground_heard_s is not None and now_s - self.ground_heard_s <= lost_after_s:
            return False
        heard_s = {d: p.heard_s for d, p in self.peers.items() if p.state.phase in TAKING_PART}
        silent_s = {drone: at_s for drone, at_s in heard_s.items() if now_s - at_s > lost_after_s}
        last_s = max(silent_s.values(), default=now_s)
        if not silent_s or now_s - last_s > lost_after_s + PARTING_S:
            return False
        gone = {drone for drone, at_s in silent_s.items() if at_s > last_s - TOGETHER_S}
        ground_gone = self.ground_heard_s is not None and abs(self.ground_heard_s - last_s) < TOGETHER_S
        if len(gone) + ground_gone < 2:
            return False
        with_us = {self._drone, *heard_s} - silent_s.keys()
        return len(with_us) == 1 or (len(gone), -min(gone)) > (len(with_us), -min(with_us))

    def silence_s(self, now_s: float, drone: int) -> float:
        """Seconds since `drone` was last heard directly; infinite if never."""
        peer = self.peers.get(drone)
        return now_s - peer.heard_s if peer else float("inf")

    def neighbours(self, now_s: float) -> tuple[Neighbour, ...]:
        """Everybody worth keeping clear of or listening to, by ascending id."""
        found: dict[int, Neighbour] = {}
        for drone, peer in self.peers.items():
            state, silence_s = peer.state, now_s - peer.heard_s
            if (
                state.position_ned_m is None
                or state.velocity_ned_mps is None
                or silence_s > OBSTACLE_MEMORY_S
            ):
                continue
            found[drone] = Neighbour(
                drone,
                state.position_ned_m,
                state.velocity_ned_mps,
                silence_s + state.position_age_s,
                state.airborne,
                _aged(state.excess_co2_ppm, silence_s) if is_estimate(state.excess_co2_ppm) else None,
                state.wind if is_wind(state.wind) else None,
                silence_s > ADRIFT_S,
                state.word if is_bounded_word(state.word) else b"",
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
                )
        return tuple(found[drone] for drone in sorted(found))

    def _hear(self, now_s: float, state: DroneState) -> None:
        peer = self.peers.get(state.sender)
        if peer is None:
            self.peers[state.sender] = Peer(state, now_s)
        elif state.incarnation != peer.state.incarnation or state.sequence > peer.state.sequence:
            peer.state, peer.heard_s = state, now_s

    def _misplaced(self, sender: str, message: object) -> str:
        """Why a message must not be believed, or nothing."""
        if isinstance(message, DroneState | TreeState):
            if str(message.sender) != sender:
                return f"a message of drone {message.sender} came under the name {sender}"
            if message.sender == self._drone:
                self.twin = message if isinstance(message, DroneState) else self.twin
                return f"another node also says that it is drone {self._drone}: every drone needs its own id"
            if message.sender not in self._members:
                return f"drone {message.sender} is not in swarm.members"
        if isinstance(message, DroneState | TreeState | Traffic) and message.frame != self._frame.identity:
            return f"{sender} flies in another frame: give all members the same origin"
        reason = refusal(message, self._all)
        return f"a message of {sender} is refused: {reason}" if reason else ""

    def _tell(self, problems: list[str], problem: str) -> None:
        """Each problem once: a misconfigured peer repeats itself five times a second."""
        if problem not in self._told and len(self._told) < 1000:
            self._told.add(problem)
            problems.append(problem)


def _aged(estimate: Scalar | None, age_s: float) -> Scalar | None:
    if estimate is None:
        return None
    return Scalar(estimate.mean, estimate.variance, estimate.age_s + age_s)


RECEIVED_BY_DRONES = (topics.STATE, topics.TREE, topics.COMMAND, topics.TRAFFIC, topics.GROUND)
