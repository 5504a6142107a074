"""Ways home that autopilots fly by themselves: straight up, straight over, straight down, whoever is there.

Each crosses at an altitude of its own (docs/decisions/0015-apart-without-hearing.md). So two of them meet only where
one climbs, or comes down, close to the other's way across; and one that comes down on whoever still hovers over its
home. Whoever brings several home lets them go in such an order that this cannot be.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import NamedTuple

from mission.geometry.frames import Vector3

_OVER_HOME_M = 2.0
"""Nearer than this to home an autopilot only comes down."""


class WayHome(NamedTuple):
    """What is left of one."""

    position_ned_m: Vector3
    home_ned_m: Vector3


def in_the_way(
    waiting: Mapping[int, WayHome],
    on_their_way: Mapping[int, WayHome],
    room_m: float,
    *,
    later: Collection[int] = (),
) -> dict[int, int]:
    """Who has to wait, and the drone that has to come down, or to go, before; those that are left set out now, all at
    once.

    `waiting`: vehicles that stay where they are until they are brought home; `later`: those of them that do not set
    out now in any case. `room_m`: how near two may come.

    Some may hover over each other's homes, so that none can be the first: they set out together. All climb side by
    side, and the lower one has crossed, and is gone, when the higher one comes.
    """
    over_home = {
        drone: {
            other
            for other, there in waiting.items()
            if other != drone and _level_m(there.position_ned_m, way.home_ned_m) < room_m
        }
        for drone, way in waiting.items()
    }
    before = {drone: _reached(drone, over_home) for drone in waiting}
    held: dict[int, int] = {}
    gone = dict(on_their_way)
    for drone in sorted(waiting):
        if drone in held or drone in gone or drone in later:
            continue
        together = {drone} | {other for other in before[drone] if drone in before[other]}
        hovers = (before[drone] - together - gone.keys()) | together.intersection(later)
        meets = (d for d, other in gone.items() for k in together if _may_meet(waiting[k], other, room_m))
        first = min(hovers) if hovers else next(meets, None)
        for one in together:
            if first is None:
                gone[one] = waiting[one]
            elif one not in later:
                held[one] = first
    return held


def _reached(drone: int, over_home: Mapping[int, set[int]]) -> set[int]:
    """Who has to go before it, and before those."""
    found: set[int] = set()
    edge = [drone]
    while edge:
        new = over_home[edge.pop()] - found
        found |= new
        edge += new
    return found


def _may_meet(waiting: WayHome, other: WayHome, room_m: float) -> bool:
    over_home = _level_m(other.position_ned_m, other.home_ned_m) < _OVER_HOME_M
    if over_home and other.position_ned_m[2] > waiting.position_ned_m[2] + room_m:
        return (
            _level_m(other.home_ned_m, waiting.home_ned_m) < room_m
        )  # it is below all of the way but its end
    return any(
        _beside_m(place, way) < room_m
        for way, goes_up_or_down in ((waiting, other), (other, waiting))
        for place in goes_up_or_down
    )


def _level_m(a: Vector3, b: Vector3) -> float:
    return math.hypot(a[0] - b[0], a[1] - b[1])


def _beside_m(place: Vector3, way: WayHome) -> float:
    """How far from the way across a place is, seen from above."""
    (from_n, from_e, _), (to_n, to_e, _) = way
    along_n, along_e = to_n - from_n, to_e - from_e
    length2 = along_n**2 + along_e**2
    share = (
        ((place[0] - from_n) * along_n + (place[1] - from_e) * along_e) / length2 if length2 > 0.0 else 0.0
    )
    share = min(max(share, 0.0), 1.0)
    return math.hypot(place[0] - from_n - share * along_n, place[1] - from_e - share * along_e)
