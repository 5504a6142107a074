"""The swarm's table among several drones, over a radio that loses and cuts."""

from __future__ import annotations

import random
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightstack.swarm.admission import refusal
from flightstack.swarm.exchange import Exchange, OrderExchange
from flightstack.swarm.peers import Peers
from flightstack.swarm.swarm_table import SwarmTable
from flightstack.swarm.table_calm import HEAL_LIMIT_S
from flightstack.swarm.topics import ORDER, READINGS, STATE, TABLE
from flightstack.swarm.wire import (
    NO_ORDER,
    TAKING_PART,
    DroneState,
    MemberRegister,
    OrderState,
    Phase,
    ReadingsState,
    TableState,
)
from flightstack.transport.memory import Conditions, MemoryRadio
from mission.estimation.estimates import Reading
from mission.geometry.formation import make_layout, rotated
from mission.geometry.frames import Geodetic, LocalFrame, Vector3
from mission.strategies.contract import Decision, Hold, Order, Stage
from mission.tree.balanced_tree import problems
from mission.tree.slot_registers import SlotRegister

FRAME = LocalFrame(Geodetic(-5.06, 151.3, 500.0))
START: Vector3 = (0.0, 0.0, -10.0)
TICK_S = 0.1


class Node:
    def __init__(self, drone: int, members: tuple[int, ...]) -> None:
        self.drone = drone
        self.layout = make_layout("hexagonal", 10.0)
        self.peers = Peers(drone)
        self.table = SwarmTable(
            drone, members, self.layout, frame_identity=FRAME.identity, incarnation=1, suspect_after_s=0.8
        )
        self.exchange = Exchange(TICK_S)
        self.orders = OrderExchange(TICK_S)
        self.stuck = False
        """It speaks, but its table does not work."""
        self.phase = Phase.SEARCHING
        self.incarnation = 1
        self.decision: Decision | None = None
        self.sequence = 0
        self.position: Vector3 = START

    def report(self) -> None:
        """As the agent does it, by its phase."""
        if self.phase not in TAKING_PART:
            self.table.leave()
        elif self.phase not in (Phase.ARMING, Phase.TAKEOFF):
            self.table.rejoin()

    def state(self) -> DroneState:
        self.sequence += 1
        return DroneState(
            sender=self.drone,
            incarnation=self.incarnation,
            sequence=self.sequence,
            frame=FRAME.identity,
            phase=self.phase,
            position_ned_m=self.position,
            velocity_ned_mps=(0.0, 0.0, 0.0),
            heading_rad=0.0,
            home_ned_m=None,
            armed=True,
            airborne=True,
            mode="GUIDED",
            battery_fraction=1.0,
            co2_ppm=None,
            excess_co2_ppm=None,
            wind=None,
            epoch=self.table.epoch,
            slot=self.table.slots.get(self.drone),
            parent=None,
            healing=False,
            tracking_best_ppm=None,
            table_digest=self.table.digest,
            order_digest=self.table.order_digest,
        )


