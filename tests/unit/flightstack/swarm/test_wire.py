"""The codec: every message survives it, and no bytes at all can do worse than `WireError`."""

from __future__ import annotations

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightstack.swarm.topics import TOPICS
from flightstack.swarm.wire import (
    VERSION,
    Codec,
    Command,
    CommandName,
    CommandOutcome,
    DroneState,
    Event,
    MemberRegister,
    OrderState,
    Phase,
    ReadingsState,
    Result,
    Severity,
    TableState,
    WireError,
)
from mission.estimation.estimates import Reading, Scalar, Wind
from mission.strategies.contract import Order, Stage
from mission.tree.slot_registers import SlotRegister

number = st.floats(allow_nan=False)
ids = st.integers(1, 250)
vectors = st.tuples(number, number, number)
scalars = st.builds(Scalar, number, number, number)
states = st.builds(
    DroneState,
    sender=ids,
    incarnation=st.integers(0, 2**31 - 1),
    sequence=st.integers(0, 2**40),
    frame=st.integers(0, 2**32 - 1),
    phase=st.sampled_from(Phase),
    position_ned_m=st.none() | vectors,
    velocity_ned_mps=st.none() | vectors,
    heading_rad=st.none() | number,
    home_ned_m=st.none() | vectors,
    armed=st.booleans(),
    airborne=st.booleans(),
    mode=st.text(max_size=12),
    battery_fraction=st.none() | number,
    co2_ppm=st.none() | number,
    excess_co2_ppm=st.none() | scalars,
    wind=st.none() | st.builds(Wind, vectors, number, number),
    epoch=st.integers(0, 2**31),
    slot=st.none() | ids,
    parent=st.none() | ids,
    healing=st.booleans(),
    tracking_best_ppm=st.none() | number,
    notes=st.lists(st.text(max_size=30), max_size=3).map(tuple),
    position_age_s=number,
)
claims = st.builds(SlotRegister, ids, st.integers(-1, 255), ids)
tables = st.builds(
    TableState,
    sender=ids,
    incarnation=st.integers(0, 2**31 - 1),
    sequence=st.integers(0, 2**31 - 1),
    frame=st.integers(0, 2**32 - 1),
    survey=st.text(max_size=10),
    slots=st.lists(st.tuples(ids, claims), max_size=4).map(tuple),
    members=st.lists(st.tuples(ids, st.builds(MemberRegister, ids, ids, ids)), max_size=4).map(tuple),
    absent=st.lists(ids, max_size=3).map(tuple),
    heals=st.integers(0, 99),
    digest=st.integers(0, 2**32 - 1),
)
ordered = st.builds(
    OrderState,
    sender=ids,
    incarnation=st.integers(0, 2**31 - 1),
    sequence=st.integers(0, 2**31 - 1),
    frame=st.integers(0, 2**32 - 1),
    survey=st.text(max_size=10),
    order=st.builds(Order, st.integers(0, 9), st.sampled_from(Stage), vectors, number, st.none() | vectors),
    ordered_by=claims,
    digest=st.integers(0, 2**32 - 1),
)
reports = st.builds(
    ReadingsState,
    sender=ids,
    incarnation=st.integers(0, 2**31 - 1),
    sequence=st.integers(0, 2**31 - 1),
    frame=st.integers(0, 2**32 - 1),
    survey=st.text(max_size=10),
    order=st.integers(0, 2**31 - 1),
    readings=st.lists(st.builds(Reading, ids, ids, vectors, number, number), max_size=3).map(tuple),
    held=st.lists(ids, max_size=3).map(tuple),
    to_anybody=st.booleans(),
)
commands = st.builds(Command, st.text(max_size=20), st.text(max_size=9), ids, st.sampled_from(CommandName))
outcomes = st.builds(CommandOutcome, st.text(max_size=20), ids, st.sampled_from(Result), st.text(max_size=40))
events = st.builds(Event, ids, ids, st.sampled_from(Severity), st.text(max_size=9), st.text(max_size=40))


@settings(max_examples=100, deadline=None)
@given(st.one_of(states, tables, ordered, reports, commands, outcomes, events))
def test_every_message_survives_the_codec(message):
    codec = Codec(type(message))
    assert codec.decode(codec.encode(message)) == message


@pytest.mark.parametrize("topic", TOPICS.values(), ids=lambda t: t.name)
@settings(max_examples=40, deadline=None)
@given(data=st.binary(max_size=80), versioned=st.booleans())
def test_any_bytes_are_a_message_or_a_wire_error(topic, data, versioned):
    try:
        message = topic.codec.decode(bytes((VERSION,)) + data if versioned else data)
    except WireError:
        return
    assert isinstance(message, topic.codec.kind)


@settings(max_examples=40, deadline=None)
@given(states, st.data())
def test_a_message_cut_short_is_a_wire_error(message, data):
    codec = Codec(DroneState)
    encoded = codec.encode(message)
    with pytest.raises(WireError):
        codec.decode(encoded[: data.draw(st.integers(0, len(encoded) - 1))])


@pytest.mark.parametrize(
    ("kind", "body"),
    [
        (Command, b"\x95\xa7command\xa2\xff\xfe\xa1a\x00\xa5start"),  # text that is not UTF-8
        (
            CommandOutcome,
            b"\x96\xa7outcome\xa1a\x01\xa8accepted\xa0" + b"\x91" * 100_000,
        ),  # a field from the future, nested deep
    ],
)
def test_damage_that_is_no_error_of_the_codecs_own_is_a_wire_error(kind, body):
    with pytest.raises(WireError, match=f"not a {kind.__name__}"):
        Codec(kind).decode(bytes((VERSION,)) + body)


def test_another_version_is_named():
    codec = Codec(Command)
    encoded = codec.encode(Command("a", "ground", 0, CommandName.START))
    with pytest.raises(WireError, match=f"version {VERSION + 1}, this software speaks {VERSION}: update"):
        codec.decode(bytes((VERSION + 1,)) + encoded[1:])


class Older(msgspec.Struct, frozen=True, array_like=True):
    a: int


class Newer(msgspec.Struct, frozen=True, array_like=True):
    a: int
    b: str = "unknown"


def test_older_and_newer_software_understand_each_other():
    assert Codec(Older).decode(Codec(Newer).encode(Newer(1, "x"))) == Older(1)
    assert Codec(Newer).decode(Codec(Older).encode(Older(1))) == Newer(1)


class Lookalike(Command, frozen=True, array_like=True, tag="lookalike"):
    """The same fields as a command's, and no command."""


def test_a_message_of_another_kind_is_never_taken_for_this_one():
    """zenoh has delivered messages under another topic's key."""
    said = Lookalike("a", "ground", 0, CommandName.START)
    with pytest.raises(WireError, match="not a Command"):
        Codec(Command).decode(Codec(Lookalike).encode(said))


@settings(max_examples=30, deadline=None)
@given(st.one_of(states, tables, ordered, commands, outcomes, events))
def test_a_message_is_read_on_its_own_topic_and_on_no_other(message):
    (own,) = (topic for topic in TOPICS.values() if topic.codec.kind is type(message))
    data = own.codec.encode(message)
    for topic in TOPICS.values():
        if topic is own:
            assert topic.codec.decode(data) == message
        else:
            with pytest.raises(WireError):
                topic.codec.decode(data)
