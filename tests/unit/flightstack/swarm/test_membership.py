"""Who takes part: suspicion, refutation, loss, departure, return, and members that lie."""

from __future__ import annotations

from collections.abc import Mapping

from hypothesis import given
from hypothesis import strategies as st

from flightstack.swarm.membership import (
    JOIN_S,
    OBJECTION_S,
    SETTLE_S,
    STEADY_SUPPORT_S,
    TOLD_SETTLE_S,
    MemberRegisters,
    Membership,
    Standing,
    merge_members,
)
from flightstack.swarm.peers import PeerFacts
from flightstack.swarm.wire import NEVER, MemberRegister
from mission.tree.slot_registers import STRIDE

SUSPECT_S = 0.8
TICK_S = 0.1
MEMBERS = (1, 2, 3, 4)

COUNTERS = st.tuples(st.integers(0, 5), st.integers(NEVER, 5), st.integers(NEVER, 5)).map(
    lambda told: MemberRegister(told[0], min(told[1], told[0]), min(told[2], told[0]))
)
TOLD = st.dictionaries(st.sampled_from(MEMBERS), COUNTERS)


def membership(drone: int, *, takes_part: bool = True) -> Membership:
    return Membership(drone, MEMBERS, suspect_after_s=SUSPECT_S, takes_part=takes_part)


def facts(heard_s: float, *, taking_part: bool = True, incarnation: int = 7) -> PeerFacts:
    return PeerFacts(heard_s, taking_part, False, (0.0, 0.0, -10.0), incarnation)


class Ears:
    """One drone that hears the others, each as long as it speaks."""

    def __init__(self, drone: int, watched: tuple[int, ...] = (1, 2, 3)) -> None:
        self.knows = membership(drone)
        self.watched = watched
        self.heard: dict[int, PeerFacts] = {}
        self.now_s = 0.0
        self.lost: list[int] = []

    def run(self, seconds: float, speaking: Mapping[int, PeerFacts] | tuple[int, ...]) -> None:
        for _ in range(round(seconds / TICK_S)):
            self.now_s = round(self.now_s + TICK_S, 3)
            for drone in speaking:
                said = speaking[drone] if isinstance(speaking, Mapping) else facts(0.0)
                self.heard[drone] = facts(
                    self.now_s, taking_part=said.taking_part, incarnation=said.incarnation
                )
            self.lost += self.knows.step(self.now_s, self.heard, self.watched)


def test_whoever_is_missed_is_suspected_and_only_then_lost() -> None:
    ears = Ears(4)
    ears.run(2.0, (1, 2, 3))
    ears.run(SUSPECT_S, (1, 3))
    assert ears.knows.standing(2) is Standing.ALIVE
    ears.run(TICK_S, (1, 3))
    assert ears.knows.standing(2) is Standing.SUSPECTED
    assert ears.knows.present == {1, 2, 3, 4}
    ears.run(SETTLE_S + TICK_S, (1, 3))
    assert ears.knows.standing(2) is Standing.LOST
    assert ears.knows.present == {1, 3, 4}
    ears.run(5.0, (1, 3))
    assert ears.lost == [2]


def test_one_that_nobody_watches_is_not_suspected() -> None:
    ears = Ears(4, watched=(1,))
    ears.run(2.0, (1, 2, 3))
    ears.run(5.0, (1,))
    assert ears.knows.present == {1, 2, 3, 4}


def test_a_refuted_suspicion_moves_nobody() -> None:
    """Drone 4 does not hear drone 2, but 2 hears of it by another way, again and again."""
    ears, other = Ears(4), membership(2)
    ears.run(2.0, (1, 2, 3))
    for _ in range(100):
        ears.run(TICK_S, (1, 3))
        other.merge(ears.knows.registers)
        ears.knows.merge(other.registers)
        assert 2 in ears.knows.present
    assert ears.lost == []
    assert other.registers[2].life > 2


def test_a_suspicion_told_by_others_counts_after_the_settle_time_too() -> None:
    ears = Ears(4, watched=())
    ears.run(1.0, (1, 2, 3))
    ears.run(SUSPECT_S, (1, 2))
    ears.knows.merge({3: MemberRegister(0, 0)})
    ears.run(TOLD_SETTLE_S, (1, 2))
    assert ears.knows.standing(3) is Standing.SUSPECTED
    ears.run(TICK_S, (1, 2))
    assert ears.lost == [3]


def test_who_heard_the_suspected_one_of_late_waits_until_it_misses_it_too() -> None:
    ears = Ears(4, watched=())
    ears.run(1.0, (1, 2, 3))
    ears.knows.merge({3: MemberRegister(0, 0)})
    ears.run(SUSPECT_S, (1, 2))
    assert ears.knows.standing(3) is Standing.SUSPECTED
    ears.run(2 * TICK_S, (1, 2))
    assert ears.lost == [3]


