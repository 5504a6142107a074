"""The formulas of the winds, each once: plain functions of numbers, in what numba understands.

Vehicles and instruments call them as they are, with memory views of the arrays; maps, puffs and trials compiled.
"""

from __future__ import annotations

import math

from mission.geometry.formation import FloatArray

MEASURED_M = 10.0
"""The height above home at which a configured wind speed is meant, as winds are measured."""
_HIGHEST_M = 1000.0
"""Above the boundary layer the wind grows no further."""


def log_law(up_m: float, roughness_m: float) -> float:
    """Wind speed at a height above home as a share of that at `MEASURED_M`, over ground of this roughness.

    The logarithmic law of the neutral surface layer (Stull 1988, 9.7.1); 0 below the aerodynamic roughness.
    """
    if up_m <= roughness_m:
        return 0.0
    return math.log(min(up_m, _HIGHEST_M) / roughness_m) / math.log(MEASURED_M / roughness_m)


def flow_at(
    before: FloatArray, after: FloatArray, share: float, nodes: int, row: float, column: float
) -> tuple[float, float]:
    """(north, east) wind between the nodes of a square grid and between two states of it.

    `before`, `after`: flat, 2 * nodes * nodes: north and east components, rows go north. `share` of the time between
    them is over. `row`, `column`: the place in cells from the south-western corner; beyond the edge it is the edge.
    """
    last = nodes - 1.0
    row, column = min(max(row, 0.0), last), min(max(column, 0.0), last)
    i, j = min(int(row), nodes - 2), min(int(column), nodes - 2)
    up, right = row - i, column - j
    down, left = 1.0 - up, 1.0 - right
    rest = 1.0 - share
    sw, se = i * nodes + j, i * nodes + j + 1
    nw, ne = sw + nodes, se + nodes
    plane = nodes * nodes
    first = down * (left * before[sw] + right * before[se]) + up * (left * before[nw] + right * before[ne])
    second = down * (left * after[sw] + right * after[se]) + up * (left * after[nw] + right * after[ne])
    north = rest * first + share * second
    sw, se, nw, ne = sw + plane, se + plane, nw + plane, ne + plane
    first = down * (left * before[sw] + right * before[se]) + up * (left * before[nw] + right * before[ne])
    second = down * (left * after[sw] + right * after[se]) + up * (left * after[nw] + right * after[ne])
    return north, rest * first + share * second
