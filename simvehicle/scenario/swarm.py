"""A whole swarm in one process, on simulated time: the same agents, autopilots, instruments and bytes as in flight.

Deterministic by seed and as fast as the machine allows: `pytest tests/scenario` flies whole surveys under faults.
Nothing here is faster or simpler than in flight except the waiting.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator, Sequence

from flightstack.agent import Agent, Inputs, Outputs, PeerMessage
from flightstack.config import DroneConfig
from flightstack.sensing.filter_stage import PortInput
from flightstack.swarm import topics
from flightstack.swarm.wire import (
    Command,
    CommandName,
    CommandOutcome,
    DroneState,
    Event,
    GroundBeat,
    OrderState,
    Phase,
    TableState,
    Traffic,
    TrafficVehicle,
)
from flightstack.transport.memory import MemoryRadio, MemoryTransport
from flightstack.transport.radio_model import RadioModel
from mission.geometry.frames import Vector3
from simvehicle.drone.drones import NOTHING, Drone, DroneBytes, SimulatedDrones
from simvehicle.drone.simulated_vehicle import SimulatedVehicle
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.fleet.fleet_problems import problems
from simvehicle.world.configured import make_world
from simvehicle.world.obstacles import Obstacles

TICK_S = 0.1
GROUND = "ground"
_INCARNATIONS = 1000
"""More than there are drones: no two agents of a flight have one incarnation."""
_SOCKET_BYTES = 212_992
"""What a socket holds for a process that does not read, Linux' `rmem_default`: later bytes are lost."""


@dataclasses.dataclass
class Member:
    """One drone: its vehicle with its instruments, its agent and its radio."""

    config: DroneConfig
    vehicle: SimulatedVehicle
    drone: Drone
    agent: Agent
    transport: MemoryTransport
    alive: bool = True
    """Whether the agent runs; the vehicle flies on without it."""
    heard: DroneBytes = NOTHING
    """What the agent said in its last tick: the vehicle hears it in the next step."""
    open_ports: set[str] = dataclasses.field(default_factory=set)
    """The instruments that the agent knows to be there."""
    frozen: bool = False
    """Whether the agent stands still, as a process does that gets no time."""
    missed: list[DroneBytes] = dataclasses.field(default_factory=list)
    """What a frozen agent's sockets hold for it."""
    clock_ahead_s: float = 0.0
    """Of the agent's clock before everybody's."""
    starts: int = 1
    """How often the agent was started."""

    @property
    def runs(self) -> bool:
        return self.alive and not self.frozen