class Network:
    """Steps all live nodes together; what they tell goes through a radio that loses and cuts."""

    def __init__(
        self, count: int, *, loss: float = 0.0, seed: int = 0, members: tuple[int, ...] | None = None
    ) -> None:
        members = members or tuple(range(1, count + 1))
        self.nodes = {drone: Node(drone, members) for drone in members}
        self.radio = MemoryRadio(seed, Conditions(loss=loss))
        self.transports = {
            drone: self.radio.join(drone, (TABLE, STATE, ORDER, READINGS)) for drone in members
        }
        self.now_s = 0.0
        self.ticks = 0
        self.dead: set[int] = set()
        for node in self.nodes.values():
            node.table.begin(0.0, "survey-1", START)

    @property
    def live(self) -> list[Node]:
        return [node for drone, node in self.nodes.items() if drone not in self.dead]

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / TICK_S)):
            self.now_s += TICK_S
            self.ticks += 1
            for node in self.live:
                if (self.ticks + node.drone) % 2 == 0:  # 5 Hz, not all at once
                    self.transports[node.drone].publish(STATE, STATE.codec.encode(node.state()))
                if node.exchange.is_due(self.now_s, node.table.digest, node.peers.facts()):
                    self.transports[node.drone].publish(TABLE, TABLE.codec.encode(node.table.message()))
                ordered = node.table.order_digest
                if ordered != NO_ORDER and node.orders.is_due(self.now_s, ordered, node.peers.facts()):
                    payload = ORDER.codec.encode(node.table.order_message())
                    self.transports[node.drone].publish(ORDER, payload)
                readings = node.table.readings_message(self.now_s, TICK_S)
                if readings is not None:
                    self.transports[node.drone].publish(READINGS, READINGS.codec.encode(readings))
            self.radio.step(self.now_s)
            heard = {drone: transport.receive() for drone, transport in self.transports.items()}
            for node in self.live:
                said = [r.topic.codec.decode(r.payload) for r in heard[node.drone]]
                for state in said:
                    node.peers.hear(self.now_s, state)
                if node.stuck:
                    continue
                node.report()
                told = [
                    message
                    for message in said
                    if isinstance(message, TableState | OrderState | ReadingsState)
                ]
                node.table.step(self.now_s, told, node.peers.facts(), node.decision, node.position)
                node.decision = None

    def agreed(self) -> dict[int, int]:
        """The assignment, after checking that all live nodes hold the same whole tree of just themselves."""
        first = self.live[0].table
        for node in self.live:
            assert node.table.slots == first.slots
            assert node.table.epoch == first.epoch
            assert node.table.order == first.order
        assert sorted(first.slots) == sorted(set(self.nodes) - self.dead)
        assert problems(first.slots, self.live[0].layout) == []
        return first.slots


def test_everybody_learns_the_roots_first_order() -> None:
    network = Network(5)
    network.run(1.0)
    network.agreed()
    assert len({node.table.digest for node in network.live}) == 1
    order = network.nodes[5].table.order
    assert order is not None
    assert (order.sequence, order.stage, order.anchor_ned_m) == (1, Stage.FORM, START)


def test_readings_reach_the_root() -> None:
    network = Network(5)
    network.run(1.0)
    for node in network.live:
        reading = Reading(node.drone, 1, START, 10.0 * node.drone, 4.0)
        node.decision = Decision(Hold(), reading=reading)
    network.run(1.0)
    assert [r.drone for r in network.nodes[1].table.readings] == [1, 2, 3, 4, 5]


def test_readings_of_another_order_are_not_mixed_in() -> None:
    network = Network(3)
    network.run(1.0)
    network.nodes[2].decision = Decision(Hold(), reading=Reading(2, 7, START, 10.0, 4.0))
    network.run(1.0)
    assert network.nodes[1].table.readings == ()


@pytest.mark.parametrize("victim", [1, 3, 5])
def test_a_dead_drone_is_healed_around(victim: int) -> None:
    network = Network(5)
    network.run(1.0)
    network.dead.add(victim)
    network.run(6.0)
    slots = network.agreed()
    assert len(slots) == 4
    assert network.live[0].table.heals == 1
    order = network.live[0].table.order
    assert order is not None
    assert order.sequence == 2


def test_root_and_its_heir_die_together() -> None:
    network = Network(7)
    network.run(1.0)
    place = network.nodes[1].table.place(network.now_s)
    assert place.heir is not None
    network.dead |= {1, place.heir}
    network.run(12.0)
    network.agreed()


def test_down_to_a_single_survivor() -> None:
    network = Network(4)
    network.run(1.0)
    for victim in (1, 2, 3):
        network.dead.add(victim)
        network.run(8.0)
        network.agreed()
    assert network.nodes[4].table.slots == {4: 0}


def test_a_drone_that_says_it_leaves_is_replaced_without_waiting_for_silence() -> None:
    network = Network(5)
    network.run(1.0)
    network.nodes[3].phase = Phase.RETURNING
    network.run(1.5)
    assert 3 not in network.nodes[1].table.slots
    assert not network.nodes[3].table.member


def test_drones_that_are_apart_leave_the_anchor_where_it_is() -> None:
    """Each alone or in groups, they say nothing about where a formation would be."""
    network = Network(5)
    network.run(1.0)
    root = network.nodes[1]
    root.decision = Decision(Hold(), order=Order(2, Stage.SEARCH, (100.0, 0.0, -10.0), 0.3, apart=True))
    network.run(1.0)
    for node in network.live:
        node.position = (40.0 * node.drone, -70.0, -10.0)
    network.dead.add(4)
    network.run(6.0)
    network.agreed()
    order = root.table.order
    assert order is not None
    assert (order.sequence, order.anchor_ned_m, order.apart) == (3, (100.0, 0.0, -10.0), True)


