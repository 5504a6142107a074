"""Status texts in parts: put together, whoever cuts in and whatever is lost."""

from __future__ import annotations

from flightstack.mavlink.statustext import StatusText, TextAssembler


def test_a_long_text_is_put_together():
    text = "EKF3 IMU0 forced reset and some more words to pass fifty characters by far, and more"
    assembler = TextAssembler()
    assert assembler.add(0.0, 4, text[:50], 7, 0) == []
    assert assembler.add(0.1, 4, text[50:], 7, 1) == [StatusText(4, text)]


def test_a_text_whose_end_is_lost_is_given_out_after_a_while():
    assembler = TextAssembler()
    assembler.add(0.0, 2, "x" * 50, 7, 0)
    assert assembler.expire(0.5) == []
    assert assembler.expire(1.5) == [StatusText(2, "x" * 50)]
    assert assembler.add(2.0, 6, "short", 0, 0) == [StatusText(6, "short")]
