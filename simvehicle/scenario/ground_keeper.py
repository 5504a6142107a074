"""What a ground station does for vehicles that nobody flies: it brings them home by MAVLink.

The rules are those of `gcs.fleet.orphans`, on what a ground station hears: states over the radio, vehicles and the
heartbeats of their agents over MAVLink, which no fault of the radio touches.
"""

from __future__ import annotations

from typing import Final

from flightstack.mavlink.modes import Duty, Flavour, mode_name, mode_of
from flightstack.swarm import topics
from flightstack.swarm.incarnations import FLYING_PHASES
from flightstack.swarm.wire import DroneState, Phase
from mission.geometry.ways_home import WayHome, in_the_way
from simvehicle.scenario.swarm import Member, Scenario

GRACE_S: Final = 5.0
"""Silence of an agent after which its vehicle is brought home: a ground station's default, `orphans.grace_s`."""
ALL_SILENT_GRACE_S: Final = 30.0
"""The same when every agent is silent: its default for `orphans.all_silent_grace_s`."""
APART_M: Final = 5.0
"""Its default for `orphans.apart_m`."""
LONGEST_WAIT_S: Final = 300.0
"""Its default for `orphans.longest_wait_s`."""


class GroundKeeper:
    """`step` once a tick; gives the drones that are sent home in it."""

    def __init__(self, flight: Scenario) -> None:
        self._flight = flight
        self._heard: dict[int, tuple[float, int, int]] = {}
        """Drone -> when its newest state came, and which that was: incarnation, sequence."""
        self._flown: dict[int, tuple[float, DroneState]] = {}
        """Vehicles that an agent has in the air, or had: when it said so last, and what it said."""
        self._due_s: dict[int, float] = {}
        """Since when a vehicle is to be brought home."""
        self.sent: set[int] = set()
        """The vehicles that come home because they were sent."""

    def step(self) -> list[int]:
        self._listen()
        now_s, members, silent_s = self._flight.now_s, self._flight.members, self._silent_s()
        for drone in self._due_s.keys() - silent_s.keys():
            del self._due_s[drone]
        for drone, (since_s, grace_s) in silent_s.items():
            if since_s > grace_s:
                self._due_s.setdefault(drone, now_s)
        self.sent = {drone for drone in self.sent if members[drone].vehicle.armed and drone not in silent_s}
        late = {drone for drone, due_s in self._due_s.items() if now_s - due_s > LONGEST_WAIT_S}
        held = self._held(silent_s.keys() - late)
        sent = sorted(drone for drone in self._due_s if drone not in held)
        for drone in sent:
            members[drone].vehicle.switch_mode(_mode(members[drone], Duty.RETURN))
        self.sent.update(sent)
        return sent

    def _held(self, waiting: set[int]) -> set[int]:
        """Those that have to wait for others."""
        ways = {
            drone: WayHome(member.vehicle.position_ned_m, member.vehicle.spec.home_ned_m)
            for drone, member in self._flight.members.items()
            if member.vehicle.controllable
        }
        on_their_way = {drone: way for drone, way in ways.items() if returns(self._flight.members[drone])}
        later = waiting - self._due_s.keys()
        return {*in_the_way({d: ways[d] for d in waiting}, on_their_way, APART_M, later=later)}

    def _listen(self) -> None:
        flight = self._flight
        for drone, state in flight.states.items():
            if self._heard.get(drone, (0.0, 0, 0))[1:] != (state.incarnation, state.sequence):
                self._heard[drone] = (flight.now_s, state.incarnation, state.sequence)
                if state.phase in FLYING_PHASES and (state.airborne or state.phase is Phase.TAKEOFF):
                    self._flown[drone] = (flight.now_s, state)
            if not flight.members[drone].vehicle.armed:
                self._flown.pop(drone, None)

    def _silent_s(self) -> dict[int, tuple[float, float]]:
        """The vehicles in the air that nobody flies: for how long, and the grace until they are brought home."""
        flight = self._flight
        found = {}
        for drone, (flown_s, flown) in self._flown.items():
            member, state, silence_s = flight.members[drone], flight.states[drone], flight.now_s - flown_s
            if member.vehicle.silent or not member.vehicle.controllable:
                continue
            if self._speaks(drone):
                flies = state.phase in FLYING_PHASES or state.incarnation == flown.incarnation
                if flies and state.phase not in (Phase.DISARMED, Phase.LANDED):
                    continue
            elif member.runs:
                continue  # the autopilot hands on its heartbeats
            alone = not any(self._speaks(other) for other in self._heard if other != drone)
            grace_s = ALL_SILENT_GRACE_S if alone and len(flight.members) > 1 else GRACE_S
            if _is_unattended(member, flown.phase):
                found[drone] = (silence_s, grace_s)
        return found

    def _speaks(self, drone: int) -> bool:
        return self._flight.now_s - self._heard[drone][0] <= (topics.STATE.stale_s or 0.0)


def returns(member: Member) -> bool:
    """Whether its autopilot brings the vehicle home."""
    return member.vehicle.custom_mode == _mode(member, Duty.RETURN)


def _mode(member: Member, duty: Duty) -> int:
    return mode_of(Flavour(member.vehicle.spec.flavour), duty)


def _is_unattended(member: Member, phase: Phase) -> bool:
    """Whether the vehicle is where its agent left it: in its mode, or in PX4's own hold or take-off."""
    mode = member.vehicle.custom_mode
    if Flavour(member.vehicle.spec.flavour) is not Flavour.PX4 or mode == _mode(member, Duty.CONTROL):
        return mode == _mode(member, Duty.CONTROL)
    taking_off = phase is Phase.TAKEOFF and mode_name(Flavour.PX4, mode) == "TAKEOFF"
    return taking_off or mode == _mode(member, Duty.HOLD)