def test_the_formation_stays_where_it_stopped() -> None:
    network = Network(5)
    network.run(1.0)
    root = network.nodes[1]
    root.decision = Decision(Hold(), order=Order(2, Stage.SEARCH, (100.0, 0.0, -10.0), 0.3))
    network.run(1.0)
    for node in network.live:  # half way to the anchor when drone 4 dies
        offset = rotated(node.layout.offset_m(node.table.slots[node.drone]), 0.3)
        node.position = (50.0 + offset[0], offset[1], -10.0)
    network.dead.add(4)
    network.run(6.0)
    network.agreed()
    order = root.table.order
    assert order is not None
    assert order.anchor_ned_m == pytest.approx((50.0, 0.0, -10.0))
    assert order.stage is Stage.SEARCH


def told(sender: int, survey: str, **changes: Any) -> TableState:
    plain = TableState(sender, 1, 1, FRAME.identity, survey, (), (), ())
    return msgspec.structs.replace(plain, **changes)


def test_knowledge_of_another_survey_changes_nothing() -> None:
    node = Network(3).nodes[2]
    before = node.table.message()
    foreign = told(1, "survey-0", slots=((0, SlotRegister(3, 2, 3)),), members=((3, MemberRegister(4, 4)),))
    node.table.step(0.1, [foreign], node.peers.facts(), None, START)
    after = node.table.message()
    assert (after.slots, after.members) == (before.slots, before.members)


def test_members_listed_in_different_orders_still_give_one_slot_to_each() -> None:
    network = Network(5)
    odd = network.nodes[4] = Node(4, (1, 4, 3, 2, 5))
    odd.table.begin(0.0, "survey-1", START)
    network.run(1.0)
    assert sorted(network.agreed().values()) == [0, 1, 2, 3, 4]


def test_a_new_order_tells_nobodys_table_again() -> None:
    network = Network(5)
    network.run(1.0)
    digests = {node.table.digest for node in network.live}
    told = {node.drone: node.table.message().sequence for node in network.live}
    for sequence in range(2, 6):
        order = Order(sequence, Stage.SEARCH, START, 0.0)
        network.nodes[1].decision = Decision(Hold(), order=order)
        network.run(0.5)
        assert {node.table.order for node in network.live} == {order}
        assert len({node.table.order_digest for node in network.live}) == 1
    assert {node.table.digest for node in network.live} == digests
    assert {node.drone: node.table.message().sequence - 1 for node in network.live} == told


@pytest.mark.parametrize("seed", range(3))
def test_who_missed_an_order_while_its_radio_was_dead_is_told_it(seed: int) -> None:
    network = Network(5, loss=0.2, seed=seed)
    network.run(1.0)
    network.radio.switch_off(4)
    network.nodes[1].decision = Decision(Hold(), order=Order(9, Stage.SEARCH, START, 0.0))
    network.run(0.5)
    before = network.nodes[4].table.order
    assert before is not None
    assert before.sequence == 1
    network.radio.switch_on(4)
    network.run(1.5)
    assert network.agreed().keys() == network.nodes.keys()
    assert network.nodes[4].table.order == network.nodes[1].table.order


def test_a_survey_is_joined_only_with_the_order_that_its_members_say_they_know() -> None:
    network = Network(3)
    network.nodes[3].table = Node(3, tuple(network.nodes)).table
    network.nodes[3].table.begin(0.0, "survey-9", START)
    joiner = network.nodes[3]
    flown = network.nodes[1].table
    slots = flown.message().slots
    state = msgspec.structs.replace(network.nodes[1].state(), table_digest=1, order_digest=2)
    for tick in range(30):
        now_s = 1.0 + TICK_S * tick
        joiner.peers.hear(now_s, msgspec.structs.replace(state, sequence=100 + tick))
        heard: list[TableState | OrderState | ReadingsState] = [told(1, "survey-1", slots=slots)]
        if tick == 20:
            assert joiner.table.survey == "survey-9"
            heard.append(flown.order_message())
        joiner.table.step(now_s, heard, joiner.peers.facts(), None, START)
    assert (joiner.table.survey, joiner.table.order) == ("survey-1", flown.order)


