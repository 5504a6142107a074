"""A strategy's own structs as bytes: the note in its orders, the word to its neighbours.

Wire, tree and recordings carry the bytes and do not look into them: they need not know which strategies there are.
What comes from a node that is broken, hostile or flies another strategy unpacks to None, so that a strategy never
has to ask whether a number in its own struct is one: the struct's `__post_init__` says what it must not hold.
"""

from __future__ import annotations

import math
from typing import Generic, TypeVar

import msgspec

from mission.estimation.estimates import Reading

FARTHEST_M = 100_000.0
"""From the origin, per axis: farther away is no place of a survey."""

T = TypeVar("T", bound=msgspec.Struct)


class Packed(Generic[T]):
    """Packs and unpacks one tagged struct; its tag is the strategy's name, so that no strategy reads another's."""

    def __init__(self, kind: type[T]) -> None:
        if kind.__struct_config__.tag is None:
            raise TypeError(
                f"{kind.__name__} needs a tag: without one another strategy's bytes could pass for it"
            )
        self._encoder = msgspec.msgpack.Encoder()
        self._decoder = msgspec.msgpack.Decoder(kind)

    def pack(self, content: T) -> bytes:
        return self._encoder.encode(content)

    def unpack(self, data: bytes) -> T | None:
        """What was packed, or None where `data` is nothing that this struct allows."""
        if not data:
            return None
        try:
            return self._decoder.decode(data)
        # Text that is not UTF-8, or arrays nested thousands deep, are not errors of msgspec's own.
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
            return None


def is_contact(reading: Reading) -> bool:
    """Whether a reading that was heard of can be one that found something."""
    return (
        0.0 < reading.excess_co2_ppm <= 1e9
        and 0.0 <= reading.variance_ppm2 < math.inf
        and all(abs(axis) <= FARTHEST_M for axis in reading.position_ned_m)
    )
