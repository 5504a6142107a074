"""What the root of a LoCUS swarm must know to go on: it travels in the order, so that an heir finds it there."""

from __future__ import annotations

import math

import msgspec

from mission.geometry.frames import Vector3
from mission.strategies.contract import Order, Reading
from mission.strategies.packed import Packed

_FARTHEST_M = 100_000.0


class LocusNote(msgspec.Struct, frozen=True, array_like=True, tag="locus"):
    search_radius_m: float = -1.0
    """How far out the search has got, negative before its first point: a new root goes on from here."""
    search_start_ned_m: Vector3 | None = None
    """Where the search began; None before it did."""
    best: Reading | None = None
    """The reading that a better one must beat, None without contact."""
    waypoints_since_best: int = 0
    """How many waypoints have been visited since `best` was taken."""

    def __post_init__(self) -> None:
        places = [self.search_start_ned_m, self.best.position_ned_m if self.best else None]
        numbers = [self.search_radius_m, *(axis for place in places if place for axis in place)]
        if not all(abs(number) <= _FARTHEST_M for number in numbers):  # not a number is not within, either
            raise ValueError("a place or radius in the note is none")
        if not 0 <= self.waypoints_since_best < 1 << 31:
            raise ValueError("the waypoints in the note are no count")
        best = self.best
        if best is not None and not (
            0.0 < best.excess_co2_ppm <= 1e9 and 0.0 <= best.variance_ppm2 < math.inf
        ):
            raise ValueError("the best reading in the note is none")


_PACKED = Packed(LocusNote)


def note_of(order: Order) -> LocusNote:
    """The note in `order`; an empty one where there is none, as at the start, or where it says what cannot be."""
    return _PACKED.unpack(order.note) or LocusNote()


def noted(order: Order, note: LocusNote) -> Order:
    """`order` with `note`."""
    return msgspec.structs.replace(order, note=_PACKED.pack(note))
