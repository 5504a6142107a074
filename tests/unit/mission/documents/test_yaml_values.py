"""What words in YAML mean: what people mean by them, or a clear refusal; never another number."""

from __future__ import annotations

import pathlib
import time
from typing import Any

import msgspec
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.documents.yaml_file import DocumentError, parse, parse_value
from mission.documents.yaml_values import text_of


class Settings(msgspec.Struct, forbid_unknown_fields=True):
    value: Any = None
    other: Any = None
    base: Any = None


def value_of(text: str) -> Any:
    return parse(f"value: {text}\n", Settings, "a.yaml").value


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1500", 1500),
        ("-7", -7),
        ("+7", 7),
        ("0", 0),
        ("0.5", 0.5),
        (".5", 0.5),
        ("-.5", -0.5),
        ("1.", 1.0),
        ("1e3", 1000.0),
        ("2.5E-1", 0.25),
        ("true", True),
        ("False", False),
        ("~", None),
        ("null", None),
        ("2024-01-31", "2024-01-31"),
        ("y", "y"),
        ("n", "n"),
        ("yes and no", "yes and no"),
        ("'01500'", "01500"),
        ('"no"', "no"),
        ("tcp/127.0.0.1:7447", "tcp/127.0.0.1:7447"),
        ("udpin:0.0.0.0:14550", "udpin:0.0.0.0:14550"),
        ("127.0.0.1", "127.0.0.1"),
        ("=", "="),
    ],
)
def test_words_mean_what_people_mean(text: str, value: Any) -> None:
    read = value_of(text)
    assert read == value
    assert type(read) is type(value)


@pytest.mark.parametrize(
    ("text", "advice"),
    [
        ("01500", "write 1500"),
        ("-012", "write -12"),
        ("007.5", "write 7.5"),
        ("00", "write 0"),
        ("08", "write 8"),
        ("12:30:00", "base 60"),
        ("10:00", "base 60"),
        ("1_000", "write 1000"),
        ("3.14_15", "write 3.1415"),
        ("0x10", "decimal"),
        ("0o17", "decimal"),
        ("0b101", "decimal"),
        ("no", "write false"),
        ("Off", "write false"),
        ("YES", "write true"),
        ("on", "write true"),
        (".nan", "no number"),
        ("-.inf", "no number"),
        ("1e400", "no number"),
        ("99999999999999999999", "too large"),
        ("!!float 3", "plain value"),
        ("!!python/object/apply:os.getcwd []", "plain value"),
        ("!mine 3", "plain value"),
    ],
)
def test_words_of_two_meanings_are_refused_with_their_line_and_what_to_write(text: str, advice: str) -> None:
    with pytest.raises(DocumentError, match=r"^a\.yaml:2: ") as caught:
        parse(f"other: 1\nvalue: {text}\n", Settings, "a.yaml")
    assert advice in str(caught.value)


def test_a_key_is_such_a_word_too() -> None:
    with pytest.raises(DocumentError, match=r"a\.yaml:1: no may be text"):
        parse("no: 1\n", Settings, "a.yaml")


@pytest.mark.parametrize("text", ["value:\n\tother: 1\n", "value:\n  x: 1\n\ty: 2\n", "value:\n  \tx: 1\n"])
def test_a_tab_is_named(text: str) -> None:
    line = 1 + next(number for number, one in enumerate(text.split("\n")) if "\t" in one)
    with pytest.raises(DocumentError, match=rf"a\.yaml:{line}: a tab; YAML indents with spaces"):
        parse(text, Settings, "a.yaml")


def test_a_tab_inside_a_line_is_none_of_that() -> None:
    assert value_of("\t5\t# a comment") == 5


