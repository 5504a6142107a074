"""Where a drone flies on its own account: forming up, filling another's slot, going home.

Each path is a plain function of where the drone is and where it shall be: it has no memory, so that a drone that
was pushed aside, paused or restarted goes on from wherever it finds itself. All positions are NED metres in the
swarm's frame; "layer" is the altitude (as down) that belongs to one drone while it crosses the others' way.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from flightstack.config import LimitsConfig
from flightstack.swarm.peers import FRESH_S
from mission.geometry.frames import Vector3
from mission.strategies.contract import Neighbour

CORRIDOR_M = 1.5
"""Horizontal distance below which a drone counts as above or below its target."""


PARKED_M = 3.0
"""Room to a drone on the ground."""


def horizontal_m(a: Vector3, b: Vector3) -> float:
    return math.hypot(a[0] - b[0], a[1] - b[1])


def over_the_top(position_ned_m: Vector3, target_ned_m: Vector3, layer_down_m: float) -> Vector3:
    """Climb to the layer, cross in it, come down onto the target: forming up and going home."""
    reached = position_ned_m[2] <= layer_down_m + 1.0
    return _by_layer(position_ned_m, target_ned_m, layer_down_m, target_ned_m[:2], reached=reached)


def heir_below_m(limits: LimitsConfig) -> float:
    """How far below the formation an heir crosses: the separation, and some room."""
    return 1.25 * limits.separation_m + 1.0


def underneath(
    position_ned_m: Vector3,
    target_ned_m: Vector3,
    layer_down_m: float,
    turn_m: tuple[float, float] | None = None,
) -> Vector3:
    """Descend below the formation, cross there, climb into the slot: the heir's way (LoCUS paper, figure 5).

    `turn_m`: where (north, east) the crossing ends, if down there something stands below the slot.
    """
    reached = position_ned_m[2] >= layer_down_m - 0.7
    turn_m = target_ned_m[:2] if turn_m is None else turn_m
    return _by_layer(position_ned_m, target_ned_m, layer_down_m, turn_m, reached=reached)


COAST_S = 4.0
"""How long a vehicle may fly on after its agent's last word: ArduPilot follows a velocity for 3 s, then brakes."""


def stretch(other: Neighbour) -> tuple[Vector3, Vector3]:
    """The ends of the stretch on which a neighbour is now: both the same, but for one that fell silent on its way."""
    position, velocity = other.position_ned_m, other.velocity_ned_mps
    ends = (other.age_s,) * 2 if other.age_s <= FRESH_S else (0.0, min(other.age_s, COAST_S))
    (n, e, d), (north_mps, east_mps, down_mps) = position, velocity
    first, last = ((n + north_mps * s, e + east_mps * s, d + down_mps * s) for s in ends)
    return first, last


def whereabouts(other: Neighbour, seen_from_ned_m: Vector3) -> Vector3:
    """Where a neighbour is now; of the places where one that fell silent can have come to rest, the nearest."""
    position, (north_mps, east_mps, down_mps) = other.position_ned_m, other.velocity_ned_mps
    if other.age_s <= FRESH_S:
        ahead_s = other.age_s
    else:
        velocity = other.velocity_ned_mps
        speed2 = math.fsum(v * v for v in velocity)
        to_us = math.fsum((s - p) * v for s, p, v in zip(seen_from_ned_m, position, velocity, strict=True))
        ahead_s = min(max(to_us / speed2, 0.0), other.age_s, COAST_S) if speed2 > 1e-4 else 0.0
    return (
        position[0] + north_mps * ahead_s,
        position[1] + east_mps * ahead_s,
        position[2] + down_mps * ahead_s,
    )


PLACES_BESIDE_M = sorted(
    ((2.0 * i, 2.0 * j) for i in range(-12, 13) for j in range(-12, 13)),
    key=lambda beside: math.hypot(*beside),
)
"""Offsets (north, east) of a 2 m grid, the nearest place first."""


HOVERS_MPS = 0.5
"""Slower than this a vehicle stays where it is; one that passes a column, or lands beside it, is soon gone."""


def stays(other: Neighbour, hovers_mps: float = HOVERS_MPS) -> bool:
    """Will it still be there when we come, for all that is known?"""
    moves = other.age_s <= FRESH_S and math.hypot(*other.velocity_ned_mps) > hovers_mps
    return other.airborne and other.adrift and not moves


def column_free(point_ned_m: Vector3, neighbours: Sequence[Neighbour], room_m: float) -> bool:
    """Whether nobody who will not make way hovers within `room_m` of the column above a point."""
    return all(
        horizontal_m(
            point_ned_m, whereabouts(other, (point_ned_m[0], point_ned_m[1], other.position_ned_m[2]))
        )
        >= room_m
        for other in neighbours
        if stays(other)
    )


def landing_point(
    home_ned_m: Vector3,
    neighbours: Sequence[Neighbour],
    room_m: float,
    allowed: Callable[[float, float], bool],
) -> Vector3:
    """Where to come down: home, or the nearest place that nobody blocks who will not make way.

    A drone whose agent died may hover over the launch line until its battery is empty. Then the nearest point of a
    2 m grid around home is taken that keeps `room_m` from its column and `PARKED_M` from drones on the ground;
    home again where there is none.
    """
    if column_free(home_ned_m, neighbours, room_m):
        return home_ned_m
    parked = [n.position_ned_m for n in neighbours if not n.airborne]
    for north_m, east_m in PLACES_BESIDE_M:
        point = (home_ned_m[0] + north_m, home_ned_m[1] + east_m, home_ned_m[2])
        if (
            all(horizontal_m(point, other) >= PARKED_M for other in parked)
            and column_free(point, neighbours, room_m)
            and allowed(point[0], point[1])
        ):
            return point
    return home_ned_m


def _by_layer(
    position: Vector3,
    target: Vector3,
    layer_down_m: float,
    turn_m: tuple[float, float],
    *,
    reached: bool,
) -> Vector3:
    if _aside_m(position[:2], turn_m, target[:2]) <= CORRIDOR_M:
        return target
    if reached:
        return turn_m[0], turn_m[1], layer_down_m
    return position[0], position[1], layer_down_m


def _aside_m(place_m: tuple[float, float], a_m: tuple[float, float], b_m: tuple[float, float]) -> float:
    """Horizontal distance of a place to the stretch from a to b."""
    along_n, along_e = b_m[0] - a_m[0], b_m[1] - a_m[1]
    from_a = (place_m[0] - a_m[0], place_m[1] - a_m[1])
    length2_m2 = along_n**2 + along_e**2
    share = (from_a[0] * along_n + from_a[1] * along_e) / length2_m2 if length2_m2 > 0.0 else 0.0
    share = min(max(share, 0.0), 1.0)
    return math.hypot(from_a[0] - share * along_n, from_a[1] - share * along_e)