def test_only_the_root_orders() -> None:
    network = Network(3)
    network.run(1.0)
    network.nodes[2].decision = Decision(Hold(), order=Order(9, Stage.TRACK, START, 0.0))
    network.run(1.0)
    order = network.nodes[2].table.order
    assert order is not None
    assert order.sequence == 1


def test_a_tree_whose_radios_reach_only_relatives_still_heals() -> None:
    """Nineteen drones, each hearing only those within one spacing (and a bit) of its own slot."""
    network = Network(19)
    network.run(0.5)
    layout = network.nodes[1].layout
    for drone in network.nodes:
        network.radio.place(drone, (*layout.offset_m(drone - 1), -10.0))
    network.radio.range_m = 10.5
    network.run(4.0)
    network.dead.add(3)
    network.run(8.0)
    assert 3 not in network.nodes[1].table.slots
    assert network.nodes[1].table.heals >= 1


@settings(max_examples=6, deadline=None)
@given(
    count=st.integers(3, 10),
    alone=st.integers(1, 10),
    members=st.randoms(use_true_random=False),
    away_s=st.floats(0.5, 25.0),
    seed=st.integers(0, 1000),
)
def test_a_drone_whose_radio_failed_for_a_while_never_sends_the_others_home(
    count: int, alone: int, members: random.Random, away_s: float, seed: int
) -> None:
    """Whoever it is, whatever its id, and however long it was alone: it is taken in again, and moves none of the
    others from the root."""
    order = members.sample(range(1, count + 1), count)
    network = Network(count, loss=0.2, seed=seed, members=tuple(order))
    network.run(1.0)
    alone = min(alone, count)
    others = set(network.nodes) - {alone}
    network.radio.cut("failed", {alone})
    network.run(away_s)
    network.radio.mend("failed")
    network.run(12.0)
    tables = [node.table for node in network.live]
    assert all(table.slots == tables[0].slots and table.order == tables[0].order for table in tables)
    assert tables[0].slots.keys() == network.nodes.keys()
    assert count == 2 or away_s < 3.0 or next(d for d, s in tables[0].slots.items() if s == 0) in others
    assert problems(tables[0].slots, network.nodes[1].layout) == []


@settings(max_examples=6, deadline=None)
@given(count=st.integers(2, 9), seed=st.integers(0, 100_000))
def test_a_member_that_tells_whatever_it_likes_cannot_split_the_others_for_good(
    count: int, seed: int
) -> None:
    """It tells each of the others something else for a while, all well-formed; then it falls silent."""
    chance = random.Random(seed)
    network = Network(count, loss=0.2, seed=seed)
    members = tuple(network.nodes)
    liar = chance.choice(members)
    network.run(1.0)
    for _ in range(chance.randint(1, 6)):
        for node in network.live:
            lie = told(
                liar,
                "survey-1",
                slots=tuple(
                    (
                        slot,
                        SlotRegister(
                            chance.randrange(50), chance.choice((*members, -1)), chance.randint(0, count)
                        ),
                    )
                    for slot in range(count)
                ),
                members=tuple(
                    (drone, MemberRegister(life := chance.randrange(50), chance.randint(-1, life), -1))
                    for drone in members
                ),
            )
            ordered = OrderState(
                liar,
                1,
                1,
                FRAME.identity,
                "survey-1",
                Order(chance.randrange(1000), Stage.SEARCH, START, 0.0),
                SlotRegister(chance.randrange(50), chance.choice(members), chance.randint(0, count)),
                chance.randrange(1 << 32),
            )
            assert refusal(lie, members) == refusal(ordered, members) == ""
            node.peers.hear(network.now_s, ordered)
            node.table.step(network.now_s, [lie, ordered], node.peers.facts(), None, node.position)
        network.run(chance.uniform(0.1, 4.0))
    network.dead.add(liar)
    network.run(5.0 * count + 5.0)
    tables = [node.table for node in network.live]
    assert all(table.slots == tables[0].slots and table.order == tables[0].order for table in tables)
    assert all(problems(table.slots, network.nodes[1].layout) == [] for table in tables)


