"""The failure monitor: what an operator must know about, now.

Pure. Each look at the fleet gives conditions; a condition has to stand for a while before it becomes an alarm and
to be gone for a while before the alarm ends, so that a flickering radio does not make a flickering display.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import NamedTuple

import msgspec

from flightstack.swarm.wire import DroneState, GroundAlarm, HeardVehicle, Phase, Severity
from gcs.fleet.agents import HeardAgent
from gcs.fleet.view import FleetView
from gcs.station_config import AlarmLimits
from mission.geometry.geofence import LocalFence

CLEAR_AFTER_S = 2.0
UNFLOWN_AFTER_S = 3.0
NEVER_HEARD_AFTER_S = 5.0
"""A station that starts in mid-flight hears the vehicles before the swarm's network has found it."""
BATTERY_HYSTERESIS_FRACTION = 0.03
CEILING_HYSTERESIS_M = 0.5
ANSWER_DUE_S = 5.0
"""A command that a live drone has not answered by then is lost."""
ANSWER_SHOWN_S = 30.0
GARBLED_SHOWN_S = 10.0
RIVAL_SHOWN_S = 3.0
"""Ground stations speak once a second."""
_INSTRUMENT = re.compile(r"[^:]+: (silent|warming|zeroing|error)\b|(CO2|wind) estimate: ")
"""Agents' notes on instruments: "NAME: STATE, reason", and on what is estimated from them. Other notes tell what
the guard or the autopilot holds up, and are no alarm."""
_RANK = {Severity.CRITICAL: 0, Severity.WARNING: 1, Severity.INFO: 2}


class Alarm(msgspec.Struct, frozen=True):
    severity: Severity
    drone: int
    """0: the ground station itself, or nobody in particular."""
    code: str
    text: str
    since_s: float
    """When it began, on the ground station's clock."""


ENDS = {
    "absent": "its agent is heard",
    "agent_silent": "its agent is heard again",
    "vehicle_silent": "its autopilot is heard over MAVLink again",
    "foreign": "this vehicle, no member of the swarm, flies no more or is out of hearing",
    "orphan": "its vehicle does not fly without an agent any more",
    "lost": "it is heard again",
    "frame": "its origin is ours again",
    "unflown": "it does not fly without its agent any more",
    "identity": "one agent alone has its number again",
    "late_ticks": "its ticks are in time again",
    "position": "it knows where it is again, or is disarmed",
    "sensor": "nothing is amiss with its instruments any more",
    "fence": "it is inside the geofence again, or on the ground",
    "ceiling": "it is below the ceiling again, or on the ground",
    "battery": "its battery is above the limit again",
    "wire": "no more unreadable messages",
    "recording": "its flight is recorded again",
    "station": "no second ground station of our name or MAVLink system id is heard any more",
    "crash": "its vehicle flies on, or was armed or restarted after the crash",
    "astray": "it goes where it is sent again, or is not steered any more",
    "no_ack": "the missing answer has come, or is not waited for any more",
}
"""What an alarm's end is told as, by its code up to a colon."""


def ended(alarm: Alarm) -> str:
    """The end of an alarm in words: what is the case now, not what was."""
    return ENDS.get(alarm.code.partition(":")[0], f"not so any more: {alarm.text}")


class Condition(NamedTuple):
    """Something that holds in this moment."""

    code: str
    severity: Severity
    text: str
    after_s: float = 0.0
    """How long it must stand before it becomes an alarm."""


class Changes(NamedTuple):
    raised: tuple[Alarm, ...]
    """New alarms, and those that became more severe than they had been."""
    cleared: tuple[Alarm, ...]


class _Standing(msgspec.Struct):
    since_s: float
    seen_s: float
    condition: Condition
    alarmed: bool
    told: Severity
    """The worst that it has been raised with."""


