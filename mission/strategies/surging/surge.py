"""What surge-cast and spiral-surge share: surging, what they search by before the first contact, keeping apart.

Sources: T. Lochmatter, A. Martinoli, "Tracking odor plumes in a laminar wind field with bio-inspired algorithms",
Experimental Robotics (ISER 2008), Springer Tracts in Advanced Robotics 54 (2009); T. Lochmatter, X. Raemy,
L. Matthey, S. Indra, A. Martinoli, "A comparison of casting and spiraling algorithms for odor source localization in
laminar flow", ICRA 2008. A robot in the plume surges straight against the wind. Once it has had no gas for
`lost_m` of its way it has lost the plume, and searches around by the strategy's own pattern until it has gas again,
or the pattern is over.

The sources' robots are single ones, that begin near a plume. What they leave open: before the first contact, after a
pattern that found nothing, and while no wind is known, a robot searches by the casting of `tracing.swarming`
(algorithm C1), as the swarms do that it is compared with. Robots do not trace together; they only keep off each
other. Ways are counted by the speed that is wanted, so that no robot waits at a wall for its pattern to go on.

The defaults are those of small robots, as in `tracing.swarming`; lengths and speed scale together.
"""

from __future__ import annotations

import math
from typing import Annotated

from msgspec import Meta

from mission.geometry.formation import FloatArray
from mission.strategies.tick_rule import EAST, NORTH, OwnSenses, Rule, TickRule
from mission.strategies.tracing.swarming import (
    RANGE_M,
    SPACING_M,
    SPEED_MPS,
    STATE_SIZE,
    WANTED_EAST,
    WANTED_NORTH,
    WORD_SIZE,
    SwarmingParameters,
    cast,
    formation_share,
    upwind,
)

# Places in the parameters, behind those of the swarms.
LOST_M, REACH_M, LEGS = 5, 6, 7
# Places in the state, behind those of casting.
MODE, SINCE_M, ALONG_M, LEG, SIDE, AXIS_N, AXIS_E, SURGE_STATE = range(STATE_SIZE, STATE_SIZE + 8)
SEARCHES, SURGES, LOCAL = 0.0, 1.0, 2.0
"""MODE. SINCE_M: way since the last gas; ALONG_M: way in the pattern; LEG, SIDE: which part of it, and on which side
it began (1, -1); AXIS: the unit vector against the wind when the plume was lost."""

_FARTHEST_M = 200.0


class SurgeParameters(SwarmingParameters, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`spacing_m` is how near robots come to each other before they give way; no formation is kept."""

    lost_m: Annotated[float, Meta(gt=0.0)] = 0.4
    """Way without gas after which the plume counts as lost (the sources' d_lost)."""
    reach_m: Annotated[float, Meta(gt=0.0)] = 0.4
    """How far the first cast goes to a side, or how far apart the arms of the spiral are (d_cast, d_gap)."""
    legs: Annotated[int, Meta(ge=1)] = 8
    """Casts, or turns of the spiral, until the robot gives the place up."""


def surging(
    own: OwnSenses,
    neighbours: FloatArray,
    count: int,
    state: FloatArray,
    word: FloatArray,
    parameters: FloatArray,
) -> tuple[float, float]:
    """The unit vector that a robot follows while it searches at large or surges; in MODE LOCAL the strategy says."""
    north, east = cast(own, neighbours, count, state, word, parameters)
    up_north, up_east = upwind(own)
    way_m = parameters[SPEED_MPS] * own.interval_s
    if own.gas > 0.0 and (up_north != 0.0 or up_east != 0.0):
        state[MODE], state[SINCE_M] = SURGES, 0.0
    elif state[MODE] == SURGES:
        state[SINCE_M] += way_m
        if state[SINCE_M] > parameters[LOST_M]:
            state[MODE], state[ALONG_M], state[LEG] = LOCAL, 0.0, 0.0
            state[SIDE] = 1.0 if own.draw < 0.5 else -1.0
            state[AXIS_N], state[AXIS_E] = up_north, up_east
            if up_north == 0.0 and up_east == 0.0:
                state[MODE] = SEARCHES
    elif state[MODE] == LOCAL:
        state[ALONG_M] += way_m
    if state[MODE] == SURGES and (up_north != 0.0 or up_east != 0.0):
        return up_north, up_east
    return north, east


def keep_apart(
    neighbours: FloatArray,
    count: int,
    goal_north: float,
    goal_east: float,
    state: FloatArray,
    parameters: FloatArray,
) -> tuple[float, float]:
    """The velocity towards `goal`, off every neighbour that is nearer than the spacing."""
    north, east = goal_north, goal_east
    for k in range(count):
        away_m = math.sqrt(neighbours[k, NORTH] ** 2 + neighbours[k, EAST] ** 2)
        if 0.0 < away_m < min(parameters[SPACING_M], parameters[RANGE_M]):
            push = formation_share(parameters[SPACING_M], away_m) / away_m
            north += push * neighbours[k, NORTH]
            east += push * neighbours[k, EAST]
    speed_mps = parameters[SPEED_MPS] / max(math.sqrt(north * north + east * east), 1.0)
    state[WANTED_NORTH], state[WANTED_EAST] = speed_mps * north, speed_mps * east
    return state[WANTED_NORTH], state[WANTED_EAST]


def surging_rule(rule: Rule) -> TickRule:
    return TickRule(
        rule=rule,
        parameters=SurgeParameters,
        range_m=_FARTHEST_M,
        state_size=SURGE_STATE,
        word_size=WORD_SIZE,
    )
