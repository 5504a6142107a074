"""What no swarm can help: vehicles that others than it keep in the air, vehicles that do not know where they are, and
two whose autopilots bring them home at one time.

They are left out of what must hold, and the transcript tells of those that are in the air at the end.
"""

from __future__ import annotations

from typing import Final

from flightstack.flight.guard import SEPARATION_MARGIN_M
from flightstack.swarm.wire import TAKING_PART, Phase
from simvehicle.scenario.afflicted_swarm import AfflictedSwarm
from simvehicle.scenario.ground_keeper import GroundKeeper, returns
from simvehicle.scenario.swarm import Member, Scenario

ASTRAY_M: Final = SEPARATION_MARGIN_M
"""A vehicle whose autopilot is wrong about its place by more than the room that is kept for such errors keeps neither
apart nor inside a fence."""


def astray(member: Member) -> bool:
    return member.vehicle.position_error_m > ASTRAY_M


def kept_up(flight: Scenario, swarm: AfflictedSwarm, *, ground_brings_home: bool) -> dict[int, str]:
    """Drones that may stay in the air as things are now, with the reason.

    Who pauses a swarm keeps all of it up: those who did not hear it wait for those who did. Nobody but the operator
    makes a drone hold.
    """
    paused = any(member.runs and _phase(member) is Phase.HOLDING for member in flight.members.values())
    home = ground_brings_home and swarm.ground_here
    reasons: dict[int, str] = {}
    for drone, member in flight.members.items():
        if swarm.pilot_flies(drone):
            reasons[drone] = "a pilot has it"
        elif member.vehicle.silent:
            reasons[drone] = "nobody reaches its autopilot"
        elif not member.runs:
            if not home:
                reasons[drone] = "it has no agent, and no ground station brings it home"
        elif _phase(member) is Phase.DISARMED and member.vehicle.airborne:
            if not home:
                reasons[drone] = "its agent started in the air, and nobody has told it what to do"
        elif paused and _phase(member) in TAKING_PART:
            reasons[drone] = "the operator has paused the swarm"
    return reasons


class OwnReturns:
    """Autopilots that bring their vehicles home. They make way for nobody, so that of two at one time one may climb,
    or come down, on the other's way (docs/decisions/0015-apart-without-hearing.md). A ground station that sends one
    home waits for the others; what goes by itself, or by command, waits for nobody. `look` after every step."""

    def __init__(self, flight: Scenario, keeper: GroundKeeper | None) -> None:
        self._flight = flight
        self._keeper = keeper
        self._since_s: dict[int, float] = {}

    def look(self) -> None:
        for drone, member in self._flight.members.items():
            if member.vehicle.controllable and returns(member):
                self._since_s.setdefault(drone, self._flight.now_s)
            else:
                self._since_s.pop(drone, None)

    def meet_by_themselves(self, drones: tuple[int, ...]) -> bool:
        """Whether both are on such a way, and nobody has sent the later one."""
        if len(drones) < 2 or not self._since_s.keys() >= set(drones):
            return False
        later = max(drones, key=self._since_s.__getitem__)
        return self._keeper is None or later not in self._keeper.sent


def _phase(member: Member) -> Phase:
    return member.agent.phase.phase
