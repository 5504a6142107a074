"""What one drone tells its peers, and how often."""

from __future__ import annotations

import msgspec
import pytest

from flightstack.autopilot import AutopilotSession
from flightstack.config import AutopilotConfig
from flightstack.sensing.filter_stage import Sensed
from flightstack.swarm.announcements import Announced, Announcements, OwnFacts
from flightstack.swarm.news import Note
from flightstack.swarm.peers import PeerFacts
from flightstack.swarm.swarm_table import SwarmTable
from flightstack.swarm.topics import EVENT, OUTCOME, STATE, TABLE, TOPICS
from flightstack.swarm.wire import (
    NO_TABLE,
    CommandOutcome,
    DroneState,
    Event,
    Phase,
    Result,
    Severity,
    TableState,
)
from mission.estimation.estimates import Scalar, Wind
from mission.geometry.formation import make_layout
from mission.geometry.frames import Geodetic, LocalFrame
from mission.strategies.contract import TreePlace

FRAME = LocalFrame(Geodetic(-5.06, 151.3, 500.0))
TICK_S = 0.1
REPORT = msgspec.structs.replace(
    AutopilotSession(2, FRAME, AutopilotConfig(link="udpin:127.0.0.1:1")).report,
    armed=True,
    airborne=True,
    mode="GUIDED",
    position_ned_m=(1.0, 2.0, -10.0),
    position_age_s=0.3,
    velocity_ned_mps=(0.5, 0.0, 0.0),
    notes=("no wind from the autopilot",),
)
EXCESS, WIND = Scalar(30.0, 4.0, 0.1), Wind((1.0, -2.0, 0.0), 0.2, 0.3)
SENSED = Sensed(450.0, EXCESS, WIND, ("co2: warming",), ())
PLACE = TreePlace(3, 1, {1: 0, 2: 1}, 1, (), None, None, 1, False)
OWN = OwnFacts(
    Phase.SEARCHING, REPORT, SENSED, PLACE, False, 31.5, ("geofence",), ticks=12, late_ticks=2, word=b"word"
)


class Speaker:
    def __init__(self) -> None:
        self.announcements = Announcements(2, 77, FRAME.identity, TICK_S)
        self.table = SwarmTable(
            2,
            (1, 2),
            make_layout("hexagonal", 10.0),
            frame_identity=FRAME.identity,
            incarnation=77,
            suspect_after_s=0.8,
        )
        self.peers: dict[int, PeerFacts] = {}

    def tell(
        self, now_s: float, *notes: Note, own: OwnFacts = OWN, outcomes: tuple[CommandOutcome, ...] = ()
    ) -> Announced:
        return self.announcements.step(now_s, notes, outcomes, own, self.table, self.peers)


@pytest.fixture
def node() -> Speaker:
    return Speaker()


def decoded(told: Announced) -> list[msgspec.Struct]:
    return [TOPICS[name].codec.decode(payload) for name, payload in told.messages]


def state_of(told: Announced) -> DroneState:
    (state,) = (message for message in decoded(told) if isinstance(message, DroneState))
    return state


def test_the_state_goes_out_at_the_rate_of_its_topic_and_the_table_seldom_where_all_know_the_same(
    node: Speaker,
) -> None:
    node.table.begin(0.0, "survey", (0.0, 0.0, -10.0))
    told = [name for tick in range(100) for name, _ in node.tell(tick * TICK_S).messages]
    assert told.count(STATE.name) == 10.0 * (STATE.rate_hz or 0.0)
    assert told.count(TABLE.name) == 10.0 * (TABLE.rate_hz or 0.0)
    assert len(told) == told.count(STATE.name) + told.count(TABLE.name)


def test_where_somebody_knows_another_table_it_is_told_as_often_as_the_state(node: Speaker) -> None:
    node.table.begin(0.0, "survey", (0.0, 0.0, -10.0))
    told: list[str] = []
    for tick in range(100):
        node.peers = {1: PeerFacts(tick * TICK_S, True, False, None, 1, node.table.digest ^ 1)}
        told += [name for name, _ in node.tell(tick * TICK_S).messages]
    assert told.count(TABLE.name) == told.count(STATE.name)


def test_a_loss_is_told_though_nobodys_registers_change_by_it(node: Speaker) -> None:
    """Each drone counts the others out by itself; who watches the swarm must hear of it."""
    node.table.begin(0.0, "survey", (0.0, 0.0, -10.0))
    node.tell(0.0)
    assert TABLE.name not in [name for name, _ in node.tell(1.0).messages]
    node.table.slots = {2: 1}
    assert TABLE.name in [name for name, _ in node.tell(1.1).messages]