class Monitor:
    """Looks at the fleet once a tick and keeps the alarms. Only `patience` 0 judges at first sight."""

    def __init__(
        self,
        limits: AlarmLimits,
        fence: LocalFence | None = None,
        *,
        patience: float = 1.0,
    ) -> None:
        self._limits = limits
        self._fence = fence
        self._patience = patience
        self._standing: dict[tuple[int, str], _Standing] = {}

    @property
    def alarms(self) -> list[Alarm]:
        """What stands, worst first."""
        standing = [
            Alarm(s.condition.severity, drone, code, s.condition.text, s.since_s)
            for (drone, code), s in self._standing.items()
            if s.alarmed
        ]
        return sorted(standing, key=lambda alarm: (_RANK[alarm.severity], alarm.drone, alarm.code))

    def step(self, now_s: float, fleet: FleetView) -> Changes:
        raised: list[Alarm] = []
        cleared: list[Alarm] = []
        for drone, condition in self._look(now_s, fleet):
            key = (drone, condition.code)
            standing = self._standing.get(key)
            if standing is None:
                standing = self._standing[key] = _Standing(
                    now_s, now_s, condition, alarmed=False, told=condition.severity
                )
            worse = standing.alarmed and _RANK[condition.severity] < _RANK[standing.told]
            standing.seen_s, standing.condition = now_s, condition
            due = not standing.alarmed and now_s - standing.since_s >= condition.after_s * self._patience
            if due or worse:
                standing.alarmed, standing.told = True, condition.severity
                raised.append(_alarm(drone, standing))
        for key, standing in list(self._standing.items()):
            gone_s = now_s - standing.seen_s
            if gone_s > 0.0 and (not standing.alarmed or gone_s >= CLEAR_AFTER_S):
                del self._standing[key]
                if standing.alarmed:
                    cleared.append(_alarm(key[0], standing))
        return Changes(tuple(raised), tuple(cleared))

    def _stands(self, drone: int, code: str) -> bool:
        standing = self._standing.get((drone, code))
        return standing is not None and standing.alarmed

    # -- conditions ----------------------------------------------------------------------------------------

    def _look(self, now_s: float, fleet: FleetView) -> Iterator[tuple[int, Condition]]:
        for drone in fleet.drones(now_s):
            agent = fleet.agents.get(drone) or HeardAgent(drone)
            vehicle = fleet.heard_vehicle(drone, now_s)
            if not fleet.is_member(drone):
                for condition in self._foreign(now_s, fleet, drone, vehicle):
                    yield drone, condition
                continue
            for condition in _twins(now_s, fleet, agent):
                yield drone, condition
            for condition in self._silence(now_s, fleet, agent, vehicle):
                yield drone, condition
            if agent.state is not None and fleet.agent_live(drone, now_s):
                for condition in self._agent(fleet, agent, agent.state, vehicle):
                    yield drone, condition
            crash = fleet.crash(drone, now_s)
            newest = fleet.newest(drone, now_s)
            if crash:
                armed = (
                    "; still armed, its propellers may turn" if newest is not None and newest.armed else ""
                )
                yield drone, Condition("crash", Severity.CRITICAL, f"crashed: {crash}{armed}")
            if newest is not None:
                for condition in self._flight(now_s, fleet, drone, newest):
                    yield drone, condition
        yield from self._network(now_s, fleet)

    @staticmethod
    def _network(now_s: float, fleet: FleetView) -> Iterator[tuple[int, Condition]]:
        """What is wrong between nodes: no answers, messages that cannot be read, ground stations in our name."""
        for identity, asked in fleet.asked.items():
            age_s = now_s - asked.time_s
            if ANSWER_DUE_S <= age_s <= ANSWER_SHOWN_S:
                for drone in asked.waiting_for:
                    text = f"no answer to {asked.command.name} from {asked.command.sender}"
                    yield drone, Condition(f"no_ack:{identity[:8]}", Severity.WARNING, text)
        if fleet.storage:
            yield 0, Condition("recording", Severity.WARNING, f"the ground station's {fleet.storage}")
        for same, (text, heard_s) in fleet.rivals.items():
            if now_s - heard_s <= RIVAL_SHOWN_S:
                yield 0, Condition(f"station:{same}", Severity.WARNING, text, RIVAL_SHOWN_S)
        for sender, garbled in fleet.garbled.items():
            if now_s - garbled.time_s <= GARBLED_SHOWN_S:
                drone = int(sender) if sender.isdecimal() else 0
                text = f"{garbled.count} unreadable messages from node {sender}: {garbled.text}"
                yield drone, Condition("wire", Severity.WARNING, text)

    def _foreign(
        self, now_s: float, fleet: FleetView, drone: int, vehicle: HeardVehicle | None
    ) -> Iterator[Condition]:
        """Who is not ours is told of while it is heard, and is nobody's loss when it is gone."""
        if fleet.agent_live(drone, now_s):
            text = (
                "an agent of this swarm, but no member of it: another survey's, or missing in swarm.members"
            )
            yield Condition("foreign", Severity.WARNING, text)
        elif vehicle is not None and vehicle.age_s <= self._limits.vehicle_silent_s:
            does = f"flies in {vehicle.mode}" if vehicle.airborne else "is on the ground"
            lacks = "is no member of this swarm" if fleet.members else "no agent of it is heard"
            yield Condition("foreign", Severity.INFO, f"{does}, but {lacks}")

    def _silence(
        self, now_s: float, fleet: FleetView, agent: HeardAgent, vehicle: HeardVehicle | None
    ) -> Iterator[Condition]:
        agent_age_s = agent.age_s(now_s)
        agent_silent = agent_age_s > self._limits.agent_silent_s
        vehicle_age_s = vehicle.age_s if vehicle is not None else math.inf
        vehicle_silent = vehicle_age_s > self._limits.vehicle_silent_s
        flying = fleet.flying(agent.drone, now_s)
        if not agent_silent:
            if vehicle is not None and vehicle_silent:
                text = f"autopilot not heard over MAVLink for {_age(vehicle_age_s)}; its agent is alive"
                yield Condition("vehicle_silent", Severity.WARNING, text)
            return
        if math.isinf(agent_age_s) and (vehicle is None or not flying):
            if agent.drone in fleet.members:
                text = f"no agent heard{why_unheard(now_s, fleet, agent.drone)}"
                yield Condition("absent", Severity.WARNING, text, self._limits.absent_s)
            return
        silent = "no agent heard" if math.isinf(agent_age_s) else f"agent silent for {_age(agent_age_s)}"
        if vehicle is not None and not vehicle_silent:
            if flying:
                text = f"{silent}, its vehicle flies on in {vehicle.mode}"
                finding_s = NEVER_HEARD_AFTER_S if math.isinf(agent_age_s) else 0.0
                yield Condition("orphan", Severity.CRITICAL, text, finding_s)
            else:
                yield Condition("agent_silent", Severity.WARNING, f"{silent}; vehicle on the ground")
        elif flying:
            where = "" if vehicle is None else f", autopilot for {_age(vehicle_age_s)}"
            yield Condition("lost", Severity.CRITICAL, f"{silent}{where}; it was flying")
        else:
            phase = f"; it was {agent.state.phase}" if agent.state is not None else ""
            yield Condition("agent_silent", Severity.INFO, f"{silent}{phase}")

    def _agent(
        self,
        fleet: FleetView,
        agent: HeardAgent,
        state: DroneState,
        vehicle: HeardVehicle | None,
    ) -> Iterator[Condition]:
        if not fleet.frame_matches(agent.drone):
            text = "its origin is not ours, so its positions are not shown: give all files the same origin"
            yield Condition("frame", Severity.CRITICAL, text)
        airborne = state.airborne or (vehicle is not None and vehicle.airborne)
        if airborne and state.phase in (Phase.DISARMED, Phase.LANDED):
            text = f"flies in {state.mode} without its agent, which holds it for {state.phase}"
            yield Condition("unflown", Severity.CRITICAL, text, UNFLOWN_AFTER_S)
        late = agent.late_fraction()
        if late > self._limits.late_ticks_fraction:
            text = f"{late:.0%} of its ticks are late: its computer is overloaded"
            yield Condition("late_ticks", Severity.WARNING, text, 2.0)
        if state.astray:
            yield Condition("astray", Severity.CRITICAL, state.astray)
        if state.armed and state.position_ned_m is None:
            yield Condition("position", Severity.CRITICAL, "armed, but it does not know where it is", 1.0)
        if state.storage:
            yield Condition("recording", Severity.WARNING, state.storage)
        trouble = [note for note in state.notes if _INSTRUMENT.match(note)]
        if trouble:
            blind = state.armed and state.excess_co2_ppm is None
            severity = Severity.WARNING if blind else Severity.INFO
            yield Condition("sensor", severity, "; ".join(trouble), 1.0)

    def _flight(
        self, now_s: float, fleet: FleetView, drone: int, newest: DroneState | HeardVehicle
    ) -> Iterator[Condition]:
        if newest.battery_fraction is not None:
            condition = self._battery(drone, newest.battery_fraction, newest.mode, airborne=newest.airborne)
            if condition is not None:
                yield condition
        position_ned_m = fleet.position_ned_m(drone, now_s)
        if not newest.airborne or position_ned_m is None:
            return
        if self._fence is not None:
            clearance_m = self._fence.clearance_m(position_ned_m[0], position_ned_m[1])
            limit_m = self._limits.fence_tolerance_m if self._stands(drone, "fence") else 0.0
            if clearance_m < limit_m:
                text = f"{-clearance_m:.0f} m outside the geofence, mode {newest.mode}"
                if clearance_m >= 0.0:
                    text = f"at the geofence line after a breach, mode {newest.mode}"
                yield Condition("fence", Severity.CRITICAL, text)
        ceiling_m = self._limits.ceiling_above_home_m
        if ceiling_m is not None and newest.home_ned_m is not None:
            above_home_m = newest.home_ned_m[2] - position_ned_m[2]
            limit_m = ceiling_m - (CEILING_HYSTERESIS_M if self._stands(drone, "ceiling") else 0.0)
            if above_home_m > limit_m:
                text = f"{above_home_m:.0f} m above home, ceiling {ceiling_m:.0f} m, mode {newest.mode}"
                yield Condition("ceiling", Severity.CRITICAL, text, 0.5)

    def _battery(self, drone: int, fraction: float, mode: str, *, airborne: bool) -> Condition | None:
        limits = self._limits
        slack = BATTERY_HYSTERESIS_FRACTION if self._stands(drone, "battery") else 0.0
        if fraction > limits.battery_low_fraction + slack:
            return None
        severity = Severity.WARNING if airborne else Severity.INFO
        if airborne and fraction <= limits.battery_critical_fraction:
            severity = Severity.CRITICAL
        return Condition("battery", severity, f"battery at {fraction:.0%}, mode {mode}", 2.0)


