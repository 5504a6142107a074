"""The fleet as the ground station sees it: what agents tell their peers, and what autopilots say over MAVLink.

Pure: messages and the time of their reception come as arguments. Every age is measured on the receiver's own
clock; what a message says about time is never compared with it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator
from typing import Literal, TypeAlias

import msgspec

from flightstack.mavlink.codec import MavlinkMessage
from flightstack.mavlink.role import Role
from flightstack.mavlink.vehicle_state import HEARTBEAT_LOST_S
from flightstack.swarm import topics
from flightstack.swarm.admission import ANYBODY, Admission, Message, Refusal, RefusalKind
from flightstack.swarm.topics import Received
from flightstack.swarm.wire import (
    Command,
    CommandOutcome,
    DroneState,
    Event,
    GroundReport,
    HeardVehicle,
    TableState,
)
from gcs.fleet.agents import HeardAgent
from gcs.fleet.vehicles import Component, Vehicles
from mission.documents.printable import printable
from mission.geometry.frames import LocalFrame, Vector3

Health: TypeAlias = Literal["live", "silent", "never"]
_EVENTS_KEPT = 50
_COMMANDS_KEPT = 64
_SENDERS_KEPT = 64
FOREIGN_SHOWN_S = 10.0
"""Who is no member is shown while it is heard, and for this long afterwards."""


class Garbled(msgspec.Struct, frozen=True):
    """Messages of a node that could not be read, or cannot be."""

    count: int
    text: str
    time_s: float


class DroneRow(msgspec.Struct, frozen=True, kw_only=True):
    """One drone as displays and programs get it. None: not known (never heard, or too old to be shown)."""

    drone: int
    member: bool
    agent: Health
    agent_age_s: float | None
    vehicle: Health
    """The autopilot as heard over MAVLink."""
    vehicle_age_s: float | None
    phase: str | None
    mode: str | None
    armed: bool | None
    airborne: bool | None
    latitude_deg: float | None
    longitude_deg: float | None
    amsl_m: float | None
    position_ned_m: Vector3 | None
    """In the swarm's frame; the last known one of a silent drone."""
    above_home_m: float | None
    co2_ppm: float | None
    excess_co2_ppm: float | None
    excess_co2_sd_ppm: float | None
    best_excess_co2_ppm: float | None
    wind_mps: float | None
    wind_from_deg: float | None
    battery_fraction: float | None
    epoch: int | None
    slot: int | None
    parent: int | None
    healing: bool
    crash: str
    """How it crashed, empty if it did not."""
    heals: int
    restarts: int
    late_tick_fraction: float
    frame_matches: bool
    notes: tuple[str, ...]
    storage: str
    """Why the drone's flight is not recorded; empty when it is, or when nobody says."""


class Asked(msgspec.Struct):
    """A command that was heard on the air, and who has answered."""

    command: Command
    time_s: float
    waiting_for: set[int]
    """Drones that it was for, that were heard then, and that have not answered."""
    outcomes: dict[int, CommandOutcome] = {}


