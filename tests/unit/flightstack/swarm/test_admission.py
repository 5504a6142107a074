"""Messages that decode and must not be believed: none may end an agent, spoil its tree or steer its drone."""

from __future__ import annotations

import math
import pathlib
from collections.abc import Callable

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightstack.agent import Agent, Inputs, PeerMessage
from flightstack.config_file import load
from flightstack.flight.strategy_call import consult
from flightstack.swarm import topics
from flightstack.swarm.admission import (
    ANYBODY,
    LONGEST_WORD,
    NOTE_AT_MOST_BYTES,
    WORD_AT_MOST_BYTES,
    Admission,
    Refusal,
    RefusalKind,
    flaw,
    refusal,
)
from flightstack.swarm.topics import Received, Topic
from flightstack.swarm.wire import (
    VERSION,
    Command,
    CommandName,
    CommandOutcome,
    DroneState,
    Event,
    GroundAlarm,
    GroundReport,
    HeardVehicle,
    MemberRegister,
    OrderState,
    Phase,
    ReadingsState,
    Result,
    Severity,
    TableState,
    Traffic,
    TrafficVehicle,
)
from mission.estimation.estimates import Reading, Scalar, Wind
from mission.strategies.contract import Decision, GoTo, Hold, Observation, Order, Stage, Velocity
from mission.tree.slot_registers import SlotRegister

EXAMPLE = pathlib.Path(__file__).parents[4] / "examples" / "drone.yaml"
MEMBERS = (1, 2, 3, 4, 5)
NAN, INF = math.nan, math.inf
READING = Reading(2, 7, (1.0, 2.0, -10.0), 40.0, 4.0)
ORDER = Order(7, Stage.TRACK, (1.0, 2.0, -10.0), 0.5, None, b"note")
STATE = DroneState(
    2, 1, 1, 0, Phase.SEARCHING, (1.0, 2.0, -10.0), (0.5, 0.0, 0.0), 0.0, None, True, True, "GUIDED", 0.9,
    450.0, None, None, 0, 1, 1, False, None,
)  # fmt: skip
CLAIM = SlotRegister(3, 2, 5)
TABLE = TableState(
    2, 1, 1, 0, "survey", ((0, CLAIM), (3, SlotRegister(1))), ((4, MemberRegister(2, 2, -1)),), (4,), 2,
)  # fmt: skip
ORDERED = OrderState(2, 1, 1, 0, "survey", ORDER, CLAIM, 77)
READINGS = ReadingsState(2, 1, 1, 0, "survey", READING.order, (READING,), (1, 4))
COMMAND = Command("c1", "ground", 0, CommandName.START)
replace = msgspec.structs.replace


def agent() -> Agent:
    return Agent(load(EXAMPLE), incarnation=7)


def message(topic: Topic, sender: str, content: object) -> PeerMessage:
    return PeerMessage(topic.name, sender, topic.codec.encode(content))


@pytest.mark.parametrize(
    "good",
    [
        STATE,
        TABLE,
        ORDERED,
        READINGS,
        COMMAND,
    ],
)
def test_what_a_healthy_node_says_is_believed(good: object) -> None:
    assert refusal(good, MEMBERS) == ""


def test_a_drone_without_a_sensor_reports_a_reading_of_infinite_variance() -> None:
    blind = replace(READING, excess_co2_ppm=0.0, variance_ppm2=INF)
    assert refusal(replace(READINGS, readings=(blind,)), MEMBERS) == ""


