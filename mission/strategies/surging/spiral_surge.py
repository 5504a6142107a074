"""Spiral-surge: against the wind in the plume; where it is lost, along a spiral around that place.

A. T. Hayes, A. Martinoli, R. M. Goodman, "Distributed odor source localization", IEEE Sensors Journal 2 (2002); see
`surge` for the version that is flown here: the spiral is Archimedes', r = d_gap theta / 2 pi.
"""

from __future__ import annotations

import math

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


def along_the_spiral(state: FloatArray, parameters: FloatArray) -> tuple[float, float]:
    """The unit tangent of the spiral after ALONG_M of it; it leaves its centre against the wind.

    The way to angle theta is b (theta sqrt(1 + theta^2) + asinh theta) / 2 with b = d_gap / 2 pi: nearly b theta at
    first and b theta^2 / 2 later, which gives theta roughly. Two steps of Newton's do the rest.
    """
    way = 2.0 * math.pi * state[ALONG_M] / parameters[REACH_M]
    theta = way / math.sqrt(1.0 + 0.5 * way)
    for _ in range(2):
        root = math.sqrt(1.0 + theta * theta)
        theta -= (0.5 * (theta * root + math.log(theta + root)) - way) / root
    state[LEG] = theta / (2.0 * math.pi)
    if state[LEG] >= parameters[LEGS]:
        state[MODE] = SEARCHES
    turned = state[SIDE] * (theta + math.atan(theta))  # the tangent is ahead of the radius by atan(theta)
    cos, sin = math.cos(turned), math.sin(turned)
    return state[AXIS_N] * cos - state[AXIS_E] * sin, state[AXIS_N] * sin + state[AXIS_E] * cos


def spiral_surge(
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
        north, east = along_the_spiral(state, parameters)
    return keep_apart(neighbours, count, north, east, state, parameters)


ENTRY = reactive_strategy("spiral-surge", surging_rule(spiral_surge))
