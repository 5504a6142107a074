"""Readings come up to the root, and whatever is known to be there is said no more."""

from __future__ import annotations

from collections.abc import Callable

from hypothesis import given, settings
from hypothesis import strategies as st

from flightstack.swarm.reading_relay import LOST_WAY_S, ReadingRelay
from flightstack.swarm.topics import Delivery
from flightstack.swarm.wire import ReadingsState
from flightstack.transport.memory import Conditions, LossyLink
from mission.estimation.estimates import Reading
from mission.geometry.formation import make_layout
from mission.strategies.contract import Order, Stage
from mission.tree.balanced_tree import place

TICK_S = 0.1
LAYOUT = make_layout("hexagonal", 10.0)


def order(sequence: int) -> Order:
    return Order(sequence, Stage.SEARCH, (0.0, 0.0, -10.0), 0.0)


def reading(drone: int, sequence: int = 1) -> Reading:
    return Reading(drone, sequence, (0.0, 0.0, -10.0), float(drone), 4.0)


class Air:
    """Relays that hear each other as `reaches` says; counts what is said."""

    def __init__(
        self, count: int, reaches: Callable[[int, int], bool], *, loss: float = 0.0, seed: int = 0
    ) -> None:
        self.slots = {drone: drone - 1 for drone in range(1, count + 1)}
        self.family = {drone: place(self.slots, LAYOUT, drone) for drone in self.slots}
        self.relays = {drone: ReadingRelay(drone) for drone in self.slots}
        self.reaches = reaches
        self.conditions = Conditions(loss=loss)
        self.links = {(a, b): LossyLink(seed, str(a), str(b)) for a in self.slots for b in self.slots}
        self.now_s = 0.0
        self.order = order(1)
        self.said: list[tuple[float, ReadingsState]] = []

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / TICK_S)):
            self.now_s += TICK_S
            told = []
            for drone, relay in self.relays.items():
                relay.follow(self.order, self.family[drone])
                due = relay.due(self.now_s, TICK_S)
                if due is not None:
                    told.append(ReadingsState(drone, 1, 1, 0, "survey", self.order.sequence, *due))
            self.said += [(self.now_s, message) for message in told]
            for message in told:
                for drone, relay in self.relays.items():
                    link = self.links[message.sender, drone]
                    near = drone != message.sender and self.reaches(message.sender, drone)
                    if near and link.arrivals_s(self.now_s, self.conditions, Delivery.BEST_EFFORT):
                        relay.hear(self.now_s, message, self.slots)

    def read(self, drone: int) -> None:
        self.relays[drone].follow(self.order, self.family[drone])
        self.relays[drone].note(self.now_s, reading(drone, self.order.sequence))

    @property
    def at_root(self) -> list[int]:
        return [found.drone for found in self.relays[1].readings]


def everybody(_a: int, _b: int) -> bool:
    return True


def neighbours_only(a: int, b: int) -> bool:
    """Slots next to each other in the formation."""
    (n, e), (north, east) = LAYOUT.offset_m(a - 1), LAYOUT.offset_m(b - 1)
    return (n - north) ** 2 + (e - east) ** 2 < 11.0**2


def test_where_the_root_hears_everybody_nobody_relays() -> None:
    air = Air(19, everybody)
    for drone in air.slots:
        air.read(drone)
    air.run(5.0)
    assert air.at_root == list(air.slots)
    assert sum(len(message.readings) for _, message in air.said) == 18, "each of its own, once"


def test_over_several_hops_each_reading_is_told_once_a_hop() -> None:
    air = Air(37, neighbours_only)
    for drone in air.slots:
        air.read(drone)
    air.run(5.0)
    assert air.at_root == list(air.slots)
    above = {drone: air.family[drone].parent for drone in air.slots}

    def depth(drone: int | None) -> int:
        return 0 if drone is None or drone == 1 else 1 + depth(above[drone])

    assert sum(len(message.readings) for _, message in air.said) == sum(map(depth, air.slots))


def test_when_all_are_there_nothing_is_said() -> None:
    air = Air(37, neighbours_only, loss=0.3)
    for drone in air.slots:
        air.read(drone)
    air.run(10.0)
    assert air.at_root == list(air.slots)
    before = len(air.said)
    air.run(10.0)
    assert len(air.said) == before


def test_one_whose_parent_does_not_hear_it_finds_another_way() -> None:
    lost = 13
    parent = Air(37, everybody).family[lost].parent

    def reaches(a: int, b: int) -> bool:
        return neighbours_only(a, b) and (a, b) != (lost, parent)

    air = Air(37, reaches)
    air.read(lost)
    air.run(LOST_WAY_S - TICK_S)
    assert air.at_root == []
    air.run(3.0)
    assert air.at_root == [lost]


def test_a_reading_of_another_order_and_of_a_stranger_is_not_taken() -> None:
    air = Air(3, everybody)
    air.run(TICK_S)
    root = air.relays[1]
    root.hear(0.0, ReadingsState(2, 1, 1, 0, "survey", 2, (reading(2, 2),)), air.slots)
    root.hear(0.0, ReadingsState(2, 1, 1, 0, "survey", 1, (reading(2, 2), reading(9))), air.slots)
    assert root.readings == ()


def test_a_new_order_forgets_the_readings_for_the_old_one() -> None:
    air = Air(3, everybody)
    air.read(2)
    air.run(1.0)
    air.order = order(2)
    air.run(1.0)
    assert air.at_root == []
    air.read(3)
    air.run(1.0)
    assert air.at_root == [3]


@settings(max_examples=20, deadline=None)
@given(st.integers(2, 20), st.integers(0, 1000), st.floats(0.0, 0.4), st.booleans())
def test_all_readings_arrive_over_any_radio(count: int, seed: int, loss: float, near_only: bool) -> None:
    air = Air(count, neighbours_only if near_only else everybody, loss=loss, seed=seed)
    for drone in air.slots:
        air.read(drone)
    air.run(15.0)
    assert air.at_root == list(air.slots)