@pytest.mark.parametrize(
    "bad",
    [
        replace(STATE, position_ned_m=(NAN, 0.0, 0.0)),
        replace(STATE, position_ned_m=(0.0, 1e300, 0.0)),
        replace(STATE, velocity_ned_mps=(0.0, 0.0, INF)),
        replace(STATE, home_ned_m=(0.0, NAN, 0.0)),
        replace(STATE, position_age_s=NAN),
        replace(STATE, position_age_s=-1.0),
        replace(TABLE, heals=2**63),
        replace(ORDERED, order=replace(ORDER, sequence=2**64 - 1)),
        replace(ORDERED, order=replace(ORDER, anchor_ned_m=(NAN, 0.0, 0.0))),
        replace(ORDERED, order=replace(ORDER, rotation_rad=INF)),
        replace(ORDERED, order=replace(ORDER, source_ned_m=(0.0, NAN, 0.0))),
        replace(ORDERED, order=replace(ORDER, source_sd_m=NAN)),
        replace(ORDERED, order=replace(ORDER, source_sd_m=-1.0)),
        replace(ORDERED, order=replace(ORDER, note=bytes(NOTE_AT_MOST_BYTES + 1))),
        replace(TABLE, heals=-1),
        replace(TABLE, sequence=2**63),
        replace(TABLE, slots=((0, CLAIM), (0, CLAIM))),
        replace(TABLE, slots=((5, CLAIM),)),
        replace(TABLE, slots=((-1, CLAIM),)),
        replace(TABLE, slots=((0, CLAIM),) * 10_000),
        replace(TABLE, slots=((0, replace(CLAIM, version=2**31)),)),
        replace(TABLE, slots=((0, replace(CLAIM, version=-1)),)),
        replace(TABLE, slots=((0, replace(CLAIM, holder=99)),)),
        replace(TABLE, slots=((0, replace(CLAIM, support=6)),)),
        replace(TABLE, slots=((0, replace(CLAIM, support=-1)),)),
        replace(TABLE, members=((9, MemberRegister()),)),
        replace(TABLE, members=((4, MemberRegister()), (4, MemberRegister(1)))),
        replace(TABLE, members=((4, MemberRegister(2**31)),)),
        replace(TABLE, members=((4, MemberRegister(-1)),)),
        replace(TABLE, members=((4, MemberRegister(1, 2)),)),
        replace(TABLE, members=((4, MemberRegister(1, -2)),)),
        replace(TABLE, members=((4, MemberRegister(1, -1, 2)),)),
        replace(TABLE, absent=(99,)),
        replace(TABLE, absent=(4,) * 10_000),
        replace(READINGS, sequence=-1),
        replace(READINGS, readings=(READING,) * 10_000),
        replace(READINGS, readings=(replace(READING, drone=99),)),
        replace(READINGS, readings=(replace(READING, excess_co2_ppm=NAN),)),
        replace(READINGS, readings=(replace(READING, variance_ppm2=-1.0),)),
        replace(READINGS, readings=(replace(READING, variance_ppm2=NAN),)),
        replace(READINGS, readings=(replace(READING, position_ned_m=(INF, 0.0, 0.0)),)),
        replace(READINGS, held=(99,)),
        replace(READINGS, held=(4,) * 10_000),
        replace(ORDERED, sequence=-1),
        replace(ORDERED, ordered_by=replace(CLAIM, holder=99)),
        replace(COMMAND, identity=""),
        replace(COMMAND, identity="x" * (LONGEST_WORD + 1)),
        replace(COMMAND, sender="a\nb"),
        Traffic("ground", 0, (TrafficVehicle(2, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.1),) * 1000),
    ],
)
def test_what_cannot_be_is_refused(bad: object) -> None:
    assert refusal(bad, MEMBERS) != ""


def said(state: DroneState, sender: str | None = None) -> Received:
    return Received(topics.STATE, sender or str(state.sender), topics.STATE.codec.encode(state))


@pytest.mark.parametrize(
    ("item", "why"),
    [
        (said(replace(STATE, frame=1)), "another frame"),
        (said(replace(STATE, sender=9)), "not in swarm.members"),
        (said(replace(STATE, sender=1)), "another node also says that it is drone 1"),
        (said(STATE, sender="3"), "came under the name 3"),
        (Received(topics.STATE, "2", bytes([VERSION]) + b"garbage"), "not a DroneState"),
        (Received(topics.STATE, "2", b"\x09" + said(STATE).payload[1:]), "message version 9"),
        (Received(topics.STATE, "2", b""), "empty message"),
    ],
)
def test_what_must_not_be_believed_is_told_once(item: Received, why: str) -> None:
    admission = Admission(MEMBERS, STATE.frame, 1)
    refused, again = admission.admit(item), admission.admit(item)
    assert isinstance(refused, Refusal)
    assert isinstance(again, Refusal)
    assert why in refused.text
    assert (refused.fresh, again.fresh) == (True, False)


def sent(content: object, sender: str) -> Received:
    topic = next(t for t in topics.TOPICS.values() if t.codec.kind is type(content))
    return Received(topic, sender, topic.codec.encode(content))


