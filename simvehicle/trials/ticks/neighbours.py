"""Who is near whom: square cells as wide as the range, each with the set of robots in it as bits.

A robot's neighbours are in its own cell and the eight around it. The plane is folded onto a table of cells, like a
torus, so that it has no edge: robots far away that fall into the same cell are told by their distance. A set is one
bit a robot, so the nine sets are joined without a branch, and the robots come out in the order of their
numbers, whatever the cells.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mission.geometry.formation import IntArray
from mission.strategies.tick_rule import EAST, EAST_MPS, NORTH, NORTH_MPS, WORD
from simvehicle.compiled import kernel, leaf
from simvehicle.trials.ticks.arrays import BitArray, Robots

_ONE = np.uint64(1)
_NONE = np.uint64(0)
_BITS = 64
# The place of the only bit that is set in a number: multiplied by this, each shows another pattern of 6 bits.
_DE_BRUIJN = 0x03F79D71B4CB0A89
_PATTERN = np.uint64(_DE_BRUIJN)
_PATTERN_SHIFT = np.uint64(58)
_PLACE = np.zeros(_BITS, np.int64)
for _bit in range(_BITS):
    _PLACE[((_DE_BRUIJN << _bit) & (2**64 - 1)) >> 58] = _bit


class Cells(NamedTuple):
    side: int
    """Cells along an edge of the table, a power of 2, at least 4."""
    cell: IntArray
    """(n,) the cell that each robot is in."""
    members: BitArray
    """(side^2, words) who is in a cell: robot 64 w + b is bit b of word w."""
    filled: BitArray
    """(side^2,) which words of `members` are not empty, one bit a word."""


@kernel
def new_cells(count: int) -> Cells:
    """An empty table for `count` robots (at most 4096)."""
    side = 8
    # The more cells, the fewer strangers in them; a large table would not stay in the processor's cache.
    while side * side < (16 * count if count <= _BITS else 2 * count):
        side *= 2
    words = (count + _BITS - 1) // _BITS
    return Cells(
        side,
        np.zeros(count, np.int64),
        np.zeros((side * side, words), np.uint64),
        np.zeros(side * side, np.uint64),
    )


@leaf
def fill_cells(cells: Cells, robots: Robots, range_m: float) -> None:
    """Put everybody alive into the cells."""
    per_m = 1.0 / range_m
    within = cells.side - 1
    for i in range(robots.alive.shape[0]):
        row = math.floor(robots.north_m[i] * per_m) & within
        column = math.floor(robots.east_m[i] * per_m) & within
        cell = row * cells.side + column
        cells.cell[i] = cell
        if robots.alive[i] == 1:
            cells.members[cell, i >> 6] |= _ONE << np.uint64(i & 63)
            cells.filled[cell] |= _ONE << np.uint64(i >> 6)


@leaf
def empty_cells(cells: Cells) -> None:
    """Take everybody out again, which is quicker than emptying every cell."""
    for i in range(cells.cell.shape[0]):
        cells.members[cells.cell[i], i >> 6] = _NONE
        cells.filled[cells.cell[i]] = _NONE


@leaf
def lowest_bit(bits: np.uint64) -> int:
    """The place of the lowest bit that is set; there must be one."""
    return int(_PLACE[((bits & (~bits + _ONE)) * _PATTERN) >> _PATTERN_SHIFT])


@leaf
def show_neighbours(cells: Cells, robots: Robots, i: int, range_m: float) -> int:
    """Fill `robots.rows` with what robot i is shown of those within `range_m`; how many they are."""
    within = cells.side - 1
    row, column = cells.cell[i] // cells.side, cells.cell[i] & within
    west, east = (column - 1) & within, (column + 1) & within
    below, level, above = (
        ((row - 1) & within) * cells.side,
        row * cells.side,
        ((row + 1) & within) * cells.side,
    )
    words = _ONE
    if cells.members.shape[1] > 1:
        words = cells.filled[below + west] | cells.filled[below + column] | cells.filled[below + east]
        words |= cells.filled[level + west] | cells.filled[level + column] | cells.filled[level + east]
        words |= cells.filled[above + west] | cells.filled[above + column] | cells.filled[above + east]
    north_m, east_m = robots.north_m[i], robots.east_m[i]
    count = 0
    while words != _NONE:
        word = lowest_bit(words)
        words &= words - _ONE
        near = (
            cells.members[below + west, word]
            | cells.members[below + column, word]
            | cells.members[below + east, word]
        )
        near |= (
            cells.members[level + west, word]
            | cells.members[level + column, word]
            | cells.members[level + east, word]
        )
        near |= (
            cells.members[above + west, word]
            | cells.members[above + column, word]
            | cells.members[above + east, word]
        )
        if word == i >> 6:
            near &= ~(_ONE << np.uint64(i & 63))
        while near != _NONE:
            j = (word << 6) + lowest_bit(near)
            near &= near - _ONE
            away_north_m, away_east_m = robots.north_m[j] - north_m, robots.east_m[j] - east_m
            # Written first and kept if near: a guess whether it is would be wrong too often.
            robots.rows[count, NORTH] = away_north_m
            robots.rows[count, EAST] = away_east_m
            robots.rows[count, NORTH_MPS] = robots.north_mps[j] - robots.north_mps[i]
            robots.rows[count, EAST_MPS] = robots.east_mps[j] - robots.east_mps[i]
            for place in range(robots.heard.shape[1]):
                robots.rows[count, WORD + place] = robots.heard[j, place]
            near_enough = away_north_m * away_north_m + away_east_m * away_east_m <= range_m * range_m
            count += 1 if near_enough else 0
    return count
