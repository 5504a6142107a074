"""Chemotaxis: towards the neighbour that reads most (algorithm C2 of `swarming`'s source).

The printed condition, a gradient of either sign, lets the vehicle in the best place flee from it: followed is only
who reads more.
"""

from __future__ import annotations

import math

from mission.geometry.formation import FloatArray
from mission.strategies.reactive import reactive_strategy
from mission.strategies.tick_rule import EAST, NORTH, WORD, OwnSenses
from mission.strategies.tracing.swarming import GAS, RANGE_M, cast, move, swarming_rule


def up_the_gradient(
    own: OwnSenses,
    neighbours: FloatArray,
    count: int,
    state: FloatArray,
    word: FloatArray,
    parameters: FloatArray,
) -> tuple[float, float]:
    """The unit vector to the neighbour with the highest reading, if that is above the robot's own; else casting's."""
    north, east = cast(own, neighbours, count, state, word, parameters)
    most = own.gas
    for k in range(count):
        away_m = math.sqrt(neighbours[k, NORTH] ** 2 + neighbours[k, EAST] ** 2)
        if neighbours[k, WORD + GAS] > most and 0.0 < away_m <= parameters[RANGE_M]:
            most = neighbours[k, WORD + GAS]
            north, east = neighbours[k, NORTH] / away_m, neighbours[k, EAST] / away_m
    return north, east


def chemotaxis(
    own: OwnSenses,
    neighbours: FloatArray,
    count: int,
    ranges_m: FloatArray,  # noqa: ARG001 (one signature for all rules)
    state: FloatArray,
    word: FloatArray,
    parameters: FloatArray,
) -> tuple[float, float]:
    north, east = up_the_gradient(own, neighbours, count, state, word, parameters)
    return move(own, neighbours, count, north, east, state, word, parameters)


ENTRY = reactive_strategy("chemotaxis", swarming_rule(chemotaxis))