def test_a_tick_that_comes_a_little_early_does_not_halve_the_rate(node: Speaker) -> None:
    period_s = 1.0 / (STATE.rate_hz or 1.0)
    assert [name for name, _ in node.tell(0.0).messages] == [STATE.name]
    assert node.tell(period_s - 0.6 * TICK_S).messages == ()
    assert [name for name, _ in node.tell(period_s - 0.4 * TICK_S).messages] == [STATE.name]


def test_a_drone_that_was_not_started_has_no_table_to_tell(node: Speaker) -> None:
    told = node.tell(0.0)
    assert not any(isinstance(message, TableState) for message in decoded(told))
    assert state_of(told).table_digest == NO_TABLE
    node.table.begin(0.1, "survey", (0.0, 0.0, -10.0))
    told = node.tell(0.2)
    (table,) = (message for message in decoded(told) if isinstance(message, TableState))
    assert (table.sender, table.survey, table.held) == (2, "survey", {1: 0, 2: 1})
    assert state_of(told).table_digest == node.table.digest != NO_TABLE


def test_the_state_says_who_where_and_how_it_is(node: Speaker) -> None:
    first = state_of(node.tell(0.0))
    assert (first.sender, first.incarnation, first.sequence, first.frame) == (2, 77, 1, FRAME.identity)
    assert (first.phase, first.mode, first.armed, first.airborne) == (Phase.SEARCHING, "GUIDED", True, True)
    assert (first.position_ned_m, first.position_age_s) == ((1.0, 2.0, -10.0), 0.3)
    assert (first.co2_ppm, first.excess_co2_ppm, first.wind, first.tracking_best_ppm) == (
        450.0,
        EXCESS,
        WIND,
        31.5,
    )
    assert (first.epoch, first.slot, first.parent, first.healing) == (3, 1, 1, False)
    assert (first.ticks, first.late_ticks, first.word) == (12, 2, b"word")
    assert state_of(node.tell(0.2)).sequence == 2


def test_a_drone_that_was_counted_out_has_no_slot_and_an_heir_on_its_way_is_healing(node: Speaker) -> None:
    out = msgspec.structs.replace(PLACE, slot=-1, parent=None)
    state = state_of(node.tell(0.0, own=msgspec.structs.replace(OWN, place=out, moving=True)))
    assert (state.slot, state.parent, state.healing) == (None, None, True)


def test_notes_say_what_is_not_as_it_should_be_and_by_whom(node: Speaker) -> None:
    assert state_of(node.tell(0.0)).notes == ("no wind from the autopilot", "co2: warming", "guard: geofence")
    waiting = msgspec.structs.replace(REPORT, armed=False, ready_reason="no GPS fix")
    on_the_ground = msgspec.structs.replace(OWN, vehicle=waiting, held_by=())
    assert state_of(node.tell(0.2, own=on_the_ground)).notes[0] == "autopilot: no GPS fix"


def test_events_are_numbered_and_sent_in_the_tick_in_which_they_happen(node: Speaker) -> None:
    node.tell(0.0)
    lost, heal = Note(Severity.WARNING, "lost", "drone 3"), Note(Severity.INFO, "heal", "epoch 1")
    told = node.tell(0.1, lost, heal)
    assert told.events == (
        Event(2, 1, Severity.WARNING, "lost", "drone 3", 77),
        Event(2, 2, Severity.INFO, "heal", "epoch 1", 77),
    )
    assert [name for name, _ in told.messages] == [EVENT.name, EVENT.name]
    assert tuple(decoded(told)) == told.events
    assert [event.sequence for event in node.tell(0.2, lost).events] == [3]


def test_a_command_is_answered_in_its_tick(node: Speaker) -> None:
    node.tell(0.0)
    outcome = CommandOutcome("c1", 2, Result.REFUSED, "already searching")
    told = node.tell(0.1, outcomes=(outcome,))
    assert [name for name, _ in told.messages] == [OUTCOME.name]
    assert decoded(told) == [outcome]


def test_tables_are_numbered_from_one_and_events_name_the_agent_that_tells(node: Speaker) -> None:
    node.table.begin(0.0, "survey", (0.0, 0.0, -10.0))
    node.peers = {1: PeerFacts(0.0, True, False, None, 1, node.table.digest ^ 1)}
    told = [node.tell(now_s, Note(Severity.INFO, "heal", "epoch 1")) for now_s in (0.0, 0.2, 0.4)]
    tables = [TABLE.codec.decode(data) for step in told for name, data in step.messages if name == TABLE.name]
    assert [(table.incarnation, table.sequence) for table in tables] == [(77, 1), (77, 2), (77, 3)]
    assert [event.incarnation for step in told for event in step.events] == [77, 77, 77]