@settings(max_examples=6, deadline=None)
@given(
    count=st.integers(2, 9),
    group=st.sets(st.integers(1, 9), min_size=1),
    away_s=st.floats(4.0, 30.0),
    seed=st.integers(0, 1000),
)
def test_halves_that_meet_again_become_one_swarm(
    count: int, group: set[int], away_s: float, seed: int
) -> None:
    """Nobody is sent home: the root that more have heard stays root, the others get free slots."""
    network = Network(count, loss=0.2, seed=seed)
    network.run(1.0)
    one = group & network.nodes.keys()
    two = network.nodes.keys() - one
    network.radio.cut("ridge", one)
    network.run(away_s)
    network.radio.mend("ridge")
    network.run(12.0)
    tables = [node.table for node in network.live]
    assert all(table.slots == tables[0].slots and table.order == tables[0].order for table in tables)
    assert problems(tables[0].slots, network.nodes[1].layout) == []
    assert tables[0].slots.keys() == network.nodes.keys()
    if away_s > 20.0 and one and two and len(one) != len(two):
        larger = max(one, two, key=len)
        assert next(drone for drone, slot in tables[0].slots.items() if slot == 0) in larger


@settings(max_examples=6, deadline=None)
@given(
    count=st.integers(2, 9),
    victims=st.lists(st.tuples(st.integers(1, 9), st.floats(0.2, 4.0)), max_size=6),
    seed=st.integers(0, 1000),
)
def test_any_losses_end_in_one_whole_tree(count: int, victims: list[tuple[int, float]], seed: int) -> None:
    network = Network(count, loss=0.3, seed=seed)
    network.run(1.0)
    for victim, wait_s in victims:
        if victim in network.nodes and len(network.live) > 1:
            network.dead.add(victim)
            network.run(wait_s)
    network.run(5.0 * len(network.nodes) + 5.0)
    network.agreed()


def surveys(network: Network) -> set[str | None]:
    return {node.table.survey for node in network.live}


@pytest.mark.parametrize("seed", range(6))
def test_two_starts_at_once_become_one_survey(seed: int) -> None:
    """Two operators: some drones heard the one first, some the other, and the radio loses a third."""
    network = Network(7, loss=0.3, seed=seed)
    chance = random.Random(seed)
    for drone, node in network.nodes.items():
        node.table.begin(0.0, "one" if chance.random() < 0.5 else "other", START)
        assert drone in node.table.slots
    network.run(15.0)
    assert len(surveys(network)) == 1
    network.agreed()


@pytest.mark.parametrize("late", [1, 4])
def test_who_starts_late_joins_the_survey_that_flies(late: int) -> None:
    """The first start did not reach it (or its agent was restarted): the operator gave another."""
    network = Network(5)
    network.nodes[late].table = Node(late, tuple(network.nodes)).table
    network.nodes[late].phase = Phase.DISARMED
    network.run(2.0)
    network.nodes[late].phase = Phase.ARMING
    network.nodes[late].table.begin(network.now_s, "survey-2", START)
    network.run(3.0)
    assert len(surveys(network)) == 1
    assert network.nodes[2].table.order is not None
    network.agreed()


def test_who_was_counted_out_joins_in_the_air_once_it_is_ready() -> None:
    """Its agent was started again after the others had healed around it."""
    network = Network(5)
    network.dead = {2}
    network.run(60.0)
    slots = network.agreed()
    back = network.nodes[2] = Node(2, tuple(network.nodes))
    back.incarnation = 2
    back.phase = Phase.DISARMED
    network.dead = set()
    network.run(3.0)
    back.phase = Phase.ARMING
    back.table.begin(network.now_s, "survey-2", START)
    network.run(3.0)
    assert back.table.survey == "survey-1"
    assert not back.table.member
    back.phase = Phase.FORMING
    network.run(3.0)
    assert network.agreed() == {**slots, 2: next(s for s in range(5) if s not in slots.values())}


