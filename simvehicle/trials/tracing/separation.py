"""How vehicles keep off each other, whatever their rule wants: an override when one is near, and no touch ever.

A vehicle's way of a step stays in its buffered Voronoi cell (Zhou, Wang, Bandyopadhyay, Schwager 2017): on its own
side, by its radius, of the middle between it and each neighbour. All cells are convex and apart, so vehicles that
move at the same time along straight lines never touch, whatever the order in which they are looked at.
"""

from __future__ import annotations

import math

from mission.geometry.formation import FloatArray
from mission.strategies.tick_rule import EAST, NORTH
from simvehicle.compiled import leaf

_HAIR_M = 1e-6
"""More than rounding can take away in a step."""


@leaf
def nearest_m(rows: FloatArray, count: int) -> float:
    """The distance of the nearest neighbour, infinite without one."""
    least2 = math.inf
    for k in range(count):
        least2 = min(least2, rows[k, NORTH] * rows[k, NORTH] + rows[k, EAST] * rows[k, EAST])
    return math.sqrt(least2)


@leaf
def flee(rows: FloatArray, count: int, within_m: float, speed_mps: float) -> tuple[float, float]:
    """The velocity away from everybody within `within_m`, the more from whom is nearer; 0 where they balance."""
    north, east = 0.0, 0.0
    for k in range(count):
        away2 = rows[k, NORTH] * rows[k, NORTH] + rows[k, EAST] * rows[k, EAST]
        if 0.0 < away2 < within_m * within_m:
            north -= rows[k, NORTH] / away2
            east -= rows[k, EAST] / away2
    size = math.sqrt(north * north + east * east)
    if size < 1e-9:
        return 0.0, 0.0
    return speed_mps * north / size, speed_mps * east / size


@leaf
def slide_off(
    rows: FloatArray, count: int, north_mps: float, east_mps: float, apart_m: float, step_s: float
) -> tuple[float, float]:
    """The velocity without its parts that would cross the border to a neighbour: it slides past where it can."""
    for k in range(count):
        away_m = math.sqrt(rows[k, NORTH] * rows[k, NORTH] + rows[k, EAST] * rows[k, EAST])
        toward_n, toward_e = rows[k, NORTH] / away_m, rows[k, EAST] / away_m
        room_mps = max(0.5 * (away_m - apart_m - _HAIR_M), 0.0) / step_s
        too_fast = north_mps * toward_n + east_mps * toward_e - room_mps
        if too_fast > 0.0:
            north_mps -= too_fast * toward_n
            east_mps -= too_fast * toward_e
    return north_mps, east_mps


@leaf
def share_of_way(
    rows: FloatArray, count: int, north_mps: float, east_mps: float, apart_m: float, step_s: float
) -> float:
    """How much of this step's way stays in the vehicle's own cell, 0 to 1."""
    share = 1.0
    for k in range(count):
        away_m = math.sqrt(rows[k, NORTH] * rows[k, NORTH] + rows[k, EAST] * rows[k, EAST])
        along_m = step_s * (north_mps * rows[k, NORTH] + east_mps * rows[k, EAST]) / away_m
        room_m = max(0.5 * (away_m - apart_m - _HAIR_M), 0.0)
        if along_m > room_m:
            share = min(share, room_m / along_m)
    return share
