"""Golden spokes: straight flights out from a centre, each a golden angle after the one before (LoCUS paper, IV).

However many have been flown, the next one falls into the widest gap. Plain functions of numbers: the agent calls
them, the trials compile them.
"""

from __future__ import annotations

import math

GOLDEN = (1.0 + math.sqrt(5.0)) / 2.0


def next_on_spokes(along_m: float, bearing_rad: float, length_m: float, step_m: float) -> tuple[float, float]:
    """(along_m, bearing_rad) of the next point: one step farther out, or the centre once the spoke is flown."""
    along_m += step_m
    if along_m > length_m * (1.0 + 1e-9):
        return 0.0, next_bearing(bearing_rad)
    return along_m, bearing_rad


def next_bearing(bearing_rad: float) -> float:
    """The bearing of the spoke after the one at `bearing_rad`."""
    return (bearing_rad + 2.0 * math.pi / GOLDEN) % (2.0 * math.pi)