def refused_as(admission: Admission, content: object, sender: str) -> RefusalKind | None:
    judged = admission.admit(sent(content, sender))
    return judged.kind if isinstance(judged, Refusal) else None


@pytest.mark.parametrize("drone", [1, None], ids=["an agent", "a ground station"])
@pytest.mark.parametrize(
    ("content", "sender", "why"),
    [
        (TABLE, "2", None),
        (STATE, "2", None),
        (TABLE, "3", RefusalKind.MISNAMED),
        (ORDERED, "2", None),
        (ORDERED, "3", RefusalKind.MISNAMED),
        (replace(ORDERED, frame=9), "2", RefusalKind.FOREIGN_FRAME),
        (replace(ORDERED, sender=7), "7", RefusalKind.STRANGER),
        (READINGS, "3", RefusalKind.MISNAMED),
        (replace(READINGS, frame=9), "2", RefusalKind.FOREIGN_FRAME),
        (replace(READINGS, sender=7), "7", RefusalKind.STRANGER),
        (replace(TABLE, frame=9), "2", RefusalKind.FOREIGN_FRAME),
        (replace(TABLE, sender=7), "7", RefusalKind.STRANGER),
        (replace(TABLE, slots=((5, CLAIM),)), "2", RefusalKind.IMPLAUSIBLE),
        (replace(STATE, position_ned_m=(NAN, 0.0, 0.0)), "2", RefusalKind.IMPLAUSIBLE),
        (replace(STATE, sender=7, position_ned_m=(NAN, 0.0, 0.0)), "7", RefusalKind.IMPLAUSIBLE),
        (Traffic("ground", 9, ()), "ground", RefusalKind.FOREIGN_FRAME),
        (CommandOutcome("c1", 2, Result.ACCEPTED), "2", None),
        (CommandOutcome("c1", 2, Result.ACCEPTED), "3", RefusalKind.MISNAMED),
        (CommandOutcome("c1", 2, Result.ACCEPTED), "ground", None),
        (Event(2, 1, Severity.INFO, "lost", "drone 3"), "3", RefusalKind.MISNAMED),
        (Event(2, 1, Severity.INFO, "orphan", "drone 2"), "ground", None),
    ],
)
def test_drones_and_ground_stations_believe_the_same(
    drone: int | None, content: object, sender: str, why: RefusalKind | None
) -> None:
    assert refused_as(Admission(MEMBERS, 0, drone), content, sender) is why


def test_a_drone_does_not_take_another_for_itself_and_a_ground_station_sees_both() -> None:
    own = replace(STATE, sender=1)
    refused = Admission(MEMBERS, 0, 1).admit(sent(own, "1"))
    assert isinstance(refused, Refusal)
    assert (refused.kind, refused.message) == (RefusalKind.TWIN, own)
    assert Admission(MEMBERS, 0).admit(sent(own, "1")) == own


def test_who_does_not_know_the_swarm_takes_any_member_and_any_frame_but_no_nonsense() -> None:
    admission = Admission()
    claims = ((0, SlotRegister(0, 200)), (1, SlotRegister(2, 201, 2)))
    far = replace(TABLE, sender=200, frame=9, slots=claims)
    assert admission.admit(sent(far, "200")) == far
    assert refused_as(admission, replace(far, sender=256), "256") is RefusalKind.STRANGER
    assert refused_as(admission, replace(far, slots=((300, CLAIM),)), "200") is RefusalKind.IMPLAUSIBLE
    assert refusal(far, ANYBODY) == ""


def test_what_nobody_believes_can_still_be_shown_without_what_is_no_number() -> None:
    odd = replace(STATE, frame=9, battery_fraction=NAN)
    refused = Admission(MEMBERS, 0).admit(sent(odd, "2"))
    assert isinstance(refused, Refusal)
    assert refused.message == replace(odd, battery_fraction=None)


def test_a_node_that_makes_up_faults_without_end_is_told_of_a_thousand_times() -> None:
    admission = Admission(MEMBERS, 0, 1)
    judged = [admission.admit(said(STATE, sender=f"node-{n}")) for n in range(1500)]
    assert sum(isinstance(refused, Refusal) and refused.fresh for refused in judged) == 1000