def test_what_is_left_of_a_survey_that_is_over_draws_nobody_in() -> None:
    """All landed; they still tell what they know of it. Drone 3 hears of the new start last."""
    network = Network(4)
    network.nodes[1].decision = Decision(Hold(), order=Order(9, Stage.TRACK, (50.0, 0.0, -10.0), 0.0))
    network.run(2.0)
    for node in network.live:
        node.phase = Phase.LANDED
    network.nodes[4] = Node(4, tuple(network.nodes))
    network.run(2.0)
    for drone in (4, 1, 2, 3):
        network.nodes[drone].phase = Phase.ARMING
        network.nodes[drone].table.begin(network.now_s, "survey-2", START)
        network.run(1.5)
    assert surveys(network) == {"survey-2"}
    network.agreed()
    order = network.nodes[3].table.order
    assert order is not None
    assert order.sequence == 1


def in_the_slots_of(network: Network, *slots: int) -> set[int]:
    return {drone for drone, slot in network.nodes[1].table.slots.items() if slot in slots}


@pytest.mark.parametrize(
    "slots",
    [
        pytest.param((18,), id="leaf"),
        pytest.param((2,), id="inner node"),
        pytest.param((0,), id="root"),
        pytest.param((2, 9), id="node and a child"),
        pytest.param((0, 4), id="root and a child"),
        pytest.param((1, 7, 8, 18), id="branch"),
        pytest.param((0, 1, 2, 3, 7, 8, 9, 10, 11), id="half, with the root"),
        pytest.param(tuple(range(18)), id="all but one"),
    ],
)
def test_losses_at_one_moment_end_in_one_whole_table(slots: tuple[int, ...]) -> None:
    """Nineteen drones in two full rings; within ten seconds, and nobody is held up by it afterwards."""
    network = Network(19)
    network.run(2.0)
    network.dead = in_the_slots_of(network, *slots)
    network.run(1.0)
    watch = network.live[0]
    for _ in range(100):
        network.run(TICK_S)
        if sorted(watch.table.slots) == [node.drone for node in network.live]:
            break
    network.run(2.0)
    network.agreed()
    for node in network.live:
        assert not node.table.place(network.now_s).healing


def test_a_loss_during_a_heal_is_healed_too() -> None:
    network = Network(19)
    network.run(2.0)
    heir = network.nodes[1].table.place(network.now_s).heir
    assert heir is not None
    network.dead = {1}
    network.run(1.4)  # the heir is about to claim, or has just done so
    network.dead = {1, heir}
    network.run(8.0)
    network.agreed()


def test_a_frozen_process_that_wakes_after_its_slot_was_given_away_takes_a_free_one() -> None:
    network = Network(9)
    network.run(2.0)
    network.dead = {2}
    network.run(20.0)
    healed = network.agreed()
    assert 1 in healed.values(), "somebody else stands in its slot"
    network.dead = set()
    network.run(3.0)
    slots = network.agreed()
    assert {drone: slot for drone, slot in slots.items() if drone != 2} == healed


@pytest.mark.parametrize("parts", [({1, 2, 3},), ({4, 5}, {6, 7, 8}), ({1}, {2})])
def test_parts_that_meet_again_keep_the_root_of_the_largest(parts: tuple[set[int], ...]) -> None:
    network = Network(9)
    network.run(6.0)
    for number, part in enumerate(parts):
        network.radio.cut(f"ridge {number}", part)
    network.run(40.0)
    largest = max((*parts, network.nodes.keys() - set().union(*parts)), key=len)
    in_it = network.nodes[min(largest)].table
    root = next(drone for drone, slot in in_it.slots.items() if slot == 0)
    assert in_it.slots.keys() == largest
    for number in range(len(parts)):
        network.radio.mend(f"ridge {number}")
    network.run(6.0)
    assert network.agreed()[root] == 0


def test_an_announced_departure_moves_the_heir_at_once() -> None:
    network = Network(9)
    network.run(2.0)
    leaver = network.nodes[2]
    assert not leaver.table.has_handed_over(network.now_s)
    leaver.phase = Phase.RETURNING
    network.run(0.6)
    assert not leaver.table.has_handed_over(network.now_s), "somebody may still object"
    network.run(0.6)
    assert leaver.table.has_handed_over(network.now_s)
    for node in network.live:
        assert 2 not in node.table.slots
        assert 1 in node.table.slots.values()