def test_whoever_is_heard_has_longer_to_refute_but_not_for_ever() -> None:
    """It speaks, and hears nobody: it never learns of the suspicion."""
    ears = Ears(4, watched=())
    ears.run(1.0, (1, 2, 3))
    ears.knows.merge({3: MemberRegister(0, 0)})
    ears.run(OBJECTION_S, (1, 2, 3))
    assert ears.knows.standing(3) is Standing.SUSPECTED
    ears.run(TICK_S, (1, 2, 3))
    assert ears.lost == [3]


def test_one_that_was_lost_takes_part_again_with_its_next_life() -> None:
    ears, other = Ears(4), membership(2)
    ears.run(2.0, (1, 2, 3))
    ears.run(3.0, (1, 3))
    assert ears.knows.standing(2) is Standing.LOST
    other.merge(ears.knows.registers)
    ears.knows.merge(other.registers)
    assert ears.knows.standing(2) is Standing.ALIVE
    ears.run(3.0, (1, 3))
    assert ears.lost == [2, 2]


def test_one_that_says_that_it_leaves_is_not_waited_for_and_may_return() -> None:
    leaver, other = membership(2), membership(4)
    leaver.leave()
    other.merge(leaver.registers)
    assert other.standing(2) is Standing.LEFT
    assert leaver.present == other.present == {1, 3, 4}
    leaver.merge(other.registers)
    assert leaver.standing(2) is Standing.LEFT
    leaver.rejoin()
    other.merge(leaver.registers)
    assert leaver.present == other.present == {1, 2, 3, 4}


def test_one_that_comes_late_has_left_until_it_says_that_it_joins() -> None:
    late, other = membership(3, takes_part=False), membership(1)
    other.merge({3: MemberRegister(8, 8, 6)})
    assert 3 not in late.present
    late.merge(other.registers)
    assert late.standing(3) is Standing.LEFT
    late.rejoin()
    other.merge(late.registers)
    assert other.standing(3) is Standing.ALIVE


def test_a_state_that_does_not_take_part_announces_departure() -> None:
    ears = Ears(4)
    ears.run(1.0, (1, 2, 3))
    ears.run(TICK_S, {1: facts(0.0), 2: facts(0.0, taking_part=False)})
    assert ears.knows.standing(2) is Standing.LEFT
    assert ears.lost == []


def test_what_a_drone_said_before_its_return_was_told_does_not_send_it_away_again() -> None:
    ears = Ears(4)
    ears.run(1.0, (1, 2, 3))
    ears.run(TICK_S, {2: facts(0.0, taking_part=False)})
    ears.knows.merge({2: MemberRegister(1, NEVER, 0)})
    ears.run(TICK_S, (1, 3))
    assert ears.knows.standing(2) is Standing.ALIVE
    ears.run(TICK_S, {2: facts(0.0, taking_part=False)})
    assert ears.knows.standing(2) is Standing.LEFT


def test_one_that_has_not_armed_yet_is_waited_for_but_not_for_ever() -> None:
    ears = Ears(4)
    waiting = {1: facts(0.0), 2: facts(0.0, taking_part=False), 3: facts(0.0)}
    ears.run(JOIN_S - 1.0, waiting)
    assert ears.knows.present == {1, 2, 3, 4}
    ears.run(2.0, waiting)
    assert ears.knows.present == {1, 3, 4}


def test_one_that_is_never_heard_is_waited_for_as_long() -> None:
    ears = Ears(4)
    ears.run(JOIN_S - 1.0, (1, 2))
    assert ears.knows.standing(3) is Standing.ALIVE
    ears.run(3.0, (1, 2))
    assert ears.lost == [3]


def test_an_agent_that_was_started_anew_has_left() -> None:
    ears = Ears(4)
    ears.run(1.0, (1, 2, 3))
    ears.run(TICK_S, {2: facts(0.0, incarnation=8)})
    assert ears.knows.standing(2) is Standing.LEFT


def test_nobody_counts_itself_out_by_what_others_say() -> None:
    knows = membership(1)
    knows.rejoin()
    knows.merge({1: MemberRegister(3, 3, 2)})
    assert knows.registers[1] == MemberRegister(4, 3, 2)
    assert knows.standing(1) is Standing.ALIVE


def test_one_on_the_ground_that_was_counted_out_waits_until_it_flies() -> None:
    knows = membership(1)
    knows.merge({1: MemberRegister(3, NEVER, 3)})
    assert knows.standing(1) is Standing.LEFT
    knows.merge({1: MemberRegister(4, 4, 3)})
    assert knows.standing(1) is Standing.LEFT
    knows.rejoin()
    assert knows.standing(1) is Standing.ALIVE


