"""What the root of a lattice must know to go on: it travels in the order, so that an heir finds it there."""

from __future__ import annotations

import functools

import msgspec
import numpy as np

from mission.estimation.estimates import Reading
from mission.geometry.formation import FloatArray
from mission.geometry.frames import Vector3
from mission.strategies.contract import Order
from mission.strategies.lattice.lattice_rule import LATTICE_STATE
from mission.strategies.packed import FARTHEST_M, Packed, is_contact

_MOST = 1e15
"""No radius, place, total or flux is larger."""


class LatticeNote(msgspec.Struct, frozen=True, array_like=True, tag="lattice"):
    start_ned_m: Vector3
    """Where the search began: the middle of its area."""
    state: tuple[float, ...]
    """Of the rule (`lattice_rule`), after the decision that gave the order."""
    best: Reading | None = None
    """The reading that a better one must beat, None without contact."""
    waypoints_since_best: int = 0

    def __post_init__(self) -> None:
        if not all(abs(axis) <= FARTHEST_M for axis in self.start_ned_m):
            raise ValueError("the start in the note is no place")
        if len(self.state) != LATTICE_STATE or not all(abs(number) <= _MOST for number in self.state):
            raise ValueError("the state in the note is none")
        if self.best is not None and not is_contact(self.best):
            raise ValueError("the best reading in the note is none")
        if not 0 <= self.waypoints_since_best < 1 << 31:
            raise ValueError("the waypoints in the note are no count")

    def rule_state(self) -> FloatArray:
        return np.array(self.state)


_PACKED = Packed(LatticeNote)


def lattice_note(order: Order) -> LatticeNote | None:
    """The note in `order`; None where there is none, or where it says what cannot be."""
    return _unpacked(order.note)


@functools.lru_cache(maxsize=64)
def _unpacked(note: bytes) -> LatticeNote | None:
    """Every tick asks for the same order's."""
    return _PACKED.unpack(note)


def with_lattice_note(order: Order, note: LatticeNote) -> Order:
    """`order` with `note`."""
    return msgspec.structs.replace(order, note=_PACKED.pack(note))
