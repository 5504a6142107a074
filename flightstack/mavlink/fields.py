"""Payloads to the fields of their messages and back, laid out as the dialect says and nothing more.

pymavlink's own decoder builds a message object that can also be printed, packed again and signed. A tick wants a few
numbers by their names, so its formats are used and its decoder is not.
"""

from __future__ import annotations

import collections
import functools
import operator
import struct
from collections.abc import Callable, Iterable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.dialect import MESSAGES


class MessageLayout:
    """How one kind of message lies in its payload."""

    def __init__(self, kind: int) -> None:
        """KeyError if the dialect has no message of this id."""
        definition = MESSAGES[kind]
        names: list[str] = definition.ordered_fieldnames
        self.name: str = definition.msgname
        self._struct: struct.Struct = definition.unpacker
        self._lengths: list[int] = definition.lengths
        sizes: list[int] = definition.array_lengths
        self._is_text = [bool(size) and count == 1 for size, count in zip(sizes, self._lengths, strict=True)]
        self.is_plain = not any(definition.array_lengths)
        """Whether it has numbers only."""
        # A status text's parts are put together before anybody can read them: each byte is kept as a character.
        is_part = kind == mavlink.MAVLINK_MSG_ID_STATUSTEXT
        self._reading = ("latin-1", "strict") if is_part else ("ascii", "replace")
        self._numbers_of = operator.attrgetter(*names)
        made = collections.namedtuple(self.name.lower(), names)  # type: ignore[misc]  # the dialect's names
        # Of which kind it is, the way pymavlink's own messages tell it: who handles messages takes either.
        typed: Any = type(made.__name__, (made,), {"__slots__": (), "get_type": lambda _: self.name})
        self._make: Callable[[Iterable[Any]], Any] = typed._make

    def unpack(self, payload: bytes) -> Any:
        """The fields by name: numbers, texts without what follows their zero, and tuples.

        What is missing at the end is zeros (MAVLink 2 cuts them off, MAVLink 1 has no extensions); what a newer
        definition adds is left out.
        """
        size = self._struct.size
        if len(payload) != size:
            payload = payload[:size].ljust(size, b"\0")
        values = self._struct.unpack(payload)
        return self._make(values if self.is_plain else self._gathered(values))

    def pack(self, message: Any) -> bytes:
        """The payload of one of pymavlink's messages of this kind, without zeros at its end. It must be plain."""
        numbers = self._numbers_of(message)
        payload = self._struct.pack(*numbers) if isinstance(numbers, tuple) else self._struct.pack(numbers)
        return payload.rstrip(b"\0") or b"\0"

    def _gathered(self, values: tuple[Any, ...]) -> list[Any]:
        gathered: list[Any] = []
        at = 0
        for count, is_text in zip(self._lengths, self._is_text, strict=True):
            if is_text:
                gathered.append(values[at].split(b"\0", 1)[0].decode(*self._reading))
            elif count == 1:
                gathered.append(values[at])
            else:
                gathered.append(values[at : at + count])
            at += count
        return gathered


@functools.cache
def layout(kind: int) -> MessageLayout:
    return MessageLayout(kind)
