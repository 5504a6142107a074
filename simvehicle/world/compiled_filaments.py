"""The kernels of the puff plume: puffs are carried, shaken, kept out of obstacles; points are asked what they smell.

Puffs stand in structures of arrays of single precision, (fields, sources, capacity): those of one source lie side by
side in the order in which they were released, at positions relative to their source, so that numbers are small and
neighbours in memory are neighbours in the air. A block of them has one box, and a point that lies outside of it asks
none of them.

A puff is the product of three bells, one an axis. All forms of the concentration multiply and add the same numbers in
the same order: one point, many points and the nodes of a grid get the same bits, and a grid needs a bell for each row
and each column instead of one for each node.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from mission.geometry.formation import FloatArray, IntArray
from simvehicle.compiled import compiled, kernel, leaf
from simvehicle.world.compiled_barriers import Barriers, blocked, inside

SingleArray: TypeAlias = NDArray[np.float32]
NumberArray: TypeAlias = NDArray[np.uint64]

NORTH, EAST, UP, SIZE, LIFT = range(5)
"""Fields of a puff: metres from its source north and east, metres above home, r^(2/3), and its rise in m/s."""
FIELDS = 5
INVERSE_R2, WEIGHT = 3, 4
"""Fields of a puff that is ready to be asked for, after the first three: 1/r^2, and strength / r^3."""
BLOCK = 32
"""Puffs of one box."""
CUT_R2 = 16.0
"""Further away than four radii along any axis a puff smells of nothing: exp(-16) = 1e-7, what single precision does
not see."""

_ZERO, _ONE, _TWO, _HALF = np.float32(0.0), np.float32(1.0), np.float32(2.0), np.float32(0.5)
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1, _MIX_2 = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31, _S21, _S42 = (np.uint64(shift) for shift in (30, 27, 31, 21, 42))
_21_BITS = np.uint64((1 << 21) - 1)
_UNIFORM_SD = math.sqrt(12.0)
"""One over the standard deviation of a number that is uniform in [0, 1)."""
_CUT = np.float32(CUT_R2)
_SIXTEENTH = np.float32(1.0 / 16.0)
_C0, _C1, _C2, _C3, _C4, _C5, _C6 = (
    np.float32(coefficient)
    for coefficient in (
        0.9999999842436148,
        -0.999998453807815,
        0.4999750912397937,
        -0.16651516704069358,
        0.041223317671799424,
        -0.007654325101843337,
        0.0008490078726026695,
    )
)
"""exp(-x) over [0, 1], interpolated at Chebyshev's points: right to 4e-8 of its value."""


# -- one puff --------------------------------------------------------------------------------------------------------


@leaf
def exp_minus(square: np.float32) -> np.float32:
    """exp(-square) to 3e-6 of its value for 0 <= square < `CUT_R2`, 0 from there on: by products and sums alone."""
    x = min(square, _CUT) * _SIXTEENTH
    value = _C0 + x * (_C1 + x * (_C2 + x * (_C3 + x * (_C4 + x * (_C5 + x * _C6)))))
    value *= value
    value *= value
    value *= value
    value *= value
    return value if square < _CUT else _ZERO


@leaf
def _high(up_m: np.float32, puff_up_m: np.float32, inverse: np.float32) -> np.float32:
    """How much of a puff is at a height, with what the ground reflects of it."""
    above, mirrored = up_m - puff_up_m, up_m + puff_up_m
    return exp_minus(above * above * inverse) + exp_minus(mirrored * mirrored * inverse)


@kernel
def mixed(z: np.uint64) -> np.uint64:
    """The finalizer of splitmix64 (Steele, Lea, Flood 2014)."""
    z = (z ^ (z >> _S30)) * _MIX_1
    z = (z ^ (z >> _S27)) * _MIX_2
    return z ^ (z >> _S31)


# -- a step ----------------------------------------------------------------------------------------------------------


