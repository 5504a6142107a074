"""Every stage of a survey has an end: for one drone alone, and for the swarm by its root's order."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightstack.config import LimitsConfig, StagesConfig
from flightstack.flight.stage_bounds import ROOT_LATE_S, StageBounds, StageEnd, ended, returning_bound_s
from flightstack.flight.transitions import IN_FORMATION, IN_THE_AIR
from flightstack.swarm.news import Note
from flightstack.swarm.wire import Phase, Severity
from mission.geometry.frames import Geodetic, LocalFrame
from mission.geometry.geofence import Circle, Geofence, LocalFence
from mission.strategies.contract import Decision, Hold, Order, Stage

TICK_S = 0.5
NOTHING = StageEnd()
ANCHOR = (3.0, 4.0, -10.0)


def bounds(**stages: Any) -> StageBounds:
    return StageBounds(LimitsConfig(stages=StagesConfig(**stages)), None)


def order(stage: Stage, sequence: int = 7) -> Order:
    return Order(sequence, stage, ANCHOR, 0.5, note=b"note", apart=True)


class Count:
    """Steps the bounds of one drone and gathers what comes out."""

    def __init__(self, counted: StageBounds, *, root: bool = False) -> None:
        self.bounds = counted
        self.now_s = 50.0
        self.notes: list[Note] = []
        self._root = root

    def run(self, seconds: float, phase: Phase, stage: Stage | None = None) -> StageEnd:
        end = NOTHING
        for _ in range(round(seconds / TICK_S)):
            self.now_s += TICK_S
            end = self.bounds.step(self.now_s, phase, order(stage) if stage else None)
            self.notes += self.bounds.notes(root=self._root)
        return end


def test_a_drone_that_does_not_get_to_its_slot_goes_home() -> None:
    count = Count(bounds(forming_s=60.0))
    assert count.run(60.0, Phase.FORMING, Stage.FORM) == NOTHING
    end = count.run(1.0, Phase.FORMING, Stage.FORM)
    assert end == StageEnd(leaves="the way to its slot has taken more than 60 s (limits.stages.forming_s)")
    assert count.run(1.0, Phase.RETURNING, Stage.FORM) == NOTHING
    assert not count.notes, "the phase tells why it leaves"


def test_a_pause_ends_at_home_and_every_pause_counts_for_itself() -> None:
    count = Count(bounds(holding_s=60.0))
    for _ in range(3):
        assert count.run(59.0, Phase.HOLDING, Stage.SEARCH) == NOTHING
        assert count.run(1.0, Phase.FORMING, Stage.SEARCH) == NOTHING
    assert "limits.stages.holding_s" in count.run(62.0, Phase.HOLDING, Stage.SEARCH).leaves


@pytest.mark.parametrize("phase", sorted(IN_FORMATION))
@pytest.mark.parametrize(
    ("stage", "name"), [(Stage.FORM, "forming_s"), (Stage.SEARCH, "searching_s"), (Stage.TRACK, "tracking_s")]
)
def test_the_root_gives_up_for_all_and_tells_it_in_one_line(phase: Phase, stage: Stage, name: str) -> None:
    count = Count(bounds(**{name: 60.0}), root=True)
    assert count.run(60.0, phase, stage) == NOTHING
    end = count.run(30.0, phase, stage)
    assert f"has taken more than 60 s (limits.stages.{name})" in end.gives_up
    assert not end.leaves
    assert [(note.severity, note.code) for note in count.notes] == [(Severity.WARNING, "overdue")]
    assert count.notes[0].text == f"{end.gives_up}: giving up"


def test_only_the_root_tells_and_each_goes_home_alone_where_no_root_ends_it() -> None:
    count = Count(bounds(searching_s=60.0))
    assert not count.run(60.0 + ROOT_LATE_S, Phase.SEARCHING, Stage.SEARCH).leaves
    end = count.run(1.0, Phase.SEARCHING, Stage.SEARCH)
    assert end.leaves == f"{end.gives_up}, and no root has ended it"
    assert not count.notes


def test_a_search_that_finds_and_loses_the_plume_for_ever_ends_too() -> None:
    count = Count(bounds(searching_s=60.0, tracking_s=90.0))
    rounds = 0
    while not count.run(10.0, Phase.SEARCHING, Stage.SEARCH).gives_up:
        assert not count.run(5.0, Phase.TRACKING, Stage.TRACK).gives_up
        rounds += 1
    assert rounds == 6
    count.bounds.begin()
    assert count.run(50.0, Phase.SEARCHING, Stage.SEARCH) == NOTHING, "the next survey begins anew"


def test_a_pause_takes_nothing_of_the_search() -> None:
    count = Count(bounds(searching_s=60.0))
    assert count.run(40.0, Phase.SEARCHING, Stage.SEARCH) == NOTHING
    assert count.run(100.0, Phase.HOLDING, Stage.SEARCH) == NOTHING
    assert count.run(20.0, Phase.SEARCHING, Stage.SEARCH) == NOTHING


@pytest.mark.parametrize("stage", [Stage.FOUND, Stage.GIVE_UP])
def test_what_has_ended_needs_no_end(stage: Stage) -> None:
    count = Count(bounds(searching_s=20.0, tracking_s=20.0), root=True)
    assert count.run(500.0, Phase.TRACKING, stage) == NOTHING


def test_a_clock_that_jumps_and_an_agent_that_stood_still_end_nothing() -> None:
    counted = bounds(searching_s=60.0, holding_s=60.0)
    for phase in (Phase.SEARCHING, Phase.HOLDING):
        for now_s in (0.0, 1000.0, 2000.0, 2000.1):
            assert counted.step(now_s, phase, order(Stage.SEARCH)) == NOTHING


def test_a_way_home_that_does_not_end_ends_where_the_drone_is() -> None:
    count = Count(bounds(returning_s=60.0))
    assert count.run(60.0, Phase.RETURNING) == NOTHING
    end = count.run(1.0, Phase.RETURNING)
    assert end.lands == "the way home has taken more than 60 s (limits.stages.returning_s): landing here"
    assert not count.notes, "the phase tells why it lands"


def test_the_way_home_may_take_what_the_area_asks_for() -> None:
    frame = LocalFrame(Geodetic(-5.06, 151.3, 500.0))
    area = Geofence(inclusion_circles=(Circle(-5.06, 151.3, 1000.0),))
    exclusion = Geofence(exclusion_circles=(Circle(-5.06, 151.35, 1000.0),))
    limits = LimitsConfig(speed_mps=5.0)
    assert returning_bound_s(limits, LocalFence(frame, area)) == pytest.approx(900.0, abs=2.0)
    assert returning_bound_s(limits, LocalFence(frame, exclusion)) == 900.0
    assert returning_bound_s(limits, None) == 900.0
    given_s = LimitsConfig(stages=StagesConfig(returning_s=70.0))
    assert returning_bound_s(given_s, LocalFence(frame, area)) == 70.0


@pytest.mark.parametrize(("phase", "bound_s"), [(Phase.LANDING, 30.0), (Phase.RTL, 130.0)])
def test_a_landing_that_does_not_end_is_told_once(phase: Phase, bound_s: float) -> None:
    count = Count(bounds(landing_s=30.0, returning_s=100.0))
    assert count.run(bound_s, phase) == NOTHING
    end = count.run(60.0, phase)
    assert f"has taken more than {bound_s:.0f} s" in end.alarm
    assert [(note.severity, note.code, note.text) for note in count.notes] == [
        (Severity.CRITICAL, "overdue", end.alarm)
    ]


def test_the_order_to_give_up_is_the_next_one_and_keeps_what_the_order_holds() -> None:
    decision = Decision(Hold(), order=order(Stage.SEARCH, 8), word=b"word")
    out = ended(decision, order(Stage.TRACK, 7), "why")
    assert out.order == Order(8, Stage.GIVE_UP, ANCHOR, 0.5, note=b"note", apart=True)
    assert (out.intent, out.word) == (decision.intent, b"word")
    assert ended(Decision(Hold()), order(Stage.FORM, 7), "why").order == out.order


@pytest.mark.parametrize(
    ("decided", "stands", "why"),
    [
        (None, order(Stage.SEARCH), ""),
        (None, None, "why"),
        (None, order(Stage.FOUND), "why"),
        (order(Stage.FOUND, 8), order(Stage.TRACK), "why"),
    ],
)
def test_a_decision_stays_where_nothing_is_overdue_or_the_search_has_ended(
    decided: Order | None, stands: Order | None, why: str
) -> None:
    decision = Decision(Hold(), order=decided)
    assert ended(decision, stands, why) is decision


@settings(max_examples=40, deadline=None)
@given(
    st.lists(
        st.tuples(
            # Who leaves is sent home by `taking_part`, after seconds.
            st.sampled_from(sorted(IN_THE_AIR - {Phase.TAKEOFF, Phase.PILOT, Phase.LEAVING})),
            st.sampled_from([None, Stage.FORM, Stage.SEARCH, Stage.TRACK]),
            st.floats(1.0, 200.0),
        ),
        min_size=1,
        max_size=12,
    )
)
def test_whatever_came_before_no_stage_goes_on_for_ever(
    flown: list[tuple[Phase, Stage | None, float]],
) -> None:
    names = StagesConfig.__struct_fields__
    count = Count(bounds(**dict.fromkeys(names, 100.0)))
    for phase, stage, seconds in flown:
        count.run(seconds, phase, stage)
    phase, stage, _ = flown[-1]
    end = count.run(201.0 + ROOT_LATE_S, phase, stage)
    assert end.leaves or end.lands or end.alarm