class Scenario:
    """Steps vehicles, radio and agents together; `states`, `events`, `outcomes` are what a ground station hears."""

    def __init__(
        self,
        drones: Sequence[DroneConfig],
        fleet: FleetConfig,
        radio: MemoryRadio | RadioModel | None = None,
        *,
        ground_watches: bool = True,
        ground_ned_m: Vector3 | None = None,
        ground_beats: bool = False,
    ) -> None:
        """`ground_watches`: a ground station tells the swarm where vehicles without agents are. Its radio stands at
        `ground_ned_m`; None: it reaches everybody. `ground_beats`: it tells once a second that it is there.

        `FleetError` for a fleet that cannot be flown, as everywhere.
        """
        for problem in problems(fleet):
            raise problem
        self.now_s = 0.0
        self.world = make_world(fleet)
        self.radio = radio if isinstance(radio, MemoryRadio) else MemoryRadio(fleet.seed, model=radio)
        self.states: dict[int, DroneState] = {}
        self.tables: dict[int, TableState] = {}
        self.orders: dict[int, OrderState] = {}
        self.events: list[tuple[float, Event]] = []
        self.outcomes: list[CommandOutcome] = []
        self.min_separation_m = math.inf
        self.min_clearance_m = math.inf
        """The nearest that a flying vehicle came to an obstacle; negative inside one."""
        self.tap: Callable[[int, float, Inputs, Outputs], None] | None = None
        """Called with every agent's tick, for recording."""
        self._commands = (f"scenario-{n}" for n in itertools.count())
        self._ground = self.radio.join(GROUND)
        if ground_ned_m is not None:
            self.radio.place(GROUND, ground_ned_m)
        self._ground_watches = ground_watches
        self._traffic_due_s = 0.0
        self._beat_due_s = 0.0 if ground_beats else math.inf
        self._beats = 0
        self.members: dict[int, Member] = {}
        specs = {spec.id: spec for spec in fleet.vehicles}
        for config in drones:
            spec = specs[config.drone]
            vehicle = SimulatedVehicle(spec, self.world, seed=fleet.seed, ready_after_s=fleet.ready_after_s)
            self.radio.place(config.drone, vehicle.position_ned_m)
            self.members[config.drone] = Member(
                config,
                vehicle,
                Drone(spec, vehicle, fleet.seed),
                Agent(config, incarnation=config.drone),
                self.radio.join(str(config.drone)),
            )
        self._drones = SimulatedDrones((m.drone for m in self.members.values()), self.world, fleet.faults)

    # -- what a test does --------------------------------------------------------------------------------------

    def command(self, name: CommandName, target: int = 0) -> str:
        command = Command(next(self._commands), GROUND, target, name)
        self._ground.publish(topics.COMMAND, topics.COMMAND.codec.encode(command))
        return command.identity

    def kill(self, drone: int) -> None:
        """The agent dies as by kill -9; its vehicle flies on by itself."""
        self.members[drone].alive = False

    def start_again(self, drone: int) -> None:
        """The agent of a drone starts anew, with a new incarnation and without any memory."""
        member = self.members[drone]
        member.transport.close()
        member.transport = self.radio.join(str(drone))
        member.agent = Agent(member.config, incarnation=drone + _INCARNATIONS * member.starts)
        member.starts += 1
        member.open_ports.clear()
        member.missed.clear()
        member.heard = NOTHING
        member.alive, member.frozen = True, False

    def freeze(self, drone: int) -> None:
        """The agent stands still as by SIGSTOP: the radio and the autopilot's socket hold what comes meanwhile."""
        self.members[drone].frozen = True

    def thaw(self, drone: int) -> None:
        self.members[drone].frozen = False

    def unplug(self, drone: int, instrument: str) -> None:
        self.members[drone].drone.set_plugged(instrument, False)

    def run_until(self, done: Callable[[], bool], limit_s: float) -> bool:
        """Step until `done`; whether it came true within `limit_s` simulated seconds."""
        end_s = self.now_s + limit_s
        while self.now_s < end_s:
            if done():
                return True
            self.step()
        return done()

    def run(self, seconds: float) -> None:
        self.run_until(lambda: False, seconds)

    @property
    def first_takeoff_s(self) -> float | None:
        """Faults count from then on."""
        return self._drones.first_takeoff_s

    def phases(self) -> set[Phase]:
        return {member.agent.phase.phase for member in self.members.values() if member.alive}

    @property
    def source_ned_m(self) -> Vector3 | None:
        """The swarm's estimate of the source, once it is found."""
        sources = (told.order.source_ned_m for told in self.orders.values())
        return next((source for source in sources if source), None)

    # -- one tick ----------------------------------------------------------------------------------------------

    def step(self) -> None:
        self.now_s += TICK_S
        said = self._drones.step(self.now_s, {drone: m.heard for drone, m in self.members.items()})
        for drone, member in self.members.items():
            member.heard = NOTHING
            self.radio.place(drone, member.vehicle.position_ned_m)
        self.radio.step(self.now_s)
        for drone, member in self.members.items():
            if member.runs:
                self._tick(member, _with_missed(member, said[drone]))
            elif member.alive:
                member.missed.append(said[drone])
        self._listen()
        if self.now_s >= self._beat_due_s:
            self._beat_due_s = self.now_s + 1.0
            self._beats += 1
            self._ground.publish(topics.GROUND, topics.GROUND.codec.encode(GroundBeat(GROUND, self._beats)))
        if self._ground_watches and self.now_s >= self._traffic_due_s:
            self._traffic_due_s = self.now_s + 0.25
            self._tell_of_orphans()
        self._measure()

    def _tick(self, member: Member, said: DroneBytes) -> None:
        data = b"".join(data for link, data in said.links if link == 0)
        peers = tuple(PeerMessage(r.topic.name, r.sender, r.payload) for r in member.transport.receive())
        inputs = Inputs(data, tuple(_ports(member, said)), peers, 0)
        outputs = member.agent.step(self.now_s + member.clock_ahead_s, inputs)
        if self.tap is not None:
            self.tap(member.config.drone, self.now_s, inputs, outputs)
        member.heard = DroneBytes(((0, outputs.autopilot),), tuple(outputs.ports))
        for topic, payload in outputs.peers:
            member.transport.publish(topics.TOPICS[topic], payload)

    def _listen(self) -> None:
        for received in self._ground.receive():
            message = received.topic.codec.decode(received.payload)
            match message:
                case DroneState():
                    self.states[message.sender] = message
                case TableState():
                    self.tables[message.sender] = message
                case OrderState():
                    self.orders[message.sender] = message
                case Event():
                    self.events.append((self.now_s, message))
                case CommandOutcome():
                    self.outcomes.append(message)

    def _tell_of_orphans(self) -> None:
        """What `gcs serve` tells of vehicles that it hears over MAVLink and whose agents are silent."""
        orphans = tuple(
            TrafficVehicle(
                drone, m.vehicle.position_ned_m, m.vehicle.velocity_ned_mps, 0.1, m.vehicle.airborne
            )
            for drone, m in self.members.items()
            if not m.runs
        )
        if orphans:
            traffic = Traffic(GROUND, self.world.frame.identity, orphans)
            self._ground.publish(topics.TRAFFIC, topics.TRAFFIC.codec.encode(traffic))

    def _measure(self) -> None:
        flying = [m.vehicle.position_ned_m for m in self.members.values() if m.vehicle.airborne]
        for a, b in itertools.combinations(flying, 2):
            self.min_separation_m = min(self.min_separation_m, math.dist(a, b))
        if isinstance(self.world.obstacles, Obstacles):
            clearances_m = map(self.world.obstacles.clearance_m, flying)
            self.min_clearance_m = min(self.min_clearance_m, min(clearances_m, default=math.inf))


