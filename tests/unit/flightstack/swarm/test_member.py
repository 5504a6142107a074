"""One drone's part in its swarm: what it makes of what it hears."""

from __future__ import annotations

import msgspec
import pytest

from flightstack.swarm import topics
from flightstack.swarm.member import SwarmMember, SwarmView
from flightstack.swarm.parting import Part
from flightstack.swarm.topics import Received
from flightstack.swarm.wire import (
    Command,
    CommandName,
    DroneState,
    GroundBeat,
    OrderState,
    Phase,
    Severity,
    TableState,
    Traffic,
    TrafficVehicle,
)
from mission.geometry.formation import make_layout
from mission.strategies.contract import Decision, Hold, Order, Stage
from mission.tree.slot_registers import configured

FRAME = 77
ANCHOR = (0.0, 0.0, -10.0)
LAYOUT = make_layout("hexagonal", 10.0)
STATE = DroneState(
    2, 1, 1, FRAME, Phase.SEARCHING, (1.0, 2.0, -10.0), (0.5, 0.0, 0.0), 0.0, None, True, True, "GUIDED", 0.9,
    450.0, None, None, 0, 1, 1, False, None,
)  # fmt: skip


def sent(content: object, sender: str) -> Received:
    topic = next(t for t in topics.TOPICS.values() if t.codec.kind is type(content))
    return Received(topic, sender, topic.codec.encode(content))


class Ears:
    """A drone's part in a swarm of three, fed with what the others say."""

    def __init__(self, drone: int = 1) -> None:
        self.member = SwarmMember(
            drone,
            (1, 2, 3),
            LAYOUT,
            frame_identity=FRAME,
            incarnation=5,
            suspect_after_s=0.8,
            lost_after_s=3.0,
            tick_s=0.1,
        )
        self.now_s = 10.0
        self.sequence = 0
        self.phase = Phase.SEARCHING

    def hear(self, *contents: tuple[object, str], decision: Decision | None = None) -> SwarmView:
        self.now_s += 0.1
        received = [sent(*content) for content in contents]
        return self.member.step(self.now_s, received, self.phase, decision, ANCHOR)

    def states(self, *drones: int, phase: Phase = Phase.SEARCHING) -> list[tuple[object, str]]:
        self.sequence += 1
        return [
            (msgspec.structs.replace(STATE, sender=d, sequence=self.sequence, phase=phase), str(d))
            for d in drones
        ]


@pytest.fixture
def ears() -> Ears:
    return Ears()


def test_every_kind_of_message_finds_its_way(ears: Ears) -> None:
    command = Command("c1", "ground", 0, CommandName.START)
    orphan = TrafficVehicle(3, (40.0, 0.0, -10.0), (0.0, 0.0, 0.0), 0.5)
    view = ears.hear(
        *ears.states(2),
        (command, "ground"),
        (Traffic("ground", FRAME, (orphan,)), "ground"),
        (GroundBeat("ground", 1), "ground"),
    )
    assert view.commands == (command,)
    assert [(n.drone, n.adrift) for n in view.neighbours] == [(2, False), (3, True)]
    assert view.ground_heard_s == ears.now_s
    assert (view.refused, view.news) == ((), ())


def test_before_a_survey_everybody_has_the_slot_of_the_configuration_and_no_order(ears: Ears) -> None:
    view = ears.hear()
    assert (view.place.slot, view.place.root, view.order, view.slot_ned_m) == (0, 1, None, None)


def test_an_order_tells_where_the_own_slot_is() -> None:
    ears = Ears(2)
    ears.hear()
    ears.member.begin(ears.now_s, "survey", ANCHOR)
    order = Order(3, Stage.SEARCH, (50.0, 20.0, -10.0), 0.0)
    claims = tuple(configured((1, 2, 3)).items())
    table = TableState(1, 1, 1, FRAME, "survey", claims, (), ())
    ordered = OrderState(1, 1, 1, FRAME, "survey", order, claims[0][1])
    view = ears.hear(*ears.states(1), (table, "1"), (ordered, "1"))
    north_m, east_m = LAYOUT.offset_m(1)
    assert view.order == order
    assert view.slot_ned_m == pytest.approx((50.0 + north_m, 20.0 + east_m, -10.0))