def test_a_refused_table_is_told_once_and_changes_nothing() -> None:
    flyer = agent()
    start = message(topics.COMMAND, "ground", COMMAND)
    flyer.step(1.0, Inputs(peers=(start,)))
    bad = replace(TABLE, frame=flyer.frame.identity, slots=((5, CLAIM),), survey="c1")
    told = [
        event.text
        for tick in range(5)
        for event in flyer.step(2.0 + tick, Inputs(peers=(message(topics.TABLE, "2", bad),))).events
        if event.code == "peer"
    ]
    assert told == ["a message of 2 is refused: its slots are not those of this swarm"]


def test_estimates_that_are_none_do_not_hide_the_drone_that_sent_them() -> None:
    flyer = agent()
    odd = replace(
        STATE,
        frame=flyer.frame.identity,
        excess_co2_ppm=Scalar(NAN, -1.0, 0.0),
        wind=Wind((INF, 0.0, 0.0), 1.0, 0.0),
        word=bytes(WORD_AT_MOST_BYTES + 1),
    )
    flyer.step(1.0, Inputs(peers=(message(topics.STATE, "2", odd),)))
    (neighbour,) = flyer._swarm._peers.neighbours(1.1)
    assert (neighbour.excess_co2_ppm, neighbour.wind, neighbour.word) == (None, None, b"")
    assert neighbour.position_ned_m == (1.0, 2.0, -10.0)


def test_one_odd_vehicle_does_not_hide_the_others_in_the_traffic() -> None:
    flyer = agent()
    good = TrafficVehicle(3, (40.0, 0.0, -10.0), (0.0, 0.0, 0.0), 0.5)
    odd = [replace(good, drone=4, age_s=age_s) for age_s in (NAN, -5.0, INF)]
    odd += [replace(good, drone=5, position_ned_m=(NAN, 0.0, 0.0)), replace(good, drone=2**60)]
    traffic = Traffic("ground", flyer.frame.identity, (*odd, good))
    flyer.step(1.0, Inputs(peers=(message(topics.TRAFFIC, "ground", traffic),)))
    assert [n.drone for n in flyer._swarm._peers.neighbours(1.1)] == [3]


numbers = st.one_of(st.floats(), st.sampled_from((0.0, 1.0, -10.0, 1e308, NAN, INF, -INF)))
counts = st.one_of(st.integers(-(2**63), 2**64 - 1), st.integers(-1, 6))
vectors = st.tuples(numbers, numbers, numbers)
readings = st.builds(Reading, counts, counts, vectors, numbers, numbers)
locus_notes = st.tuples(st.just("locus"), numbers, st.none() | vectors, st.none() | readings, counts).map(
    msgspec.msgpack.encode
)
orders = st.builds(
    Order, counts, st.sampled_from(Stage), vectors, numbers, st.none() | vectors,
    locus_notes | st.binary(max_size=600),
)  # fmt: skip
claims = st.builds(SlotRegister, counts, st.sampled_from((*MEMBERS, -1)) | counts, counts)
small_claims = st.builds(SlotRegister, st.integers(0, 6), st.sampled_from((*MEMBERS, -1)), st.integers(0, 5))
lives = st.integers(0, 6).flatmap(
    lambda life: st.builds(MemberRegister, st.just(life), st.integers(-1, life), st.integers(-1, life))
)


