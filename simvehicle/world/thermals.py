"""Thermals: which columns of rising air there are, when and where. What they do is `wind_formulas.updraught_mps`."""

from __future__ import annotations

from typing import Final

import numpy as np

from mission.geometry.formation import FloatArray

CELLS: Final = 8
"""Along a side of the lattice, which then comes again."""
GENERATIONS: Final = 32
"""Of thermals in each cell."""
_PER_AREA: Final = 0.6
_MIDDLE_RADIUS: Final = 0.102 * 0.5 ** (1.0 / 3.0) * (1.0 - 0.25 * 0.5)
"""Outer radius half-way up, as a share of the mixed layer's height."""
_FROM_EDGE: Final = 0.2


def cell_m(mixed_layer_m: float) -> float:
    """Side of the square that has one thermal: on the average there are 0.6 A / (height of the layer * radius) in an
    area A (Allen 2006)."""
    return float(mixed_layer_m * (_MIDDLE_RADIUS / _PER_AREA) ** 0.5)


def thermals(seed: int) -> FloatArray:
    """(GENERATIONS, CELLS, CELLS, 4): see `updraught_mps`."""
    rng = np.random.default_rng([seed & 0xFFFFFFFF, 0x7E3A1])
    drawn = rng.uniform(size=(GENERATIONS, CELLS, CELLS, 4))
    drawn[..., :2] = _FROM_EDGE + (1.0 - 2.0 * _FROM_EDGE) * drawn[..., :2]
    drawn[..., 2] += 0.5  # half to one and a half times the mean strength
    drawn[..., 3] = drawn[0, ..., 3]  # a cell's lives follow each other
    return drawn
