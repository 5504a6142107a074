"""The tree protocol among several drones, over a radio that loses and cuts."""

from __future__ import annotations

import random

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightstack.swarm.admission import refusal
from flightstack.swarm.peers import Peers
from flightstack.swarm.topics import STATE, TREE
from flightstack.swarm.tree_protocol import SwarmTree
from flightstack.swarm.wire import DroneState, Phase, TreeState
from flightstack.transport.memory import Conditions, MemoryRadio
from mission.estimation.estimates import Reading
from mission.geometry.formation import make_layout, rotated
from mission.geometry.frames import Geodetic, LocalFrame, Vector3
from mission.strategies.contract import Decision, Hold, Order, Stage
from mission.tree.balanced_tree import heal, problems

FRAME = LocalFrame(Geodetic(-5.06, 151.3, 500.0))
START: Vector3 = (0.0, 0.0, -10.0)
TICK_S = 0.1


class Node:
    def __init__(self, drone: int, members: tuple[int, ...]) -> None:
        self.drone = drone
        self.layout = make_layout("hexagonal", 10.0)
        self.peers = Peers(drone)
        self.tree = SwarmTree(
            drone, members, self.layout, frame_identity=FRAME.identity, incarnation=1, lost_after_s=3.0
        )
        self.phase = Phase.SEARCHING
        self.decision: Decision | None = None
        self.sequence = 0
        self.position: Vector3 = START

    def state(self) -> DroneState:
        self.sequence += 1
        return DroneState(
            sender=self.drone,
            incarnation=1,
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
            epoch=self.tree.epoch,
            slot=self.tree.slots.get(self.drone),
            parent=None,
            healing=False,
            tracking_best_ppm=None,
        )


class Network:
    """Steps all live nodes together; what they tell goes through a radio that loses and cuts."""

    def __init__(
        self, count: int, *, loss: float = 0.0, seed: int = 0, members: tuple[int, ...] | None = None
    ) -> None:
        members = members or tuple(range(1, count + 1))
        self.nodes = {drone: Node(drone, members) for drone in members}
        self.radio = MemoryRadio(seed, Conditions(loss=loss))
        self.transports = {drone: self.radio.join(drone, (TREE, STATE)) for drone in members}
        self.now_s = 0.0
        self.dead: set[int] = set()
        for node in self.nodes.values():
            node.tree.begin(0.0, "survey-1", START)

    @property
    def live(self) -> list[Node]:
        return [node for drone, node in self.nodes.items() if drone not in self.dead]

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / TICK_S)):
            self.now_s += TICK_S
            for node in self.live:
                self.transports[node.drone].publish(TREE, TREE.codec.encode(node.tree.message()))
                self.transports[node.drone].publish(STATE, STATE.codec.encode(node.state()))
            self.radio.step(self.now_s)
            heard = {drone: transport.receive() for drone, transport in self.transports.items()}
            for node in self.live:
                said = [r.topic.codec.decode(r.payload) for r in heard[node.drone]]
                for state in said:
                    node.peers.hear(self.now_s, state)
                trees = [tree for tree in said if isinstance(tree, TreeState)]
                node.tree.step(self.now_s, trees, node.peers.facts(), node.decision, node.position)
                node.decision = None

    def agreed(self) -> dict[int, int]:
        """The assignment, after checking that all live nodes hold the same whole tree of just themselves."""
        first = self.live[0].tree
        for node in self.live:
            assert node.tree.slots == first.slots
            assert node.tree.epoch == first.epoch
            assert node.tree.order == first.order
        assert sorted(first.slots) == sorted(set(self.nodes) - self.dead)
        assert problems(first.slots, self.live[0].layout) == []
        return first.slots


def test_everybody_learns_the_roots_first_order() -> None:
    network = Network(5)
    network.run(1.0)
    network.agreed()
    order = network.nodes[5].tree.order
    assert order is not None
    assert (order.sequence, order.stage, order.anchor_ned_m) == (1, Stage.FORM, START)


def test_readings_reach_the_root() -> None:
    network = Network(5)
    network.run(1.0)
    for node in network.live:
        reading = Reading(node.drone, 1, START, 10.0 * node.drone, 4.0)
        node.decision = Decision(Hold(), reading=reading)
    network.run(1.0)
    assert [r.drone for r in network.nodes[1].tree.readings] == [1, 2, 3, 4, 5]


