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
LOWEST_M, TALLEST_M = 3.048, 304.8
"""10 ft and 1000 ft: between them the turbulence changes with the height."""
GUSTS_MEASURED_M = 6.096
"""20 ft: the wind there says how strong the turbulence is."""
_FT = 0.3048
_FARTHEST_M = 1e7
_ALLEN_PEAK = 2.0
"""Of a Gaussian updraught, over the mean speed of Allen's that carries as much air: it has half the area."""
_FARTHEST_SPREADS2 = 25.0
"""A thermal is felt no farther from its middle than five times its spread."""


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
    # Comparisons, not min and max: a vehicle asks so often that their calls are a third of the time.
    if row < 0.0:
        row = 0.0
    elif row > last:
        row = last
    if column < 0.0:
        column = 0.0
    elif column > last:
        column = last
    i = int(row) if row < last else nodes - 2
    j = int(column) if column < last else nodes - 2
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


def turbulence_lengths_m(up_m: float) -> tuple[float, float]:
    """(horizontal, vertical) length of the gusts at a height above home: MIL-F-8785C, low altitude."""
    feet = min(max(up_m, LOWEST_M), TALLEST_M) / _FT
    return _FT * feet / (0.177 + 0.000823 * feet) ** 1.2, _FT * feet


def turbulence_sds_mps(up_m: float, wind_20ft_mps: float) -> tuple[float, float]:
    """(horizontal, vertical) standard deviation of the gusts at a height above home: MIL-F-8785C, low altitude.

    The standard says nothing of what is below 10 ft: there the gusts fade to none at the ground.
    """
    feet = min(max(up_m, LOWEST_M), TALLEST_M) / _FT
    vertical = 0.1 * wind_20ft_mps * min(max(up_m, 0.0) / LOWEST_M, 1.0)
    return vertical / (0.177 + 0.000823 * feet) ** 0.4, vertical


def turbulence_level(up_m: float, levels: int) -> float:
    """At a height above home, from 0 to `levels` - 1: they stand evenly on the logarithm of the height."""
    height_m = min(max(up_m, LOWEST_M), TALLEST_M)
    return (levels - 1) * math.log(height_m / LOWEST_M) / math.log(TALLEST_M / LOWEST_M)


def gusts_at(
    series: FloatArray,
    speeds_mps: FloatArray,
    spacings_m: FloatArray,
    lanes_m: FloatArray,
    lanes: int,
    samples: int,
    level: float,
    along_m: float,
    across_m: float,
    time_s: float,
) -> tuple[float, float, float]:
    """Gusts of standard deviation 1 along the wind, across it, and down.

    `series`: flat, (levels, lanes, samples + 1, 3), the last sample being the first. `level`: with its fraction.
    `along_m`, `across_m`: the place, downwind and to the right of it. Independent gusts are blended so that the
    squares of their weights add up to 1.
    """
    if abs(along_m) > _FARTHEST_M or abs(across_m) > _FARTHEST_M:
        along_m = across_m = 0.0  # nobody is there
    low = min(int(level), len(speeds_mps) - 2)
    turn = 0.5 * math.pi * (level - low)
    weight = math.cos(turn)
    u = v = w = 0.0
    for at in range(low, low + 2):
        lane = across_m / lanes_m[at]
        left = math.floor(lane)
        aside = 0.5 * math.pi * (lane - left)
        place = (speeds_mps[at] * time_s - along_m) / spacings_m[at]
        behind = math.floor(place)
        share = place - behind
        sample = int(behind) % samples
        a = 3 * ((at * lanes + int(left) % lanes) * (samples + 1) + sample)
        b = 3 * ((at * lanes + int(left + 1) % lanes) * (samples + 1) + sample)
        a0, b0 = weight * math.cos(aside), weight * math.sin(aside)
        a1, b1 = a0 * share, b0 * share
        a0, b0 = a0 - a1, b0 - b1
        u += a0 * series[a] + a1 * series[a + 3] + b0 * series[b] + b1 * series[b + 3]
        v += a0 * series[a + 1] + a1 * series[a + 4] + b0 * series[b + 1] + b1 * series[b + 4]
        w += a0 * series[a + 2] + a1 * series[a + 5] + b0 * series[b + 2] + b1 * series[b + 5]
        weight = math.sin(turn)
    return u, v, w


def updraught_mps(
    thermals: FloatArray,
    cells: int,
    generations: int,
    cell_m: float,
    life_s: float,
    convective_mps: float,
    mixed_layer_m: float,
    north_m: float,
    east_m: float,
    up_m: float,
    time_s: float,
) -> float:
    """Vertical speed of the air, up, between thermals and in them. `north_m`, `east_m` drift with the wind.

    M. J. Allen: "Updraft model for development of autonomous soaring uninhabited air vehicles", AIAA 2006-1510: mean
    speed and outer radius of an updraught at a height. Its profile is a Gaussian that carries as much air, and around
    thermals the air sinks, so that none is lost.
    `thermals`: flat, (generations, cells, cells, 4): place in its cell (north, east), share of the mean strength, and
    share of a life by which the cell is ahead; one a cell of a lattice that comes again after `cells`.
    """
    height = up_m / mixed_layer_m
    if not 0.0 < height < 1.0 / 1.1:
        return 0.0
    root = math.pow(height, 1.0 / 3.0)
    radius_m = max(10.0, 0.102 * root * (1.0 - 0.25 * height) * mixed_layer_m)
    peak_mps = _ALLEN_PEAK * convective_mps * root * (1.0 - 1.1 * height)
    spread2 = radius_m * radius_m / _ALLEN_PEAK
    # The four cells whose middles are around the place: no thermal is near its cell's edge.
    row = math.floor(min(max(north_m, -_FARTHEST_M), _FARTHEST_M) / cell_m - 0.5)
    column = math.floor(min(max(east_m, -_FARTHEST_M), _FARTHEST_M) / cell_m - 0.5)
    # A thermal grows for a quarter of its life, and fades for one; of the lattice's area so much rises.
    total = -0.75 * math.pi * spread2 / (cell_m * cell_m)
    for i in range(2):
        for j in range(2):
            cell = (int(row + i) % cells) * cells + int(column + j) % cells
            age = time_s / life_s + thermals[4 * cell + 3]
            born = math.floor(age)
            k = 4 * ((int(born) % generations) * cells * cells + cell)
            off_n = north_m - (row + i + thermals[k]) * cell_m
            off_e = east_m - (column + j + thermals[k + 1]) * cell_m
            away = (off_n * off_n + off_e * off_e) / spread2
            if away < _FARTHEST_SPREADS2:
                grown = min(1.0, 4.0 * (age - born), 4.0 * (1.0 - (age - born)))
                total += thermals[k + 2] * grown * math.exp(-away)
    return peak_mps * total
