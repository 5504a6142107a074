"""What must hold in every tick of a swarm, whatever goes wrong. Each limit has a name, a unit and a reason."""

from __future__ import annotations

import itertools
import math
from typing import Final

from flightstack.agent import Outputs
from flightstack.mavlink.framing import FrameFinder
from flightstack.swarm import topics
from mission.geometry.formation import make_layout
from mission.geometry.geofence import LocalFence
from simvehicle.scenario.afflicted_swarm import AfflictedSwarm
from simvehicle.scenario.agreement import Agreement
from simvehicle.scenario.ground_keeper import GroundKeeper
from simvehicle.scenario.own_matters import OwnReturns, astray
from simvehicle.scenario.scenario_result import Violation
from simvehicle.scenario.swarm import Scenario
from simvehicle.world.obstacles import TOUCHES_M, Obstacles

HANDED_OVER_WITHIN_S: Final = 1.0
"""From the pilot's switch to the last setpoint: a heartbeat tells the mode once a second."""
_SETPOINTS: Final = frozenset({84, 86})
"""SET_POSITION_TARGET_LOCAL_NED and _GLOBAL_INT."""


class Invariants:
    """`hear` in every agent's tick and `look` after every step gather what is violated, each kind once for the same
    drones."""

    def __init__(self, flight: Scenario, swarm: AfflictedSwarm, keeper: GroundKeeper | None = None) -> None:
        self._flight = flight
        self._swarm = swarm
        self._returns = OwnReturns(flight, keeper)
        config = next(iter(flight.members.values())).config
        self._separation_m = config.limits.separation_m
        self._fence = LocalFence(flight.world.frame, config.geofence) if config.geofence else None
        layout = make_layout(config.formation.layout, config.formation.spacing_m)
        self.agreement = Agreement(flight, swarm, layout)
        self._found: dict[tuple[str, str], Violation] = {}
        self._let_pass: set[tuple[str, tuple[int, ...]]] = set()
        """Pairs that came too near, and drones that came outside or into an obstacle, when nobody
        could help it, and are so still."""

    @property
    def violations(self) -> tuple[Violation, ...]:
        return tuple(self._found.values())

    def violated(self, kind: str, who: str, text: str) -> None:
        if (kind, who) not in self._found:
            began_s = self._flight.first_takeoff_s or 0.0
            at_s = round(self._flight.now_s - began_s, 1)
            self._found[kind, who] = Violation(kind, at_s, f"{who}: {text}" if who else text)

    def hear(self, drone: int, said: Outputs) -> None:
        now_s = self._flight.now_s
        for name, payload in said.peers:
            if name == topics.OUTCOME.name:
                self._swarm.hear(topics.OUTCOME.codec.decode(payload))
        for problem in self.agreement.hear(drone, said):
            self.violated(*problem)
        for event in said.events:
            if event.code == "defect":
                self.violated("defect", f"drone {drone}", event.text)
        taken_s = self._swarm.pilots.get(drone)
        if (
            taken_s is not None
            and now_s - taken_s > HANDED_OVER_WITHIN_S
            and self._swarm.pilot_flies(drone)
            and any(frame.kind in _SETPOINTS for frame in FrameFinder().find(said.autopilot))
        ):
            self.violated("pilot", f"drone {drone}", "sends setpoints to a vehicle that its pilot flies")

    def look(self) -> None:
        self._returns.look()
        self._apart()
        self._inside()
        self._clear()
        for problem in self.agreement.problems_now():
            self.violated(*problem)

    def _apart(self) -> None:
        flying = [(d, m) for d, m in self._flight.members.items() if m.vehicle.controllable]
        for (a, one), (b, other) in itertools.combinations(flying, 2):
            apart_m = math.dist(one.vehicle.position_ned_m, other.vehicle.position_ned_m)
            if self._is_judged("separation", (a, b), apart_m < self._separation_m):
                text = f"{apart_m:.1f} m apart, {self._separation_m:g} m are configured"
                self.violated("separation", f"drones {a} and {b}", text)

    def _inside(self) -> None:
        for drone, member in self._flight.members.items() if self._fence else ():
            vehicle = member.vehicle
            if vehicle.controllable and drone not in self._swarm.pilots and self._fence:
                beyond_m = -self._fence.clearance_m(*vehicle.position_ned_m[:2])
                if self._is_judged("fence", (drone,), beyond_m > 0.0):
                    self.violated("fence", f"drone {drone}", f"{beyond_m:.1f} m outside the geofence")

    def _clear(self) -> None:
        obstacles = self._flight.world.obstacles
        for drone, member in self._flight.members.items() if isinstance(obstacles, Obstacles) else ():
            vehicle = member.vehicle
            if vehicle.controllable and drone not in self._swarm.pilots and isinstance(obstacles, Obstacles):
                clearance_m = obstacles.clearance_m(vehicle.position_ned_m)
                if self._is_judged("obstacle", (drone,), clearance_m < TOUCHES_M):
                    self.violated("obstacle", f"drone {drone}", f"{clearance_m:.1f} m from an obstacle")

    def _is_judged(self, kind: str, drones: tuple[int, ...], wrong: bool) -> bool:
        """Whether something is wrong, and not since nobody could help it."""
        if not wrong:
            self._let_pass.discard((kind, drones))
        elif self._returns.meet_by_themselves(drones) or any(
            astray(self._flight.members[drone]) for drone in drones
        ):
            self._let_pass.add((kind, drones))
        return wrong and (kind, drones) not in self._let_pass
