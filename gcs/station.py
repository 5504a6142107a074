"""The ground station's core: one synchronous step a tick, messages and bytes in, messages and bytes out.

Like the agent's, it is deterministic in its arguments: the sockets, files and the clock are in `gcs.serve`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink import vehicle_state
from flightstack.mavlink.codec import MavlinkCodec, MavlinkMessage
from flightstack.mavlink.commands import heartbeat, set_mode
from flightstack.mavlink.message_rates import StreamRequests
from flightstack.mavlink.modes import Flavour, mode_of
from flightstack.mavlink.role import AUTOPILOT_COMPONENT
from flightstack.swarm import topics
from flightstack.swarm.topics import Received, Topic
from flightstack.swarm.wire import (
    Command,
    Event,
    GroundBeat,
    GroundReport,
    Severity,
    Traffic,
    TrafficVehicle,
)
from gcs.fleet.monitor import Alarm, Monitor, ended, on_the_wire
from gcs.fleet.orphans import OrphanKeeper
from gcs.fleet.proxy import CommandProxy
from gcs.fleet.vehicle_texts import VehicleTexts
from gcs.fleet.vehicles import Component, Source
from gcs.fleet.view import FleetView
from gcs.station_config import GroundConfig
from mission.geometry.frames import LocalFrame
from mission.geometry.geofence import Geofence, LocalFence

COMPONENT = mavlink.MAV_COMP_ID_MISSIONPLANNER
"""190: what ground stations use."""
HEARTBEAT_HZ = 1.0
_NEEDED_HZ = {
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 4.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 1.0,
}
RATES_HZ = dict.fromkeys(Flavour, _NEEDED_HZ)
"""The few messages that the ground station needs of any autopilot."""
TRAFFIC_POSITION_MAX_AGE_S = 5.0
"""A vehicle whose last position is older is no use as an obstacle: it may be anywhere."""
_EARLY_FRAMES = 200
"""Kept of a system that may turn out to be a vehicle."""


class TimelineEntry(msgspec.Struct, frozen=True):
    """One record of the merged timeline."""

    topic: str
    message: Any


class Frame(msgspec.Struct, frozen=True):
    """One MAVLink frame for a vehicle's log, received from it or sent to it."""

    system: int
    data: bytes


class StationOutputs(msgspec.Struct, frozen=True):
    publish: tuple[tuple[Topic, msgspec.Struct], ...]
    writes: tuple[bytes, ...]
    """Bytes for each MAVLink link, in the order of the configuration."""
    timeline: tuple[TimelineEntry, ...]
    frames: tuple[Frame, ...]
    log: tuple[tuple[Severity, str], ...]
    """Lines for the operator."""