@settings(max_examples=150, deadline=None)
@given(
    slots=st.lists(st.tuples(counts, claims), max_size=6).map(tuple)
    | st.dictionaries(st.integers(0, 4), small_claims).map(lambda told: tuple(told.items())),
    members=st.lists(st.tuples(counts, st.builds(MemberRegister, counts, counts, counts)), max_size=6).map(
        tuple
    )
    | st.dictionaries(st.sampled_from(MEMBERS), lives).map(lambda told: tuple(told.items())),
    absent=st.lists(counts, max_size=6).map(tuple) | st.sets(st.sampled_from(MEMBERS)).map(tuple),
    order=orders,
    ordered_by=claims | small_claims,
    read=st.lists(readings, max_size=6).map(tuple),
    position=vectors,
    velocity=vectors,
    mean=numbers,
)
def test_no_well_formed_message_ends_an_agent(
    slots: tuple[tuple[int, SlotRegister], ...],
    members: tuple[tuple[int, MemberRegister], ...],
    absent: tuple[int, ...],
    order: Order,
    ordered_by: SlotRegister,
    read: tuple[Reading, ...],
    position: tuple[float, float, float],
    velocity: tuple[float, float, float],
    mean: float,
) -> None:
    flyer = agent()
    frame = flyer.frame.identity
    flyer.step(1.0, Inputs(peers=(message(topics.COMMAND, "ground", COMMAND),)))
    flyer._swarm.begin(1.0, "c1", (0.0, 0.0, -10.0))  # as if its autopilot had been there to accept the start
    table = TableState(2, 1, 1, frame, "c1", slots, members, absent)
    ordered = OrderState(2, 1, 1, frame, "c1", order, ordered_by)
    reported = ReadingsState(2, 1, 1, frame, "c1", order.sequence, read, absent, to_anybody=True)
    state = replace(
        STATE,
        frame=frame,
        position_ned_m=position,
        velocity_ned_mps=velocity,
        position_age_s=abs(mean),
        excess_co2_ppm=Scalar(mean, mean, mean),
        wind=Wind(velocity, mean, mean),
    )
    traffic = Traffic("ground", frame, (TrafficVehicle(3, position, velocity, mean),))
    peers = (
        message(topics.TABLE, "2", table),
        message(topics.ORDER, "2", ordered),
        message(topics.READINGS, "2", reported),
        message(topics.STATE, "2", state),
        message(topics.TRAFFIC, "ground", traffic),
    )
    for tick in range(12):
        flyer.step(2.0 + tick, Inputs(peers=peers))
    flyer._swarm._table.message()
    for neighbour in flyer._swarm._peers.neighbours(14.0):
        assert all(map(math.isfinite, (*neighbour.position_ned_m, *neighbour.velocity_ned_mps)))


class Broken:
    """A strategy with a defect."""

    def decide(self, observation: Observation, rng: np.random.Generator) -> Decision:
        raise ZeroDivisionError("no way")


class Says:
    def __init__(self, decision: Decision) -> None:
        self._decision = decision

    def decide(self, observation: Observation, rng: np.random.Generator) -> Decision:
        return self._decision


@pytest.mark.parametrize(
    "decision",
    [
        Decision(GoTo((NAN, 0.0, 0.0))),
        Decision(GoTo((0.0, 0.0, 0.0), NAN)),
        Decision(Velocity((0.0, INF, 0.0))),
        Decision(Hold(), reading=replace(READING, excess_co2_ppm=NAN)),
        Decision(Hold(), word=bytes(WORD_AT_MOST_BYTES + 1)),
        Decision(Hold(), order=replace(ORDER, note=bytes(NOTE_AT_MOST_BYTES + 1))),
        Decision(Hold(), order=replace(ORDER, anchor_ned_m=(NAN, 0.0, 0.0))),
    ],
)
def test_a_strategy_that_decides_on_nonsense_is_not_obeyed(decision: Decision) -> None:
    assert flaw(decision) != ""
    held, failure = consult(Says(decision), None, np.random.default_rng(1))  # type: ignore[arg-type]
    assert held == Decision(Hold())
    assert failure.startswith("the strategy failed: ")


def test_a_strategy_that_raises_tells_where_and_holds() -> None:
    held, failure = consult(Broken(), None, np.random.default_rng(1))  # type: ignore[arg-type]
    assert held == Decision(Hold())
    assert failure.startswith("the strategy failed: ZeroDivisionError: no way (test_admission.py:")


@pytest.mark.parametrize(("ticks", "second"), [(500, True), (0, False)])
def test_of_two_nodes_with_one_number_the_younger_gives_way(ticks: int, second: bool) -> None:
    flyer = agent()
    assert not flyer.step(0.9, Inputs()).status.comes_second
    twin = replace(STATE, sender=1, frame=flyer.frame.identity, ticks=ticks)
    output = flyer.step(1.0, Inputs(peers=(message(topics.STATE, "1", twin),)))
    assert output.status.comes_second is second
    assert [event.severity for event in output.events if event.code == "peer"] == [Severity.WARNING]