def test_readings_of_another_order_are_not_mixed_in() -> None:
    network = Network(3)
    network.run(1.0)
    network.nodes[2].decision = Decision(Hold(), reading=Reading(2, 7, START, 10.0, 4.0))
    network.run(1.0)
    assert network.nodes[1].tree.readings == ()


@pytest.mark.parametrize("victim", [1, 3, 5])
def test_a_dead_drone_is_healed_around(victim: int) -> None:
    network = Network(5)
    network.run(1.0)
    network.dead.add(victim)
    network.run(6.0)
    slots = network.agreed()
    assert len(slots) == 4
    assert network.live[0].tree.epoch == 1
    assert network.live[0].tree.heals == 1
    order = network.live[0].tree.order
    assert order is not None
    assert order.sequence == 2


def test_root_and_its_heir_die_together() -> None:
    network = Network(7)
    network.run(1.0)
    place = network.nodes[1].tree.place(network.now_s, network.nodes[1].peers.facts())
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
    assert network.nodes[4].tree.slots == {4: 0}


def test_a_drone_that_says_it_leaves_is_replaced_without_waiting_for_silence() -> None:
    network = Network(5)
    network.run(1.0)
    network.nodes[3].phase = Phase.RETURNING
    network.run(1.5)
    assert 3 not in network.nodes[1].tree.slots
    assert not network.nodes[3].tree.member


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
    order = root.tree.order
    assert order is not None
    assert (order.sequence, order.anchor_ned_m, order.apart) == (3, (100.0, 0.0, -10.0), True)


def test_the_formation_stays_where_it_stopped() -> None:
    network = Network(5)
    network.run(1.0)
    root = network.nodes[1]
    root.decision = Decision(Hold(), order=Order(2, Stage.SEARCH, (100.0, 0.0, -10.0), 0.3))
    network.run(1.0)
    for node in network.live:  # half way to the anchor when drone 4 dies
        offset = rotated(node.layout.offset_m(node.tree.slots[node.drone]), 0.3)
        node.position = (50.0 + offset[0], offset[1], -10.0)
    network.dead.add(4)
    network.run(6.0)
    network.agreed()
    order = root.tree.order
    assert order is not None
    assert order.anchor_ned_m == pytest.approx((50.0, 0.0, -10.0))
    assert order.stage is Stage.SEARCH


def test_knowledge_of_another_survey_changes_nothing() -> None:
    network = Network(3)
    node = network.nodes[2]
    foreign = TreeState(1, 1, FRAME.identity, 1, 1, ((2, 0),), (), None, (), 0, "survey-0", ((2, 1),))
    node.tree.step(0.1, [foreign], node.peers.facts(), None, START)
    assert node.tree.epoch == 0


def test_an_assignment_that_is_no_tree_is_not_adopted() -> None:
    network = Network(3)
    node = network.nodes[2]
    broken = TreeState(1, 1, FRAME.identity, 1, 1, ((2, 0), (3, 0)), (), None, (), 0, "survey-1", ((2, 1),))
    node.tree.step(0.1, [broken], node.peers.facts(), None, START)
    assert node.tree.epoch == 0


def test_members_listed_in_different_orders_still_give_one_slot_to_each() -> None:
    network = Network(5)
    odd = network.nodes[4] = Node(4, (1, 4, 3, 2, 5))
    odd.tree.begin(0.0, "survey-1", START)
    network.run(1.0)
    assert sorted(network.agreed().values()) == [0, 1, 2, 3, 4]


def test_only_the_root_orders() -> None:
    network = Network(3)
    network.run(1.0)
    network.nodes[2].decision = Decision(Hold(), order=Order(9, Stage.TRACK, START, 0.0))
    network.run(1.0)
    order = network.nodes[2].tree.order
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
    assert 3 not in network.nodes[1].tree.slots
    assert network.nodes[1].tree.heals >= 1


@settings(max_examples=15, deadline=None)
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
    """Whoever it is, whatever its id, and however long it was alone: the others go on, with it or without it."""
    order = members.sample(range(1, count + 1), count)
    network = Network(count, loss=0.2, seed=seed, members=tuple(order))
    network.run(1.0)
    alone = min(alone, count)
    others = set(network.nodes) - {alone}
    network.radio.cut("failed", {alone})
    network.run(away_s)
    network.radio.mend("failed")
    network.run(12.0)
    trees = [node.tree for node in network.live]
    assert all(tree.slots == trees[0].slots and tree.order == trees[0].order for tree in trees)
    assert others <= trees[0].slots.keys()
    assert problems(trees[0].slots, network.nodes[1].layout) == []