@pytest.mark.parametrize("victims", [{1}, {2}])
def test_an_heir_that_is_heard_and_does_not_claim_is_passed_over(victims: set[int]) -> None:
    network = Network(9)
    network.run(2.0)
    victim = network.nodes[min(victims)]
    heir = victim.table.place(network.now_s).heir
    assert heir is not None
    network.nodes[heir].stuck = True
    network.dead = victims
    network.run(8.0)
    for node in network.live:
        if not node.stuck:
            assert problems(node.table.slots, node.layout) == []
            assert heir in node.table.slots, "it is heard, and keeps its own slot"
            assert not node.table.place(network.now_s).healing


def test_one_that_waits_for_a_slot_and_takes_none_holds_up_nobody_for_ever() -> None:
    network = Network(5)
    network.dead = {2}
    network.run(60.0)
    back = network.nodes[2] = Node(2, tuple(network.nodes))
    back.table.begin(network.now_s, "survey-1", START)
    network.dead = set()
    network.run(TICK_S)
    back.stuck = True
    assert 2 not in network.nodes[1].table.slots
    network.run(HEAL_LIMIT_S + 5.0)
    root = network.nodes[1]
    assert root.table.order is not None
    sequence = root.table.order.sequence + 1
    root.decision = Decision(Hold(), order=Order(sequence, Stage.SEARCH, START, 0.0))
    network.run(1.0)
    assert network.nodes[5].table.order == Order(sequence, Stage.SEARCH, START, 0.0)
    assert not root.table.place(network.now_s).healing


def test_a_suspicion_under_heavy_loss_moves_nobody() -> None:
    network = Network(7, loss=0.2, seed=3)
    network.run(120.0)
    assert network.agreed() == {drone: drone - 1 for drone in network.nodes}
    assert all(node.table.heals == 0 for node in network.live)


class Faults:
    """What may happen to a swarm, one after another; `end` mends what can be mended."""

    def __init__(self, network: Network) -> None:
        self.network = network
        self.frozen: set[int] = set()
        self.killed: set[int] = set()
        self.cuts: list[str] = []
        self.booting: set[int] = set()

    def happen(self, fault: str, drones: set[int]) -> None:
        network = self.network
        drones = drones & network.nodes.keys() - self.killed
        match fault:
            case "kill" if len(self.killed | drones) < len(network.nodes):
                self.killed |= drones
            case "freeze":
                self.frozen |= drones
            case "thaw":
                self.frozen -= drones
            case "cut":
                self.cuts.append(f"cut {len(self.cuts)}")
                network.radio.cut(self.cuts[-1], drones)
            case "mend":
                self.mend()
            case "boot":
                for drone in drones - self.frozen:
                    self.boot(drone)
            case "fly":
                self.fly()
        network.dead = self.killed | self.frozen

    def boot(self, drone: int) -> None:
        before = self.network.nodes[drone]
        node = self.network.nodes[drone] = Node(drone, tuple(self.network.nodes))
        node.incarnation = before.incarnation + 1
        node.phase = Phase.ARMING
        node.table.begin(self.network.now_s, "survey-1", START)
        self.booting.add(drone)

    def fly(self) -> None:
        for drone in self.booting:
            self.network.nodes[drone].phase = Phase.FORMING
        self.booting = set()

    def mend(self) -> None:
        while self.cuts:
            self.network.radio.mend(self.cuts.pop())

    def end(self) -> None:
        self.mend()
        self.fly()
        self.network.dead = self.killed


@settings(max_examples=10, deadline=None)
@given(
    count=st.integers(2, 9),
    faults=st.lists(
        st.tuples(
            st.sampled_from(("kill", "freeze", "thaw", "cut", "mend", "boot", "fly")),
            st.sets(st.integers(1, 9), min_size=1, max_size=4),
            st.floats(0.1, 8.0),
        ),
        max_size=8,
    ),
    seed=st.integers(0, 1000),
)
def test_any_faults_end_in_one_whole_table_of_all_that_live(
    count: int, faults: list[tuple[str, set[int], float]], seed: int
) -> None:
    network = Network(count, loss=0.15, seed=seed)
    network.run(1.0)
    schedule = Faults(network)
    for fault, drones, wait_s in faults:
        schedule.happen(fault, drones)
        network.run(wait_s)
    schedule.end()
    network.run(25.0)
    network.agreed()
    for node in network.live:
        assert not node.table.place(network.now_s).healing