def test_the_roots_own_decision_is_the_swarms_order(ears: Ears) -> None:
    ears.hear()
    ears.member.begin(ears.now_s, "survey", ANCHOR)
    order = Order(2, Stage.SEARCH, (5.0, 0.0, -10.0), 0.0)
    assert ears.hear(decision=Decision(Hold(), order=order)).order == order


def test_a_lost_peer_is_healed_around_and_told_of(ears: Ears) -> None:
    ears.hear(*ears.states(2, 3))
    ears.member.begin(ears.now_s, "survey", ANCHOR)
    ears.hear(*ears.states(2, 3))
    news = []
    for _ in range(60):
        view = ears.hear(*ears.states(2))
        news += view.news
    assert [(note.code, note.text) for note in news] == [
        ("lost", "drone 3 lost to the swarm"),
        ("heal", "slots: 1 in 0, 2 in 1"),
    ]
    assert view.place.slots == {1: 0, 2: 1}
    assert not view.moved, "the root keeps its slot"


def test_an_heir_is_told_that_it_has_to_move() -> None:
    ears = Ears(3)
    ears.hear(*ears.states(1, 2))
    ears.member.begin(ears.now_s, "survey", ANCHOR)
    ears.hear(*ears.states(1, 2))
    views = [ears.hear(*ears.states(2)) for _ in range(60)]
    heal = next(index for index, view in enumerate(views) if view.moved)
    assert views[heal].place.slot == 0
    assert [view.moved for view in views].count(True) == 1


def test_while_another_flies_to_its_new_slot_the_swarm_is_healing(ears: Ears) -> None:
    ears.hear()
    ears.member.begin(ears.now_s, "survey", ANCHOR)
    ((state, sender),) = ears.states(2)
    assert ears.hear((msgspec.structs.replace(state, healing=True), sender)).place.healing
    assert not ears.hear(*ears.states(2)).place.healing


def test_a_swarm_that_comes_apart_has_a_smaller_part(ears: Ears) -> None:
    ears.hear(*ears.states(2, 3))
    assert ears.hear().part is Part.WHOLE
    for _ in range(29):
        ears.hear()
    assert ears.hear().part is Part.SMALLER


def test_who_stood_still_does_not_take_that_for_a_swarm_come_apart(ears: Ears) -> None:
    ears.hear(*ears.states(2, 3))
    ears.now_s += 8.0
    assert ears.hear().part is Part.WHOLE
    for _ in range(29):
        assert ears.hear().part is Part.WHOLE
    assert [ears.hear().part for _ in range(3)][-1] is Part.SMALLER, "they do not speak now, either"


def test_what_is_not_believed_is_told_once_and_changes_nothing(ears: Ears) -> None:
    foreign = (msgspec.structs.replace(STATE, frame=1), "2")
    view = ears.hear(foreign)
    assert [(note.severity, note.code) for note in view.refused] == [(Severity.WARNING, "peer")]
    assert view.neighbours == ()
    assert ears.hear(foreign).refused == ()


@pytest.mark.parametrize(("ticks", "second"), [(500, True), (99, False), (100, True)])
def test_of_two_agents_of_one_drone_that_which_runs_longer_comes_first(
    ears: Ears, ticks: int, second: bool
) -> None:
    assert not ears.member.comes_second(100)
    ears.hear((msgspec.structs.replace(STATE, sender=1, incarnation=9, ticks=ticks), "1"))
    assert ears.member.comes_second(100) is second


def test_the_root_begins_a_survey_with_the_order_to_form_up(ears: Ears) -> None:
    ears.hear()
    ears.member.begin(ears.now_s, "survey", ANCHOR)
    assert ears.hear().order == Order(1, Stage.FORM, ANCHOR, 0.0)
