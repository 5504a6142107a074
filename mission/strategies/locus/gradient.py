"""The plane that fits a swarm's readings best, and the waypoint that follows from it (LoCUS paper, eq. 3).

Plain functions of numbers and small arrays: the agent calls them, the trials compile them.
"""

from __future__ import annotations

import math

from mission.geometry.formation import FloatArray


def plane_gradient(
    north_m: FloatArray,
    east_m: FloatArray,
    value: FloatArray,
    weight: FloatArray,
    count: int,
    min_extent_m: float,
) -> tuple[float, float, int]:
    """Gradient (value per metre north, per metre east) of the weighted least-squares plane, and its rank.

    The first `count` entries are used. The plane has three unknowns; where the positions spread less than
    `min_extent_m` (standard deviation) along an axis, nothing can be known along it and the fit is degenerate:
    rank 1 gives the gradient along the one line that is known (the least-norm solution, which is what a
    swarm of one or two has), rank 0 gives none.
    """
    total = 0.0
    mean_n = mean_e = mean_v = 0.0
    for i in range(count):
        total += weight[i]
        mean_n += weight[i] * north_m[i]
        mean_e += weight[i] * east_m[i]
        mean_v += weight[i] * value[i]
    if total <= 0.0:
        return 0.0, 0.0, 0
    mean_n /= total
    mean_e /= total
    mean_v /= total
    nn = ee = ne = nv = ev = 0.0
    for i in range(count):
        dn = north_m[i] - mean_n
        de = east_m[i] - mean_e
        share = weight[i] / total
        nn += share * dn * dn
        ee += share * de * de
        ne += share * dn * de
        nv += share * dn * (value[i] - mean_v)
        ev += share * de * (value[i] - mean_v)
    # Principal axes of the positions: variance `wide` along (along_n, along_e), `narrow` across.
    half = 0.5 * (nn - ee)
    root = math.hypot(half, ne)
    wide = 0.5 * (nn + ee) + root
    narrow = max((nn * ee - ne * ne) / wide, 0.0) if wide > 0.0 else 0.0
    least = min_extent_m * min_extent_m
    if wide <= least or wide <= 0.0:
        return 0.0, 0.0, 0
    axis_rad = 0.5 * math.atan2(2.0 * ne, nn - ee)
    along_n = math.cos(axis_rad)
    along_e = math.sin(axis_rad)
    along = (nv * along_n + ev * along_e) / wide
    if narrow <= least or narrow <= 1e-12 * wide:
        return along * along_n, along * along_e, 1
    across = (ev * along_n - nv * along_e) / narrow
    return along * along_n - across * along_e, along * along_e + across * along_n, 2


def waypoint_uphill(
    gradient_n: float,
    gradient_e: float,
    anchor_n_m: float,
    anchor_e_m: float,
    step_m: float,
    jitter_n_m: float,
    jitter_e_m: float,
) -> tuple[bool, float, float]:
    """The next anchor `step_m` up the gradient, moved by the jitter; (False, the old anchor) without a gradient.

    The jitter is the paper's random offset of up to 0.1 m per axis, which ends oscillations between two points.
    """
    steepness = math.hypot(gradient_n, gradient_e)
    if steepness == 0.0:
        return False, anchor_n_m, anchor_e_m
    return (
        True,
        anchor_n_m + step_m * gradient_n / steepness + jitter_n_m,
        anchor_e_m + step_m * gradient_e / steepness + jitter_e_m,
    )
