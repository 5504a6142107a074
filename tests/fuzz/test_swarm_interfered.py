"""A hovering swarm that hears a million mutated frames and messages: nobody ends, grows, is taken over, or moves."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Callable
from typing import Any

import messages
import pytest
from interference import A_BATTERY, FAMILIES, Air, Growth, Wire, hovering
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.agent import Agent, Inputs, Outputs, PeerMessage
from flightstack.mavlink.framing import V2_MAGIC, FrameFinder
from flightstack.swarm import topics
from flightstack.swarm.wire import (
    Phase,
)
from simvehicle.scenario.swarm import Scenario

RECORDED_AT_MOST = 5000
"""Messages of a recording that is said again; later ones take the places of earlier ones."""


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
    """Where everybody is, and what they send."""

    def __init__(self, flight: Scenario) -> None:
        self._flight = flight
        self._places = {drone: m.vehicle.position_ned_m for drone, m in flight.members.items()}
        self.farthest_m = 0.0

    def look(self) -> None:
        for drone, member in self._flight.members.items():
            position = member.vehicle.position_ned_m
            assert all(map(math.isfinite, position))
            self.farthest_m = max(self.farthest_m, math.dist(self._places[drone], position))
            outputs = getattr(member.agent, "outputs", None)
            if outputs is not None:
                check_setpoints(outputs.autopilot, drone, member.config.limits)


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
    for _ in Growth().ticks(count // (a_tick * len(flight.members))):
        flight.step()
        watch.look()
    assert [event.text for _, event in flight.events if event.code == "defect"] == []
    return watch


@pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
def test_frames_that_are_damaged_or_of_others_change_nothing(cases: int, flavour: str) -> None:
    wire, a_tick = Wire(f"others {flavour}"), 20 if cases < 1000 else 200

    def add(drone: int, inputs: Inputs) -> Inputs:
        pieces = [inputs.autopilot]
        for frame in wire.frames(FrameFinder().find(inputs.autopilot), a_tick):
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
        said += [
            messages.forged(wire.rng, frame, drone, 1)
            for frame in wire.frames(FrameFinder().find(inputs.autopilot), a_tick)
        ]
        return Inputs(b"".join(said), inputs.ports, inputs.peers, inputs.late_ticks)

    interfere(hovering(flavour), FAMILIES * cases // 2, a_tick, add)


def test_one_wrong_payload_a_second_of_the_own_autopilot_moves_nobody(cases: int) -> None:
    """All but those that say that somebody else has taken the vehicle: HEARTBEAT, and what a failsafe says."""
    wire, ticks = Wire("now and then"), itertools.count()
    authority = {mavlink.MAVLINK_MSG_ID_HEARTBEAT, mavlink.MAVLINK_MSG_ID_STATUSTEXT}

    def add(drone: int, inputs: Inputs) -> Inputs:
        if next(ticks) % 30:
            return inputs
        frames = [
            frame
            for frame in wire.frames(FrameFinder().find(inputs.autopilot), 10)
            if frame.kind not in authority
        ]
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


HEARD = tuple(topic.name for topic in topics.RECEIVED_BY_DRONES)


@pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
def test_what_was_said_before_changes_nothing_said_again_or_in_anothers_name(
    cases: int, flavour: str
) -> None:
    """Everything that anybody said since the start, again and again, by its sender and by others, in any order."""
    flight = hovering(flavour)
    rng, a_tick = random.Random(f"before {flavour}"), 20 if cases < 1000 else 200
    recorded: list[PeerMessage] = []

    def add(_drone: int, inputs: Inputs) -> Inputs:
        for message in inputs.peers:
            if len(recorded) < RECORDED_AT_MOST:
                recorded.append(message)
            else:
                recorded[rng.randrange(RECORDED_AT_MOST)] = message
        added = [
            PeerMessage(said.topic, rng.choice(("1", "2", "3")), said.payload) if rng.random() < 0.3 else said
            for said in rng.choices(recorded, k=a_tick)
        ] if recorded else []  # fmt: skip
        peers = [*inputs.peers, *added]
        return Inputs(inputs.autopilot, inputs.ports, tuple(peers), inputs.late_ticks)

    watch = interfere(flight, FAMILIES * cases // 4, a_tick, add)
    assert flight.phases() == {Phase.HOLDING}
    assert watch.farthest_m < 1.5
    assert {drone for table in flight.tables.values() for drone in table.held} == {1, 2, 3}


@pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
def test_messages_of_strangers_change_nothing(cases: int, flavour: str) -> None:
    flight = hovering(flavour)
    air, a_tick = Air(f"strangers {flavour}", flight), 20 if cases < 1000 else 200
    forged = air.forged(("state", "table", "order"), strangers=True)

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
    assert {drone for table in flight.tables.values() for drone in table.held} == {1, 2, 3}


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
    # One that says it comes down unsteered has the 5 m around the column over its home to itself.
    assert watch.farthest_m < 6.5
    assert {drone for table in flight.tables.values() for drone in table.held} <= {1, 2, 3}
