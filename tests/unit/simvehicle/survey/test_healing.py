"""How long healing took, from what the launcher heard of swarms whose times are known."""

from __future__ import annotations

import math
from collections.abc import Iterable

import msgspec
import pytest

from flightstack.swarm import topics
from flightstack.swarm.wire import DroneState, MemberRegister, Phase, TableState
from mission.geometry.formation import make_layout
from mission.strategies.contract import Order, Stage
from mission.tree.slot_registers import configured
from simvehicle.survey.agent_faults import Freeze
from simvehicle.survey.healing import Failure, Healing, Rejoin, failures, healings, rejoins
from simvehicle.survey.watch import (
    Log,
    OrderMark,
    PhaseMark,
    SlotMark,
    StandingMark,
    SurveyWatch,
    WatchStanding,
)

LAYOUT = make_layout("hexagonal", 10.0)
START = tuple(SlotMark(0.0, drone, drone - 1, False) for drone in range(1, 10))
"""Nine drones in the slots 0 to 8; 7 and 8 hang below 1, 1 to 6 below 0."""


def standing(drone: int, doubted_s: float, gone_s: float) -> tuple[StandingMark, ...]:
    return StandingMark(doubted_s, drone, WatchStanding.DOUBTED), StandingMark(
        gone_s, drone, WatchStanding.GONE
    )


def healed(log: Log, *failed: Failure) -> list[tuple[float | None, float | None, float | None]]:
    return [
        (one.noticed_after_s, one.agreed_after_s, one.flown_after_s) for one in healings(log, failed, LAYOUT)
    ]


def test_a_heal_in_its_three_parts() -> None:
    """The drone in slot 1 dies; its heir comes from slot 7."""
    slots = (*START, SlotMark(62.0, 8, 1, True), SlotMark(70.5, 8, 1, False))
    log = Log(slots=slots, standings=standing(2, 60.9, 61.5))
    assert healed(log, Failure(2, "killed", 60.0)) == [
        (pytest.approx(0.9), pytest.approx(1.1), pytest.approx(8.5))
    ]


def test_for_a_leaf_nobody_flies() -> None:
    log = Log(slots=START, standings=standing(9, 60.75, 61.25))
    assert healed(log, Failure(9, "killed", 60.0)) == [(0.75, 0.5, 0.0)]


def test_who_was_on_the_way_before_is_not_waited_for() -> None:
    slots = (*START, SlotMark(55.0, 6, 5, True), SlotMark(70.0, 6, 5, False))
    log = Log(slots=slots, standings=standing(9, 60.75, 61.25))
    assert healed(log, Failure(9, "killed", 60.0)) == [(0.75, 0.5, 0.0)]


def test_losses_that_overlap_end_together_and_the_dead_hold_nothing() -> None:
    """Root and heir: the root's slot goes to slot 2's drone only once the heir in slot 1 is counted out, too."""
    slots = (
        *START,
        SlotMark(62.0, 2, 0, True),
        SlotMark(62.0, 8, 1, True),
        SlotMark(64.0, 3, 0, True),
        SlotMark(66.0, 8, 1, False),
        SlotMark(68.0, 3, 0, False),
    )
    log = Log(slots=slots, standings=(*standing(1, 61.0, 61.5), *standing(2, 63.0, 63.5)))
    root, heir = healed(log, Failure(1, "killed", 60.0), Failure(2, "killed", 62.5))
    assert root == (1.0, 1.0, 6.0), "whole for a moment, with the heir that died on its way"
    assert heir == (0.5, 1.0, 4.0)


def test_what_the_survey_did_not_come_to() -> None:
    failure = Failure(2, "killed", 60.0)
    assert healed(Log(slots=START), failure) == [(None, None, None)]
    doubted = Log(slots=START, standings=standing(2, 61.0, 61.5)[:1])
    assert healed(doubted, failure) == [(1.0, None, None)]
    open_hole = Log(slots=START, standings=standing(2, 61.0, 61.5))
    assert healed(open_hole, failure) == [(1.0, None, None)]
    on_the_way = Log(slots=(*START, SlotMark(62.0, 8, 1, True)), standings=standing(2, 61.0, 61.5))
    assert healed(on_the_way, failure) == [(1.0, 1.0, None)]


def test_who_is_woken_before_it_is_missed_is_not_healed_around() -> None:
    log = Log(slots=START, standings=standing(9, 63.0, 64.0))
    assert healed(log, Failure(9, "frozen", 60.0, 62.0)) == [(None, None, None)]


def test_every_kind_of_loss_in_order() -> None:
    phases = (PhaseMark(80.0, 3, Phase.CRASHED), PhaseMark(81.0, 3, Phase.CRASHED))
    log = Log(phases=phases, died={1: 60.3, 5: 70.0})
    assert failures(log, {1: 60.0}.items(), (Freeze(6, 90.0, 130.0), Freeze(7, 20.0))) == [
        Failure(7, "frozen", 20.0),
        Failure(1, "killed", 60.0),
        Failure(5, "died", 70.0),
        Failure(3, "crashed", 80.0),
        Failure(6, "frozen", 90.0, 130.0),
    ]