@compiled
def grid_winds(
    puffs: SingleArray,
    counts: IntArray,
    grid_mps: SingleArray,
    corners: SingleArray,
    per_m: float,
    winds_mps: SingleArray,
) -> None:
    """Fill (2, sources, capacity) `winds_mps`, north and east: bilinear in (2, rows, columns) `grid_mps`.

    Beyond the grid's edges the wind is that of its edge. `corners` (sources, 2): the south-western node, metres from
    each source. `per_m`: nodes a metre.
    """
    rows, columns = grid_mps.shape[1], grid_mps.shape[2]
    last_row, last_column = np.float32(rows - 1.001), np.float32(columns - 1.001)
    inverse = np.float32(per_m)
    flat = grid_mps.reshape(2 * rows * columns)
    second = np.int32(rows * columns)
    width = np.int32(columns)
    for source in range(puffs.shape[1]):
        south, west = corners[source, 0], corners[source, 1]
        norths, easts = puffs[NORTH, source], puffs[EAST, source]
        to_north, to_east = winds_mps[0, source], winds_mps[1, source]
        for k in range(counts[source]):
            row_at = min(max((norths[k] - south) * inverse, _ZERO), last_row)
            column_at = min(max((easts[k] - west) * inverse, _ZERO), last_column)
            row, column = np.int32(row_at), np.int32(column_at)
            a, b = row_at - np.float32(row), column_at - np.float32(column)
            p = row * width + column
            u0 = flat[p] + (flat[p + 1] - flat[p]) * b
            u1 = flat[p + width] + (flat[p + width + 1] - flat[p + width]) * b
            to_north[k] = u0 + (u1 - u0) * a
            p += second
            v0 = flat[p] + (flat[p + 1] - flat[p]) * b
            v1 = flat[p + width] + (flat[p + width + 1] - flat[p + width]) * b
            to_east[k] = v0 + (v1 - v0) * a


@compiled
def carry(
    before: SingleArray,
    after: SingleArray,
    numbers: NumberArray,
    counts: IntArray,
    fresh: IntArray,
    shares: SingleArray,
    winds_mps: SingleArray,
    key: np.uint64,
    dt_s: float,
    shaking: float,
    vertical_shaking: float,
    growth: float,
    lift_kept: float,
) -> None:
    """Fill `after` with where the puffs of `before` are `dt_s` later.

    The last `fresh` (sources,) of the `counts` (sources,) puffs are released on the way: they have the `shares`
    (sources, most) of the step. `numbers`: of the puffs, which with `key` (seed and step) make each puff's noise,
    uniform with the standard deviation shaking dt^1/2. `winds_mps`: two components keep the puffs at their height;
    with three (north, east, up) they are shaken and rise there too, and the ground reflects them.
    """
    upright = winds_mps.shape[0] == 3
    dt = np.float32(dt_s)
    scale = np.float32(shaking * math.sqrt(dt_s) * _UNIFORM_SD / (1 << 21))
    half = np.float32(0.5 * shaking * math.sqrt(dt_s) * _UNIFORM_SD)
    scale_up = np.float32(vertical_shaking * math.sqrt(dt_s) * _UNIFORM_SD / (1 << 21))
    half_up = np.float32(0.5 * vertical_shaking * math.sqrt(dt_s) * _UNIFORM_SD)
    grown, kept = np.float32(growth * dt_s), np.float32(lift_kept)
    for source in range(before.shape[1]):
        stream = mixed(key + np.uint64(source + 1) * _GOLDEN)
        number = numbers[source]
        north, east, up, size, lift = (
            before[NORTH, source],
            before[EAST, source],
            before[UP, source],
            before[SIZE, source],
            before[LIFT, source],
        )
        to_north, to_east, to_up, to_size, to_lift = (
            after[NORTH, source],
            after[EAST, source],
            after[UP, source],
            after[SIZE, source],
            after[LIFT, source],
        )
        wind_north, wind_east = winds_mps[0, source], winds_mps[1, source]
        for k in range(counts[source]):
            z = mixed((number[k] * _GOLDEN) ^ stream)
            to_north[k] = north[k] + wind_north[k] * dt + (np.float32(np.int32(z & _21_BITS)) * scale - half)
            to_east[k] = (
                east[k] + wind_east[k] * dt + (np.float32(np.int32((z >> _S21) & _21_BITS)) * scale - half)
            )
            to_size[k] = size[k] + grown
        if upright:
            wind_up = winds_mps[2, source]
            for k in range(counts[source]):
                z = mixed((number[k] * _GOLDEN) ^ stream)
                shaken = np.float32(np.int32(z >> _S42 & _21_BITS)) * scale_up - half_up
                to_up[k] = abs(up[k] + (wind_up[k] + lift[k]) * dt + shaken)
                to_lift[k] = lift[k] * kept
        else:
            for k in range(counts[source]):
                to_up[k] = up[k]
                to_lift[k] = lift[k]
        first = counts[source] - fresh[source]
        for j in range(fresh[source]):
            k, share = first + j, shares[source, j]
            shaken = np.float32(math.sqrt(share))
            wind = wind_north[k] * dt
            to_north[k] = north[k] + wind * share + (to_north[k] - north[k] - wind) * shaken
            wind = wind_east[k] * dt
            to_east[k] = east[k] + wind * share + (to_east[k] - east[k] - wind) * shaken
            to_up[k] = up[k] + (to_up[k] - up[k]) * share
            to_lift[k] = lift[k] * kept**share
            to_size[k] = size[k] + grown * share


