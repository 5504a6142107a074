"""What a plume is like for who flies in it: how often there is gas, in what bursts, how wide it is, how it wanders.

A smooth plume is a slope to climb, a torn one is a series of whiffs: which strategy finds its source depends on these
numbers. Terms as in E. Balkovsky, B. I. Shraiman, PNAS 99, 12589 (2002), and A. Celani, E. Villermaux, M. Vergassola,
Phys. Rev. X 4, 041015 (2014): whiffs are the stretches of time with gas above a threshold, blanks those without.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mission.geometry.formation import FloatArray
from simvehicle.world.recorded_air import RecordedAir

PEAK_PERCENTILE: Final = 99.0
"""What counts as the peak in time: the largest of all samples would grow with their number."""
_RING_NODES: Final = 2.0
"""Thickness of a ring about the source, in nodes."""


class SeriesStatistics(NamedTuple):
    """Of what sensors at fixed points read: medians over the points. NaN where there is nothing to tell."""

    intermittency: float
    """The share of the time without gas."""
    peak_to_mean: float
    """99th percentile over the mean, in time."""
    whiff_mean_s: float
    """Of the whiffs of all points: those that begin and end while it is recorded."""
    whiff_median_s: float
    blank_mean_s: float
    blank_median_s: float


class PlumeStatistics(NamedTuple):
    """Of a recorded plume, at its nodes where the mean is above the threshold."""

    series: SeriesStatistics
    plume_share: float
    """Of the open ground: where there ever is gas above the threshold."""


class PlumeWidth(NamedTuple):
    """Standard deviations across the plume at a distance from its source (Gifford 1959).

    total^2 = own^2 + meander^2.
    """

    own_m: float
    """Of the gas about the plume's middle of the moment."""
    meander_m: float
    """Of that middle."""
    total_m: float
    """Of the mean plume."""


def whiffs_and_blanks(
    series: NDArray[np.floating], sample_s: float, threshold: float
) -> tuple[FloatArray, FloatArray]:
    """Durations in seconds of all whiffs and of all blanks in (samples,) or (samples, points).

    The first and the last stretch of a series have no known length and are left out.
    """
    smelt = np.atleast_2d((np.asarray(series) > threshold).T)
    points, samples = np.nonzero(smelt[:, 1:] != smelt[:, :-1])
    same = points[1:] == points[:-1]
    durations_s = (samples[1:] - samples[:-1])[same] * sample_s
    is_whiff = smelt[points, samples + 1][:-1][same]
    return durations_s[is_whiff].astype(np.float64), durations_s[~is_whiff].astype(np.float64)


def series_statistics(series: NDArray[np.floating], sample_s: float, threshold: float) -> SeriesStatistics:
    """Of (samples,) or (samples, points) readings, `sample_s` apart, where more than `threshold` counts as gas."""
    readings = np.asarray(series, np.float64).reshape(len(series), -1)
    if not readings.size:
        return SeriesStatistics(*[math.nan] * 6)
    means = readings.mean(axis=0)
    smelling = means > 0.0
    peaks = np.percentile(readings[:, smelling], PEAK_PERCENTILE, axis=0) / means[smelling]
    whiffs_s, blanks_s = whiffs_and_blanks(readings, sample_s, threshold)
    return SeriesStatistics(
        float(np.median((readings <= threshold).mean(axis=0))),
        _median(peaks),
        _mean(whiffs_s),
        _median(whiffs_s),
        _mean(blanks_s),
        _median(blanks_s),
    )


def plume_statistics(air: RecordedAir, threshold: float, *, every: int = 4) -> PlumeStatistics:
    """Of all frames at every `every`-th node to the north and the east."""
    gas = air.gas[:, ::every, ::every]
    is_open = ~air.solid[::every, ::every]
    plume = (gas.mean(axis=0, dtype=np.float64) > threshold) & is_open
    ever = (gas.max(axis=0) > threshold) & is_open
    return PlumeStatistics(
        series_statistics(gas[:, plume], air.frame_s, threshold), float(ever.sum() / max(is_open.sum(), 1))
    )


def plume_width(air: RecordedAir, source_m: tuple[float, float], distance_m: float) -> PlumeWidth:
    """At a distance from the source (north, east), in the ring of nodes about it; NaN if there never is gas in it."""
    rows, columns = air.solid.shape
    north_m = air.gas_origin_m[0] + air.gas_spacing_m * np.arange(rows) - source_m[0]
    east_m = air.gas_origin_m[1] + air.gas_spacing_m * np.arange(columns) - source_m[1]
    away_m = np.hypot(north_m[:, None], east_m[None, :])
    i, j = np.nonzero(np.abs(away_m - distance_m) <= 0.5 * _RING_NODES * air.gas_spacing_m)
    # On the circle itself, so that the ring's thickness is no width.
    scale = distance_m / away_m[i, j] if distance_m > 0.0 else np.zeros(len(i))
    places_m = np.column_stack([north_m[i] * scale, east_m[j] * scale])
    gas = air.gas[:, i, j].astype(np.float64)
    whole = gas.sum(axis=1)
    some = whole > 0.0
    if not some.any():
        return PlumeWidth(math.nan, math.nan, math.nan)
    gas, whole = gas[some], whole[some]
    middles_m = gas @ places_m / whole[:, None]
    squares = gas @ (places_m**2).sum(axis=1) / whole - (middles_m**2).sum(axis=1)
    own2 = float(np.average(np.maximum(squares, 0.0), weights=whole))
    middle_m = np.average(middles_m, axis=0, weights=whole)
    meander2 = float(np.average(((middles_m - middle_m) ** 2).sum(axis=1), weights=whole))
    return PlumeWidth(math.sqrt(own2), math.sqrt(meander2), math.sqrt(own2 + meander2))


def _mean(values: FloatArray) -> float:
    return float(values.mean()) if values.size else math.nan


def _median(values: FloatArray) -> float:
    return float(np.median(values)) if values.size else math.nan
