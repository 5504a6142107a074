"""What agents must agree on, judged by what they say of the tree; nothing flies."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import msgspec
import pytest

from flightstack.agent import AgentStatus, Outputs
from flightstack.swarm.parting import GOES_HOME_BECAUSE
from flightstack.swarm.wire import Event, Phase, Severity
from mission.geometry.formation import make_layout
from mission.strategies.contract import TreePlace
from mission.tree.balanced_tree import place
from simvehicle.scenario.agreement import HAS_A_SLOT_WITHIN_S, Agreement
from simvehicle.scenario.table_invariants import AGREED_WITHIN_S

LAYOUT = make_layout("hexagonal", 10.0)
WHOLE = {1: 0, 2: 1, 3: 2}


def place_of(drone: int, slots: dict[int, int]) -> TreePlace:
    if drone not in slots:
        return TreePlace(1, -1, slots, None, (), None, None, -1, False)
    family = place(slots, LAYOUT, drone)
    return TreePlace(1, slots[drone], slots, family.parent, family.children, None, None, family.root, False)


class Swarm:
    """Three agents that search, and a radio."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.heard: dict[str, set[str]] = {str(n): {"1", "2", "3", "ground"} - {str(n)} for n in WHOLE}
        self.members = {
            drone: SimpleNamespace(
                runs=True, agent=SimpleNamespace(phase=SimpleNamespace(phase=Phase.SEARCHING))
            )
            for drone in WHOLE
        }
        self.radio = SimpleNamespace(audible=lambda node: self.heard[node])
        self.faults = SimpleNamespace(in_burst=False)
        self.agreement = Agreement(cast(Any, self), cast(Any, self.faults), LAYOUT)
        for drone in WHOLE:
            self.says(drone, place_of(drone, WHOLE))

    def says(self, drone: int, of_the_tree: TreePlace, *events: Event) -> list[tuple[str, str, str]]:
        status = AgentStatus(
            phase=Phase.SEARCHING,
            connected=True,
            airborne=True,
            steerable=True,
            waiting_for="",
            comes_second=False,
            place=of_the_tree,
        )
        return list(self.agreement.hear(drone, Outputs(b"", (), (), events, status)))

    def after(self, seconds: float) -> set[tuple[str, str]]:
        """Kinds and drones of what is wrong then."""
        list(self.agreement.problems_now())
        found: set[tuple[str, str]] = set()
        for _ in range(round(seconds)):
            self.now_s += 1.0
            found = {(kind, who) for kind, who, _ in self.agreement.problems_now()}
        return found


@pytest.fixture
def swarm() -> Swarm:
    return Swarm()


def test_a_whole_tree_that_all_know_is_well(swarm: Swarm) -> None:
    assert swarm.after(2.0 * HAS_A_SLOT_WITHIN_S) == set()
    assert swarm.agreement.whole_table(2) == WHOLE


def test_who_hears_each_other_has_one_table_in_time(swarm: Swarm) -> None:
    swarm.says(3, place_of(3, {1: 0, 3: 1}))
    assert swarm.after(AGREED_WITHIN_S - 1.0) == set()
    assert swarm.after(2.0) == {("agreement", "drones 1 and 3"), ("agreement", "drones 2 and 3")}


def test_the_time_begins_anew_with_every_change_of_who_hears_whom_and_stands_still_in_a_burst(
    swarm: Swarm,
) -> None:
    swarm.says(3, place_of(3, {1: 0, 3: 1}))
    assert swarm.after(AGREED_WITHIN_S - 1.0) == set()
    swarm.heard["3"] = {"1"}
    assert swarm.after(AGREED_WITHIN_S) == set()
    swarm.faults.in_burst = True
    assert swarm.after(5.0 * AGREED_WITHIN_S) == set()
    swarm.faults.in_burst = False
    assert swarm.after(AGREED_WITHIN_S + 1.0) == {("agreement", "drones 1 and 3")}, "2 does not hear 3"


def test_a_tree_with_a_hole_is_wrong(swarm: Swarm) -> None:
    for drone in WHOLE:
        swarm.says(drone, msgspec.structs.replace(place_of(drone, WHOLE), slots={1: 1, 2: 2, 3: 3}))
    assert {kind for kind, _ in swarm.after(AGREED_WITHIN_S + 1.0)} == {"table"}
    assert swarm.agreement.whole_table(2) == {}


def test_everybody_has_somebody_to_tell_that_it_lives(swarm: Swarm) -> None:
    swarm.members[1].runs = False
    assert swarm.after(AGREED_WITHIN_S + 1.0) == {("target", "drone 2"), ("target", "drone 3")}


def test_who_takes_part_gets_a_slot(swarm: Swarm) -> None:
    for drone in WHOLE:
        swarm.says(drone, place_of(drone, {1: 0, 2: 1}))
    assert swarm.after(HAS_A_SLOT_WITHIN_S) == set()
    assert swarm.after(1.0) == {("slot", "drone 3")}


def test_the_last_one_goes_on_while_the_ground_station_tells_it_that_the_others_are_down(
    swarm: Swarm,
) -> None:
    leaves = Event(3, 1, Severity.WARNING, "leaving", f"returning: {GOES_HOME_BECAUSE}")
    alone = place_of(3, {3: 0})
    assert swarm.says(3, alone, leaves) == [], "two others run"
    swarm.members[1].runs = swarm.members[2].runs = False
    assert [kind for kind, _, _ in swarm.says(3, alone, leaves)] == ["last"]
    swarm.heard["3"] = set()
    assert swarm.says(3, alone, leaves) == [], "nobody tells it"
