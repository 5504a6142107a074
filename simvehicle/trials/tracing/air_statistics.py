"""Numbers that tell how hard a recorded plume is to trace: gaps, peaks, width, meandering."""

from __future__ import annotations

import math

import numpy as np

from simvehicle.world.recorded_air import RecordedAir


def plume_statistics(air: RecordedAir, detection: float) -> dict[str, float]:
    """Of what a sensor that does not move would read where the plume is at all, in the middle of the plume's places.

    `intermittency`: the share of the time without gas. `peak_to_mean`: the 99th percentile over the mean, in time.
    `plume_share`: the share of the ground that ever has gas. `meander`: how far the plume's middle goes about,
    the deviation of its centre of mass over its mean width.
    """
    gas = air.gas[::5]
    coarse = np.ascontiguousarray(gas[:, ::4, ::4], np.float64)
    mean = coarse.mean(axis=0)
    plume = mean > max(detection, 0.0)
    if not plume.any():
        return {"intermittency": 1.0, "peak_to_mean": math.nan, "plume_share": 0.0, "meander": math.nan}
    there = coarse[:, plume]
    peaks = np.percentile(there, 99.0, axis=0) / mean[plume]
    whole = coarse.sum(axis=(1, 2))
    norths, easts = np.arange(coarse.shape[1]), np.arange(coarse.shape[2])
    some = whole > 0.0
    centres = np.column_stack(
        [
            (coarse.sum(axis=2)[some] @ norths) / whole[some],
            (coarse.sum(axis=1)[some] @ easts) / whole[some],
        ]
    )
    spread = math.sqrt(float(plume.sum()) / math.pi)
    return {
        "intermittency": float(np.median((there <= detection).mean(axis=0))),
        "peak_to_mean": float(np.median(peaks)),
        "plume_share": float((coarse.max(axis=0) > detection).mean()),
        "meander": float(np.linalg.norm(centres.std(axis=0)) / spread),
    }
