"""Who is near whom. Sets of robots are bits: robot 64 w + b is bit b of word w, so sets join without a branch.

A swarm of one word (64 robots) is tested all against all: the processor tests several at once, so that it is the
quickest. A larger one is sorted into square cells just wider than the range: a robot's neighbours are in its own cell
and the eight around it. The plane is folded onto a table of cells, like a torus, so that it has no edge: robots far
away that fall into the same cell are told by their distance. Either way the neighbours come out in the order of
their numbers.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mission.strategies.tick_rule import EAST, EAST_MPS, NORTH, NORTH_MPS, WORD
from simvehicle.compiled import kernel, leaf
from simvehicle.trials.ticks.arrays import BitArray, Robots

_ONE = np.uint64(1)
_NONE = np.uint64(0)
_BITS = 64
_PLACE_OF = np.uint64(63)
_WORD_OF = np.uint64(6)
_CELLS_PER_RANGE = 1.0 - 1e-6
"""A little less than one, for two that are the range apart must not be rounded into cells that do not touch."""
# The place of the only bit that is set in a number: multiplied by this, each shows another pattern of 6 bits.
_DE_BRUIJN = 0x03F79D71B4CB0A89
_PATTERN = np.uint64(_DE_BRUIJN)
_PATTERN_SHIFT = np.uint64(58)
_PLACE = np.zeros(_BITS, np.uint64)
for _bit in range(_BITS):
    _PLACE[((_DE_BRUIJN << _bit) & (2**64 - 1)) >> 58] = _bit


class Neighbourhood(NamedTuple):
    """What the search keeps; either the first or the rest is used."""

    near: BitArray
    """(n,) who is near each robot, in a swarm of one word."""
    side: int
    """Cells along an edge of the table, a power of 2, at least 4."""
    row: BitArray
    """(n,) the row of the table, and the column, of the cell that each robot is in."""
    column: BitArray
    members: BitArray
    """(side, side, words) who is in a cell."""
    filled: BitArray
    """(side, side) which words of `members` are not empty, one bit a word."""


@kernel
def new_neighbourhood(count: int) -> Neighbourhood:
    """Nobody near anybody, for `count` robots (at most 4096)."""
    side = 4
    # The more cells, the fewer strangers in them; a large table would not stay in the processor's cache.
    while count > _BITS and side * side < 2 * count:
        side *= 2
    words = (count + _BITS - 1) // _BITS
    return Neighbourhood(
        np.zeros(count, np.uint64),
        side,
        np.zeros(count, np.uint64),
        np.zeros(count, np.uint64),
        np.zeros((side, side, words), np.uint64),
        np.zeros((side, side), np.uint64),
    )


@leaf
def _test_pairs(around: Neighbourhood, robots: Robots, range_m: float) -> None:
    count = around.near.shape[0]
    for i in range(count):
        around.near[i] = _NONE
    for j in range(count):
        if robots.alive[j] == 0:
            continue
        north_m, east_m = robots.north_m[j], robots.east_m[j]
        bit = _ONE << np.uint64(j)
        # One against all, without a branch: the compiler makes vector instructions of it.
        for i in range(count):
            away_north_m, away_east_m = robots.north_m[i] - north_m, robots.east_m[i] - east_m
            near_enough = away_north_m * away_north_m + away_east_m * away_east_m <= range_m * range_m
            around.near[i] |= bit if near_enough else _NONE


@leaf
def _fill_cells(around: Neighbourhood, robots: Robots, range_m: float) -> None:
    per_m = _CELLS_PER_RANGE / range_m
    within = around.side - 1
    # Who was in is taken out again, which is quicker than emptying every cell.
    for i in range(around.row.shape[0]):
        around.members[around.row[i], around.column[i], np.uint64(i) >> _WORD_OF] = _NONE
        around.filled[around.row[i], around.column[i]] = _NONE
    for i in range(around.row.shape[0]):
        row = np.uint64(math.floor(robots.north_m[i] * per_m) & within)
        column = np.uint64(math.floor(robots.east_m[i] * per_m) & within)
        around.row[i], around.column[i] = row, column
        if robots.alive[i] == 1:
            word = np.uint64(i) >> _WORD_OF
            around.members[row, column, word] |= _ONE << (np.uint64(i) & _PLACE_OF)
            around.filled[row, column] |= _ONE << word


@leaf
def find_neighbours(around: Neighbourhood, robots: Robots, range_m: float) -> None:
    """Search anew, as everybody alive is now; `show_neighbours` tells what was found."""
    if around.near.shape[0] <= _BITS:
        _test_pairs(around, robots, range_m)
    else:
        _fill_cells(around, robots, range_m)


@leaf
def lowest_bit(bits: np.uint64) -> np.uint64:
    """The place of the lowest bit that is set; there must be one."""
    place: np.uint64 = _PLACE[((bits & (~bits + _ONE)) * _PATTERN) >> _PATTERN_SHIFT]
    return place


@leaf
def _within_range(near: np.uint64, word: np.uint64, robots: Robots, i: int, range_m: float) -> np.uint64:
    """Those of the set `near`, of word `word`, that are within range of robot i."""
    north_m, east_m = robots.north_m[i], robots.east_m[i]
    found = _NONE
    while near != _NONE:
        bit = near & (~near + _ONE)
        near ^= bit
        j = (word << _WORD_OF) | lowest_bit(bit)
        away_north_m, away_east_m = robots.north_m[j] - north_m, robots.east_m[j] - east_m
        near_enough = away_north_m * away_north_m + away_east_m * away_east_m <= range_m * range_m
        found |= bit if near_enough else _NONE
    return found


@leaf
def _show(near: np.uint64, word: np.uint64, robots: Robots, i: int, count: int) -> int:
    """Add the set `near`, of word `word` and without robot i itself, to the `count` rows; how many there are then."""
    if word == np.uint64(i) >> _WORD_OF:
        near &= ~(_ONE << (np.uint64(i) & _PLACE_OF))
    while near != _NONE:
        j = (word << _WORD_OF) | lowest_bit(near)
        near &= near - _ONE
        robots.rows[count, NORTH] = robots.north_m[j] - robots.north_m[i]
        robots.rows[count, EAST] = robots.east_m[j] - robots.east_m[i]
        robots.rows[count, NORTH_MPS] = robots.north_mps[j] - robots.north_mps[i]
        robots.rows[count, EAST_MPS] = robots.east_mps[j] - robots.east_mps[i]
        for place in range(robots.heard.shape[1]):
            robots.rows[count, WORD + place] = robots.heard[j, place]
        count += 1
    return count


@leaf
def show_neighbours(around: Neighbourhood, robots: Robots, i: int, range_m: float) -> int:
    """Fill `robots.rows` with what robot i is shown of those within `range_m`; how many they are."""
    if around.near.shape[0] <= _BITS:
        return _show(around.near[i], _NONE, robots, i, 0)
    within = np.uint64(around.side - 1)
    row, column = around.row[i], around.column[i]
    below, above = (row - _ONE) & within, (row + _ONE) & within
    west, east = (column - _ONE) & within, (column + _ONE) & within
    filled = around.filled
    words = filled[below, west] | filled[below, column] | filled[below, east]
    words |= filled[row, west] | filled[row, column] | filled[row, east]
    words |= filled[above, west] | filled[above, column] | filled[above, east]
    members = around.members
    count = 0
    while words != _NONE:
        w = lowest_bit(words)
        words &= words - _ONE
        near = members[below, west, w] | members[below, column, w] | members[below, east, w]
        near |= members[row, west, w] | members[row, column, w] | members[row, east, w]
        near |= members[above, west, w] | members[above, column, w] | members[above, east, w]
        count = _show(_within_range(near, w, robots, i, range_m), w, robots, i, count)
    return count
