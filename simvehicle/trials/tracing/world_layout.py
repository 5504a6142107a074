"""Where things are in a world of traced plumes: sources, obstacles, and swarms at the start, each at random."""

from __future__ import annotations

import functools
import math
from typing import Final

import numpy as np

from mission.geometry.formation import FloatArray
from simvehicle.trials.tracing.terrain import Terrain, clearances_of
from simvehicle.trials.trials_error import TrialsError
from simvehicle.world.world_config import RectangularObstacle

_INNER: Final = 0.15
"""A source keeps this share of the world's length from its walls."""
_ASIDE_RAD: Final = math.radians(60.0)
_SOURCE_CLEAR_M: Final = 1.0
_OBSTACLE_GAP_M: Final = 0.7
"""Between obstacles, and to the walls: a vehicle fits through."""
_LATTICE_M: Final = 0.8
"""Between vehicles at the start: the fluxotaxis paper's spacing."""
_TRIES: Final = 10_000


def source_places(length_m: float, count: int, rng: np.random.Generator) -> FloatArray:
    """(count, 2) anywhere but near the walls."""
    return np.asarray(rng.uniform(_INNER * length_m, (1.0 - _INNER) * length_m, (count, 2)))


def source_velocities(
    length_m: float, places_m: FloatArray, speed_mps: float, rng: np.random.Generator
) -> FloatArray:
    """(count, 2) each more or less towards the middle, so that no source leaves the world soon."""
    inwards = 0.5 * length_m - places_m
    headings_rad = np.arctan2(inwards[:, 1], inwards[:, 0]) + rng.uniform(
        -_ASIDE_RAD, _ASIDE_RAD, len(places_m)
    )
    return np.asarray(speed_mps * np.column_stack([np.cos(headings_rad), np.sin(headings_rad)]))


def square_obstacles(
    length_m: float, count: int, side_m: float, ways_m: FloatArray, rng: np.random.Generator
) -> list[RectangularObstacle]:
    """`count` squares at random, apart from each other, from the walls and from `ways_m` (n, 2), where sources go.

    `TrialsError`: there is no room for so many.
    """
    half_m = 0.5 * side_m
    low_m, high_m = half_m + _OBSTACLE_GAP_M, length_m - half_m - _OBSTACLE_GAP_M
    found: list[FloatArray] = []
    for _ in range(_TRIES):
        if len(found) == count:
            break
        at = rng.uniform(low_m, high_m, 2)
        apart = all(np.abs(at - other).max() > side_m + _OBSTACLE_GAP_M for other in found)
        if apart and np.abs(at - ways_m).max(axis=1).min() > half_m + _SOURCE_CLEAR_M:
            found.append(at)
    else:
        raise TrialsError(f"no room for {count} obstacles of {side_m:g} m in a world of {length_m:g} m")
    return [
        RectangularObstacle(
            centre_north_m=float(at[0]),
            centre_east_m=float(at[1]),
            length_north_m=side_m,
            length_east_m=side_m,
        )
        for at in found
    ]


def lattice_start(
    terrain: Terrain,
    source_m: FloatArray,
    most_m: float,
    robots: int,
    radius_m: float,
    rng: np.random.Generator,
) -> FloatArray:
    """(robots, 2) a lattice about a place up to `most_m` from `source_m`; who would stand in something is left out,
    and the lattice goes on.

    `TrialsError`: no such place was found.
    """
    length_m = terrain.length_m
    sites = _lattice(2 * robots + 4 * (len(terrain.tops_m) + 1))
    for _ in range(_TRIES):
        away_m, bearing_rad = most_m * rng.random(), 2.0 * math.pi * rng.random()
        centre = source_m + away_m * np.array([math.cos(bearing_rad), math.sin(bearing_rad)])
        if not np.all((centre > 1.0) & (centre < length_m - 1.0)):
            continue
        places = centre + sites
        inside = np.all((places > radius_m) & (places < length_m - radius_m), axis=1)
        free = places[inside & (clearances_of(terrain, places) > radius_m)]
        if len(free) >= robots:
            return np.asarray(free[:robots])
    raise TrialsError(f"no room for {robots} robots within {most_m:g} m of the source")


@functools.cache
def _lattice(sites: int) -> FloatArray:
    """(sites, 2) of a hexagonal lattice, the nearest to its middle first."""
    reach = math.ceil(math.sqrt(sites)) + 1
    along, across = np.meshgrid(np.arange(-reach, reach + 1), np.arange(-reach, reach + 1))
    places = _LATTICE_M * np.column_stack(
        [(along + 0.5 * (across % 2)).ravel(), math.sqrt(0.75) * across.ravel()]
    )
    return np.asarray(places[np.argsort(np.round((places**2).sum(axis=1), 6), kind="stable")][:sites])
