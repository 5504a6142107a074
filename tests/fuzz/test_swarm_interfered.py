"""A hovering swarm that hears a million mutated frames and messages: nobody ends, grows, is taken over, or moves."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import messages
import psutil
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.agent import Agent, Inputs, Outputs, PeerMessage
from flightstack.mavlink.framing import V2_MAGIC, FrameFinder, MavlinkFrame
from flightstack.swarm import topics
from flightstack.swarm.wire import (
    Command,
    CommandName,
    CommandOutcome,
    Event,
    GroundBeat,
    GroundReport,
    Phase,
    Result,
    Severity,
    Traffic,
    TrafficVehicle,
)
from simvehicle.scenario.swarm import Scenario
from simvehicle.survey.draft import draft, in_process
from simvehicle.survey.survey_file import parse_survey

SURVEY = """
name: interfered
origin: {latitude_deg: 38.4040, longitude_deg: 14.9630, amsl_m: 300.0}
launch_line: {count: 3, flavour: FLAVOUR, spacing_m: 6.0, towards_deg: 50.0}
formation: {spacing_m: 10.0, radio_range_m: 80.0}
limits: {ceiling_above_home_m: 60.0}
geofence:
  inclusion:
    - [[38.4053, 14.9613], [38.4053, 14.9647], [38.4027, 14.9647], [38.4027, 14.9613]]