class Station:
    def __init__(
        self, config: GroundConfig, fence: Geofence | None, started_s: float, *, incarnation: int = 1
    ) -> None:
        """`incarnation` (31 bits, not 0) is another one at every start: by it the station knows its own echo."""
        self.config = config
        self._incarnation = incarnation
        frame = LocalFrame(config.origin)
        self.fleet = FleetView(config.swarm.members, frame, started_s)
        self.frame = frame
        self.monitor = Monitor(config.alarms, LocalFence(frame, fence) if fence is not None else None)
        self._keeper = OrphanKeeper(config.orphans)
        self._proxy = CommandProxy(config.alarms.agent_silent_s)
        self._streams: dict[Source, StreamRequests] = {}
        self._codecs = [
            MavlinkCodec(config.mavlink.system, COMPONENT, vehicle_state.STATES, vehicle_state.EVENTS)
            for _ in config.mavlink.links
        ]
        self._writes = [bytearray() for _ in self._codecs]
        self._publish: list[tuple[Topic, msgspec.Struct]] = []
        self._timeline: list[TimelineEntry] = []
        self._frames: list[Frame] = []
        self._early: dict[int, list[Frame]] = {}
        self._log: list[tuple[Severity, str]] = []
        self._texts = VehicleTexts()
        self._signers: set[int] = set()
        self._sent_s: dict[str, float] = {}
        self._counts: Counter[str] = Counter()
        """Messages told, by topic."""

    def step(
        self, now_s: float, peers: Sequence[Received], links: Sequence[bytes], storage: str = ""
    ) -> StationOutputs:
        """One tick: `links` holds what came over each MAVLink link since the last; `storage` tells why the station
        does not record, if it does not."""
        self.fleet.storage = storage
        self._publish, self._timeline, self._frames, self._log = [], [], [], []
        self._writes = [bytearray() for _ in self._codecs]
        for index, data in enumerate(links):
            self._receive_mavlink(now_s, index, data)
        self._tell_texts(now_s)
        for received in peers:
            self._receive_peer(now_s, received)
        self._watch(now_s)
        self._act(now_s)
        self._tell(now_s)
        return StationOutputs(
            tuple(self._publish),
            tuple(bytes(data) for data in self._writes),
            tuple(self._timeline),
            tuple(self._frames),
            tuple(self._log),
        )

    # -- in ------------------------------------------------------------------------------------------------

    def _receive_mavlink(self, now_s: float, index: int, data: bytes) -> None:
        codec = self._codecs[index]
        for frame, message in codec.receive_frames(now_s, data):
            if message is not None:
                component = self.fleet.receive_mavlink(now_s, index, message)
                if message.kind == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
                    self._look_for_rival(now_s, index, message)
                if message.kind == mavlink.MAVLINK_MSG_ID_COMMAND_ACK and codec.is_answer_to_us(message):
                    self._requests_of(component).acknowledge(
                        now_s, message.fields.command, message.fields.result
                    )
            self._log_frame(Frame(frame.system, frame.data))
        if self.config.mavlink.signing_key is None:
            self._tell_signers(codec)

    def _tell_signers(self, codec: MavlinkCodec) -> None:
        """Vehicles with a key that we have not: we hear them, and they may not hear us."""
        for system, component in codec.signers:
            if (
                component == AUTOPILOT_COMPONENT
                and self.fleet.is_member(system)
                and system not in self._signers
            ):
                self._signers.add(system)
                text = f"drone {system} signs, and may obey nobody without its key: set mavlink.signing_key"
                self._log.append((Severity.WARNING, text))

    def _look_for_rival(self, now_s: float, index: int, message: MavlinkMessage) -> None:
        """Another ground station's heartbeat under our system id; our own comes back with our mark in it."""
        own, fields = self.config.mavlink, message.fields
        is_rival = fields.type == mavlink.MAV_TYPE_GCS and fields.custom_mode != self._incarnation
        if message.system == own.system and is_rival:
            text = (
                f"another ground station (component {message.component}) on {own.links[index]} has our system id "
                f"{own.system}: give one of them another (here: mavlink.system)"
            )
            self.fleet.rivals["system"] = (text, now_s)

    def _tell_texts(self, now_s: float) -> None:
        """Warnings and worse of our own vehicles are events; everything is on the timeline."""
        for component in self.fleet.vehicles.components.values():
            component.flush(now_s)
            link, system, number = component.source
            for text in component.take_texts():
                self._timeline.append(TimelineEntry(f"/statustext/{system}", text))
                if text.severity > mavlink.MAV_SEVERITY_WARNING or not self.fleet.is_member(system):
                    continue
                if number == AUTOPILOT_COMPONENT:
                    self._texts.hear(now_s, link, system, text)
                else:
                    self._event(Severity.WARNING, system, "statustext", f"component {number}: {text.text}")
        for drone, text in self._texts.due(now_s, lambda drone: self.fleet.agent_live(drone, now_s)):
            self._event(Severity.WARNING, drone, "statustext", text.text)

    def _log_frame(self, frame: Frame) -> None:
        """Into the vehicle's log; what came before its first heartbeat waits until it is known as a vehicle."""
        early = self._early.setdefault(frame.system, [])
        early.append(frame)
        if frame.system in self.fleet.vehicles.systems():
            self._frames += early
            early.clear()
        del early[:-_EARLY_FRAMES]

    def _receive_peer(self, now_s: float, received: Received) -> None:
        message = self.fleet.receive_peer(now_s, received)
        if message is None:
            return
        self._timeline.append(TimelineEntry(f"/{received.topic.name}/{received.sender}", message))
        if isinstance(message, Command):
            self._proxy.receive(now_s, message, self.fleet, self._keeper)
        elif isinstance(message, Event):
            self._log.append((message.severity, f"drone {message.sender}: {message.code}: {message.text}"))
            if message.code == "statustext":
                self._texts.agent_told(now_s, message.sender, message.text)
        elif isinstance(message, GroundBeat):
            self._meet_station(now_s, message)

    def _meet_station(self, now_s: float, beat: GroundBeat) -> None:
        """The network does not bring our own beats back: who has our name is another."""
        own = self.config
        if beat.sender == own.station:
            text = (
                f"another ground station calls itself {own.station}: give one of them another `station` name"
            )
            self.fleet.rivals["name"] = (text, now_s)
        elif beat.system == own.mavlink.system and own.mavlink.links:
            text = (
                f"ground station {beat.sender} has our MAVLink system id {beat.system}: "
                "give one of them another (mavlink.system)"
            )
            self.fleet.rivals["system"] = (text, now_s)

    # -- judge and act -------------------------------------------------------------------------------------

    def _watch(self, now_s: float) -> None:
        changes = self.monitor.step(now_s, self.fleet)
        for alarm in changes.raised:
            self._timeline.append(TimelineEntry("/alarm", {"change": "raised", "alarm": alarm}))
            if not self._told_by_agent(alarm):
                self._event(alarm.severity, alarm.drone, alarm.code, alarm.text)
        for alarm in changes.cleared:
            self._timeline.append(TimelineEntry("/alarm", {"change": "cleared", "alarm": alarm}))
            self._event(Severity.INFO, alarm.drone, alarm.code, ended(alarm))

    def _told_by_agent(self, alarm: Alarm) -> bool:
        """Whether the drone's own event has told the beginning of this alarm: once is enough."""
        agent = self.fleet.agents.get(alarm.drone)
        if agent is None or agent.state is None:
            return False
        return bool({"crash": agent.state.crash, "astray": agent.state.astray}.get(alarm.code))

    def _act(self, now_s: float) -> None:
        for change in self._keeper.step(now_s, self.fleet):
            vehicle = change.vehicle
            custom_mode = mode_of(vehicle.mode_table, change.duty)
            self._send(vehicle.source, set_mode(vehicle, custom_mode, change.confirmation))
        for action in self._keeper.take_actions():
            self._timeline.append(TimelineEntry("/action", action))
            self._event(action.severity, action.drone, "bring_home", action.text)
        for outcome in self._proxy.step(now_s, self.fleet):
            self._publish.append((topics.OUTCOME, outcome))
        for autopilot in self.fleet.vehicles.autopilots():
            if not self.fleet.is_member(autopilot.source.system):
                continue  # it is not ours, and not asked for anything
            for message in self._requests_of(autopilot).step(now_s, autopilot):
                self._send(autopilot.source, message)

    def _requests_of(self, component: Component) -> StreamRequests:
        requests = self._streams.get(component.source)
        if requests is None:
            # What another ground station on this radio asked for already is left as it comes.
            requests = self._streams[component.source] = StreamRequests(
                RATES_HZ, once=(mavlink.MAVLINK_MSG_ID_HOME_POSITION,), asks_first=False
            )
        return requests

    def _tell(self, now_s: float) -> None:
        if self._due(now_s, "heartbeat", HEARTBEAT_HZ):
            for index, codec in enumerate(self._codecs):
                self._writes[index] += codec.encode(heartbeat(mavlink.MAV_TYPE_GCS, self._incarnation))
        if self._due(now_s, topics.GROUND.name, topics.GROUND.rate_hz):
            system = self.config.mavlink.system if self.config.mavlink.links else 0
            beat = GroundBeat(self.config.station, self._number(topics.GROUND), system, self._incarnation)
            self._publish.append((topics.GROUND, beat))
        if self._due(now_s, topics.REPORT.name, topics.REPORT.rate_hz):
            self._publish.append((topics.REPORT, self._report(now_s)))
        traffic = self._traffic(now_s)
        if traffic and self._due(now_s, topics.TRAFFIC.name, topics.TRAFFIC.rate_hz):
            number = self._number(topics.TRAFFIC)
            message = Traffic(self.config.station, self.frame.identity, traffic, self._incarnation, number)
            self._publish.append((topics.TRAFFIC, message))
            self._timeline.append(TimelineEntry(f"/traffic/{self.config.station}", message))

    def _traffic(self, now_s: float) -> tuple[TrafficVehicle, ...]:
        """Vehicles that some drones do not hear: obstacles for them while they fly, and no more once they are down.

        Those whose agents are silent, and where a swarm has come apart each part's for the other.
        """
        return tuple(
            TrafficVehicle(
                vehicle.source.system,
                vehicle.position_ned_m,
                vehicle.velocity_ned_mps,
                vehicle.position_age_s(now_s),
                vehicle.airborne(now_s),
            )
            for vehicle in self._heard(now_s)
            if (
                not self.fleet.agent_live(drone := vehicle.source.system, now_s)
                or self.fleet.missed(drone, now_s)
            )
            and vehicle.position_ned_m is not None
            and vehicle.velocity_ned_mps is not None
            and vehicle.position_age_s(now_s) <= TRAFFIC_POSITION_MAX_AGE_S
        )

    def _report(self, now_s: float) -> GroundReport:
        vehicles = tuple(
            heard
            for vehicle in self._heard(now_s)
            if (heard := self.fleet.heard_vehicle(vehicle.source.system, now_s)) is not None
        )
        alarms = on_the_wire(self.monitor.alarms, now_s)
        return GroundReport(self.config.station, self.frame.identity, alarms, vehicles)

    def _heard(self, now_s: float) -> list[Component]:
        drones = sorted(self.fleet.drones(now_s))
        return [c for drone in drones if (c := self.fleet.vehicle(drone)) is not None]

    # -- out -----------------------------------------------------------------------------------------------

    def _send(self, target: Source, message: Any) -> None:
        frame = self._codecs[target.link].encode(message)
        self._writes[target.link] += frame
        self._frames.append(Frame(target.system, frame))

    def _event(self, severity: Severity, drone: int, code: str, text: str) -> None:
        event = Event(drone, self._number(topics.EVENT), severity, code, text, self._incarnation)
        self._publish.append((topics.EVENT, event))
        self._timeline.append(TimelineEntry(f"/event/{self.config.station}", event))
        self._log.append((severity, f"drone {drone}: {code}: {text}" if drone else f"{code}: {text}"))

    def _number(self, topic: Topic) -> int:
        self._counts[topic.name] += 1
        return self._counts[topic.name]

    def _due(self, now_s: float, name: str, rate_hz: float | None) -> bool:
        last_s = self._sent_s.get(name)
        period_s = 1.0 / (rate_hz or HEARTBEAT_HZ)
        if last_s is not None and now_s - last_s < period_s - 0.5 / self.config.tick_hz:
            return False
        self._sent_s[name] = now_s
        return True
