"""What must hold in every tick of a swarm of kinematic drones. Each limit has a name, a unit and a reason."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Final

from flightstack.swarm.membership import JOIN_S
from flightstack.swarm.table_calm import HEAL_LIMIT_S
from mission.tree.balanced_tree import problems
from simvehicle.scenario.kinematic_drone import TRANSFER_LIMIT_S, KinematicDrone
from simvehicle.scenario.kinematic_swarm import KinematicSwarm
from simvehicle.scenario.scenario_result import Violation

AGREED_WITHIN_S: Final = 10.0
"""Those who hear each other have one table so long after the last fault, or the last drone that came or went: 0.8 s
until a silent one is missed, 2 s for the objection of who hears it, 3 s each for two heirs that do not act, and the
words between at 30 % loss."""

SEARCHES_WITHIN_S: Final = 30.0
"""From one order of the root to the next: 10 s for the readings that are not coming, a step, a heal in between."""

SEPARATION_M: Final = 4.0


class TableInvariants:
    """`look` after every step gathers what is violated, each kind once for the same drones."""

    def __init__(self, swarm: KinematicSwarm) -> None:
        self._swarm = swarm
        self._changes = swarm.changes
        self._untroubled_s = 0.0
        self._parts: list[frozenset[int]] = []
        self._checked: dict[frozenset[int], tuple[int, ...]] = {}
        self._held_since_s: dict[int, float] = {}
        self._ordered: dict[int, tuple[int, float]] = {}
        """By root: the number of its newest order, and since when."""
        self._found: dict[tuple[str, str], Violation] = {}

    @property
    def violations(self) -> tuple[Violation, ...]:
        return tuple(self._found.values())

    def look(self) -> None:
        swarm = self._swarm
        now_s = swarm.now_s
        running = {d: m.drone for d, m in swarm.members.items() if m.runs and m.drone.takes_part}
        self._hold_ends(now_s, running)
        if swarm.changes != self._changes:
            self._changes, self._untroubled_s = swarm.changes, now_s
            self._parts = []
            self._ordered = {}
        if now_s - self._untroubled_s <= AGREED_WITHIN_S:
            return
        if not self._parts:
            self._parts = self._who_hear_each_other(running)
        for part in self._parts:
            drones = {drone: running[drone] for drone in part}
            if self._agreed(part, drones):
                self._searches(now_s, drones)
                self._apart(drones)

    def _violated(self, kind: str, who: str, text: str) -> None:
        if (kind, who) not in self._found:
            self._found[kind, who] = Violation(kind, round(self._swarm.now_s, 1), f"{who}: {text}")

    def _hold_ends(self, now_s: float, running: Mapping[int, KinematicDrone]) -> None:
        """Nobody is held up by a heal for ever."""
        for number, drone in running.items():
            if drone.place is None or not drone.place.healing:
                self._held_since_s.pop(number, None)
            elif now_s - self._held_since_s.setdefault(number, now_s) > HEAL_LIMIT_S + TRANSFER_LIMIT_S:
                self._violated("hold", f"drone {number}", "has held for a heal without end")

    def _who_hear_each_other(self, running: Mapping[int, KinematicDrone]) -> list[frozenset[int]]:
        """The groups that are connected both ways, over whatever hops, and by no one-way link to another."""
        hears = {
            d: {int(other) for other in self._swarm.radio.audible(str(d))} & running.keys() for d in running
        }
        reach = {drone: _reached(drone, hears) for drone in running}
        parts = {frozenset(other for other in reach[drone] if drone in reach[other]) for drone in running}
        return sorted(
            (
                part
                for part in parts
                if all(reach[drone] == part for drone in part) and _is_alone(part, hears)
            ),
            key=min,
        )

    def _agreed(self, part: frozenset[int], drones: Mapping[int, KinematicDrone]) -> bool:
        first = drones[min(part)]
        slots = first.table.slots
        for number, drone in drones.items():
            if drone.table.slots != slots:
                text = f"have two tables, {words(slots)} and {words(drone.table.slots)}"
                self._violated("agreement", f"drones {first.drone} and {number}", text)
                return False
            if drone.table.survey != first.table.survey:
                self._violated("agreement", f"drones {first.drone} and {number}", "fly two surveys")
                return False
        who = f"drones {' '.join(str(drone) for drone in sorted(part))}"
        if slots.keys() > part and self._waits_for_late_ones(part):
            return False
        if slots.keys() != part:
            self._violated("members", who, f"fly with the table {words(slots)}")
            return False
        for problem in problems(slots, self._swarm.layout):
            self._violated("tree", who, problem)
        for number, drone in drones.items():
            if drone.place is None or (drone.place.parent is None and drone.place.root != number):
                self._violated("heartbeat", f"drone {number}", "has nobody to tell that it lives")
        return True

    def _waits_for_late_ones(self, part: frozenset[int]) -> bool:
        """An agent that was started again gives members that it has never heard `JOIN_S` to come."""
        members = self._swarm.members
        return any(self._swarm.now_s - members[drone].up_at_s < JOIN_S + AGREED_WITHIN_S for drone in part)

    def _searches(self, now_s: float, drones: Mapping[int, KinematicDrone]) -> None:
        """The part goes on, be it one drone alone, and everybody follows."""
        root = next(d for d, slot in next(iter(drones.values())).table.slots.items() if slot == 0)
        order = drones[root].table.order
        sequence = order.sequence if order is not None else 0
        known = self._ordered.get(root)
        if known is None or known[0] != sequence:
            self._ordered[root] = sequence, now_s
        elif now_s - known[1] > SEARCHES_WITHIN_S:
            self._violated("search", f"drone {root}", f"is root and gives no order after its {sequence}th")
        for number, drone in drones.items():
            theirs = drone.table.order.sequence if drone.table.order is not None else 0
            if theirs < sequence - 2:
                text = f"follows order {theirs}, its root {root} has given {sequence}"
                self._violated("orders", f"drone {number}", text)

    def _apart(self, drones: Mapping[int, KinematicDrone]) -> None:
        """Those who do not change their slots fly in formation."""
        settled = [d for d in drones.values() if d.has_arrived and not (d.place and d.place.healing)]
        for one, other in itertools.combinations(settled, 2) if len(settled) == len(drones) else ():
            apart_m = math.dist(one.position_ned_m, other.position_ned_m)
            if apart_m < SEPARATION_M:
                text = f"{apart_m:.1f} m apart in formation"
                self._violated("separation", f"drones {one.drone} and {other.drone}", text)


def _reached(drone: int, hears: Mapping[int, set[int]]) -> frozenset[int]:
    """Whose words come to `drone`, over whatever hops; itself counted."""
    found = {drone}
    edge = [drone]
    while edge:
        new = hears[edge.pop()] - found
        found |= new
        edge += new
    return frozenset(found)


def _is_alone(part: frozenset[int], hears: Mapping[int, set[int]]) -> bool:
    """Whether nobody outside hears anybody in it."""
    return not any(hears[other] & part for other in hears.keys() - part)


def words(slots: Mapping[int, int]) -> str:
    """Who holds which slot: "1@0 4@1 2@2"."""
    return " ".join(f"{drone}@{slot}" for drone, slot in sorted(slots.items(), key=lambda held: held[1]))
