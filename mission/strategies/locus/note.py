"""What the root of a LoCUS swarm must know to go on: it travels in the order, so that an heir finds it there."""

from __future__ import annotations

import functools

import msgspec

from mission.estimation.estimates import Reading
from mission.geometry.frames import Vector3
from mission.strategies.contract import Order
from mission.strategies.packed import FARTHEST_M, Packed, is_contact


class LocusNote(msgspec.Struct, frozen=True, array_like=True, tag="locus"):
    search_radius_m: float = -1.0
    """How far out the search has got, negative before its first point: a new root goes on from here."""
    search_start_ned_m: Vector3 | None = None
    """Where the search began; None before it did."""
    best: Reading | None = None
    """The reading that a better one must beat, None without contact."""
    waypoints_since_best: int = 0
    """How many waypoints have been visited since `best` was taken."""
    search_bearing_rad: float = 0.0
    """Of the spoke that is being flown, where the search is on spokes."""

    seats: tuple[tuple[int, int], ...] = ()
    """(drone, place in the formation) where the drones do not stand in their tree's slots."""

    def __post_init__(self) -> None:
        start = self.search_start_ned_m or (0.0, 0.0, 0.0)
        numbers = (self.search_radius_m, self.search_bearing_rad, *start)
        if not all(abs(number) <= FARTHEST_M for number in numbers):  # not a number is not within, either
            raise ValueError("a place or radius in the note is none")
        if not 0 <= self.waypoints_since_best < 1 << 31:
            raise ValueError("the waypoints in the note are no count")
        if self.best is not None and not is_contact(self.best):
            raise ValueError("the best reading in the note is none")
        places = {place for _, place in self.seats}
        if len(places) < len(self.seats) or not all(0 <= place < 256 for place in places):
            raise ValueError("the seats in the note are none")


_PACKED = Packed(LocusNote)


def note_of(order: Order) -> LocusNote:
    """The note in `order`; an empty one where there is none, as at the start, or where it says what cannot be."""
    return _unpacked(order.note)


@functools.lru_cache(maxsize=64)
def _unpacked(note: bytes) -> LocusNote:
    """Every tick asks for the same order's."""
    return _PACKED.unpack(note) or LocusNote()


def noted(order: Order, note: LocusNote) -> Order:
    """`order` with `note`."""
    return msgspec.structs.replace(order, note=_PACKED.pack(note))
