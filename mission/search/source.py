"""Where the source is, from the readings that were taken around it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mission.frames import Vector3
from mission.observation import Reading

_STRONG = 0.7
"""Readings below this fraction of the best one are left out: downwind the plume falls off more slowly than
upwind, and what lies far down its flanks would draw the estimate downwind."""
_REACH = 0.8
"""As are readings farther from the best one than this fraction of the formation's spacing."""


def estimate_source(readings: Sequence[Reading], spacing_m: float) -> Vector3:
    """The point of the largest concentration (NED, m), from at least one reading above 0.

    The logarithm of the strong readings around the best one is fitted with a paraboloid (a plume's
    cross-section is a Gaussian: its logarithm is one exactly), and its summit is taken. Where the fit has
    no summit, or one outside the region that was read, it is the centroid of the best readings.
    """
    reach_m = _REACH * spacing_m
    usable = [r for r in readings if np.isfinite(r.variance_ppm2) and r.excess_co2_ppm > 0.0]
    best = max(usable, key=lambda reading: reading.excess_co2_ppm)
    near = [
        r
        for r in usable
        if r.excess_co2_ppm >= _STRONG * best.excess_co2_ppm
        and np.hypot(
            r.position_ned_m[0] - best.position_ned_m[0], r.position_ned_m[1] - best.position_ned_m[1]
        )
        <= reach_m
    ]
    place_m = np.array([r.position_ned_m[:2] for r in near])
    value = np.array([r.excess_co2_ppm for r in near])
    top = value >= 0.9 * best.excess_co2_ppm
    centroid_m = np.average(place_m[top], axis=0, weights=value[top])
    summit_m = _summit(place_m - centroid_m, value)
    if summit_m is None or np.hypot(*summit_m) > 0.5 * reach_m:
        summit_m = np.zeros(2)
    north_m, east_m = centroid_m + summit_m
    return float(north_m), float(east_m), best.position_ned_m[2]


def _summit(place_m: np.ndarray, value: np.ndarray) -> np.ndarray | None:
    """The summit of the paraboloid through log(value) by least squares, None where there is none."""
    if len(value) < 8:
        return None
    north, east = place_m.T
    terms = np.column_stack((np.ones_like(north), north, east, north * north, north * east, east * east))
    weight = value / value.max()
    solution, _, rank, _ = np.linalg.lstsq(terms * weight[:, None], np.log(value) * weight, rcond=1e-6)
    if rank < 6:
        return None
    _, slope_n, slope_e, nn, ne, ee = solution
    if nn >= 0.0 or 4.0 * nn * ee - ne * ne <= 0.0:
        return None
    return np.linalg.solve(np.array([[2.0 * nn, ne], [ne, 2.0 * ee]]), -np.array([slope_n, slope_e]))