def _ports(member: Member, said: DroneBytes) -> Iterator[PortInput]:
    """What the agent's side of the instruments' lines sees: cables pulled and put in, and bytes."""
    data = dict(said.instruments)
    lines = member.drone.lines
    for name in lines.names:
        plugged, known = lines.is_plugged(name), name in member.open_ports
        if plugged and not known:
            member.open_ports.add(name)
            yield PortInput(name, connected=True)
        elif known and not plugged:
            member.open_ports.discard(name)
            yield PortInput(name, lost="unplugged")
        if name in data:
            yield PortInput(name, data[name])


def _with_missed(member: Member, said: DroneBytes) -> DroneBytes:
    """What an agent reads that was frozen: first what its sockets held, as far as they could."""
    if not member.missed:
        return said
    links: list[tuple[int, bytes]] = []
    instruments: dict[str, bytes] = {}
    held = 0
    for piece in (*member.missed, said):
        for index, data in piece.links:
            if index == 0 and held + len(data) <= _SOCKET_BYTES:
                held += len(data)
                links.append((index, data))
        for name, data in piece.instruments:
            instruments[name] = instruments.get(name, b"") + data
    member.missed.clear()
    return DroneBytes(tuple(links), tuple((name, data[:_SOCKET_BYTES]) for name, data in instruments.items()))
