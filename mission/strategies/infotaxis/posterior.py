"""Where the source may be, as probabilities on a grid, and what a place would tell of it (Vergassola et al. 2007).

The source emits patches of gas at a rate R; they spread with diffusivity D, drift with the wind V and live for a time
tau. A sensor of size a at r from the source then meets them at the rate of the paper's three-dimensional solution

    R(r) = R a / |r| exp(V . r / 2D - |r| / lambda),    lambda = sqrt(D tau / (1 + V^2 tau / 4D)),

and meets at least one in a time T with probability h = 1 - exp(-R T). The paper counts patches; a gas sensor tells
whether there is gas. A small share of what it tells is taken to be wrong, so that no cell is ever excluded for good.

The grid is square, of SIDE by SIDE cells about where the swarm began. It lies in a robot's state from FIRST on,
row by row; all functions are scalar loops, since the trials compile them for places where no array may be made.
"""

from __future__ import annotations

import math

from mission.geometry.formation import FloatArray

SIDE = 31
CELLS = SIDE * SIDE

# Places in the numbers of the parameters that are the plume's.
CELL_M, RATE_HZ, DIFFUSIVITY, LIFETIME_S, SENSOR_M = range(4, 9)

_WRONG = 0.01
_NOTHING = 1e-12
"""Cells less probable than this do not count."""


def begin_grid(state: FloatArray, first: int) -> None:
    """The source is anywhere on the grid."""
    for k in range(CELLS):
        state[first + k] = 1.0 / CELLS


def cell_at(north_m: float, east_m: float, cell_m: float) -> int:
    """The cell of a place, -1 outside of the grid."""
    row = math.floor(north_m / cell_m + 0.5 * SIDE)
    column = math.floor(east_m / cell_m + 0.5 * SIDE)
    if row < 0 or column < 0 or row >= SIDE or column >= SIDE:
        return -1
    return row * SIDE + column


def cell_centre_m(cell: int, cell_m: float) -> tuple[float, float]:
    """(north, east) from where the swarm began."""
    row = cell // SIDE
    return (row - 0.5 * (SIDE - 1)) * cell_m, (cell - row * SIDE - 0.5 * (SIDE - 1)) * cell_m


def hit_probability(
    north_m: float, east_m: float, wind_n: float, wind_e: float, time_s: float, parameters: FloatArray
) -> float:
    """Of gas within `time_s`, at (north, east) from a source; within half a cell it is as at its edge."""
    diffusivity, lifetime_s = parameters[DIFFUSIVITY], parameters[LIFETIME_S]
    away_m = max(math.sqrt(north_m * north_m + east_m * east_m), 0.5 * parameters[CELL_M])
    wind2 = wind_n * wind_n + wind_e * wind_e
    fades_pm = math.sqrt((1.0 + 0.25 * wind2 * lifetime_s / diffusivity) / (diffusivity * lifetime_s))
    drifts = 0.5 * (north_m * wind_n + east_m * wind_e) / diffusivity
    rate_hz = parameters[RATE_HZ] * parameters[SENSOR_M] / away_m * math.exp(drifts - away_m * fades_pm)
    return _WRONG + (1.0 - 2.0 * _WRONG) * (1.0 - math.exp(-rate_hz * time_s))


def observe(
    state: FloatArray,
    first: int,
    north_m: float,
    east_m: float,
    hit: bool,
    wind_n: float,
    wind_e: float,
    time_s: float,
    parameters: FloatArray,
) -> None:
    """Bayes' rule: there was gas at a place within `time_s`, or there was none."""
    total = 0.0
    for k in range(CELLS):
        if state[first + k] > _NOTHING:
            centre_n, centre_e = cell_centre_m(k, parameters[CELL_M])
            chance = hit_probability(
                north_m - centre_n, east_m - centre_e, wind_n, wind_e, time_s, parameters
            )
            state[first + k] *= chance if hit else 1.0 - chance
        total += state[first + k]
    for k in range(CELLS):
        state[first + k] /= total


def entropy(state: FloatArray, first: int) -> float:
    """Of the source's place, in nats."""
    total = 0.0
    for k in range(CELLS):
        if state[first + k] > _NOTHING:
            total -= state[first + k] * math.log(state[first + k])
    return total


def expected_entropy(
    state: FloatArray,
    first: int,
    north_m: float,
    east_m: float,
    wind_n: float,
    wind_e: float,
    time_s: float,
    parameters: FloatArray,
) -> float:
    """What is left of the entropy, on average, after `time_s` at a place (the paper's equation 1): nothing if the
    source is there, else what gas or none of it leaves.

    The entropy of weights w that sum to W is log W - sum(w log w) / W, and counts with probability W.
    """
    hits, hit_logs, blanks, blank_logs = 0.0, 0.0, 0.0, 0.0
    for k in range(CELLS):
        weight = state[first + k]
        if weight > _NOTHING:
            centre_n, centre_e = cell_centre_m(k, parameters[CELL_M])
            chance = hit_probability(
                north_m - centre_n, east_m - centre_e, wind_n, wind_e, time_s, parameters
            )
            hits += weight * chance
            hit_logs += weight * chance * math.log(weight * chance)
            blanks += weight * (1.0 - chance)
            blank_logs += weight * (1.0 - chance) * math.log(weight * (1.0 - chance))
    here = cell_at(north_m, east_m, parameters[CELL_M])
    found = state[first + here] if here >= 0 else 0.0
    return (1.0 - found) * (hits * math.log(hits) - hit_logs + blanks * math.log(blanks) - blank_logs)