strategy: {name: locus, parameters: {step_m: 4.0, search_radius_m: 100.0}}
wind: {speed_mps: 2.0, from_deg: 320.0}
plume: {type: gaussian, source_north_m: 20.0, source_east_m: -45.0, vent_sd_m: 4.0, emission_kgps: 2.5}
ready_after_s: 1
seed: 3
"""
FAMILIES = 10
"""So many messages are tried for one file: a message is quicker than a file."""
GROWTH_AT_MOST_MIB = 32.0
A_BATTERY = 12_000
"""Ticks of all three drones for which they can hover."""


def hovering(flavour: str = "ardupilot") -> Scenario:
    """Three drones that hold their places in formation."""
    survey = parse_survey(SURVEY.replace("FLAVOUR", flavour), "interfered")
    parts = draft(survey, in_process(survey))
    flight = Scenario(parts.drones, parts.fleet)
    flight.run(2.0)
    flight.command(CommandName.START)
    assert flight.run_until(lambda: flight.phases() == {Phase.SEARCHING}, 120.0), flight.phases()
    flight.command(CommandName.PAUSE)
    assert flight.run_until(lambda: flight.phases() == {Phase.HOLDING}, 10.0)
    flight.run(10.0)
    return flight


class Interfered:
    """An agent that hears more than it should."""

    def __init__(self, agent: Agent, add: Callable[[int, Inputs], Inputs]) -> None:
        self._agent, self._add = agent, add
        self.outputs: Outputs | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._agent, name)

    def step(self, now_s: float, inputs: Inputs) -> Outputs:
        self.outputs = self._agent.step(now_s, self._add(self._agent.config.drone, inputs))
        return self.outputs


class Watch:
    """Where everybody is, what they send, and how large this process is."""

    def __init__(self, flight: Scenario) -> None:
        self._flight = flight
        self._places = {drone: m.vehicle.position_ned_m for drone, m in flight.members.items()}
        self._process = psutil.Process()
        self._begin_mib: float | None = None
        self.farthest_m = 0.0

    def look(self) -> None:
        for drone, member in self._flight.members.items():
            position = member.vehicle.position_ned_m
            assert all(map(math.isfinite, position))
            self.farthest_m = max(self.farthest_m, math.dist(self._places[drone], position))
            outputs = getattr(member.agent, "outputs", None)
            if outputs is not None:
                check_setpoints(outputs.autopilot, drone, member.config.limits)

    def size_mib(self) -> float:
        return float(self._process.memory_info().rss) / 2**20


def check_setpoints(data: bytes, drone: int, limits: Any) -> None:
    ears = mavlink.MAVLink(None)
    for message in ears.parse_buffer(data) or []:
        if not message.get_type().startswith("SET_POSITION_TARGET"):
            continue
        assert message.target_system == drone
        velocity = (message.vx, message.vy, message.vz)
        assert all(map(math.isfinite, velocity))
        assert math.hypot(*velocity[:2]) <= limits.speed_mps + 1e-3
        assert -limits.climb_mps - 1e-3 <= velocity[2] <= limits.descent_mps + 1e-3


def interfere(flight: Scenario, count: int, a_tick: int, add: Callable[[int, Inputs], Inputs]) -> Watch:
    """Fly on until every agent has heard its share of `count` mutated messages, `a_tick` of them in each tick."""
    for member in flight.members.values():
        member.agent = Interfered(member.agent, add)  # type: ignore[assignment]
    watch = Watch(flight)
    ticks = max(10, count // (a_tick * len(flight.members)))
    sizes: list[float] = []
    for tick in range(ticks):
        flight.step()
        watch.look()
        if tick in (ticks // 5, ticks - 1):
            sizes.append(watch.size_mib())
    assert sizes[-1] - sizes[0] < GROWTH_AT_MOST_MIB, f"grew from {sizes[0]:.0f} to {sizes[-1]:.0f} MiB"
    assert [event.text for _, event in flight.events if event.code == "defect"] == []
    return watch


class Wire:
    """Mutated frames, made of a recorded conversation and of what this very autopilot says."""

    def __init__(self, seed: str) -> None:
        self.rng = random.Random(seed)
        self.recorded = messages.recorded_frames("arducopter-4.6.3-conversation.tlog", 400)
        self.recorded += messages.recorded_frames("px4-1.16-dev-flight.tlog", 400)

    def frames(self, inputs: Inputs, count: int) -> list[MavlinkFrame]:
        own = FrameFinder().find(inputs.autopilot)
        return [
            self.rng.choice(own if own and self.rng.random() < 0.5 else self.recorded) for _ in range(count)
        ]


@pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
def test_frames_that_are_damaged_or_of_others_change_nothing(cases: int, flavour: str) -> None:
    wire, a_tick = Wire(f"others {flavour}"), 20 if cases < 1000 else 200

    def add(drone: int, inputs: Inputs) -> Inputs:
        pieces = [inputs.autopilot]
        for frame in wire.frames(inputs, a_tick):
            system, component = wire.rng.choice(list(messages.others(drone)))
            forged = messages.forged(wire.rng, frame, system, component)
            match wire.rng.randrange(5):
                case 0 if frame.data[0] == V2_MAGIC:
                    pieces.append(messages.slightly_damaged(wire.rng, frame))
                case 1:
                    pieces.append(messages.damaged(wire.rng, FrameFinder().find(forged)[0]))
                case _:
                    pieces.append(forged)
        wire.rng.shuffle(pieces)
        return Inputs(b"".join(pieces), inputs.ports, inputs.peers, inputs.late_ticks)

    flight = hovering(flavour)
    watch = interfere(flight, FAMILIES * cases // 2, a_tick, add)
    assert flight.phases() == {Phase.HOLDING}
    assert watch.farthest_m < 1.5


@pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
def test_wrong_payloads_of_the_own_autopilot_end_nothing_and_stay_within_the_limits(
    cases: int, flavour: str
) -> None:
    """What the own autopilot says is believed, and so another mode or place may be flown after: but never a number
    that is none, a faster setpoint, or another vehicle."""
    wire, a_tick = Wire(f"own {flavour}"), 5 if cases < 1000 else 50

    def add(drone: int, inputs: Inputs) -> Inputs:
        said = [inputs.autopilot]
        said += [messages.forged(wire.rng, frame, drone, 1) for frame in wire.frames(inputs, a_tick)]
        return Inputs(b"".join(said), inputs.ports, inputs.peers, inputs.late_ticks)

    interfere(hovering(flavour), FAMILIES * cases // 2, a_tick, add)


def test_one_wrong_payload_a_second_of_the_own_autopilot_moves_nobody(cases: int) -> None:
    """All but those that say that somebody else has taken the vehicle: HEARTBEAT, and what a failsafe says."""
    wire, ticks = Wire("now and then"), itertools.count()
    authority = {mavlink.MAVLINK_MSG_ID_HEARTBEAT, mavlink.MAVLINK_MSG_ID_STATUSTEXT}

    def add(drone: int, inputs: Inputs) -> Inputs:
        if next(ticks) % 30:
            return inputs
        frames = [frame for frame in wire.frames(inputs, 10) if frame.kind not in authority]
        newest = FrameFinder().find(inputs.autopilot)
        if not frames or not newest:
            return inputs
        forged = messages.forged(wire.rng, frames[0], drone, 1, (newest[-1].sequence + 1) % 256)
        if FrameFinder().find(forged)[0].kind in authority:
            return inputs
        return Inputs(inputs.autopilot + forged, inputs.ports, inputs.peers, inputs.late_ticks)

    for _ in range(max(1, cases // A_BATTERY)):
        watch = interfere(hovering(), min(cases, A_BATTERY), 1, add)
        assert watch.farthest_m < 3.0


class Air:
    """Mutated messages of the swarm, made of what its members and the ground station really say."""

    def __init__(self, seed: str, flight: Scenario) -> None:
        self.rng = random.Random(seed)
        self._newest: dict[tuple[str, str], bytes] = {}
        self._flight = flight
        ground = (
            (topics.COMMAND, Command("pause-again", "ground", 0, CommandName.PAUSE)),
            (topics.GROUND, GroundBeat("ground", 7)),
            (topics.EVENT, Event(2, 9, Severity.WARNING, "heal", "drone 2 healed")),
            (topics.OUTCOME, CommandOutcome("pause-again", 2, Result.REFUSED, "why")),
            (
                topics.TRAFFIC,
                Traffic(
                    "ground",
                    flight.world.frame.identity,
                    (
                        TrafficVehicle(2, (200.0, 10.0, -20.0), (0.0, 0.0, 0.0), 0.2),
                        TrafficVehicle(9, (150.0, 0.0, -9.0), (1.0, 0.0, 0.0), 0.1),
                    ),
                ),
            ),
            (topics.REPORT, GroundReport("ground", flight.world.frame.identity, (), ())),
        )
        for topic, message in ground:
            self._newest[topic.name, "ground"] = topic.codec.encode(message)
        for topic, told in ((topics.STATE, flight.states), (topics.TREE, flight.trees)):
            for drone, message in told.items():
                self._newest[topic.name, str(drone)] = topic.codec.encode(message)

    def heard(self, peers: Sequence[PeerMessage]) -> None:
        for peer in peers:
            self._newest[peer.topic, peer.sender] = peer.payload

    def forged(self, topics_in: Sequence[str], *, senders: Sequence[str] = ()) -> Iterator[PeerMessage]:
        """Without end. `senders`: under whose names; else under that of whom it was made of, or another one."""
        while True:
            name, sender = self.rng.choice([key for key in self._newest if key[0] in topics_in])
            payload = messages.forged_message(self.rng, topics.TOPICS[name], self._newest[name, sender])
            if messages.is_order_to_move(topics.TOPICS[name], payload):
                continue
            if senders:
                sender = self.rng.choice(senders)
            yield PeerMessage(name, sender, payload)


STRANGERS = ("0", "4", "9", "77", "250", "256", "-1", "x", "ground2", "2 ", "２", "")
HEARD = tuple(topic.name for topic in topics.RECEIVED_BY_DRONES)


@pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
def test_messages_of_strangers_change_nothing(cases: int, flavour: str) -> None:
    flight = hovering(flavour)
    air, a_tick = Air(f"strangers {flavour}", flight), 20 if cases < 1000 else 200
    forged = air.forged(("state", "tree"), senders=STRANGERS)

    def add(drone: int, inputs: Inputs) -> Inputs:
        air.heard(inputs.peers)
        return Inputs(
            inputs.autopilot,
            inputs.ports,
            (*inputs.peers, *itertools.islice(forged, a_tick)),
            inputs.late_ticks,
        )

    watch = interfere(flight, FAMILIES * cases // 4, a_tick, add)
    assert flight.phases() == {Phase.HOLDING}
    assert watch.farthest_m < 1.5
    assert {drone for tree in flight.trees.values() for drone, _ in tree.slots} == {1, 2, 3}


@pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
def test_wrong_messages_of_members_end_nothing_and_move_nobody(cases: int, flavour: str) -> None:
    """A member that says what is not so may be given way to, and may be counted out; nobody flies away for it."""
    flight = hovering(flavour)
    air, a_tick = Air(f"members {flavour}", flight), 20 if cases < 1000 else 200
    forged = air.forged(HEARD)

    def add(drone: int, inputs: Inputs) -> Inputs:
        air.heard(inputs.peers)
        return Inputs(
            inputs.autopilot,
            inputs.ports,
            (*inputs.peers, *itertools.islice(forged, a_tick)),
            inputs.late_ticks,
        )

    watch = interfere(flight, FAMILIES * cases // 4, a_tick, add)
    assert watch.farthest_m < 1.5
    assert {drone for tree in flight.trees.values() for drone, _ in tree.slots} <= {1, 2, 3}
