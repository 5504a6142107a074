"""Damaged copies of real files: seeded, so that every case can be made again from its number.

Two kinds of damage: to bytes, as discs, links and editors do it, and to the structure of a document, as other
programs and people write it: another type, nothing, nested without end, a key twice, a number that nobody can fly.
"""

from __future__ import annotations

import copy
import json
import random
import re
from collections.abc import Callable, Sequence
from typing import Any

Mutation = Callable[[random.Random, bytes], bytes]

NUMBERS = (
    *(
        "0",
        "-0",
        "-1",
        "1",
        "1e308",
        "-1e308",
        "1e400",
        "1e-320",
        "NaN",
        "nan",
        "Infinity",
        "-inf",
        ".inf",
        ".nan",
    ),
    *("2147483647", "2147483648", "-2147483649", "4294967296", "9223372036854775808", "16777217", "99999999"),
    *(
        "9" * 30,
        "9" * 400,
        "0x10",
        "01500",
        "1_000",
        "12:30",
        "1,5",
        "90.0000001",
        "-180.1",
        "359.9999",
        "1.",
    ),
    *(
        ".5",
        "+7",
        "--3",
        "1e",
        "1 2",
        "",
        "null",
        "true",
        "no",
        "off",
        "١٢٣",
        "½",
        "２",
        "1\u2009000",
        "6\u00b0",
    ),
)
WORDS = (
    *(
        b"\x00",
        b"\xff\xfe",
        b"\xef\xbb\xbf",
        b"\r",
        b"\n\n\n",
        b"\t",
        b"\x1b[2J",
        b"\x02",
        b"\x03",
        b"$",
        b"*",
        b"&a",
    ),
    *(
        b"*a",
        b"{",
        b"}",
        b"[",
        b"]",
        b"<",
        b">",
        b"</",
        b"<!--",
        b"-->",
        b"<![CDATA[",
        b"&amp;",
        b"&#0;",
        b"&lol;",
    ),
    *(
        b'"',
        b"'",
        b"\\",
        b"\\u0000",
        b"\\ud800",
        b": ",
        b"- ",
        b"#",
        b"!!python/object:os.system",
        b"<<: *a",
        b"? ",
    ),
    *(
        b"null",
        b"true",
        b"~",
        b"---\n",
        b"...\n",
        "é".encode(),
        "é".encode("latin-1"),
        "😀".encode(),
        "\u2028".encode(),
    ),
)
_NUMBER = re.compile(rb"[+-]?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")
_TAG = re.compile(rb"<[^<>]{1,80}>")
_VALUES: tuple[Any, ...] = (
    *(
        None,
        True,
        False,
        0,
        -1,
        1,
        2,
        16,
        255,
        1e9,
        -1e9,
        1e308,
        float("nan"),
        float("inf"),
        2**31,
        2**63,
        10**40,
    ),
    *(
        "",
        "x",
        "NaN",
        "1",
        "é😀",
        "a" * 300,
        "\x1b[31m",
        "\ud800",
        [],
        {},
        [[]],
        [None],
        {"a": None},
        47.5,
        181.0,
        90.5,
    ),
)


def a_chunk(rng: random.Random, data: bytes, at_most: int = 64) -> tuple[int, int]:
    begin = rng.randrange(len(data) + 1)
    return begin, min(len(data), begin + rng.randint(0, at_most))


def flip(rng: random.Random, data: bytes) -> bytes:
    damaged = bytearray(data or b"\x00")
    for _ in range(rng.choice((1, 1, 2, 5, 20))):
        damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
    return bytes(damaged)


def cut(rng: random.Random, data: bytes) -> bytes:
    begin, end = a_chunk(rng, data, rng.choice((1, 4, 64, 4096)))
    return data[:begin] + data[end:]


def truncate(rng: random.Random, data: bytes) -> bytes:
    place = rng.randrange(len(data) + 1)
    return data[:place] if rng.random() < 0.7 else data[place:]


def insert(rng: random.Random, data: bytes) -> bytes:
    place = rng.randrange(len(data) + 1)
    what = (
        rng.choice(WORDS) * rng.choice((1, 1, 1, 3))
        if rng.random() < 0.7
        else rng.randbytes(rng.randint(1, 16))
    )
    return data[:place] + what + data[place:]


def repeat(rng: random.Random, data: bytes) -> bytes:
    begin, end = a_chunk(rng, data, rng.choice((8, 64, 1024)))
    return data[:end] + data[begin:end] * rng.choice((1, 1, 2, 20)) + data[end:]


def swap(rng: random.Random, data: bytes) -> bytes:
    (a, b), (c, d) = sorted((a_chunk(rng, data), a_chunk(rng, data)))
    b = min(b, c)
    return data[:a] + data[c:d] + data[b:c] + data[a:b] + data[d:]


def number(rng: random.Random, data: bytes) -> bytes:
    found = list(_NUMBER.finditer(data))
    for match in sorted(
        rng.sample(found, min(len(found), rng.choice((1, 1, 2, 4)))), key=lambda m: -m.start()
    ):
        data = data[: match.start()] + rng.choice(NUMBERS).encode() + data[match.end() :]
    return data


