"""Anemotaxis: against the wind wherever there is gas (algorithm C3 of `swarming`'s source)."""

from __future__ import annotations

from mission.geometry.formation import FloatArray
from mission.strategies.reactive import reactive_strategy
from mission.strategies.tick_rule import OwnSenses
from mission.strategies.tracing.swarming import cast, move, swarming_rule, upwind


def against_the_wind(
    own: OwnSenses,
    neighbours: FloatArray,
    count: int,
    state: FloatArray,
    word: FloatArray,
    parameters: FloatArray,
) -> tuple[float, float]:
    """The unit vector against the wind where there are gas and wind; else casting's."""
    north, east = cast(own, neighbours, count, state, word, parameters)
    up_north, up_east = upwind(own)
    if own.gas > 0.0 and (up_north != 0.0 or up_east != 0.0):
        return up_north, up_east
    return north, east


def anemotaxis(
    own: OwnSenses,
    neighbours: FloatArray,
    count: int,
    ranges_m: FloatArray,  # noqa: ARG001 (one signature for all rules)
    state: FloatArray,
    word: FloatArray,
    parameters: FloatArray,
) -> tuple[float, float]:
    north, east = against_the_wind(own, neighbours, count, state, word, parameters)
    return move(own, neighbours, count, north, east, state, word, parameters)


ENTRY = reactive_strategy("anemotaxis", swarming_rule(anemotaxis))