@pytest.mark.parametrize(
    ("said", "words"),
    [
        (replace(STATE, mode="G\x1b[2J", notes=("co2: ok", "a\nb")), lambda m: (m.mode, *m.notes)),
        (Event(2, 1, Severity.INFO, "co\nde", "\x1b[31mred"), lambda m: (m.code, m.text)),
        (CommandOutcome("c1", 2, Result.REFUSED, "no\x07"), lambda m: (m.reason,)),
        (
            GroundReport(
                "g\n",
                0,
                (GroundAlarm(2, Severity.INFO, "x\x00", "y\u202e", 1.0),),
                (HeardVehicle(2, "RTL\t", True, True, None, None, None, None, 0.0),),
            ),
            lambda m: (m.sender, m.alarms[0].code, m.alarms[0].text, m.vehicles[0].mode),
        ),
    ],
    ids=["state", "event", "outcome", "report"],
)
def test_what_peers_say_in_words_can_be_shown(
    said: object, words: Callable[[object], tuple[str, ...]]
) -> None:
    assert not all(map(str.isprintable, words(said)))
    topic = next(t for t in topics.TOPICS.values() if t.codec.kind is type(said))
    heard = Admission(MEMBERS, 0).admit(Received(topic, "2", topic.codec.encode(said)))
    assert type(heard) is type(said)
    assert all(map(str.isprintable, words(heard)))


def test_a_refused_message_is_told_in_words_that_can_be_shown() -> None:
    refused = Admission(MEMBERS, 0).admit(
        Received(topics.STATE, "\x1b[2Jevil", topics.STATE.codec.encode(STATE))
    )
    assert isinstance(refused, Refusal)
    assert refused.text.isprintable()
    assert r"\x1b[2Jevil" in refused.text


def test_what_was_heard_before_is_refused_without_a_word_and_what_is_of_the_past_with_one() -> None:
    admission = Admission(MEMBERS, 0, 1, 500)
    assert admission.admit(sent(replace(STATE, incarnation=7, sequence=9), "2")) == replace(
        STATE, incarnation=7, sequence=9
    )
    repeated = admission.admit(sent(replace(STATE, incarnation=7, sequence=9), "2"))
    assert isinstance(repeated, Refusal)
    assert (repeated.kind, repeated.fresh) == (RefusalKind.REPEATED, False)
    past = [admission.admit(sent(replace(STATE, incarnation=6, sequence=n), "2")) for n in (20, 21)]
    assert [(p.kind, p.fresh) for p in past if isinstance(p, Refusal)] == [
        (RefusalKind.PAST, True),
        (RefusalKind.PAST, False),
    ]
    assert refused_as(admission, replace(STATE, incarnation=7, sequence=10), "2") is None


def test_nothing_that_is_refused_is_remembered() -> None:
    """Who speaks in another's name, or nonsense, keeps nobody from being heard."""
    admission = Admission(MEMBERS, 0, 1)
    ahead = replace(STATE, incarnation=900, sequence=5000)
    assert refused_as(admission, ahead, "3") is RefusalKind.MISNAMED
    assert (
        refused_as(admission, replace(ahead, position_ned_m=(NAN, 0.0, 0.0)), "2") is RefusalKind.IMPLAUSIBLE
    )
    assert refused_as(admission, replace(ahead, frame=9), "2") is RefusalKind.FOREIGN_FRAME
    assert refused_as(admission, STATE, "2") is None


def test_our_own_words_that_come_back_are_no_twin() -> None:
    own = replace(STATE, sender=1, incarnation=500)
    assert refused_as(Admission(MEMBERS, 0, 1, 500), own, "1") is RefusalKind.REPEATED
    assert refused_as(Admission(MEMBERS, 0, 1, 501), own, "1") is RefusalKind.TWIN


def test_a_command_that_is_repeated_by_its_sender_is_answered_again_and_a_recorded_one_is_not() -> None:
    flyer = agent()
    numbered = [replace(COMMAND, incarnation=5, sequence=n) for n in (1, 2, 2, 1, 3)]
    answers = [
        sum(topic == topics.OUTCOME.name for topic, _ in flyer.step(1.0 + tick, Inputs(peers=(heard,))).peers)
        for tick, heard in enumerate(message(topics.COMMAND, "ground", said) for said in numbered)
    ]
    assert answers == [1, 1, 0, 0, 1]
