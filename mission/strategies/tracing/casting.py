"""Casting: the swarm sweeps the world along diagonals, gas or no gas (algorithm C1 of `swarming`'s source)."""

from __future__ import annotations

from mission.geometry.formation import FloatArray
from mission.strategies.reactive import reactive_strategy
from mission.strategies.tick_rule import OwnSenses
from mission.strategies.tracing.swarming import cast, move, swarming_rule


def casting(
    own: OwnSenses,
    neighbours: FloatArray,
    count: int,
    ranges_m: FloatArray,  # noqa: ARG001 (one signature for all rules)
    state: FloatArray,
    word: FloatArray,
    parameters: FloatArray,
) -> tuple[float, float]:
    north, east = cast(own, neighbours, count, state, word, parameters)
    return move(own, neighbours, count, north, east, state, word, parameters)


ENTRY = reactive_strategy("casting", swarming_rule(casting))