def test_who_comes_back_takes_a_slot_and_flies_there() -> None:
    back = StandingMark(131.0, 6, WatchStanding.THERE)
    slots = (
        *START,
        SlotMark(130.5, 6, None, False),
        SlotMark(131.5, 6, 7, True),
        SlotMark(141.0, 6, 7, False),
    )
    log = Log(slots=slots, standings=(*standing(6, 91.0, 91.5), back))
    assert rejoins(log, [Freeze(6, 90.0, 130.0)]) == (Rejoin(6, 7, 130.0, 131.5, 141.0),)
    assert rejoins(log, ()) == (Rejoin(6, 7, None, 131.5, 141.0),)


def test_who_was_counted_out_and_kept_its_slot_is_back_at_once() -> None:
    log = Log(slots=START, standings=(*standing(9, 91.0, 91.5), StandingMark(95.0, 9, WatchStanding.THERE)))
    assert rejoins(log, ()) == (Rejoin(9, 8, None, 95.0, 95.0),)


def test_who_wakes_and_leaves_at_once_is_back_when_it_comes_back() -> None:
    """Its vehicle was brought home meanwhile: it is started again, at first as a survey of its own."""
    slots = (
        *START,
        SlotMark(130.4, 6, None, False),
        SlotMark(135.8, 6, 5, True),
        SlotMark(136.8, 6, None, False),
        SlotMark(147.4, 6, 5, True),
        SlotMark(157.0, 6, 5, False),
    )
    standings = (
        *standing(6, 91.0, 91.5),
        StandingMark(130.4, 6, WatchStanding.THERE),
        StandingMark(130.5, 6, WatchStanding.GONE),
        StandingMark(147.3, 6, WatchStanding.THERE),
    )
    assert rejoins(Log(slots=slots, standings=standings), ()) == (Rejoin(6, 5, None, 147.4, 157.0),)


def test_who_is_counted_in_again_when_the_survey_is_over_has_not_rejoined() -> None:
    orders = (OrderMark(100.0, Order(9, Stage.FOUND, (0.0, 0.0, -10.0), 0.0)),)
    standings = (*standing(9, 99.0, 99.5), StandingMark(100.1, 9, WatchStanding.THERE))
    assert rejoins(Log(slots=START, standings=standings, orders=orders), ()) == ()


def test_a_doubt_that_is_refuted_is_no_return() -> None:
    doubted = StandingMark(91.0, 6, WatchStanding.DOUBTED), StandingMark(91.4, 6, WatchStanding.THERE)
    assert rejoins(Log(slots=START, standings=doubted), ()) == ()
    gone_home = Log(
        slots=(*START, SlotMark(90.0, 6, None, False)),
        standings=(*standing(6, 91.0, 91.5), StandingMark(95.0, 6, WatchStanding.THERE)),
    )
    assert rejoins(gone_home, ()) == (), "it takes part in nothing"


@pytest.mark.parametrize(
    ("healing", "words"),
    [
        (
            Healing(1, "killed", 60.04, 0.9, 0.5, 8.5),
            "drone 1 killed at 60 s, noticed after 0.9 s, agreed after 0.5 s, flown after 8.5 s",
        ),
        (Healing(1, "frozen", 60.0), "drone 1 frozen at 60 s, not noticed before the end"),
        (
            Healing(1, "died", 60.0, 1.0),
            "drone 1 died at 60 s, noticed after 1.0 s, not agreed before the end",
        ),
        (
            Rejoin(6, 7, 130.0, 131.5, 141.0),
            "drone 6 back in the swarm 1.5 s after it was woken, in slot 7, there 9.5 s later",
        ),
        (
            Rejoin(6, 7, None, 131.5, None),
            "drone 6 back in the swarm at 132 s, in slot 7, not there before the end",
        ),
    ],
)
def test_words(healing: Healing | Rejoin, words: str) -> None:
    assert healing.words == words


# -- what the watch makes of the messages ---------------------------------------------------------------------------