def _twins(now_s: float, fleet: FleetView, agent: HeardAgent) -> Iterator[Condition]:
    """Two that use one number, while they do."""
    vehicle = fleet.vehicle(agent.drone)
    if agent.incarnations.has_twins(now_s):
        text = f"two agents call themselves drone {agent.drone}: stop one, or change its number"
        yield Condition("identity", Severity.CRITICAL, text)
    elif vehicle is not None and vehicle.is_contested(now_s):
        text = f"two autopilots speak as system {agent.drone}: every vehicle needs its own id"
        yield Condition("identity", Severity.CRITICAL, text)


def why_unheard(now_s: float, fleet: FleetView, drone: int) -> str:
    """How "no agent heard" goes on. Where others are heard the network itself works, and what is missing may be our
    own connection: nodes whose files list all endpoints do not tell of each other."""
    mend = "is its endpoint in our swarm.connect?"
    witnesses = fleet.witnesses(drone, now_s)
    if witnesses:
        return f" here, but drone {witnesses[0].drone} hears it: {mend}"
    return f", but others are: does it run, and {mend}" if fleet.agents else ""


def _alarm(drone: int, standing: _Standing) -> Alarm:
    condition = standing.condition
    return Alarm(condition.severity, drone, condition.code, condition.text, standing.since_s)


def _age(seconds: float) -> str:
    """An age as a person reads it."""
    if math.isinf(seconds):
        return "ever"
    if seconds < 10.0:
        return f"{seconds:.1f} s"
    return f"{seconds:.0f} s" if seconds < 120.0 else f"{seconds / 60.0:.0f} min"


def on_the_wire(alarms: list[Alarm], now_s: float) -> tuple[GroundAlarm, ...]:
    """The alarms as a ground station tells them to displays, with ages instead of times of its own clock."""
    return tuple(GroundAlarm(a.drone, a.severity, a.code, a.text, now_s - a.since_s) for a in alarms)
