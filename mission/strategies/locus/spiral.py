"""Archimedes' spiral about the start: where a formation looks for first contact (LoCUS paper, V-A).

Plain functions of numbers: the agent calls them, the trials compile them.
"""

from __future__ import annotations

import math

POINTS_PER_TURN = 30
"""The authors' program has a point every 12 degrees."""
_EVEN_FROM_RAD = float(POINTS_PER_TURN)
"""From here on 12 degrees of an arm are longer than the distance between arms."""
_EVEN_FROM_INDEX = POINTS_PER_TURN * _EVEN_FROM_RAD / (2.0 * math.pi)


def arm_spacing_m(full_levels: int, spacing_m: float) -> float:
    """Distance between the arms for a formation with `full_levels` full levels, the root's own counted.

    Twice R = 2 (full_levels - 1/2) r_max, the authors' radius of the largest full shell.
    """
    return 4.0 * (full_levels - 0.5) * spacing_m


def spiral_point(index: int, arms_m: float, even: bool) -> tuple[float, float]:
    """Point `index` (from 0, the centre) as (north_m, east_m) from the centre, arms `arms_m` apart.

    The paper's points stand 12 degrees apart, so far out the legs outgrow the formation and it would fly over
    ground that nobody reads. With `even` the points are one arm's distance apart once 12 degrees are more than
    that: from the angle of 30 rad on, where the arc length is angle^2 arms / (4 pi) to within a thousandth.
    """
    angle_rad = index * (2.0 * math.pi / POINTS_PER_TURN)
    if even and angle_rad > _EVEN_FROM_RAD:
        angle_rad = math.sqrt(_EVEN_FROM_RAD**2 + 4.0 * math.pi * (index - _EVEN_FROM_INDEX))
    radius_m = arms_m / (2.0 * math.pi) * angle_rad
    return radius_m * math.cos(angle_rad), radius_m * math.sin(angle_rad)


def spiral_index(radius_m: float, arms_m: float, even: bool) -> float:
    """The inverse of `spiral_point`: the (fractional) number of the point at `radius_m` from the centre."""
    angle_rad = radius_m * 2.0 * math.pi / arms_m
    if even and angle_rad > _EVEN_FROM_RAD:
        return _EVEN_FROM_INDEX + (angle_rad**2 - _EVEN_FROM_RAD**2) / (4.0 * math.pi)
    return angle_rad * POINTS_PER_TURN / (2.0 * math.pi)
