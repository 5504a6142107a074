"""What a ground station does for vehicles whose agents are silent: it brings them home by MAVLink."""

from __future__ import annotations

from typing import Final

from flightstack.mavlink.modes import Duty, Flavour, mode_of
from simvehicle.scenario.swarm import Scenario

GRACE_S: Final = 5.0
"""Silence of an agent after which its vehicle is brought home: a ground station's default, `orphans.grace_s`."""
ALL_SILENT_GRACE_S: Final = 30.0
"""The same when every agent is silent: its default for `orphans.all_silent_grace_s`."""


class GroundKeeper:
    """`step` once a tick; gives the drones that are sent home in it."""

    def __init__(self, flight: Scenario) -> None:
        self._flight = flight
        self._newest: dict[int, tuple[float, tuple[int, int]]] = {}
        """Drone -> when its newest state came, and which that was."""
        self._sent: set[int] = set()

    def step(self) -> list[int]:
        flight = self._flight
        for drone, state in flight.states.items():
            which = (state.incarnation, state.sequence)
            if drone not in self._newest or self._newest[drone][1] != which:
                self._newest[drone] = (flight.now_s, which)
                self._sent.discard(drone)
        silent_s = {drone: flight.now_s - heard_s for drone, (heard_s, _) in self._newest.items()}
        grace_s = GRACE_S if min(silent_s.values(), default=0.0) <= GRACE_S else ALL_SILENT_GRACE_S
        sent = [
            drone
            for drone, since_s in silent_s.items()
            if since_s > grace_s
            and drone not in self._sent
            and flight.members[drone].vehicle.controllable
            and flight.members[drone].vehicle.armed
            and not flight.members[drone].vehicle.silent
        ]
        for drone in sent:
            vehicle = flight.members[drone].vehicle
            vehicle.switch_mode(mode_of(Flavour(vehicle.spec.flavour), Duty.RETURN))
        self._sent.update(sent)
        return sent
