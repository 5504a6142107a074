"""What the strategies of this folder share: their parameters, memory and word, the formation force, the casting.

Source: D. V. Zarzhitsky, D. F. Spears, D. R. Thayer, "Experimental studies of swarm robotic chemical plume tracing
using computational fluid dynamics simulations", International Journal of Intelligent Computing and Cybernetics 3
(2010), the second study (algorithms C1 to C4). A robot's velocity is

    v = speed * cap(goal + stiffness * sum_j R F(r_j) r_j / |r_j|),    F(r) = R / r^2 - R^1.7 / r^2.7,

with the unit vector `goal` of the strategy and a lattice of spacing R. Everything is a share of spacing and speed, so
that a swarm of any size flies alike: the paper's robots have R = 0.8 m and 0.1 m/s; drones with ten times the spacing
(8 m, range 10 m) and twenty times the speed (2 m/s) do in 1 s what the robots do in 2 s.
"""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
from msgspec import Meta

from mission.geometry.formation import FloatArray
from mission.strategies.tick_rule import EAST, NORTH, WORD, OwnSenses, Rule, TickRule

# Places in the parameters, in the order of the struct.
SPACING_M, RANGE_M, SPEED_MPS, STIFFNESS, HELD_S = range(5)
# Places in the word: the reading and the wind at a robot, and which way it casts since when.
GAS, WIND_NORTH, WIND_EAST, CAST_NORTH, CAST_EAST, FLIPPED_S, WORD_SIZE = range(7)
# Places in the state.
WANTED_NORTH, WANTED_EAST, HELD_NORTH_S, HELD_EAST_S, BEGUN, STATE_SIZE = range(6)

_FARTHEST_M = 200.0
"""No spacing of a swarm needs to hear farther."""
_HINDERED = 0.25
"""Less than this share of the wanted velocity: something holds the robot."""
_AHEAD = 0.5
"""Cosine: a neighbour within 60 degrees of a direction is ahead."""


