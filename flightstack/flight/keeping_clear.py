"""Keeping clear of what is known to stand there: the part of a velocity that leads into it is taken away.

An obstacle with its margin is a prism. A drone is outside of it as long as it is beside it or above it, so it may
come nearer the one way while it keeps its distance the other way. If it does neither, it is braked on the way on
which there is more room left: beside a wall it stops and may sink, over a roof it flies on and stops sinking.
"""

from __future__ import annotations

import math

from flightstack.config import LimitsConfig
from flightstack.flight.braking import REACTION_S, braking_distance_m, braking_speed_mps
from flightstack.flight.surroundings import ObstaclesAround
from mission.geometry.frames import Vector3
from mission.geometry.known_obstacles import Beside

_SLACK_M = 0.1
"""A drone that slides along a margin sways about it by so much."""
_AHEAD_M = 1.0
_TOO_FAST_MPS = 0.3
_PARTS = (1.0, 0.8, 0.6, 0.4, 0.2)


def kept_clear(
    position_ned_m: Vector3,
    velocity_ned_mps: Vector3,
    wanted_ned_mps: Vector3,
    obstacles: ObstaclesAround,
    limits: LimitsConfig,
) -> Vector3:
    """The velocity from which the drone can still stop before every obstacle; away from one whose margin it is in.

    `velocity_ned_mps`: how it moves now.
    """
    acceleration_mps2 = limits.acceleration_mps2
    reach_m = obstacles.margin_m + braking_distance_m(limits.speed_mps, acceleration_mps2) + _AHEAD_M
    near = obstacles.beside(position_ned_m, reach_m)
    velocity = wanted_ned_mps
    for _ in range(3 if near else 0):
        for one in near:
            velocity = _kept_out(one, velocity, velocity_ned_mps, obstacles.margin_m, acceleration_mps2)
    walls = [one for one in near if one.above_m <= obstacles.margin_m]
    return _able_to_stop(position_ned_m, velocity, obstacles, walls, acceleration_mps2)


def _kept_out(
    one: Beside, velocity: Vector3, moves: Vector3, margin_m: float, acceleration_mps2: float
) -> Vector3:
    aside_m, above_m = one.aside_m - margin_m, one.above_m - margin_m
    north, east = one.towards
    closing_mps = velocity[0] * north + velocity[1] * east
    allowed_mps = braking_speed_mps(aside_m, acceleration_mps2)
    sinking_mps = braking_speed_mps(above_m, acceleration_mps2)
    if aside_m > 0.0 and closing_mps <= allowed_mps:
        return velocity
    if above_m > 0.0 and velocity[2] <= sinking_mps:
        return velocity
    if above_m > aside_m:
        return velocity[0], velocity[1], min(velocity[2], sinking_mps)
    kept_mps = min(closing_mps, allowed_mps)
    along_mps = velocity[1] * north - velocity[0] * east
    if moves[0] * north + moves[1] * east > allowed_mps + _TOO_FAST_MPS:
        along_mps = moves[1] * north - moves[0] * east  # all that it can brake goes against the wall
    return north * kept_mps - east * along_mps, east * kept_mps + north * along_mps, velocity[2]


def _able_to_stop(
    position: Vector3,
    velocity: Vector3,
    obstacles: ObstaclesAround,
    walls: list[Beside],
    acceleration_mps2: float,
) -> Vector3:
    """Slow down until the drone can stop outside: in a corner there is a second wall that is not in the way yet."""
    if not walls or not any(velocity[:2]):
        return velocity
    spare_m = min(one.aside_m for one in walls) - obstacles.margin_m
    needed_m = obstacles.margin_m + min(spare_m, 0.0) - _SLACK_M
    for part in _PARTS:
        north_mps, east_mps = velocity[0] * part, velocity[1] * part
        stop_s = REACTION_S + math.hypot(north_mps, east_mps) / (1.2 * acceleration_mps2)
        stop = position[0] + north_mps * stop_s, position[1] + east_mps * stop_s
        if obstacles.beside_walls_m(*stop, -position[2]) >= needed_m:
            return north_mps, east_mps, velocity[2]
    return 0.0, 0.0, velocity[2]
