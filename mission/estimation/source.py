"""Where the source is, from the readings that were taken around it.

With a known wind a steady Gaussian plume is fitted to the readings (source, width at the vent, growth, strength,
direction), as the works do that the LoCUS paper builds on (its section II: Gaussian parameter
estimation). What it cannot know is how steady the real plume was. Without wind, or
where no such plume fits, a paraboloid finds the summit of the strongest readings.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mission.estimation.estimates import Reading
from mission.geometry.formation import FloatArray
from mission.geometry.frames import Vector3

_STRONG = 0.7
"""Readings below this fraction of the best one are left out: downwind the plume falls off more slowly than
upwind, and what lies far down its flanks would draw the estimate downwind."""
_REACH = 0.8
"""As are readings farther from the best one than this fraction of the formation's spacing."""


_FIT_RADIUS_M = 40.0
"""How far from the best reading the plume is fitted."""
_FIT_FARTHEST_M = 25.0
"""A fitted source farther than this from the best reading is an extrapolation, and not believed."""
_FIT_READINGS = 20
_LARGEST_LOG = 20.0
"""Of a width or strength that is tried on the way to a fit: beyond it the numbers would overflow."""
_FIT_MISFIT = 0.12
"""Largest root-mean-square misfit of the square roots of relative concentration that still is a fit."""


def estimate_source(
    readings: Sequence[Reading], spacing_m: float, wind_ned_mps: Vector3 | None = None
) -> Vector3:
    """The point of the largest concentration (NED, m), from at least one reading above 0."""
    best = max((r for r in readings if np.isfinite(r.variance_ppm2)), key=lambda r: r.excess_co2_ppm)
    if wind_ned_mps is not None:
        fitted = _fitted_source(readings, best, math.atan2(wind_ned_mps[1], wind_ned_mps[0]))
        if fitted is not None:
            return *fitted, best.position_ned_m[2]
    return _summit_of_best(readings, spacing_m)


def _fitted_source(
    readings: Sequence[Reading], best: Reading, downwind_rad: float
) -> tuple[float, float] | None:
    """Source (north, east) of the Gaussian plume that fits the readings around the best one; None where none does.

    Concentration at d downwind and y across: A s0^2/s^2 exp(-y^2/2s^2) with s^2 = s0^2 + (g max(d, 0))^2, and
    upwind of the source the vent's own blur exp(-d^2/2 s0^2). Square roots weigh the skirts as the summit.
    """
    from scipy.optimize import least_squares  # late: only the root needs it, and once

    valid = [r for r in readings if np.isfinite(r.variance_ppm2)]
    place_m = np.array([r.position_ned_m[:2] for r in valid]) - np.array(best.position_ned_m[:2])
    value = np.array([max(r.excess_co2_ppm, 0.0) for r in valid])
    near = np.hypot(place_m[:, 0], place_m[:, 1]) <= _FIT_RADIUS_M
    if int(near.sum()) < _FIT_READINGS:
        return None
    north, east = place_m[near].T
    measured = np.sqrt(value[near] / best.excess_co2_ppm + 1e-3)

    def misfit(q: FloatArray) -> FloatArray:
        north_0, east_0, *logs, bearing = q
        log_vent, log_growth, log_strength = np.clip(logs, -_LARGEST_LOG, _LARGEST_LOG)
        cos, sin = np.cos(bearing), np.sin(bearing)
        downwind = (north - north_0) * cos + (east - east_0) * sin
        across = (east - east_0) * cos - (north - north_0) * sin
        vent2 = np.exp(2.0 * log_vent)
        width2 = vent2 + (np.exp(log_growth) * np.maximum(downwind, 0.0)) ** 2
        blur = across**2 / width2 + np.minimum(downwind, 0.0) ** 2 / vent2
        model = np.exp(log_strength) * vent2 / width2 * np.exp(-0.5 * blur)
        # What is known beforehand, weakly: the wind's direction, vents of metres, growth of some per cent.
        prior = (bearing - downwind_rad) / 1.5, (log_vent - 1.4) / 20.0, (log_growth + 2.5) / 7.0
        return np.concatenate((np.sqrt(model + 1e-3) - measured, prior))

    fits = []
    for ahead_m in (0.0, -8.0, 8.0):
        start = (math.cos(downwind_rad) * ahead_m, math.sin(downwind_rad) * ahead_m)
        guess = (*start, 1.4, -2.5, 0.0, downwind_rad)
        fits.append(least_squares(misfit, guess, loss="soft_l1", f_scale=0.1, max_nfev=60))
    fit = min(fits, key=lambda one: float(one.cost))
    rms = float(np.sqrt(np.mean(misfit(fit.x)[:-3] ** 2)))
    if rms > _FIT_MISFIT or math.hypot(fit.x[0], fit.x[1]) > _FIT_FARTHEST_M:
        return None
    return best.position_ned_m[0] + float(fit.x[0]), best.position_ned_m[1] + float(fit.x[1])


def _summit_of_best(readings: Sequence[Reading], spacing_m: float) -> Vector3:
    """The summit of the readings around the best one.

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