def test_a_lie_of_great_lives_is_refuted_and_uses_up_no_numbers() -> None:
    knows, other = membership(1), membership(2)
    knows.rejoin()
    lie = {1: MemberRegister(1 << 30, 1 << 31, 1 << 31), 99: MemberRegister(1, 1)}
    for turn in range(1, 5):
        knows.merge(lie)
        other.merge(lie)
        other.merge(knows.registers)
        assert other.standing(1) is Standing.ALIVE
        assert knows.registers[1].life <= turn * (STRIDE + 1)
    assert 99 not in knows.registers


def test_support_is_what_was_heard_steadily() -> None:
    ears = Ears(1, watched=())
    ears.run(6.0, (2, 3, 4))
    assert ears.knows.support == 4
    ears.run(4.0, ())
    assert ears.knows.support == 1
    ears.run(STEADY_SUPPORT_S - 1.0, (2, 3, 4))
    assert ears.knows.support == 1
    ears.run(2.0, (2, 3, 4))
    assert ears.knows.support == 4


@given(TOLD, TOLD, TOLD)
def test_merging_knows_no_order_and_no_repetition(
    a: MemberRegisters, b: MemberRegisters, c: MemberRegisters
) -> None:
    assert merge_members(a, b) == merge_members(b, a)
    assert merge_members(merge_members(a, b), c) == merge_members(a, merge_members(b, c))
    assert merge_members(merge_members(a, b), b) == merge_members(a, b)


@given(st.lists(TOLD, max_size=5), st.permutations(MEMBERS))
def test_all_know_the_same_in_the_end_whatever_was_said(
    said: list[MemberRegisters], order: list[int]
) -> None:
    """Everybody takes part and hears everything at last: then everybody is present to everybody."""
    everybody = {drone: membership(drone) for drone in order}
    for knows in everybody.values():
        knows.rejoin()
    for turn, told in enumerate(said):
        everybody[order[turn % len(order)]].merge(told)
    for _ in range(3):
        for knows in everybody.values():
            for other in everybody.values():
                knows.merge(other.registers)
    assert len({knows.digest for knows in everybody.values()}) == 1
    assert all(knows.present == set(MEMBERS) for knows in everybody.values())


def test_who_stood_still_has_heard_nobody_steadily() -> None:
    """It wakes with everybody's words in its ears, and must not displace who took its slot meanwhile."""
    membership = Membership(1, (1, 2, 3), suspect_after_s=0.8)
    for tick in range(100):
        now_s = 0.1 * tick
        membership.step(now_s, {d: PeerFacts(now_s, True, False, None) for d in (2, 3)}, ())
    assert membership.support == 3
    supports = []
    for tick in range(60):
        now_s = 30.0 + 0.1 * tick
        membership.step(now_s, {d: PeerFacts(now_s, True, False, None) for d in (2, 3)}, ())
        supports.append(membership.support)
    assert supports[:50] == [1] * 50
    assert supports[-1] == 3


def test_who_stood_still_misses_nobody_for_it() -> None:
    """It wakes a moment before the first words come."""
    membership = Membership(1, (1, 2, 3), suspect_after_s=0.8)
    silent = {d: PeerFacts(5.0, True, False, None) for d in (2, 3)}
    membership.step(5.0, silent, (2, 3))
    assert membership.step(30.0, silent, (2, 3)) == ()
    assert {d: membership.standing(d) for d in (2, 3)} == {2: Standing.ALIVE, 3: Standing.ALIVE}
    for tick in range(1, 30):
        membership.step(30.0 + 0.1 * tick, silent, (2, 3))
    assert membership.present == {1}, "but those who do not speak then"


def test_one_whose_word_comes_by_others_only_is_doubted_ever_more_rarely_and_never_counted_out() -> None:
    """Drone 4 does not hear drone 2, whose answers come by way of the others, late."""
    ears, other = Ears(4), membership(2)
    ears.run(2.0, (1, 2, 3))
    lives: list[int] = []
    for _ in range(60):
        ears.run(SETTLE_S - TICK_S, (1, 3))
        other.merge(ears.knows.registers)
        ears.knows.merge(other.registers)
        lives.append(other.registers[2].life if 2 in other.registers else 0)
    assert ears.lost == []
    assert lives[19] >= 2
    assert lives[-1] - lives[-20] <= 1, "it is asked once in six seconds"
    ears.run(2.0, (1, 2, 3))
    ears.run(SUSPECT_S + SETTLE_S + 2.0 * TICK_S, (1, 3))
    assert ears.lost == [2], "heard again it is missed as soon as any other"
