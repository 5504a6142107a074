"""Words from elsewhere, made safe to show."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission.documents.printable import printable


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain words, ü and 5 µg – all of it", "plain words, ü and 5 µg – all of it"),
        ("\x1b[2J\x07", r"\x1b[2J\x07"),
        ("two\nlines\tand\ra return", r"two\nlines\tand\ra return"),
        ("\u202eturned\u2066", r"\u202eturned\u2066"),
        ("half \ud800", r"half \ud800"),
        ("", ""),
    ],
)
def test_only_what_is_no_visible_character_is_written_out(text: str, shown: str) -> None:
    assert printable(text) == shown


@given(st.text())
def test_what_comes_out_can_be_shown_and_stays_as_it_is(text: str) -> None:
    assert printable(text).isprintable()
    assert printable(printable(text)) == printable(text)
