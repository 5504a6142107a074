"""Surge-cast: against the wind in the plume; where it is lost, across the wind from side to side, wider and wider.

See `surge` for the source. Its casts go by d_cast to one side and then to the other; here each further one reaches
d_cast farther, as a moth's do, so that a plume that has moved is found too.
"""

from __future__ import annotations

from mission.geometry.formation import FloatArray
from mission.strategies.reactive import reactive_strategy
from mission.strategies.surging.surge import (
    ALONG_M,
    AXIS_E,
    AXIS_N,
    LEG,
    LEGS,
    LOCAL,
    MODE,
    REACH_M,
    SEARCHES,
    SIDE,
    keep_apart,
    surging,
    surging_rule,
)
from mission.strategies.tick_rule import OwnSenses


def across_the_wind(state: FloatArray, parameters: FloatArray) -> tuple[float, float]:
    """The unit vector of the present cast: leg k leads from `k` to `k + 1` times `reach_m` on the other side."""
    if state[ALONG_M] >= (2.0 * state[LEG] + 1.0) * parameters[REACH_M]:
        state[ALONG_M] -= (2.0 * state[LEG] + 1.0) * parameters[REACH_M]
        state[LEG] += 1.0
        state[SIDE] = -state[SIDE]
        if state[LEG] >= parameters[LEGS]:
            state[MODE] = SEARCHES
    return -state[SIDE] * state[AXIS_E], state[SIDE] * state[AXIS_N]


def surge_cast(
    own: OwnSenses,
    neighbours: FloatArray,
    count: int,
    ranges_m: FloatArray,  # noqa: ARG001 (one signature for all rules)
    state: FloatArray,
    word: FloatArray,
    parameters: FloatArray,
) -> tuple[float, float]:
    north, east = surging(own, neighbours, count, state, word, parameters)
    if state[MODE] == LOCAL:
        north, east = across_the_wind(state, parameters)
    return keep_apart(neighbours, count, north, east, state, parameters)


ENTRY = reactive_strategy("surge-cast", surging_rule(surge_cast))