@compiled
def keep_out(
    before: SingleArray,
    after: SingleArray,
    counts: IntArray,
    fresh: IntArray,
    sources_m: FloatArray,
    barriers: Barriers,
) -> None:
    """Take back what of the puffs' step leads into obstacles: a puff slides along the wall, or stays.

    `sources_m` (sources, 2): north and east. Of the `fresh`, those that a moving source releases in an obstacle are
    out of reach at the end of the step.
    """
    for source in range(before.shape[1]):
        for k in range(counts[source]):
            n0 = sources_m[source, 0] + float(before[NORTH, source, k])
            e0 = sources_m[source, 1] + float(before[EAST, source, k])
            n1 = sources_m[source, 0] + float(after[NORTH, source, k])
            e1 = sources_m[source, 1] + float(after[EAST, source, k])
            up0, up1 = float(before[UP, source, k]), float(after[UP, source, k])
            if k >= counts[source] - fresh[source] and inside(barriers, n0, e0, up0):
                after[NORTH, source, k] = np.inf
                continue
            if not blocked(barriers, n0, e0, up0, n1, e1, up1):
                continue
            # At its height, along one axis, up or down the wall, or nowhere.
            if not blocked(barriers, n0, e0, up0, n1, e1, up0):
                after[UP, source, k] = before[UP, source, k]
            elif not blocked(barriers, n0, e0, up0, n1, e0, up0):
                after[EAST, source, k], after[UP, source, k] = before[EAST, source, k], before[UP, source, k]
            elif not blocked(barriers, n0, e0, up0, n0, e1, up0):
                after[NORTH, source, k], after[UP, source, k] = (
                    before[NORTH, source, k],
                    before[UP, source, k],
                )
            else:
                after[NORTH, source, k], after[EAST, source, k] = (
                    before[NORTH, source, k],
                    before[EAST, source, k],
                )
                if blocked(barriers, n0, e0, up0, n0, e0, up1):
                    after[UP, source, k] = before[UP, source, k]


@compiled
def drop_gone(
    puffs: SingleArray, numbers: NumberArray, counts: IntArray, reach_m: float, oldest: NumberArray
) -> None:
    """Close the gaps that puffs leave which are out of reach, or older than `oldest` (sources,); `counts` shrink."""
    reach = np.float32(reach_m)
    for source in range(puffs.shape[1]):
        norths, easts, number = puffs[NORTH, source], puffs[EAST, source], numbers[source]
        gone = 0
        for k in range(counts[source]):
            gone += (abs(norths[k]) > reach) | (abs(easts[k]) > reach) | (number[k] < oldest[source])
        if gone == 0:
            continue
        kept = 0
        for k in range(counts[source]):
            if abs(norths[k]) <= reach and abs(easts[k]) <= reach and number[k] >= oldest[source]:
                for field in range(puffs.shape[0]):
                    puffs[field, source, kept] = puffs[field, source, k]
                number[kept] = number[k]
                kept += 1
        counts[source] = kept


# -- what there is at a time -----------------------------------------------------------------------------------------


