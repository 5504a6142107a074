"""Terrain between two radios: who sees whom over which ridge."""

from __future__ import annotations

from typing import Annotated, Final

from msgspec import Meta

from flightstack.config import Section
from mission.geometry.frames import Vector3

_CoordinateM = Annotated[float, Meta(ge=-1e6, le=1e6)]

_AT_A_CORNER: Final = 1e-9
"""Fraction of a piece's length by which two pieces overlap where they join: rounding opens no gap there."""


class Ridge(Section, frozen=True, kw_only=True):
    """A crater's rim, a wall, a hill: everything below its crest hides. The crest is straight between its points."""

    crest_ned_m: Annotated[tuple[tuple[_CoordinateM, _CoordinateM, _CoordinateM], ...], Meta(min_length=2)]
    """Points along the crest, each at its own height: north, east, down in the swarm's frame."""

    def hides(self, a_ned_m: Vector3, b_ned_m: Vector3) -> bool:
        """Whether the straight line between the two passes below the crest; one that touches it passes.

        Neither the ground's reflection nor diffraction over the crest is reckoned with: at 2.4 GHz a crest metres
        above the line costs 20 dB and more.
        """
        near, far = sorted(
            (a_ned_m, b_ned_m)
        )  # the same rounding there and back: what a sees of b, b sees of a
        pieces = zip(self.crest_ned_m, self.crest_ned_m[1:], strict=False)
        return any(_passes_below(near, far, start, end) for start, end in pieces)


def _passes_below(a: Vector3, b: Vector3, start: Vector3, end: Vector3) -> bool:
    """Whether the line from `a` to `b` goes through the wall under the crest from `start` to `end` (all NED, m)."""
    north, east = b[0] - a[0], b[1] - a[1]
    crest_north, crest_east = end[0] - start[0], end[1] - start[1]
    to_north, to_east = start[0] - a[0], start[1] - a[1]
    cross = north * crest_east - east * crest_north
    aside = to_north * east - to_east * north
    if cross == 0.0:
        return aside == 0.0 and _passes_below_along(a, b, start, end)
    on_line = (to_north * crest_east - to_east * crest_north) / cross
    on_crest = aside / cross
    if not (0.0 <= on_line <= 1.0 and -_AT_A_CORNER <= on_crest <= 1.0 + _AT_A_CORNER):
        return False
    return _down_m(a, b, on_line) > _down_m(start, end, on_crest)


def _passes_below_along(a: Vector3, b: Vector3, start: Vector3, end: Vector3) -> bool:
    """As `_passes_below`, for a line along the crest: both are straight, so the ends of what they share decide."""
    north, east = b[0] - a[0], b[1] - a[1]
    length2 = north * north + east * east
    if length2 == 0.0:
        return False  # straight above each other: no ground is between them
    first = ((start[0] - a[0]) * north + (start[1] - a[1]) * east) / length2
    last = ((end[0] - a[0]) * north + (end[1] - a[1]) * east) / length2
    begins, ends = max(0.0, min(first, last)), min(1.0, max(first, last))
    if begins > ends:
        return False
    if first == last:
        return _down_m(a, b, first) > min(start[2], end[2])
    return any(
        _down_m(a, b, at) > _down_m(start, end, (at - first) / (last - first)) for at in (begins, ends)
    )


def _down_m(start: Vector3, end: Vector3, fraction: float) -> float:
    return start[2] + fraction * (end[2] - start[2])