@settings(max_examples=15, deadline=None)
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
            left = chance.sample(members, chance.randint(1, count))
            slots = heal(
                {drone: slot for slot, drone in enumerate(members)}, node.layout, set(members) - set(left)
            )
            lineage = tuple(
                (chance.randint(1, count), chance.choice(members)) for _ in range(chance.randrange(count))
            )
            lie = msgspec.structs.replace(
                network.nodes[liar].tree.message(),
                epoch=len(lineage),
                author=lineage[-1][1] if lineage else 0,
                lineage=lineage,
                slots=tuple(slots.slots.items()),
                lost=tuple(chance.sample(members, chance.randint(0, count))),
                order=Order(chance.randrange(1000), Stage.SEARCH, START, 0.0),
            )
            assert refusal(lie, members) == ""
            node.tree.step(network.now_s, [lie], node.peers.facts(), None, node.position)
        network.run(chance.uniform(0.1, 4.0))
    network.dead.add(liar)
    network.run(5.0 * count + 5.0)
    trees = [node.tree for node in network.live]
    assert all(tree.slots == trees[0].slots and tree.order == trees[0].order for tree in trees)
    assert all(problems(tree.slots, network.nodes[1].layout) == [] for tree in trees)


@settings(max_examples=15, deadline=None)
@given(
    count=st.integers(2, 9),
    group=st.sets(st.integers(1, 9), min_size=1),
    away_s=st.floats(4.0, 30.0),
    seed=st.integers(0, 1000),
)
def test_halves_that_meet_again_become_one_swarm(
    count: int, group: set[int], away_s: float, seed: int
) -> None:
    """One half's assignment stands, the larger one's where they differ; the others hear that they are out."""
    network = Network(count, loss=0.2, seed=seed)
    network.run(1.0)
    one = group & network.nodes.keys()
    two = network.nodes.keys() - one
    network.radio.cut("ridge", one)
    network.run(away_s)
    network.radio.mend("ridge")
    network.run(12.0)
    trees = [node.tree for node in network.live]
    assert all(tree.slots == trees[0].slots and tree.order == trees[0].order for tree in trees)
    assert problems(trees[0].slots, network.nodes[1].layout) == []
    if away_s > 5.0 * count + 5.0:  # long enough for both to have found out about everybody
        larger = max(one, two, key=len)
        assert len(one) == len(two) or trees[0].slots.keys() == larger


@settings(max_examples=15, deadline=None)
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
    return {node.tree.survey for node in network.live}


@pytest.mark.parametrize("seed", range(6))
def test_two_starts_at_once_become_one_survey(seed: int) -> None:
    """Two operators: some drones heard the one first, some the other, and the radio loses a third."""
    network = Network(7, loss=0.3, seed=seed)
    chance = random.Random(seed)
    for drone, node in network.nodes.items():
        node.tree.begin(0.0, "one" if chance.random() < 0.5 else "other", START)
        assert drone in node.tree.slots
    network.run(15.0)
    assert len(surveys(network)) == 1
    network.agreed()


@pytest.mark.parametrize("late", [1, 4])
def test_who_starts_late_joins_the_survey_that_flies(late: int) -> None:
    """The first start did not reach it (or its agent was restarted): the operator gave another."""
    network = Network(5)
    network.nodes[late].tree = Node(late, tuple(network.nodes)).tree
    network.nodes[late].phase = Phase.DISARMED
    network.run(2.0)
    network.nodes[late].phase = Phase.ARMING
    network.nodes[late].tree.begin(network.now_s, "survey-2", START)
    network.run(3.0)
    assert len(surveys(network)) == 1
    assert network.nodes[2].tree.order is not None
    network.agreed()


def test_who_was_counted_out_of_the_survey_that_flies_is_told_so() -> None:
    network = Network(5)
    network.dead = {4}
    network.run(60.0)
    back = network.nodes[4] = Node(4, tuple(network.nodes))
    back.phase = Phase.DISARMED
    network.dead = set()
    network.run(3.0)
    assert back.tree.shut_out
    assert back.tree.survey is None
    for node in network.live:
        node.phase = Phase.RETURNING
    network.run(4.0)
    assert not back.tree.shut_out, "they are on their way home: the next survey can be started"


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
        network.nodes[drone].tree.begin(network.now_s, "survey-2", START)
        network.run(1.5)
    assert surveys(network) == {"survey-2"}
    order = network.agreed() and network.nodes[3].tree.order
    assert order is not None
    assert order.sequence == 1