def lines(rng: random.Random, data: bytes) -> bytes:
    """A line lost, twice, elsewhere, or indented otherwise."""
    rows = data.splitlines(keepends=True) or [b"\n"]
    index, other = rng.randrange(len(rows)), rng.randrange(len(rows))
    match rng.randrange(5):
        case 0:
            del rows[index]
        case 1:
            rows.insert(other, rows[index])
        case 2:
            rows[index], rows[other] = rows[other], rows[index]
        case 3:
            rows[index] = rng.choice((b" ", b"    ", b"\t")) + rows[index]
        case _:
            rows[index] = rows[index].lstrip()
    return b"".join(rows)


def tags(rng: random.Random, data: bytes) -> bytes:
    """An XML tag lost, twice, elsewhere, nested, or in another case."""
    found = list(_TAG.finditer(data))
    if not found:
        return insert(rng, data)
    one, other = rng.choice(found), rng.choice(found)
    what = {0: b"", 1: one[0] * 2, 2: other[0], 3: one[0] * 3000, 4: one[0].swapcase(), 5: other[0] + one[0]}
    return data[: one.start()] + what[rng.randrange(6)] + data[one.end() :]


BYTES: tuple[Mutation, ...] = (flip, cut, truncate, insert, repeat, swap, number, number, number, lines)


def structure(rng: random.Random, document: Any) -> Any:
    """A copy of decoded JSON in which one to three places are something else."""
    document = copy.deepcopy(document)
    for _ in range(rng.choice((1, 1, 2, 3))):
        places = list(_places(document))
        if not places:
            return rng.choice(_VALUES)
        inside, key = rng.choice(places)
        match rng.randrange(10):
            case 0 if isinstance(inside, dict):
                del inside[key]
            case 0:
                inside.pop(key)
            case 1 if isinstance(inside, list):
                inside.insert(key, copy.deepcopy(inside[key]))
            case 1:
                inside[rng.choice(list(inside))] = copy.deepcopy(inside[key])
            case 2:
                other, other_key = rng.choice(places)
                if other_key in other if isinstance(other, dict) else other_key < len(other):
                    inside[key] = copy.deepcopy(other[other_key])
            case 3:
                inside[key] = _nested(rng, inside[key])
            case 4 if isinstance(inside, dict):
                inside[f"{key}_"] = inside.pop(key)
            case 5 if isinstance(inside[key], int | float) and not isinstance(inside[key], bool):
                inside[key] = (
                    -inside[key] if rng.random() < 0.5 else inside[key] * rng.choice((10, 1e6, 1e-6, 0.5))
                )
            case _:
                inside[key] = copy.deepcopy(rng.choice(_VALUES))
    return document


def _nested(rng: random.Random, value: Any) -> Any:
    # The deepest is more than a reader takes, and little enough to be copied when it comes three times.
    for _ in range(rng.choice((1, 2, 30, 102))):
        value = [value] if rng.random() < 0.5 else {"items": value}
    return value


def _places(value: Any) -> Any:
    """Every (container, key or index) of a document."""
    stack = [value]
    while stack:
        inside = stack.pop()
        entries = inside.items() if isinstance(inside, dict) else enumerate(inside)
        for key, child in entries:
            yield inside, key
            if isinstance(child, dict | list):
                stack.append(child)


def json_text(rng: random.Random, document: Any) -> bytes:
    """A document as JSON, sometimes with a key that stands twice, or so deep that no reader can take it."""
    text = json.dumps(document, ensure_ascii=rng.random() < 0.5, indent=rng.choice((None, 1)))
    if rng.random() < 0.05 and (keys := list(re.finditer(r'"\w+": ', text))):
        key = rng.choice(keys)
        text = text[: key.start()] + f"{key[0]}{rng.choice(NUMBERS) or 0}, " + text[key.start() :]
    if rng.random() < 0.01:
        depth, place = rng.choice((200, 3000, 100_000)), text.find("[") + 1
        text = text[:place] + "[" * depth + "]" * depth + ("," if rng.random() < 0.5 else "") + text[place:]
    return text.encode("utf-8", "surrogatepass")


class Mutator:
    """Case `number` of a kind of file is the same bytes on every machine and in every run."""

    def __init__(
        self,
        kind: str,
        seeds: Sequence[bytes],
        mutations: Sequence[Mutation] = BYTES,
        documents: Sequence[Any] = (),
        text: Callable[[random.Random, Any], bytes] = json_text,
    ) -> None:
        self._kind, self._seeds, self._mutations = kind, list(seeds), tuple(mutations)
        self._documents, self._text = list(documents), text

    def case(self, index: int) -> bytes:
        rng = random.Random(f"{self._kind} {index}")
        if self._documents and rng.random() < 0.5:
            return self._text(rng, structure(rng, rng.choice(self._documents)))
        data = rng.choice(self._seeds)
        if rng.random() < 0.05:  # the beginning of one file and the end of another
            other = rng.choice(self._seeds)
            data = data[: rng.randrange(len(data) + 1)] + other[rng.randrange(len(other) + 1) :]
        for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
            data = rng.choice(self._mutations)(rng, data)
        return data
