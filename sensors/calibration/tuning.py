"""Fitting an instrument's numbers to a recording of it, by maximum likelihood.

The likelihood is that of the innovations (F. C. Schweppe, IEEE Trans. Information Theory 11(1), 1965): how
probable every reading was, given the readings before it, for the filter that flies. A recording that tells
something holds clean air and sharp edges: lift a hood off the inlet, or fly through a plume. In air that
never changes nothing is known about the lag, and the result says so by its uncertainty.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final

import msgspec
import numpy as np

from sensors.filters.co2_filter import Co2Filter, Co2FilterConfig
from sensors.instruments.samples import Sample
from sensors.instruments.sensor_error import SensorError

_LEAST_READINGS: Final = 50
_GOLDEN: Final = (math.sqrt(5.0) - 1.0) / 2.0
_SHRINKS: Final = 5
_LOOKS: Final = 11
_EDGE_S: Final = 0.3
"""Correlation time of the air's rate while tuning: a slow one would decay like a lag, and the two trade
places."""


@dataclasses.dataclass(frozen=True)
class Fitted:
    """One number: its value, and the factor within which it lies with about two chances in three."""

    value: float
    factor: float

    @property
    def known(self) -> bool:
        """Whether the recording says something about it."""
        return self.factor < 2.0


@dataclasses.dataclass(frozen=True)
class Co2Tuning:
    lag_s: Fitted
    noise_ppm: Fitted
    readings: int
    log_likelihood: float
    before: float
    """Log likelihood with the numbers that the fit began from."""


@dataclasses.dataclass(frozen=True)
class WindTuning:
    noise_mps: Fitted
    gust_sd_mps: Fitted
    gust_time_s: Fitted
    readings: int
    log_likelihood: float


def tune_co2(
    samples: Sequence[Sample], start: Co2FilterConfig, progress: Callable[[float], None] | None = None
) -> Co2Tuning:
    """Lag and noise of the CO2 instrument that made `samples`, beginning from `start`.

    `progress` is told the share that is done. `SensorError` if there are too few readings to say anything.
    """
    readings = [s for s in samples if s.co2_ppm is not None]
    if len(readings) < _LEAST_READINGS:
        raise SensorError(
            f"{len(readings)} valid CO2 readings are too few to tune by; record a minute or more"
        )

    def objective(numbers: Mapping[str, float]) -> float:
        # How lively the plume was is fitted along, and forgotten: a hood that is lifted and a flight through
        # eddies differ in it, and taken wrong it would pass for lag.
        lively = numbers["lively"]
        config = msgspec.structs.replace(
            start,
            instrument=None,
            lag_s=numbers["lag_s"],
            noise_ppm=numbers["noise_ppm"],
            plume_rate_ppmps=lively * start.plume_rate_ppmps,
            rate_per_s=lively * start.rate_per_s,
            rate_time_s=_EDGE_S,
            time_sd_s=0.0,  # on the bench no tick is late, and at a hood's edge it would pass for the noise
        )
        filter_ = Co2Filter(config)
        for sample in readings:
            filter_.step(sample.time_s, (sample,))
        # A reading that the gate turned away counts as one just outside of it: refusing must not pay.
        return filter_.log_likelihood - 0.5 * filter_.refused * start.gate_sd**2

    first = {"noise_ppm": start.noise_ppm, "lively": 1.0, "lag_s": start.lag_s}
    before = objective(first)
    best, log_likelihood = _climb(objective, first, rounds=2, progress=progress)
    fitted = {
        n: Fitted(best[n], _uncertainty(objective, best, n, log_likelihood)) for n in ("lag_s", "noise_ppm")
    }
    return Co2Tuning(
        fitted["lag_s"],
        fitted["noise_ppm"],
        len(readings),
        log_likelihood,
        before,
    )


def tune_wind(samples: Sequence[Sample], progress: Callable[[float], None] | None = None) -> WindTuning:
    """Noise of an anemometer that stands still, and strength and time of the gusts that it saw.

    The model is the wind filter's, a first-order Gauss-Markov process about a mean, one axis at a time.
    `SensorError` if there are too few readings to say anything.
    """
    pairs = [
        (s.time_s, s.wind_body_mps or s.wind_ned_mps) for s in samples if s.wind_body_mps or s.wind_ned_mps
    ]
    if len(pairs) < _LEAST_READINGS:
        raise SensorError(f"{len(pairs)} valid wind readings are too few to tune by; record a minute or more")
    pairs.sort(key=lambda p: p[0])
    times = [t for t, _ in pairs]
    table = np.array([v for _, v in pairs])[:, :2]
    series = [(table[:, axis] - table[:, axis].mean()).tolist() for axis in (0, 1)]

    def objective(numbers: Mapping[str, float]) -> float:
        return sum(_gust_likelihood(times, values, **numbers) for values in series)

    spread = max(float(table.std(axis=0).mean()), 0.05)
    first = {"noise_mps": 0.3 * spread, "gust_sd_mps": spread, "gust_time_s": 5.0}
    best, log_likelihood = _climb(objective, first, rounds=3, progress=progress)
    errors = {name: _uncertainty(objective, best, name, log_likelihood) for name in best}
    fitted = {name: Fitted(value, errors[name]) for name, value in best.items()}
    return WindTuning(
        fitted["noise_mps"], fitted["gust_sd_mps"], fitted["gust_time_s"], len(pairs), log_likelihood
    )


def _gust_likelihood(
    times: Sequence[float], values: Sequence[float], noise_mps: float, gust_sd_mps: float, gust_time_s: float
) -> float:
    """Log likelihood of readings that are a gust (Gauss-Markov) plus white noise."""
    noise_var, gust_var = noise_mps**2, gust_sd_mps**2
    x, p, then_s, total = 0.0, gust_var, times[0], 0.0
    for time_s, value in zip(times, values, strict=True):
        decay = math.exp(-(time_s - then_s) / gust_time_s)
        x, p, then_s = x * decay, p * decay * decay + gust_var * (1.0 - decay * decay), time_s
        s = p + noise_var
        y = value - x
        total -= 0.5 * (y * y / s + math.log(2.0 * math.pi * s))
        gain = p / s
        x, p = x + gain * y, p * (1.0 - gain)
    return total


def _climb(
    objective: Callable[[Mapping[str, float]], float],
    first: Mapping[str, float],
    rounds: int,
    progress: Callable[[float], None] | None,
) -> tuple[dict[str, float], float]:
    """The largest objective, one number after the other, along its logarithm."""
    best, value = dict(first), -math.inf
    spans = dict.fromkeys(best, math.log(12.0))
    done, steps = 0, rounds * len(best)
    for _ in range(rounds):
        for name in best:
            centre = math.log(best[name])

            def along(position: float, name: str = name) -> float:
                return objective({**best, name: math.exp(position)})

            position, value = _highest(along, centre - spans[name], centre + spans[name])
            best[name] = math.exp(position)
            spans[name] = max(0.3 * spans[name], 0.05)
            done += 1
            if progress is not None:
                progress(done / steps)
    return best, value


def _highest(function: Callable[[float], float], low: float, high: float) -> tuple[float, float]:
    """Where a function is largest between `low` and `high`: it may have several humps, so first a coarse
    look."""
    places = [low + (high - low) * i / (_LOOKS - 1) for i in range(_LOOKS)]
    values = [function(p) for p in places]
    top = max(range(_LOOKS), key=values.__getitem__)
    return _golden(function, places[max(top - 1, 0)], places[min(top + 1, _LOOKS - 1)])


def _golden(function: Callable[[float], float], low: float, high: float) -> tuple[float, float]:
    """Where a function of one hump is largest between `low` and `high`, and how large."""
    left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_left, at_right = function(left), function(right)
    for _ in range(_SHRINKS):
        if at_left > at_right:
            high, right, at_right = right, left, at_left
            left = high - _GOLDEN * (high - low)
            at_left = function(left)
        else:
            low, left, at_left = left, right, at_right
            right = low + _GOLDEN * (high - low)
            at_right = function(right)
    return (left, at_left) if at_left > at_right else (right, at_right)


def _uncertainty(
    objective: Callable[[Mapping[str, float]], float], best: Mapping[str, float], name: str, top: float
) -> float:
    """The factor of one standard deviation, from the curvature of the likelihood in the number's
    logarithm."""
    width = 0.15
    beside = [objective({**best, name: best[name] * math.exp(side * width)}) for side in (-1.0, 1.0)]
    curvature = (2.0 * top - sum(beside)) / width**2
    return math.exp(min(1.0 / math.sqrt(curvature), 3.0)) if curvature > 0.0 else math.exp(3.0)
