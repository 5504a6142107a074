"""What a hovering swarm, a station and a vehicle are interfered with by, and what must stay as it is."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence

import messages
import psutil

from flightstack.agent import PeerMessage
from flightstack.mavlink.framing import MavlinkFrame
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

STRANGERS = ("0", "4", "9", "77", "250", "256", "-1", "x", "ground2", "2 ", "２", "")
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


class Growth:
    """How much memory this process has taken since a fifth of its work was done."""

    def __init__(self) -> None:
        self._process = psutil.Process()

    def _size_mib(self) -> float:
        return float(self._process.memory_info().rss) / 2**20

    def ticks(self, count: int) -> Iterator[int]:
        """So many ticks, at least ten; then the process must not have grown."""
        count = max(10, count)
        begin_mib = 0.0
        for tick in range(count):
            yield tick
            if tick == count // 5:
                begin_mib = self._size_mib()
        end_mib = self._size_mib()
        assert end_mib - begin_mib < GROWTH_AT_MOST_MIB, f"grew from {begin_mib:.0f} to {end_mib:.0f} MiB"


class Wire:
    """Mutated frames, made of a recorded conversation and of what this very autopilot says."""

    def __init__(self, seed: str) -> None:
        self.rng = random.Random(seed)
        self.recorded = messages.recorded_frames("arducopter-4.6.3-conversation.tlog", 400)
        self.recorded += messages.recorded_frames("px4-1.16-dev-flight.tlog", 400)

    def frames(self, own: Sequence[MavlinkFrame], count: int) -> list[MavlinkFrame]:
        """So many, as they came: half of those recorded, half of what the autopilot says now."""
        return [
            self.rng.choice(own if own and self.rng.random() < 0.5 else self.recorded) for _ in range(count)
        ]


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
        for topic, told in (
            (topics.STATE, flight.states),
            (topics.TABLE, flight.tables),
            (topics.ORDER, flight.orders),
        ):
            for drone, message in told.items():
                self._newest[topic.name, str(drone)] = topic.codec.encode(message)

    def heard(self, peers: Sequence[PeerMessage]) -> None:
        for peer in peers:
            self._newest[peer.topic, peer.sender] = peer.payload

    def forged(self, topics_in: Sequence[str], *, strangers: bool = False) -> Iterator[PeerMessage]:
        """Without end. `strangers`: under names that no member has, else under that of whom it was made of."""
        while True:
            name, sender = self.rng.choice([key for key in self._newest if key[0] in topics_in])
            payload = messages.forged_message(self.rng, topics.TOPICS[name], self._newest[name, sender])
            if messages.is_order_to_move(topics.TOPICS[name], payload):
                continue
            if strangers:
                sender = self.rng.choice(STRANGERS)
            yield PeerMessage(name, sender, payload)
