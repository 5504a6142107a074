"""Fluxotaxis: towards the neighbour from whom most gas flows in (algorithm C4 of `swarming`'s source).

The flux of neighbour n is rho_n V_n . u_n, with its reading, its wind and the unit vector u_n to it: negative where
it flows towards the robot. The scalar product is the paper's |V| cos(theta - phi) without its arctan(v / u), which
has the wrong sign for half of all directions.
"""

from __future__ import annotations

import math

from mission.geometry.formation import FloatArray
from mission.strategies.reactive import reactive_strategy
from mission.strategies.tick_rule import EAST, NORTH, WORD, OwnSenses
from mission.strategies.tracing.anemotaxis import against_the_wind
from mission.strategies.tracing.chemotaxis import up_the_gradient
from mission.strategies.tracing.swarming import GAS, RANGE_M, WIND_EAST, WIND_NORTH, move, swarming_rule


def along_the_flux(neighbours: FloatArray, count: int, range_m: float) -> tuple[int, float, float]:
    """(neighbours in range, north, east): the unit vector to the largest influx, else to the largest outflux, else
    (0, 0)."""
    met = 0
    influx, outflux = 0.0, 0.0
    in_north, in_east, out_north, out_east = 0.0, 0.0, 0.0, 0.0
    for k in range(count):
        away_m = math.sqrt(neighbours[k, NORTH] ** 2 + neighbours[k, EAST] ** 2)
        if not 0.0 < away_m <= range_m:
            continue
        met += 1
        north, east = neighbours[k, NORTH] / away_m, neighbours[k, EAST] / away_m
        along_mps = neighbours[k, WORD + WIND_NORTH] * north + neighbours[k, WORD + WIND_EAST] * east
        flux = neighbours[k, WORD + GAS] * along_mps
        if flux < influx:
            influx, in_north, in_east = flux, north, east
        if flux > outflux:
            outflux, out_north, out_east = flux, north, east
    if influx < 0.0:
        return met, in_north, in_east
    return met, out_north, out_east


def fluxotaxis(
    own: OwnSenses,
    neighbours: FloatArray,
    count: int,
    ranges_m: FloatArray,  # noqa: ARG001 (one signature for all rules)
    state: FloatArray,
    word: FloatArray,
    parameters: FloatArray,
) -> tuple[float, float]:
    met, flux_north, flux_east = along_the_flux(neighbours, count, parameters[RANGE_M])
    if met > 1:
        north, east = up_the_gradient(own, neighbours, count, state, word, parameters)
        if flux_north != 0.0 or flux_east != 0.0:
            north, east = flux_north, flux_east
    else:
        north, east = against_the_wind(own, neighbours, count, state, word, parameters)
    return move(own, neighbours, count, north, east, state, word, parameters)


ENTRY = reactive_strategy("fluxotaxis", swarming_rule(fluxotaxis))