class SwarmingParameters(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Lengths and speed scale together; the defaults are the paper's robots."""

    spacing_m: Annotated[float, Meta(gt=0.0)] = 0.8
    """R of the formation force: neighbours settle this far apart."""
    range_m: Annotated[float, Meta(gt=0.0, le=_FARTHEST_M)] = 1.0
    """R_s: who is farther away is no neighbour. Less than 1.7 spacings, or the second ring pulls at the first."""
    speed_mps: Annotated[float, Meta(gt=0.0)] = 0.1
    stiffness: Annotated[float, Meta(ge=0.0)] = 0.375
    """Of the formation, beside the goal."""
    held_s: Annotated[float, Meta(ge=0.0)] = 1.0
    """A robot that is held up for so long is at a wall, and turns. Longer than a vehicle takes to change velocity."""


def formation_share(spacing_m: float, away_m: float) -> float:
    """R F(r), positive where the neighbour attracts: 0 at the spacing."""
    ratio = spacing_m / away_m
    return ratio * ratio * (1.0 - math.pow(ratio, 0.7))


def cast(
    own: OwnSenses,
    neighbours: FloatArray,
    count: int,
    state: FloatArray,
    word: FloatArray,
    parameters: FloatArray,
) -> tuple[float, float]:
    """C1: the unit vector along a diagonal, turned at what holds the robot up; everybody joins the newest turn."""
    if state[BEGUN] == 0.0:
        state[BEGUN] = 1.0
        quarter = int(4.0 * own.draw)
        word[CAST_NORTH] = 1.0 if quarter < 2 else -1.0
        word[CAST_EAST] = 1.0 if quarter % 2 == 0 else -1.0
        word[FLIPPED_S] = (
            4.0 * own.draw - quarter - 1.0
        )  # before the beginning, each at another time: one wins
    flips_north = _is_held(own, neighbours, count, state, HELD_NORTH_S, word[CAST_NORTH], 0.0, parameters)
    flips_east = _is_held(own, neighbours, count, state, HELD_EAST_S, 0.0, word[CAST_EAST], parameters)
    if flips_north or flips_east:
        word[CAST_NORTH] *= -1.0 if flips_north else 1.0
        word[CAST_EAST] *= -1.0 if flips_east else 1.0
        word[FLIPPED_S] = own.elapsed_s
    for k in range(count):
        said_n, said_e = neighbours[k, WORD + CAST_NORTH], neighbours[k, WORD + CAST_EAST]
        if said_n * said_e != 0.0 and neighbours[k, WORD + FLIPPED_S] > word[FLIPPED_S]:
            word[CAST_NORTH] = 1.0 if said_n > 0.0 else -1.0
            word[CAST_EAST] = 1.0 if said_e > 0.0 else -1.0
            word[FLIPPED_S] = neighbours[k, WORD + FLIPPED_S]
    return math.sqrt(0.5) * word[CAST_NORTH], math.sqrt(0.5) * word[CAST_EAST]


def _is_held(
    own: OwnSenses,
    neighbours: FloatArray,
    count: int,
    state: FloatArray,
    place: int,
    toward_n: float,
    toward_e: float,
    parameters: FloatArray,
) -> bool:
    """Whether something that is no neighbour has kept the robot from flying this way for long enough."""
    wanted_mps = state[WANTED_NORTH] * toward_n + state[WANTED_EAST] * toward_e
    flown_mps = own.velocity_north_mps * toward_n + own.velocity_east_mps * toward_e
    if wanted_mps < _HINDERED * parameters[SPEED_MPS] or flown_mps > _HINDERED * wanted_mps:
        state[place] = 0.0
        return False
    for k in range(count):
        away_m = math.sqrt(neighbours[k, NORTH] ** 2 + neighbours[k, EAST] ** 2)
        ahead_m = neighbours[k, NORTH] * toward_n + neighbours[k, EAST] * toward_e
        if away_m < parameters[SPACING_M] and ahead_m > _AHEAD * away_m:
            state[place] = 0.0
            return False
    state[place] += own.interval_s
    if state[place] < parameters[HELD_S]:
        return False
    state[place] = 0.0
    return True


def upwind(own: OwnSenses) -> tuple[float, float]:
    """The unit vector against the wind; (0, 0) when there is none."""
    wind_mps = math.hypot(own.wind_north_mps, own.wind_east_mps)
    if wind_mps == 0.0:
        return 0.0, 0.0
    return -own.wind_north_mps / wind_mps, -own.wind_east_mps / wind_mps


def move(
    own: OwnSenses,
    neighbours: FloatArray,
    count: int,
    goal_north: float,
    goal_east: float,
    state: FloatArray,
    word: FloatArray,
    parameters: FloatArray,
) -> tuple[float, float]:
    """The velocity towards `goal` in formation; what the robot senses goes into its word."""
    word[GAS] = own.gas
    word[WIND_NORTH], word[WIND_EAST] = own.wind_north_mps, own.wind_east_mps
    north, east = goal_north, goal_east
    for k in range(count):
        away_m = math.sqrt(neighbours[k, NORTH] ** 2 + neighbours[k, EAST] ** 2)
        if 0.0 < away_m <= parameters[RANGE_M]:
            pull = parameters[STIFFNESS] * formation_share(parameters[SPACING_M], away_m) / away_m
            north += pull * neighbours[k, NORTH]
            east += pull * neighbours[k, EAST]
    speed_mps = parameters[SPEED_MPS] / max(math.sqrt(north * north + east * east), 1.0)
    state[WANTED_NORTH], state[WANTED_EAST] = speed_mps * north, speed_mps * east
    return state[WANTED_NORTH], state[WANTED_EAST]


def swarming_rule(rule: Rule) -> TickRule:
    return TickRule(
        rule=rule,
        parameters=SwarmingParameters,
        range_m=_FARTHEST_M,
        state_size=STATE_SIZE,
        word_size=WORD_SIZE,
    )
