"""Where a drone may be soon that makes no way: over its home, and over where it is, or fell silent.

Both are places that are known beforehand. Whoever is steered by an agent keeps out of them, so that one that comes
home unheard, steered or by its autopilot, goes up and down alone (docs/decisions/0015-apart-without-hearing.md). One
that is heard may begin to climb as well, faster than who is over it can.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from flightstack.flight.guidance import CORRIDOR_M, horizontal_m, whereabouts
from flightstack.swarm.peers import FRESH_S
from mission.geometry.frames import Vector3
from mission.strategies.contract import Neighbour

CLIMBS_WITHIN_S = 40.0
"""Who falls silent and goes home has left the place where it was last heard within this time, upwards: it is missed
within 10 s, by the others as by a ground station, and the layers of ten drones are 25 s high."""


LEAVES_WITHIN_M = 20.0
"""So far over one that is heard its column is left in time: an autopilot climbs at 3 m/s, who comes down towards it
does 1.5 m/s, and needs 3 s to the side."""


def columns(
    neighbours: Sequence[Neighbour],
    seen_from_ned_m: Vector3,
    own_home_ned_m: Vector3 | None,
    room_m: float,
) -> Iterator[tuple[int, Vector3, float]]:
    """(drone, the nearest point of a column of it, the room to keep); nothing for one that hears and makes way.

    Launch points stand closer than `room_m` + `CORRIDOR_M` at times: then the room leaves the way down to the own
    home free.
    """
    adrift = [other for other in neighbours if other.airborne and other.adrift]
    homes = [(other.drone, other.home_ned_m) for other in neighbours if other.home_ned_m is not None]
    level_m = seen_from_ned_m[2]

    def beside_own_way_down(place: Vector3) -> float:
        spare_m = math.inf if own_home_ned_m is None else horizontal_m(place, own_home_ned_m)
        return min(room_m, max(0.0, spare_m - CORRIDOR_M))

    for drone, (north_m, east_m, _) in homes:
        if any(other.drone == drone for other in adrift):
            place = (north_m, east_m, level_m)
            yield drone, place, beside_own_way_down(place)
    for other in adrift:
        north_m, east_m, down_m = whereabouts(other, seen_from_ned_m)
        if other.age_s <= FRESH_S and 0.0 < down_m - level_m < LEAVES_WITHIN_M:
            place = (north_m, east_m, level_m)
            yield other.drone, place, beside_own_way_down(place)
    for other in neighbours:
        north_m, east_m, down_m = other.position_ned_m
        if not (other.airborne and FRESH_S < other.age_s < CLIMBS_WITHIN_S and level_m < down_m):
            continue
        place = (north_m, east_m, level_m)
        # It keeps out of the others' columns itself: until it climbs it may have come so much nearer.
        others = [home for drone, home in homes if drone != other.drone]
        others += [own_home_ned_m] if own_home_ned_m is not None else []
        shift_m = max((room_m - horizontal_m(place, home) for home in others), default=0.0)
        farther_m = min(room_m + shift_m, horizontal_m(place, seen_from_ned_m))
        yield other.drone, place, max(room_m, farther_m)


def in_own_cell(
    place_ned_m: Vector3, own_home_ned_m: Vector3, other_home_ned_m: Vector3, room_m: float
) -> bool:
    """Whether a landing place is on the own side of the middle between two homes, half of `room_m` from it: of two
    drones that know nothing of each other each finds one that the other does not take. The own home always is."""
    apart_m = horizontal_m(own_home_ned_m, other_home_ned_m)
    nearer_m2 = (
        horizontal_m(place_ned_m, other_home_ned_m) ** 2 - horizontal_m(place_ned_m, own_home_ned_m) ** 2
    )
    return nearer_m2 >= min(room_m, apart_m) * apart_m
