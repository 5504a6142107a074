"""Where a swarm has met gas and where it has not: what an estimate of the source needs to know, in bounded memory.

Readings that follow each other by seconds in one place are hardly more than one: an eddy or a gap of the plume is as
long. So they are gathered in cells, and each adds to its cell's weight only as fast as independent ones would come.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from mission.geometry.formation import FloatArray, IntArray

CELL_M: Final = 4.0
INDEPENDENT_S: Final = 10.0
"""Readings of one cell that are so far apart count as much as those of different cells ..."""
INDEPENDENT_SHARE: Final = 0.5
"""... which are not quite independent either: whiffs and gaps are longer than a cell."""
WEIGHT_MOST: Final = 2.0
"""Of a cell: however long drones hover in one place, a model of the plume's mean stays a model."""
CELLS_MOST: Final = 1200
SIGMAS: Final = 4.0
"""An excess below so many standard deviations is no contact."""

# Columns of `Evidence.cells`.
(
    NORTH,
    EAST,
    DOWNWIND_NORTH,
    DOWNWIND_EAST,
    BLANK,
    BLANK_LOG,
    CONTACT,
    CONTACT_LOG,
    CONTACT_LOG_VARIANCE,
    COLUMNS,
) = range(10)


class Evidence:
    """What one drone has heard. `cells` (n, COLUMNS): a cell's place (m), the downwind unit vector there (0, 0 where
    no wind was known), the weight of its blanks and the mean logarithm of what they could have detected (ppm), the
    weight of its contacts, and mean and variance of their logarithms (of ppm)."""

    def __init__(self) -> None:
        self._cells: FloatArray = np.zeros((64, COLUMNS))
        self._heard_s: FloatArray = np.zeros(64)
        self._changes: IntArray = np.zeros(64, np.int64)
        self._places: dict[tuple[int, int], int] = {}
        self._drones_s: dict[int, float] = {}
        self._count = 0

    @property
    def cells(self) -> FloatArray:
        return self._cells[: self._count]

    @property
    def changes(self) -> IntArray:
        """(n,) how often each cell has changed, which its readers compare."""
        return self._changes[: self._count]

    @property
    def contact_cells(self) -> int:
        """In how many cells there was contact."""
        return int(np.count_nonzero(self.cells[:, CONTACT]))

    def take(
        self,
        now_s: float,
        north_m: float,
        east_m: float,
        excess_co2_ppm: float,
        variance_ppm2: float,
        downwind: tuple[float, float],
    ) -> None:
        """One reading. `downwind`: the unit vector (north, east) to which the air goes, (0, 0) where nobody knows.
        What is no number is no reading."""
        sd_ppm = math.sqrt(variance_ppm2) if 0.0 <= variance_ppm2 < math.inf else math.inf
        if not (math.isfinite(sd_ppm) and math.isfinite(excess_co2_ppm) and math.isfinite(now_s)):
            return
        place = self._place(now_s, north_m, east_m)
        weight = INDEPENDENT_SHARE * min((now_s - self._heard_s[place]) / INDEPENDENT_S, 1.0)
        if weight <= 0.0:
            return
        cell = self._cells[place]
        self._heard_s[place] = now_s
        self._changes[place] += 1
        before = cell[BLANK] + cell[CONTACT]
        kept = min((WEIGHT_MOST - weight) / before, 1.0) if before > 0.0 else 0.0
        cell[BLANK] *= kept
        cell[CONTACT] *= kept
        share = weight / (before * kept + weight)
        for column, value in (
            (NORTH, north_m),
            (EAST, east_m),
            (DOWNWIND_NORTH, downwind[0]),
            (DOWNWIND_EAST, downwind[1]),
        ):
            cell[column] += share * (value - cell[column])
        least_ppm = max(SIGMAS * sd_ppm, _LEAST_PPM)
        if excess_co2_ppm <= least_ppm:
            cell[BLANK] += weight
            cell[BLANK_LOG] += weight / cell[BLANK] * (math.log(least_ppm) - cell[BLANK_LOG])
            return
        cell[CONTACT] += weight
        share = weight / cell[CONTACT]
        off = math.log(excess_co2_ppm) - cell[CONTACT_LOG]
        cell[CONTACT_LOG] += share * off
        cell[CONTACT_LOG_VARIANCE] = (1.0 - share) * (cell[CONTACT_LOG_VARIANCE] + share * off * off)

    def _place(self, now_s: float, north_m: float, east_m: float) -> int:
        """The row of a place's cell, which may be a new one."""
        key = math.floor(north_m / CELL_M), math.floor(east_m / CELL_M)
        place = self._places.get(key)
        if place is not None:
            return place
        if self._count < CELLS_MOST:
            place = self._count
            self._count += 1
            if place == len(self._cells):
                self._cells = np.concatenate((self._cells, np.zeros_like(self._cells)))
                self._heard_s = np.concatenate((self._heard_s, np.zeros_like(self._heard_s)))
                self._changes = np.concatenate((self._changes, np.zeros_like(self._changes)))
        else:
            # The blank that was heard longest ago, or the oldest of all where there is none.
            without = self.cells[:, CONTACT] == 0.0
            age = np.where(without | ~without.any(), self._heard_s[: self._count], math.inf)
            place = int(np.argmin(age))
            del self._places[next(key for key, held in self._places.items() if held == place)]
            self._cells[place] = 0.0
        self._places[key] = place
        self._heard_s[place] = now_s - INDEPENDENT_S
        return place


_LEAST_PPM: Final = 1.0
"""No instrument detects less, whatever it thinks of its own noise."""
