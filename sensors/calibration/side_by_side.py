"""Cross-calibration: drones side by side in the same air, each brought to the ensemble's median.

The operators' `calibrate` step: for a minute all drones breathe the same air, and what each reads differently
from the others is its own. With air that changes enough in that minute (a car's exhaust nearby does) a scale
can be told from an offset; in air that does not, only the offset is.
"""

from __future__ import annotations

import math
import pathlib
import statistics
from collections.abc import Mapping, Sequence
from typing import Final

import msgspec
import numpy as np

from mission.documents.printable import printable
from sensors.instruments.calibrated import Calibration
from sensors.instruments.samples import Sample
from sensors.instruments.sensor_error import SensorError

LEAST_S: Final = 30.0
"""Shorter than this, an offset is not better known than the instrument's noise makes it."""
_BIN_S: Final = 1.0
_SPREAD_FOR_SCALE: Final = 10.0
"""The ensemble has to move by this many times a drone's own scatter before a scale is fitted."""


def cross_calibrate(readings: Mapping[str, Sequence[Sample]], made_at: str = "") -> dict[str, Calibration]:
    """Every drone's calibration against the ensemble median, from samples taken side by side.

    Each drone's `time_s` counts from its own start of the common minute: clocks of two machines are never
    compared. `SensorError` for fewer than two drones with readings, or less than `LEAST_S` in common.
    """
    means = {name: _by_second(samples) for name, samples in readings.items()}
    means = {name: by_second for name, by_second in means.items() if by_second}
    if len(means) < 2:
        raise SensorError(f"cross-calibration needs two drones with readings, there are {len(means)}")
    common = sorted(set.intersection(*(set(by_second) for by_second in means.values())))
    if len(common) * _BIN_S < LEAST_S:
        held = ", ".join(f"{name} {len(by_second)} s" for name, by_second in sorted(means.items()))
        raise SensorError(f"only {len(common)} s of readings in common, {LEAST_S:.0f} are needed ({held})")
    table = {name: np.array([by_second[second] for second in common]) for name, by_second in means.items()}
    median = np.median(np.array(list(table.values())), axis=0)
    return {name: _fit(values, median, made_at) for name, values in table.items()}


def _by_second(samples: Sequence[Sample]) -> dict[int, float]:
    """Mean reading (ppm) of every second since the first sample."""
    valid = [(s.time_s, s.co2_ppm) for s in samples if s.co2_ppm is not None]
    if not valid:
        return {}
    begin_s = min(time_s for time_s, _ in valid)
    seconds: dict[int, list[float]] = {}
    for time_s, value in valid:
        seconds.setdefault(int((time_s - begin_s) / _BIN_S), []).append(value)
    return {second: statistics.fmean(values) for second, values in seconds.items()}


def _fit(values: np.ndarray, median: np.ndarray, made_at: str) -> Calibration:
    offset_ppm, scale = float(np.median(median - values)), 1.0
    scatter_ppm = float(np.std(median - values - offset_ppm))
    if float(np.std(median)) > _SPREAD_FOR_SCALE * max(scatter_ppm, 1e-3) / math.sqrt(len(values)) and float(
        np.ptp(values)
    ) > _SPREAD_FOR_SCALE * max(scatter_ppm, 0.1):
        slope, intercept = np.polyfit(values, median, 1)
        if 0.5 <= slope <= 2.0:
            scale, offset_ppm = float(slope), float(intercept)
            scatter_ppm = float(np.std(median - scale * values - offset_ppm))
    return Calibration(
        offset_ppm=round(offset_ppm, 3),
        scale=round(scale, 5),
        scatter_ppm=round(scatter_ppm, 3),
        seconds=len(values),
        made_at=made_at,
    )


def save(path: pathlib.Path, calibrations: Mapping[str, Calibration]) -> None:
    """Write the calibrations, by drone, as JSON. `SensorError` if the file cannot be written."""
    text = msgspec.json.format(msgspec.json.encode(dict(calibrations)), indent=2)
    try:
        path.write_bytes(text + b"\n")
    except OSError as error:
        raise SensorError(f"{path}: cannot be written: {error.strerror or error}") from error


def load(path: pathlib.Path) -> dict[str, Calibration]:
    """Calibrations by drone. `SensorError` if the file is absent or holds something else."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=dict[str, Calibration])
    except OSError as error:
        raise SensorError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise SensorError(printable(f"{path}: not a calibration file: {error}")) from error
