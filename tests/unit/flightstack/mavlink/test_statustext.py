"""Status texts in parts: put together, whoever cuts in, whatever is lost and in whatever order they come."""

from __future__ import annotations

import random

from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.codec import MavlinkCodec
from flightstack.mavlink.statustext import (
    MISSING,
    OPEN_AT_MOST,
    PART_LENGTH,
    PATIENCE_S,
    StatusText,
    TextAssembler,
)


def parts_of(text: str) -> list[str]:
    """As MAVLink cuts it: a text that fills its last part is followed by an empty one."""
    cut = [text[at : at + PART_LENGTH] for at in range(0, len(text), PART_LENGTH)]
    return cut if len(cut[-1]) < PART_LENGTH else [*cut, ""]


def through_the_wire(*messages: object) -> list[StatusText]:
    sender, reader = MavlinkCodec(3, 1), MavlinkCodec(255, 190, events={mavlink.MAVLINK_MSG_ID_STATUSTEXT})
    assembler = TextAssembler()
    texts: list[StatusText] = []
    for message in messages:
        for heard in reader.receive(0.0, sender.encode(message)):
            fields = heard.fields
            texts += assembler.add(0.0, fields.severity, fields.text, fields.id, fields.chunk_seq)
    return texts + assembler.expire(2.0)


def test_a_long_text_is_put_together():
    text = "EKF3 IMU0 forced reset and some more words to pass fifty characters by far, and more"
    assembler = TextAssembler()
    assert assembler.add(0.0, 4, text[:50], 7, 0) == []
    assert assembler.add(0.1, 4, text[50:], 7, 1) == [StatusText(4, text)]


def test_a_text_whose_end_is_lost_is_given_out_after_a_while_with_a_mark():
    assembler = TextAssembler()
    assembler.add(0.0, 2, "x" * 50, 7, 0)
    assert assembler.expire(0.5) == []
    assert assembler.expire(1.5) == [StatusText(2, "x" * 50 + f" {MISSING}")]
    assert assembler.add(2.0, 6, "short", 0, 0) == [StatusText(6, "short")]


def test_a_text_that_fills_its_parts_ends_with_an_empty_one():
    assembler = TextAssembler()
    assert assembler.add(0.0, 4, "c" * 50, 9, 0) == []
    assert assembler.add(0.0, 4, "", 9, 1) == [StatusText(4, "c" * 50)]


def test_parts_that_came_in_another_order_are_put_in_order():
    assembler = TextAssembler()
    assert assembler.add(0.0, 4, "second part", 10, 1) == []
    assert assembler.add(0.0, 4, "d" * 50, 10, 0) == [StatusText(4, "d" * 50 + "second part")]


def test_a_lost_middle_and_a_lost_beginning_are_marked_where_they_were():
    assembler = TextAssembler()
    assembler.add(0.0, 4, "e" * 50, 11, 0)
    assembler.add(0.0, 4, "third", 11, 2)
    assembler.add(0.0, 4, "only the end", 12, 3)
    assert assembler.expire(0.9) == []
    assert [text.text for text in assembler.expire(1.1)] == [
        f"{'e' * 50} {MISSING} third",
        f"{MISSING} only the end",
    ]


def test_patience_counts_from_the_newest_part():
    assembler = TextAssembler()
    assembler.add(0.0, 4, "a" * 50, 7, 0)
    assembler.add(0.9, 4, "b" * 50, 7, 1)
    assert assembler.expire(1.5) == []
    assert assembler.add(1.8, 4, "end", 7, 2) == [StatusText(4, "a" * 50 + "b" * 50 + "end")]
    assert assembler.expire(1.8 + 2 * PATIENCE_S) == []


def test_texts_between_each_others_parts_do_not_cut_them_off():
    assembler = TextAssembler()
    assembler.add(0.0, 4, "a" * 50, 7, 0)
    assembler.add(0.0, 4, "b" * 50, 8, 0)
    assert assembler.add(0.0, 6, "between", 0, 0) == [StatusText(6, "between")]
    assert assembler.add(0.1, 4, "A", 7, 1) == [StatusText(4, "a" * 50 + "A")]
    assert assembler.add(0.1, 4, "B", 8, 1) == [StatusText(4, "b" * 50 + "B")]


def test_a_number_that_is_used_again_is_another_text():
    assembler = TextAssembler()
    assembler.add(0.0, 2, "old " * 12 + "o.", 7, 0)
    assert assembler.add(0.5, 4, "new " * 12 + "n.", 7, 0) == [
        StatusText(2, "old " * 12 + f"o. {MISSING}"),
    ]
    assert assembler.add(0.6, 4, "end", 7, 1) == [StatusText(4, "new " * 12 + "n.end")]


def test_what_no_terminal_should_see_is_written_out():
    packed = [
        b"F bad utf8 \xff\xfe \xb5",
        b"G \x1b[31mred\x1b[0m \x07bell\nnewline",
        "H PreArm: üñí".encode(),
        b"Armed by RC\t",
        "I \u202eturned".encode(),
        b"J \x9b31m",
    ]
    texts = through_the_wire(*(mavlink.MAVLink_statustext_message(4, text, 0, 0) for text in packed))
    assert [text.text for text in texts] == [
        r"F bad utf8 \xff\xfe \xb5",
        r"G \x1b[31mred\x1b[0m \x07bell\nnewline",
        "H PreArm: üñí",
        "Armed by RC",
        r"I \u202eturned",
        r"J \x9b31m",
    ]


def test_a_character_that_lies_across_two_parts_is_one():
    raw = ("a" * 49 + "ü" + "b" * 60).encode()
    parts = [raw[:50], raw[50:100], raw[100:]]
    messages = [mavlink.MAVLink_statustext_message(4, part, 5, number) for number, part in enumerate(parts)]
    assert [text.text for text in through_the_wire(*messages)] == [raw.decode()]


@given(
    texts=st.lists(
        st.text("abc dÿ", min_size=51, max_size=200).map(str.strip).filter(len), min_size=1, max_size=6
    ),
    seed=st.integers(0, 1000),
)
def test_any_order_gives_the_texts_that_were_sent(texts: list[str], seed: int) -> None:
    pieces = [(i + 1, n, part) for i, text in enumerate(texts) for n, part in enumerate(parts_of(text))]
    random.Random(seed).shuffle(pieces)
    assembler = TextAssembler()
    found = [t for identity, n, part in pieces for t in assembler.add(0.0, 4, part, identity, n)]
    expected = [text.encode("latin-1").decode("utf-8", "backslashreplace") for text in texts]
    assert sorted(t.text for t in found) == sorted(expected)
    assert assembler.expire(9.0) == []


@given(st.lists(st.tuples(st.text(max_size=60), st.integers(0, 65535), st.integers(0, 255)), max_size=60))
def test_whatever_comes_is_bounded_and_visible(messages: list[tuple[str, int, int]]) -> None:
    assembler = TextAssembler()
    found = [t for text, identity, part in messages for t in assembler.add(0.0, 4, text, identity, part)]
    waiting = assembler.expire(5.0)
    assert len(waiting) <= OPEN_AT_MOST
    assert all(t.text.isprintable() for t in [*found, *waiting])


def test_a_part_that_is_said_again_and_again_does_not_keep_its_text_back():
    assembler = TextAssembler()
    told = []
    for tick in range(20):
        now_s = 0.2 * tick
        told += assembler.expire(now_s)
        told += assembler.add(now_s, 4, "B" * 50, 8, 0)
    assert {text.text for text in told} == {"B" * 50 + " [part missing]"}
    assert len(told) == 3
