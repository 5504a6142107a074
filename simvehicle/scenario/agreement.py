"""What must hold between a swarm's agents: one table, a slot and a parent for everybody, a last one that goes on."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator, Mapping
from typing import Final

from flightstack.agent import Outputs
from flightstack.swarm.parting import GOES_HOME_BECAUSE
from flightstack.swarm.wire import TAKING_PART
from mission.geometry.formation import Layout
from mission.strategies.contract import TreePlace
from mission.tree.balanced_tree import problems
from simvehicle.scenario.afflicted_swarm import AfflictedSwarm
from simvehicle.scenario.swarm import GROUND, Scenario
from simvehicle.scenario.table_invariants import AGREED_WITHIN_S, words

HAS_A_SLOT_WITHIN_S: Final = 40.0
"""Who takes part has a slot so long after the last change: it may wait 30 s for a free one, and words get lost."""

Problem = tuple[str, str, str]
"""Kind of violation, drones, text."""


class Agreement:
    """`hear` in every agent's tick, `problems_now` after every step."""

    def __init__(self, flight: Scenario, swarm: AfflictedSwarm, layout: Layout) -> None:
        self._flight = flight
        self._swarm = swarm
        self._layout = layout
        self.places: dict[int, TreePlace] = {}
        """What every agent knows of the tree, by drone."""
        self._wrong: dict[int, list[str]] = {}
        """What is wrong with the trees that they know."""
        self._untroubled_s = 0.0
        self._audible: dict[int, frozenset[str]] = {}

    def hear(self, drone: int, said: Outputs) -> Iterator[Problem]:
        place, known = said.status.place, self.places.get(drone)
        if known is None or known.slots != place.slots:
            self._wrong[drone] = problems(dict(place.slots), self._layout)
        self.places[drone] = place
        for event in said.events:
            if event.code == "leaving" and GOES_HOME_BECAUSE in event.text and self._is_last(drone):
                yield "last", f"drone {drone}", "hears the ground station, is the last one and does not go on"

    def whole_table(self, drone: int) -> Mapping[int, int]:
        """Who holds which slot, as an agent knows it; empty while slots are empty that a heal has to fill."""
        return {} if self._wrong[drone] else self.places[drone].slots

    def problems_now(self) -> Iterator[Problem]:
        flight, places = self._flight, self.places
        taking_part = {d for d, m in flight.members.items() if m.runs and m.agent.phase.phase in TAKING_PART}
        audible = {drone: frozenset(flight.radio.audible(str(drone))) for drone in taking_part}
        if audible != self._audible or self._swarm.in_burst:
            self._audible, self._untroubled_s = audible, flight.now_s
        untroubled_s = flight.now_s - self._untroubled_s
        if untroubled_s <= AGREED_WITHIN_S:
            return
        for drone in taking_part & places.keys():
            place = places[drone]
            for problem in self._wrong[drone]:
                yield "table", f"drone {drone}", problem
            if place.slot > 0 and (place.parent is None or place.parent not in taking_part):
                yield "target", f"drone {drone}", f"has no parent that hears it, but {place.parent}"
            if place.slot < 0 and untroubled_s > HAS_A_SLOT_WITHIN_S:
                yield "slot", f"drone {drone}", "takes part without a slot"
        for a, b in _pairs(audible):
            one, other = places.get(a), places.get(b)
            if one is not None and other is not None and one.slots != other.slots:
                text = f"have two tables, {words(one.slots)} and {words(other.slots)}"
                yield "agreement", f"drones {a} and {b}", text

    def _is_last(self, drone: int) -> bool:
        """Whether no other agent runs, and the ground station, which tells who is down, is heard."""
        others = (member for other, member in self._flight.members.items() if other != drone)
        return not any(m.runs for m in others) and GROUND in self._flight.radio.audible(str(drone))


def _pairs(audible: Mapping[int, Collection[str]]) -> Iterator[tuple[int, int]]:
    """Who hear each other."""
    for a, b in itertools.combinations(sorted(audible), 2):
        if str(a) in audible[b] and str(b) in audible[a]:
            yield a, b
