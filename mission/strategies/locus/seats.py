"""Who takes which place of a formation that forms up around a point: whoever is nearest takes the innermost.

A plain function of numbers and small arrays: the agent calls it, the trials compile it.
"""

from __future__ import annotations

import math

from mission.geometry.formation import FloatArray, IntArray


def nearest_first(
    north_m: FloatArray,
    east_m: FloatArray,
    present: IntArray,
    centre_n_m: float,
    centre_e_m: float,
    placed: IntArray,
    holder: IntArray,
) -> None:
    """`holder` gets the number of the drone in each place, innermost first, -1 where there are no more.

    `present` is 1 for drones that take part; of equally near ones the first comes first. `placed` is scratch.
    """
    for i in range(placed.shape[0]):
        placed[i] = 0
    for place in range(holder.shape[0]):
        nearest = -1
        least_m = math.inf
        for i in range(placed.shape[0]):
            away_m = math.hypot(north_m[i] - centre_n_m, east_m[i] - centre_e_m)
            if present[i] == 1 and placed[i] == 0 and away_m < least_m:
                nearest, least_m = i, away_m
        holder[place] = nearest
        if nearest >= 0:
            placed[nearest] = 1
