"""A simulated vehicle that hovers and hears mutated frames: of others it takes nothing, and nothing ends it."""

from __future__ import annotations

import math

import messages
import pytest
from interference import Growth, Wire, hovering
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.framing import V2_MAGIC, FrameFinder, MavlinkFrame
from simvehicle.scenario.swarm import TICK_S, Scenario

ADDRESSED = frozenset(
    kind for kind, definition in mavlink.mavlink_map.items() if "target_system" in definition.fieldnames
)


def at_hover(flavour: str) -> tuple[Scenario, list[MavlinkFrame]]:
    """The flight, and what an agent says to its vehicle in half a minute."""
    flight = hovering(flavour)
    said: list[bytes] = []
    flight.tap = lambda drone, now_s, inputs, outputs: said.append(outputs.autopilot) if drone == 1 else None
    flight.run(30.0)
    flight.tap = None
    return flight, FrameFinder().find(b"".join(said))


@pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
def test_what_is_damaged_or_meant_for_another_vehicle_does_nothing(cases: int, flavour: str) -> None:
    flight, own = at_hover(flavour)
    wire, a_tick, growth = Wire(f"vehicle {flavour}"), 20 if cases < 1000 else 200, Growth()
    member = flight.members[1]
    place, mode = member.vehicle.position_ned_m, member.vehicle.mode

    def meant_for_another() -> bytes:
        """A whole frame that names another system."""
        while True:
            (frame,) = wire.frames(own, 1)
            forged = messages.forged(
                wire.rng, frame, wire.rng.choice((1, 2, 255)), wire.rng.choice((1, 190, 191))
            )
            (found,) = FrameFinder().find(forged)
            if found.kind in ADDRESSED:
                return messages.addressed(found, wire.rng.choice((2, 3, 77, 255)))

    for tick in growth.ticks(5 * cases // a_tick):
        pieces = []
        for frame in wire.frames(own, a_tick):
            match wire.rng.randrange(5):
                case 0 if frame.data[0] == V2_MAGIC:
                    pieces.append(messages.slightly_damaged(wire.rng, frame))
                case 1:
                    pieces.append(messages.damaged(wire.rng, FrameFinder().find(meant_for_another())[0]))
                case _:
                    pieces.append(meant_for_another())
        member.vehicle.receive(0, b"".join(pieces))
        flight.step()
        assert member.vehicle.armed
        assert member.vehicle.mode == mode, tick
        assert math.dist(place, member.vehicle.position_ned_m) < 1.5


@pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
def test_wrong_payloads_of_its_own_agent_end_nothing(cases: int, flavour: str) -> None:
    """It may do as it is told; but it stays a vehicle that is somewhere, goes on with its clock and does not grow."""
    flight, own = at_hover(flavour)
    wire, a_tick, growth = Wire(f"vehicle's own {flavour}"), 20 if cases < 1000 else 200, Growth()
    vehicle = flight.members[1].vehicle
    now_s, said_bytes = flight.now_s, 0
    for _ in growth.ticks(5 * cases // a_tick):
        pieces = [
            messages.forged(wire.rng, frame, wire.rng.choice((1, 255, 250)), wire.rng.choice((191, 190, 1)))
            for frame in wire.frames(own, a_tick)
        ]
        vehicle.receive(0, b"".join(pieces))
        now_s += TICK_S
        vehicle.step(now_s)
        said = vehicle.drain()
        said_bytes = max(said_bytes, sum(len(data) for _, data in said))
        assert all(map(math.isfinite, (*vehicle.position_ned_m, *vehicle.velocity_ned_mps)))
        assert 0.0 <= vehicle.battery_fraction <= 1.0
    assert said_bytes < 3_000_000