@compiled
def make_ready(
    before: SingleArray,
    after: SingleArray,
    counts: IntArray,
    share: float,
    strengths: SingleArray,
    ready: SingleArray,
    boxes: SingleArray,
) -> None:
    """Fill `ready` (5, sources, capacity) with the puffs at `share` of the step.

    And `boxes` (6, sources, blocks): south, north, west, east, bottom and top of what each block's puffs reach.
    """
    part = np.float32(share)
    for source in range(before.shape[1]):
        strength = strengths[source]
        north, east, up, size = (
            before[NORTH, source],
            before[EAST, source],
            before[UP, source],
            before[SIZE, source],
        )
        to_north, to_east = after[NORTH, source], after[EAST, source]
        to_up, to_size = after[UP, source], after[SIZE, source]
        now_north, now_east, now_up = ready[NORTH, source], ready[EAST, source], ready[UP, source]
        inverse, weight = ready[INVERSE_R2, source], ready[WEIGHT, source]
        for k in range(counts[source]):
            now_north[k] = north[k] + part * (to_north[k] - north[k])
            now_east[k] = east[k] + part * (to_east[k] - east[k])
            now_up[k] = up[k] + part * (to_up[k] - up[k])
            s = size[k] + part * (to_size[k] - size[k])
            inverse[k] = _ONE / (s * s * s)
            weight[k] = strength * inverse[k] * np.sqrt(inverse[k])
        for block in range((counts[source] + BLOCK - 1) // BLOCK):
            begin, end = block * BLOCK, min((block + 1) * BLOCK, counts[source])
            south = west = bottom = np.float32(np.inf)
            top_n = top_e = top = np.float32(-np.inf)
            least = np.float32(np.inf)
            for k in range(begin, end):
                south, top_n = min(south, now_north[k]), max(top_n, now_north[k])
                west, top_e = min(west, now_east[k]), max(top_e, now_east[k])
                bottom, top = min(bottom, now_up[k]), max(top, now_up[k])
                least = min(least, inverse[k])
            # A little wider than the cut, so that rounding loses nothing.
            farthest = np.float32(1.0001) * np.sqrt(_CUT / least)
            boxes[0, source, block], boxes[1, source, block] = south - farthest, top_n + farthest
            boxes[2, source, block], boxes[3, source, block] = west - farthest, top_e + farthest
            boxes[4, source, block], boxes[5, source, block] = bottom - farthest, top + farthest


@compiled
def concentration_at(
    ready: SingleArray,
    boxes: SingleArray,
    counts: IntArray,
    sources_m: FloatArray,
    barriers: Barriers,
    upright: bool,
    north_m: float,
    east_m: float,
    up_m: float,
) -> float:
    """What all puffs make at one point: 0 in obstacles. `upright`: heights count, and the ground reflects."""
    if (upright and up_m < 0.0) or inside(barriers, north_m, east_m, up_m):
        return 0.0
    total = _ZERO
    u = np.float32(up_m)
    for source in range(ready.shape[1]):
        n, e = np.float32(north_m - sources_m[source, 0]), np.float32(east_m - sources_m[source, 1])
        for block in range((counts[source] + BLOCK - 1) // BLOCK):
            if (
                n < boxes[0, source, block]
                or n > boxes[1, source, block]
                or e < boxes[2, source, block]
                or e > boxes[3, source, block]
                or (upright and (u < boxes[4, source, block] or u > boxes[5, source, block]))
            ):
                continue
            for k in range(block * BLOCK, min((block + 1) * BLOCK, counts[source])):
                inverse, weight = ready[INVERSE_R2, source, k], ready[WEIGHT, source, k]
                dn, de = n - ready[NORTH, source, k], e - ready[EAST, source, k]
                if dn * dn * inverse >= _CUT or de * de * inverse >= _CUT:
                    continue
                if upright:
                    weight *= _high(u, ready[UP, source, k], inverse)
                total += weight * exp_minus(dn * dn * inverse) * exp_minus(de * de * inverse)
    return float(total)


_TILE = 128
"""Points that are asked for together."""


@compiled
def concentrations(
    ready: SingleArray,
    boxes: SingleArray,
    counts: IntArray,
    sources_m: FloatArray,
    barriers: Barriers,
    upright: bool,
    positions_ned_m: FloatArray,
    values: FloatArray,
) -> None:
    """Fill (n,) `values` with `concentration_at` the (n, 3) positions; neighbours should stand side by side."""
    ns, es, us, sums = (
        np.empty(_TILE, np.float32),
        np.empty(_TILE, np.float32),
        np.empty(_TILE, np.float32),
        np.empty(_TILE, np.float32),
    )
    for begin in range(0, positions_ned_m.shape[0], _TILE):
        size = min(_TILE, positions_ned_m.shape[0] - begin)
        for i in range(size):
            us[i] = -positions_ned_m[begin + i, 2]
            sums[i] = _ZERO
        lowest, highest = us[:size].min(), us[:size].max()
        for source in range(ready.shape[1]):
            for i in range(size):
                ns[i] = positions_ned_m[begin + i, 0] - sources_m[source, 0]
                es[i] = positions_ned_m[begin + i, 1] - sources_m[source, 1]
            south, north, west, east = ns[:size].min(), ns[:size].max(), es[:size].min(), es[:size].max()
            for block in range((counts[source] + BLOCK - 1) // BLOCK):
                if (
                    north < boxes[0, source, block]
                    or south > boxes[1, source, block]
                    or east < boxes[2, source, block]
                    or west > boxes[3, source, block]
                    or (upright and (highest < boxes[4, source, block] or lowest > boxes[5, source, block]))
                ):
                    continue
                for k in range(block * BLOCK, min((block + 1) * BLOCK, counts[source])):
                    inverse, weight = ready[INVERSE_R2, source, k], ready[WEIGHT, source, k]
                    puff_n, puff_e, puff_up = (
                        ready[NORTH, source, k],
                        ready[EAST, source, k],
                        ready[UP, source, k],
                    )
                    if upright and lowest != highest:
                        for i in range(size):
                            dn, de = ns[i] - puff_n, es[i] - puff_e
                            here = weight * _high(us[i], puff_up, inverse)
                            sums[i] += here * exp_minus(dn * dn * inverse) * exp_minus(de * de * inverse)
                        continue
                    if upright:
                        weight *= _high(lowest, puff_up, inverse)
                    for i in range(size):
                        dn, de = ns[i] - puff_n, es[i] - puff_e
                        sums[i] += weight * exp_minus(dn * dn * inverse) * exp_minus(de * de * inverse)
        for i in range(size):
            north_m, east_m = positions_ned_m[begin + i, 0], positions_ned_m[begin + i, 1]
            up_m = -positions_ned_m[begin + i, 2]
            hidden = (upright and up_m < 0.0) or inside(barriers, north_m, east_m, up_m)
            values[begin + i] = 0.0 if hidden else sums[i]


@kernel
def _bell(
    places_m: SingleArray, puff_m: np.float32, inverse: np.float32, weight: np.float32, bell: SingleArray
) -> None:
    """Fill `bell` with `weight` times the puff's bell along one axis."""
    for i in range(len(places_m)):
        away_m = places_m[i] - puff_m
        bell[i] = weight * exp_minus(away_m * away_m * inverse)


@kernel
def _not_zero(bell: SingleArray) -> tuple[int, int]:
    """The first place that is not zero, and that behind the last."""
    begin, end = 0, len(bell)
    while begin < end and bell[begin] == _ZERO:
        begin += 1
    while end > begin and bell[end - 1] == _ZERO:
        end -= 1
    return begin, end


@kernel
def _add(row: SingleArray, weight: np.float32, bell: SingleArray) -> None:
    for j in range(len(row)):
        row[j] += weight * bell[j]


@compiled
def grid_concentrations(
    ready: SingleArray,
    counts: IntArray,
    sources_m: FloatArray,
    barriers: Barriers,
    upright: bool,
    norths_m: FloatArray,
    easts_m: FloatArray,
    up_m: float,
    values: SingleArray,
) -> None:
    """Fill (rows, columns) `values` with `concentration_at` the nodes of a regular grid."""
    values[:] = _ZERO
    if upright and up_m < 0.0:
        return
    rows, columns = len(norths_m), len(easts_m)
    u = np.float32(up_m)
    ns, es = np.empty(rows, np.float32), np.empty(columns, np.float32)
    bells_n, bells_e = np.empty((BLOCK, rows), np.float32), np.empty((BLOCK, columns), np.float32)
    first, last = np.empty(BLOCK, np.int64), np.empty(BLOCK, np.int64)
    for source in range(ready.shape[1]):
        for i in range(rows):
            ns[i] = norths_m[i] - sources_m[source, 0]
        for j in range(columns):
            es[j] = easts_m[j] - sources_m[source, 1]
        for begin in range(0, counts[source], BLOCK):
            size = min(BLOCK, counts[source] - begin)
            for m in range(size):
                inverse, weight = ready[INVERSE_R2, source, begin + m], ready[WEIGHT, source, begin + m]
                if upright:
                    weight *= _high(u, ready[UP, source, begin + m], inverse)
                _bell(ns, ready[NORTH, source, begin + m], inverse, weight, bells_n[m])
                _bell(es, ready[EAST, source, begin + m], inverse, _ONE, bells_e[m])
                first[m], last[m] = _not_zero(bells_e[m])
            for i in range(rows):
                row = values[i]
                for m in range(size):
                    if bells_n[m, i] > _ZERO:
                        _add(row[first[m] : last[m]], bells_n[m, i], bells_e[m, first[m] : last[m]])
    for i in range(rows):
        for j in range(columns):
            if inside(barriers, norths_m[i], easts_m[j], up_m):
                values[i, j] = _ZERO
