"""Answering for the silent: the operator's "bring it down" reaches a vehicle whose agent cannot hear it.

Commands of a survey go to agents. When an agent is silent and its vehicle is heard over MAVLink, the ground
station carries out abort, rtl and land itself and answers in the drone's name, saying so.
"""

from __future__ import annotations

import msgspec

from flightstack.mavlink.modes import Duty
from flightstack.mavlink.vehicle_state import HEARTBEAT_LOST_S
from flightstack.swarm.wire import Command, CommandName, CommandOutcome, Result
from gcs.fleet.orphans import OrphanKeeper
from gcs.fleet.vehicles import Component
from gcs.fleet.view import FleetView

DUTIES = {
    CommandName.ABORT: Duty.RETURN,
    CommandName.RTL: Duty.RETURN,
    CommandName.LAND: Duty.LAND,
}
GIVE_UP_S = 4.0
"""Before the 5 s that `gcs survey` waits by default: an answer that comes too late is none."""
FINDING_S = 5.0
"""How long a new station waits for agents to be found by the network before it takes them as silent."""
_KEPT = 64


class _Errand(msgspec.Struct):
    drone: int
    duty: Duty
    since_s: float
    outcome: CommandOutcome | None = None
    said: bool = False


class CommandProxy:
    def __init__(self, agent_silent_s: float) -> None:
        self._agent_silent_s = agent_silent_s
        self._errands: dict[tuple[str, int], _Errand] = {}

    def receive(self, now_s: float, command: Command, fleet: FleetView, keeper: OrphanKeeper) -> None:
        """Take a command from the air; one heard again is answered again."""
        duty = DUTIES.get(command.name)
        if duty is None or now_s - fleet.started_s < FINDING_S:
            return
        for drone in fleet.members if command.target == 0 else (command.target,):
            errand = self._errands.get((command.identity, drone))
            if errand is not None:
                errand.said = False
                continue
            vehicle = fleet.vehicle(drone)
            if vehicle is None or vehicle.age_s(now_s) > HEARTBEAT_LOST_S or self._hears(now_s, fleet, drone):
                continue
            errand = _Errand(drone, duty, now_s)
            obeyed = _obeyed_already(vehicle)
            reason = "it is no member of this swarm: the ground station does not command it"
            if fleet.is_member(drone):
                reason = _reason_against(now_s, vehicle, duty, named=command.target != 0)
            if fleet.is_member(drone) and obeyed:
                errand.outcome = CommandOutcome(command.identity, drone, Result.ACCEPTED, obeyed)
            elif reason:
                errand.outcome = CommandOutcome(command.identity, drone, Result.REFUSED, reason)
            elif not vehicle.in_mode(duty):
                keeper.command(now_s, drone, duty)
            self._errands[command.identity, drone] = errand
            while len(self._errands) > _KEPT:
                del self._errands[next(iter(self._errands))]

    def step(self, now_s: float, fleet: FleetView) -> list[CommandOutcome]:
        """The outcomes to publish now."""
        outcomes = []
        for (identity, drone), errand in self._errands.items():
            if errand.outcome is None:
                errand.outcome = _result(now_s, identity, errand, fleet.vehicle(drone))
            if errand.outcome is not None and not errand.said:
                errand.said = True
                outcomes.append(errand.outcome)
        return outcomes

    def _hears(self, now_s: float, fleet: FleetView, drone: int) -> bool:
        agent = fleet.agents.get(drone)
        return agent is not None and agent.age_s(now_s) <= self._agent_silent_s


def _obeyed_already(vehicle: Component) -> str:
    """Why the vehicle needs no bringing down, as its agent would answer; empty where it does."""
    if vehicle.crash:
        return "its agent is silent and its vehicle has crashed"
    return "" if vehicle.armed else "its agent is silent and its vehicle is on the ground, disarmed"


def _reason_against(now_s: float, vehicle: Component, duty: Duty, *, named: bool) -> str:
    """Why the ground station does not take this vehicle; empty when it does."""
    if not vehicle.airborne(now_s):
        return "its agent is silent and its vehicle is on the ground, armed"
    if named or vehicle.in_mode(Duty.CONTROL) or vehicle.in_mode(duty):
        return ""
    return (
        f"its agent is silent and its vehicle is in {vehicle.mode}, which is not the agent's mode: "
        f"command it with --drone {vehicle.source.system} if nobody flies it"
    )


def _result(now_s: float, identity: str, errand: _Errand, vehicle: Component | None) -> CommandOutcome | None:
    if vehicle is not None and vehicle.in_mode(errand.duty):
        reason = f"by the ground station over MAVLink, its agent is silent; mode {vehicle.mode}"
        return CommandOutcome(identity, errand.drone, Result.ACCEPTED, reason)
    if now_s - errand.since_s > GIVE_UP_S:
        reason = "its agent is silent and its autopilot does not change its mode; still trying"
        return CommandOutcome(identity, errand.drone, Result.REFUSED, reason)
    return None