class Heard:
    """A watch of three drones and what they tell it."""

    def __init__(self) -> None:
        self.watch = SurveyWatch([1, 2, 3])

    def table(
        self,
        now_s: float,
        sender: int,
        members: Iterable[tuple[int, MemberRegister]],
        absent: tuple[int, ...] = (),
        survey: str = "s",
    ) -> None:
        slots = tuple(configured((1, 2, 3)).items())
        told = TableState(sender, 1, 1, 7, survey, slots, tuple(members), absent)
        self.watch.hear(now_s, topics.TABLE, topics.TABLE.codec.encode(told))

    def state(self, now_s: float, phase: Phase, slot: int | None, *, healing: bool = False) -> None:
        told = DroneState(
            1, 1, 1, 7, phase, (0.0, 0.0, -10.0), None, None, None, True, True, "GUIDED", None, None, None, None, 0,
            slot, None, healing, None,
        )  # fmt: skip
        self.watch.hear(now_s, topics.STATE, topics.STATE.codec.encode(told))

    @property
    def standings(self) -> list[tuple[float, int, str]]:
        # No drone took off: the log's times count from the first mark of a phase, which is at 0.
        return [(m.time_s, m.drone, m.standing.value) for m in self.watch.log().standings]


def test_who_holds_which_slot_is_what_one_says_that_holds_one() -> None:
    """A drone that was started again knows of nobody who was lost before."""
    heard = Heard()
    heard.table(1.0, 1, ())
    heard.table(2.0, 1, [(2, MemberRegister(0, 0)), (3, MemberRegister(0, 0))], absent=(2, 3))
    heard.table(3.0, 3, [(3, MemberRegister(0, -1, 0))], absent=(3,))
    assert [mark.slots for mark in heard.watch.log().trees] == [{1: 0, 2: 1, 3: 2}, {1: 0}]


def test_a_member_is_doubted_counted_out_and_there_again_whoever_says_it() -> None:
    heard = Heard()
    heard.table(1.0, 1, ())
    heard.table(2.0, 1, [(3, MemberRegister(0, 0))])
    heard.table(2.2, 2, [(3, MemberRegister(0, 0))])
    heard.table(2.6, 2, [(3, MemberRegister(0, 0))], absent=(3,))
    heard.table(2.7, 1, [(3, MemberRegister(0, 0))])
    heard.table(9.0, 3, [(3, MemberRegister(1, 0))])
    heard.table(9.1, 1, [(3, MemberRegister(0, 0))], absent=(3,))
    assert heard.standings == [(2.0, 3, "doubted"), (2.6, 3, "gone"), (9.0, 3, "there")]


def test_who_leaves_by_its_own_word_is_gone_at_once() -> None:
    heard = Heard()
    heard.table(5.0, 3, [(3, MemberRegister(0, -1, 0))], absent=(3,))
    assert heard.standings == [(5.0, 3, "gone")]


def test_a_survey_that_was_started_anew_has_other_members() -> None:
    heard = Heard()
    heard.table(1.0, 1, [(3, MemberRegister(4, 4))], absent=(3,))
    heard.table(2.0, 1, (), survey="t")
    assert heard.standings == [(1.0, 3, "gone"), (2.0, 3, "there")]


def test_who_starts_late_has_a_survey_of_its_own_which_is_not_the_swarms() -> None:
    heard = Heard()
    heard.table(1.0, 1, [(3, MemberRegister(0, 0))])
    heard.table(1.1, 2, [(3, MemberRegister(0, 0))], absent=(3,))
    heard.table(9.0, 3, [(1, MemberRegister(0, 0)), (3, MemberRegister())], absent=(1,), survey="late")
    heard.table(9.1, 1, [(3, MemberRegister(0, 0))], absent=(3,))
    heard.table(10.0, 3, [(3, MemberRegister(1, 0))])
    assert heard.standings == [(1.0, 3, "doubted"), (1.1, 3, "gone"), (10.0, 3, "there")]


def test_a_slot_is_marked_when_it_changes_and_while_it_is_flown_to() -> None:
    heard = Heard()
    for now_s, phase, slot, healing in (
        (0.0, Phase.FORMING, 2, False),
        (1.0, Phase.SEARCHING, 2, False),
        (2.0, Phase.SEARCHING, 2, False),
        (3.0, Phase.HOLDING, 0, True),
        (4.0, Phase.SEARCHING, 0, False),
        (5.0, Phase.RETURNING, 0, False),
    ):
        heard.state(now_s, phase, slot, healing=healing)
    assert [(m.time_s, m.slot, m.moving) for m in heard.watch.log().slots] == [
        (0.0, 2, True),
        (1.0, 2, False),
        (3.0, 0, True),
        (4.0, 0, False),
        (5.0, None, False),
    ]


def test_marks_count_from_the_first_take_off() -> None:
    heard = Heard()
    heard.watch.first_takeoff_s = 50.0
    heard.state(60.0, Phase.SEARCHING, 0)
    heard.table(61.0, 1, [(3, MemberRegister(0, 0))])
    heard.watch.died(62.0, 3)
    log = heard.watch.log()
    assert (log.slots[0].time_s, log.standings[0].time_s, log.died) == (10.0, 11.0, {3: 12.0})
    assert msgspec.json.decode(msgspec.json.encode(log), type=Log) == log
    assert math.isinf(Failure(1, "died", 1.0).until_s)