class FleetView:
    """Merges everything. `members` are shown from the beginning; other drones as soon as they are heard."""

    def __init__(self, members: Iterable[int], frame: LocalFrame | None, started_s: float) -> None:
        self.members = tuple(members)
        self.frame = frame
        """None: not known; there are no latitudes then, and autopilots' own positions cannot be placed."""
        self.started_s = started_s
        self.agents: dict[int, HeardAgent] = {}
        self.vehicles = Vehicles(frame)
        self._admission = Admission(self.members, frame.identity if frame is not None else None)
        self.events: deque[tuple[float, Event]] = deque(maxlen=_EVENTS_KEPT)
        self.asked: dict[str, Asked] = {}
        self.garbled: dict[str, Garbled] = {}
        self.storage = ""
        """Why the running station does not record; empty when it does."""
        self.rivals: dict[str, tuple[str, float]] = {}
        """Ground stations that pass for ours, by what is the same: what to tell, and when it was heard last."""
        self.report: GroundReport | None = None
        """The newest report of a running ground station (heard by displays)."""
        self.report_s: float | None = None

    def is_member(self, drone: int) -> bool:
        """Whether the drone is one of ours. Where the members are not known, every agent's is."""
        return drone in (self.members or self.agents)

    def drones(self, now_s: float) -> list[int]:
        """Members in their order, then everybody else who is heard."""
        others = set(self.agents) | self.vehicles.systems()
        if self.report is not None:
            others |= {vehicle.drone for vehicle in self.report.vehicles}
        others.difference_update(self.members)
        heard = (d for d in others if self.is_member(d) or self._heard_age_s(d, now_s) <= FOREIGN_SHOWN_S)
        return [*self.members, *sorted(heard)]

    def _heard_age_s(self, drone: int, now_s: float) -> float:
        """Since anything was heard of a drone."""
        agent, vehicle = self.agents.get(drone), self.heard_vehicle(drone, now_s)
        ages_s = (
            math.inf if agent is None else agent.age_s(now_s),
            math.inf if vehicle is None else vehicle.age_s,
        )
        return min(ages_s)

    def crash(self, drone: int, now_s: float) -> str:
        """How and where it crashed: as its agent says, else as its autopilot's messages tell; empty if it did not."""
        agent, vehicle = self.agents.get(drone), self.heard_vehicle(drone, now_s)
        told = agent.state.crash if agent is not None and agent.state is not None else ""
        if told or vehicle is None or not vehicle.crash:
            return told
        if vehicle.position_ned_m is None or self.frame is None:
            return f"{vehicle.crash}; it is not known where"
        place = self.frame.to_geodetic(vehicle.position_ned_m)
        return f"{vehicle.crash}, at {place.latitude_deg:.6f}, {place.longitude_deg:.6f}"

    def agent(self, drone: int) -> HeardAgent:
        agent = self.agents.get(drone)
        if agent is None:
            agent = self.agents[drone] = HeardAgent(drone)
        return agent

    def vehicle(self, drone: int) -> Component | None:
        return self.vehicles.autopilot(drone)

    def heard_vehicle(self, drone: int, now_s: float) -> HeardVehicle | None:
        """The vehicle as heard over MAVLink here, else as the running ground station reports it."""
        component = self.vehicle(drone)
        if component is not None:
            return HeardVehicle(
                drone,
                component.mode,
                component.armed,
                component.airborne(now_s),
                component.position_ned_m,
                component.velocity_ned_mps,
                component.home_ned_m,
                component.battery_fraction,
                component.age_s(now_s),
                component.crash,
            )
        if self.report is None or self.report_s is None:
            return None
        if self.frame is not None and self.report.frame != self.frame.identity:
            return None
        for vehicle in self.report.vehicles:
            if vehicle.drone == drone:
                return msgspec.structs.replace(vehicle, age_s=vehicle.age_s + now_s - self.report_s)
        return None

    # -- messages ------------------------------------------------------------------------------------------

    def receive_mavlink(self, now_s: float, link: int, message: MavlinkMessage) -> Component:
        component = self.vehicles.receive(now_s, link, message)
        agent = self.agents.get(component.source.system)
        if agent is not None and component.role is Role.AUTOPILOT and not component.armed:
            agent.flown = False
        return component

    def receive_peer(self, now_s: float, received: Received) -> Message | None:
        """Take one message of the swarm; returns it, None where it is not to be believed."""
        message = self._admission.admit(received)
        if isinstance(message, Refusal):
            shown = self._shown(message)
            if shown is None:
                self._refused(now_s, printable(received.sender), message)
                return None
            message = shown
        match message:
            case DroneState():
                self.agent(message.sender).receive_state(now_s, message)
            case TableState():
                agent = self.agent(message.sender)
                if agent.incarnations.speaks(message.incarnation):
                    agent.table, agent.table_s = message, now_s
            case Event():
                self.events.append((now_s, message))
            case Command():
                self._command(now_s, message)
            case CommandOutcome():
                asked = self.asked.get(message.command)
                if asked is not None:
                    asked.outcomes[message.sender] = message
                    asked.waiting_for.discard(message.sender)
            case GroundReport():
                self.report, self.report_s = message, now_s
        return message

    def _shown(self, refusal: Refusal) -> DroneState | None:
        """The state of a drone that no member of the swarm believes, for it is of another swarm or in another frame:
        a person must see that it is there, and what is wrong with it."""
        foreign = refusal.kind in (RefusalKind.STRANGER, RefusalKind.FOREIGN_FRAME)
        state = refusal.message if foreign else None
        return state if isinstance(state, DroneState) and state.sender in ANYBODY else None

    def _refused(self, now_s: float, sender: str, refusal: Refusal) -> None:
        """Remember for an alarm what a node says wrong; of strangers and foreign frames their states tell already,
        and what was heard before is nothing wrong."""
        if refusal.kind in (RefusalKind.STRANGER, RefusalKind.FOREIGN_FRAME, RefusalKind.REPEATED):
            return
        before = self.garbled.pop(sender, None)
        self.garbled[sender] = Garbled(before.count + 1 if before else 1, refusal.reason, now_s)
        while len(self.garbled) > _SENDERS_KEPT:
            del self.garbled[next(iter(self.garbled))]

    def _command(self, now_s: float, command: Command) -> None:
        if command.identity in self.asked:
            return
        addressed = self.drones(now_s) if command.target == 0 else [command.target]
        live = {d for d in addressed if self.is_member(d) and self.agent_live(d, now_s)}
        self.asked[command.identity] = Asked(command, now_s, live)
        while len(self.asked) > _COMMANDS_KEPT:
            del self.asked[next(iter(self.asked))]

    # -- questions -----------------------------------------------------------------------------------------

    def agent_live(self, drone: int, now_s: float) -> bool:
        """Whether the agent's state is fresh by the topic's own staleness limit."""
        agent = self.agents.get(drone)
        stale_s = topics.STATE.stale_s
        return agent is not None and stale_s is not None and agent.age_s(now_s) <= stale_s

    def witnesses(self, drone: int, now_s: float) -> list[HeardAgent]:
        """The other agents whose tables count `drone` in: they hear it, whatever we do."""
        return [a for a, counted_in in self._countings(drone, now_s) if counted_in]

    def missed(self, drone: int, now_s: float) -> bool:
        """Whether the table of another agent does not count `drone` in: that one may not hear it."""
        return not all(counted_in for _, counted_in in self._countings(drone, now_s))

    def _countings(self, drone: int, now_s: float) -> Iterator[tuple[HeardAgent, bool]]:
        """The other live agents that have told a table, and whether each counts `drone` in."""
        for agent in self.agents.values():
            table, table_s = agent.table, agent.table_s
            if agent.drone == drone or table is None or table_s is None:
                continue
            if self.agent_live(agent.drone, now_s) and now_s - table_s <= (topics.TABLE.stale_s or 0.0):
                yield agent, drone in table.held

    def frame_matches(self, drone: int) -> bool:
        """Whether the drone's positions are in our frame (or nothing speaks against it)."""
        agent = self.agents.get(drone)
        if agent is None or agent.state is None or self.frame is None:
            return True
        return agent.state.frame == self.frame.identity

    def newest(self, drone: int, now_s: float) -> DroneState | HeardVehicle | None:
        """Who speaks for the drone: its agent while it is live, else the fresher of agent and autopilot."""
        agent = self.agents.get(drone)
        state = agent.state if agent is not None else None
        vehicle = self.heard_vehicle(drone, now_s)
        if agent is None or state is None or vehicle is None:
            return state or vehicle
        return state if self.agent_live(drone, now_s) or agent.age_s(now_s) <= vehicle.age_s else vehicle

    def position_ned_m(self, drone: int, now_s: float) -> Vector3 | None:
        """Where the drone was last known to be, in our frame."""
        newest = self.newest(drone, now_s)
        if newest is None or (isinstance(newest, DroneState) and not self.frame_matches(drone)):
            return None
        return newest.position_ned_m

    def flying(self, drone: int, now_s: float) -> bool:
        """Whether the drone is in the air, as far as anybody last said."""
        newest = self.newest(drone, now_s)
        return newest is not None and newest.airborne and not self.crash(drone, now_s)

    def rows(self, now_s: float) -> list[DroneRow]:
        """The whole fleet, one row a drone, for displays and programs."""
        return [self._row(drone, now_s) for drone in self.drones(now_s)]

    def _row(self, drone: int, now_s: float) -> DroneRow:
        agent = self.agents.get(drone) or HeardAgent(drone)
        state, vehicle, newest = agent.state, self.heard_vehicle(drone, now_s), self.newest(drone, now_s)
        position_ned_m = self.position_ned_m(drone, now_s)
        geodetic = None
        if position_ned_m is not None and self.frame is not None:
            geodetic = self.frame.to_geodetic(position_ned_m)
        above_home_m = None
        if newest is not None and newest.position_ned_m is not None and newest.home_ned_m is not None:
            above_home_m = newest.home_ned_m[2] - newest.position_ned_m[2]
        live = self.agent_live(drone, now_s)
        wind = state.wind if state is not None and live else None
        excess = state.excess_co2_ppm if state is not None and live else None
        return DroneRow(
            drone=drone,
            member=drone in self.members,
            agent=_health(agent.age_s(now_s), live),
            agent_age_s=_finite(agent.age_s(now_s)),
            vehicle=_health(vehicle.age_s, vehicle.age_s <= HEARTBEAT_LOST_S) if vehicle else "never",
            vehicle_age_s=_finite(vehicle.age_s) if vehicle else None,
            phase=str(state.phase) if state is not None else None,
            mode=newest.mode if newest is not None else None,
            armed=newest.armed if newest is not None else None,
            airborne=newest.airborne if newest is not None else None,
            latitude_deg=geodetic.latitude_deg if geodetic else None,
            longitude_deg=geodetic.longitude_deg if geodetic else None,
            amsl_m=geodetic.amsl_m if geodetic else None,
            position_ned_m=position_ned_m,
            above_home_m=above_home_m,
            co2_ppm=state.co2_ppm if state is not None and live else None,
            excess_co2_ppm=excess.mean if excess is not None else None,
            excess_co2_sd_ppm=math.sqrt(max(excess.variance, 0.0)) if excess is not None else None,
            best_excess_co2_ppm=state.tracking_best_ppm if state is not None else None,
            wind_mps=math.hypot(*wind.wind_ned_mps[:2]) if wind is not None else None,
            wind_from_deg=_from_deg(wind.wind_ned_mps) if wind is not None else None,
            battery_fraction=newest.battery_fraction if newest is not None else None,
            epoch=state.epoch if state is not None else None,
            slot=state.slot if state is not None else None,
            parent=state.parent if state is not None else None,
            healing=state.healing if state is not None else False,
            crash=self.crash(drone, now_s),
            heals=agent.table.heals if agent.table is not None else 0,
            restarts=agent.incarnations.restarts,
            late_tick_fraction=agent.late_fraction(),
            frame_matches=self.frame_matches(drone),
            notes=state.notes if state is not None and live else (),
            storage=state.storage if state is not None and live else "",
        )


def _health(age_s: float, live: bool) -> Health:
    if live:
        return "live"
    return "never" if math.isinf(age_s) else "silent"


def _finite(age_s: float) -> float | None:
    return None if math.isinf(age_s) else age_s


def _from_deg(wind_ned_mps: Vector3) -> float:
    """Where the air comes from, degrees clockwise from north, as forecasts say it."""
    return math.degrees(math.atan2(-wind_ned_mps[1], -wind_ned_mps[0])) % 360.0
