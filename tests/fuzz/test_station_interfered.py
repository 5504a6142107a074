"""A ground station that hears mutated frames and messages beside those of a hovering swarm."""

from __future__ import annotations

import itertools
import random
from collections.abc import Callable, Sequence

import messages
import pytest
from interference import Air, Growth, Wire, hovering
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.agent import Inputs, Outputs
from flightstack.mavlink.framing import V2_MAGIC, FrameFinder, MavlinkFrame
from flightstack.recording import named_json
from flightstack.swarm import topics
from flightstack.swarm.topics import Received
from flightstack.swarm.wire import Severity
from gcs.station import Station, StationOutputs
from gcs.station_config import GroundConfig, MavlinkConfig, SwarmConfig

MEMBERS = (1, 2, 3)
MOVING = frozenset(
    {
        mavlink.MAV_CMD_DO_SET_MODE,
        mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
        mavlink.MAV_CMD_NAV_TAKEOFF,
        mavlink.MAV_CMD_NAV_LAND,
        mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH,
    }
)


class Listening:
    """A station beside a flight: every tick it hears what the drones say, and more."""

    def __init__(self, flavour: str) -> None:
        self.flight = hovering(flavour)
        config = self.flight.members[1].config
        ground = GroundConfig(
            swarm=SwarmConfig(name="interfered", members=MEMBERS),
            origin=config.origin,
            mavlink=MavlinkConfig(links=("udpin:127.0.0.1:0",)),
        )
        self.station = Station(ground, config.geofence, self.flight.now_s)
        self._said: list[bytes] = []
        self._told: list[Received] = []
        self.flight.tap = self._tap
        for _ in range(100):
            self.tick(lambda real: b"", ())

    def _tap(self, drone: int, _now_s: float, inputs: Inputs, outputs: Outputs) -> None:
        self._said.append(inputs.autopilot)
        self._told += [Received(topics.TOPICS[name], str(drone), payload) for name, payload in outputs.peers]

    def tick(
        self, frames: Callable[[Sequence[MavlinkFrame]], bytes], told: Sequence[Received]
    ) -> StationOutputs:
        self.flight.step()
        said, heard = b"".join(self._said), [*self._told, *told]
        self._said, self._told = [], []
        added = frames(FrameFinder().find(said))
        outputs = self.station.step(self.flight.now_s, heard, [said + added])
        for topic, message in outputs.publish:
            topic.codec.encode(message)
        for entry in outputs.timeline:
            named_json.encode({"of": entry.message})
        assert all(line.isprintable() for _, line in outputs.log), outputs.log
        return outputs

    def orders(self, outputs: StationOutputs) -> list[str]:
        """What the station tells drones to do."""
        ears = mavlink.MAVLink(None)
        return [
            str(message)
            for message in ears.parse_buffer(b"".join(outputs.writes)) or []
            if message.get_type() in ("COMMAND_LONG", "COMMAND_INT", "SET_MODE")
            and getattr(message, "command", mavlink.MAV_CMD_DO_SET_MODE) in MOVING
        ]


@pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
def test_frames_of_others_are_no_vehicles_and_no_reason_to_act(cases: int, flavour: str) -> None:
    """Whatever comes of other components than an autopilot, and whatever is damaged."""
    listening, wire = Listening(flavour), Wire(f"station {flavour}")
    a_tick = 20 if cases < 1000 else 500
    growth = Growth()
    others = [
        (system, component) for system in (1, 2, 3, 77, 255) for component in (0, 2, 25, 100, 156, 191, 250)
    ]

    def frames(real: Sequence[MavlinkFrame]) -> bytes:
        pieces = []
        for frame in wire.frames(real, a_tick):
            forged = messages.forged(wire.rng, frame, *wire.rng.choice(others))
            match wire.rng.randrange(5):
                case 0 if frame.data[0] == V2_MAGIC:
                    pieces.append(messages.slightly_damaged(wire.rng, frame))
                case 1:
                    pieces.append(messages.damaged(wire.rng, FrameFinder().find(forged)[0]))
                case _:
                    pieces.append(forged)
        return b"".join(pieces)

    for tick in growth.ticks(5 * cases // a_tick):
        outputs = listening.tick(frames, ())
        assert listening.orders(outputs) == [], tick
        assert listening.station.fleet.vehicles.systems() == set(MEMBERS)
    alarms = [a for a in listening.station.monitor.alarms if a.severity is Severity.CRITICAL]
    assert alarms == []


@pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
def test_wrong_payloads_of_autopilots_end_nothing(cases: int, flavour: str) -> None:
    listening, wire = Listening(flavour), Wire(f"station's own {flavour}")
    a_tick = 20 if cases < 1000 else 500
    growth = Growth()

    def frames(real: Sequence[MavlinkFrame]) -> bytes:
        chosen = wire.frames(real, a_tick)
        return b"".join(
            messages.forged(wire.rng, frame, wire.rng.choice((1, 2, 3, 9)), 1) for frame in chosen
        )

    for _ in growth.ticks(5 * cases // a_tick):
        listening.tick(frames, ())


@pytest.mark.parametrize("whose", ["members", "strangers", "thousands"])
def test_wrong_messages_end_nothing(cases: int, whose: str) -> None:
    listening, a_tick = Listening("ardupilot"), 20 if cases < 1000 else 300
    air, rng, growth = Air(f"station {whose}", listening.flight), random.Random(whose), Growth()
    forged = air.forged([topic.name for topic in topics.TOPICS.values()], strangers=whose == "strangers")

    def told() -> list[Received]:
        some = [
            Received(topics.TOPICS[m.topic], m.sender, m.payload) for m in itertools.islice(forged, a_tick)
        ]
        if whose != "thousands":
            return some
        return [
            received._replace(sender=str(number), payload=messages.from_sender(received.payload, number))
            for received in some
            if (number := rng.choice((rng.randrange(2**40), rng.randrange(300))))
        ]

    for _ in growth.ticks(4 * cases // a_tick):
        outputs = listening.tick(lambda real: b"", told())
        if whose != "members":
            assert listening.orders(outputs) == []
            assert set(MEMBERS) <= {row.drone for row in listening.station.fleet.rows(listening.flight.now_s)}