def test_a_key_that_stands_twice_is_refused_and_merged_keys_give_way() -> None:
    with pytest.raises(DocumentError, match=r"a\.yaml:2: the key 'value' stands twice"):
        parse("value: 1\nvalue: 2\n", Settings, "a.yaml")
    merged = parse("base: &b {x: 1, y: 2}\nvalue: {<<: *b, y: 3}\n", Settings, "a.yaml")
    assert merged.value == {"x": 1, "y": 3}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("value: &a [*a]\n", "refers to what it stands in"),
        ("value: " + "[" * 60 + "]" * 60, "nested too deeply"),
        ("value: " + "[" * 100_000, "nested too deeply"),
        ("value: 1\n---\nvalue: 2\n", "document"),
        ("value: {<<: 5}\n", "expected a mapping"),
        ("value: 1\n}\n", "a.yaml:2"),
        ("value: \x01\n", "control characters"),
        ("", "empty"),
        ("# nothing\n", "empty"),
    ],
)
def test_what_is_no_yaml_is_one_line(text: str, words: str) -> None:
    with pytest.raises(DocumentError) as caught:
        parse(text, Settings, "a.yaml")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_aliases_of_aliases_are_counted_and_not_built() -> None:
    lines = ["base: &a0 [1, 2, 3, 4, 5, 6, 7, 8, 9]", "value:"]
    lines += [f"- &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 40)]
    began_s = time.perf_counter()
    with pytest.raises(DocumentError, match="aliases counted as often"):
        parse("\n".join(lines), Settings, "a.yaml")
    assert time.perf_counter() - began_s < 5.0


def test_an_option_of_the_command_line_is_read_in_the_same_way() -> None:
    assert parse_value("1e3", "--option") == 1000.0
    with pytest.raises(DocumentError, match=r"--option range:1: 010 may be octal"):
        parse_value("010", "--option range")


def test_what_a_file_says_reaches_no_terminal_as_it_is() -> None:
    with pytest.raises(DocumentError) as caught:
        parse('"a\\e[31m\\nb": 1\n', Settings, "a.yaml")
    assert str(caught.value).isprintable()


values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**12), 10**12)
    | st.floats(-1e12, 1e12)
    | st.text(max_size=12),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(min_size=1, max_size=5), inner, max_size=3)
    ),
    max_leaves=8,
)
words = st.from_regex(r"[-+]?[0-9][0-9_.:xobe]{0,6}", fullmatch=True) | st.sampled_from(
    [
        "no",
        "Yes",
        "off",
        "ON",
        "null",
        "~",
        "true",
        "<<",
        "=",
        "",
        " ",
        "1e3",
        ".5",
        "0b1",
        "!x",
        "*a",
        "&a",
        "- a",
        "#",
    ]
)


@settings(max_examples=150, deadline=None)
@given(values | words)
def test_what_is_written_is_read_again_by_us_and_by_others(value: Any) -> None:
    text = text_of({"value": value})
    assert parse(text, Settings, "a.yaml").value == value
    assert yaml.safe_load(text)["value"] == value


@settings(max_examples=200, deadline=None)
@given(st.text("0123456789abxoeE+-._:nyfts", max_size=8))
def test_no_word_becomes_another_number(word: str) -> None:
    try:
        read = value_of(word)
    except DocumentError:
        return
    if isinstance(read, int | float) and not isinstance(read, bool):
        assert read == float(word), "what everybody else reads in these digits"


def test_files_are_read_as_text_or_refused(tmp_path: pathlib.Path) -> None:
    from mission.documents.yaml_file import read_text

    def written(data: bytes) -> pathlib.Path:
        (tmp_path / "f").write_bytes(data)
        return tmp_path / "f"

    assert read_text(written(b"\xef\xbb\xbfa\r\nb\rc\n")) == "a\nb\nc\n"
    for data, why in (
        ("a: 1".encode("utf-16"), "UTF-16"),
        (b"PK\x03\x04...", "zip"),
        (b"\x1f\x8b...", "compressed"),
        (b"a\n\xe9\n", "UTF-8"),
        (b"a\0b", "zero bytes"),
        (b"x" * ((16 << 20) + 1), "larger than"),
    ):
        with pytest.raises(DocumentError, match=why):
            read_text(written(data))
    with pytest.raises(DocumentError, match="Is a directory"):
        read_text(tmp_path)
