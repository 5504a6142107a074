"""The air and the instrument as the CO2 filter sees them: four states, linear in time.

State, in this order: excess concentration c (ppm), its rate r (ppm/s), the background b (ppm) and the
instrument's reading m (ppm), which trails the air:

    c' = r,   r' = -r / T + w_r,   b' = w_b,   m' = (c + b - m) / lag

The rate is Singer's exponentially correlated manoeuvre (R. A. Singer, IEEE Trans. AES-6(4), 1970, eq. 3, one
order lower), the lag is the textbook first-order instrument. Both noises are white; the step from continuous
to discrete time is van Loan's (IEEE Trans. AC-23(3), 1978).
"""

from __future__ import annotations

import functools
import math
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

EXCESS: Final = 0
RATE: Final = 1
BACKGROUND: Final = 2
READING: Final = 3
STATES: Final = 4

CALM: Final = slice(0, STATES)
PLUME: Final = slice(STATES, 2 * STATES)
"""Where each of the two filters has its states (`sensors.filters.co2_bank`)."""


class Co2FilterConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The instrument's and the plume's numbers. `flightstack sensors tune` fits the first four from a
    recording."""

    lag_s: float = 1.5
    """Time constant of the instrument's first-order response."""
    noise_ppm: float = 1.0
    """Standard deviation of one reading in clean air."""
    noise_fraction: float = 0.002
    """What a reading's standard deviation grows by with the reading itself."""
    resolution_ppm: float = 0.01
    time_sd_s: float = 0.03
    """How well it is known when a reading was made: it is stamped with the tick in which it was received."""
    drift_ppm_per_sqrt_hour: float = 5.0
    """Random walk of background and instrument together: standard deviation after an hour."""
    background_co2_ppm: float | None = None
    """The background where it is known; None: the drone starts in clean air and learns it there."""
    background_sd_ppm: float = 3.0
    """How well a given background is known."""
    clean_start_s: float = 10.0
    """How long the first readings are taken for clean air."""
    clean_sd_ppm: float = 1.0
    """What clean air departs from the background by."""
    zero_step_ppm: float = 1.0
    """Standard deviation of the step that a zero makes in an instrument's offset."""
    rate_time_s: float = 2.0
    """Correlation time T of the concentration's rate along the drone's way."""
    rate_floor_ppmps: float = 1.0
    """Standard deviation of the rate in clean air."""
    plume_rate_ppmps: float = 60.0
    """The same in a plume, at least."""
    rate_per_s: float = 0.7
    """What the rate's standard deviation in a plume grows by with the concentration: edges scale with the
    core."""
    calm_time_s: float = 80.0
    """How long the air stays clean on average."""
    plume_time_s: float = 5.0
    """How long a plume lasts on average, as the drone flies through it."""
    gate_sd: float = 6.0
    """A reading further from its prediction than this many standard deviations waits for a second that
    agrees."""
    fresh_s: float = 1.0
    """Age of the newest reading up to which an estimate is good."""
    lost_s: float = 3.0
    """Age above which it is bad; the filter then starts anew, with the background it had."""
    stuck_s: float = 10.0
    """A reading that repeats itself to the last digit for this long is not one."""
    late_s: float = 1.0
    """Readings that come out of order are worked in up to this age."""
    instrument: str | None = None
    """Take only the samples of the instrument of this name; None: of any CO2 instrument."""

    def __post_init__(self) -> None:
        for name in (
            "lag_s",
            "noise_ppm",
            "rate_time_s",
            "rate_floor_ppmps",
            "gate_sd",
            "lost_s",
            "clean_sd_ppm",
        ):
            if not 0.0 < getattr(self, name) < float("inf"):
                raise ValueError(f"{name} {getattr(self, name)} is not a positive number")

    def reading_variance_ppm2(self, reading_ppm: float, slope_ppmps: float = 0.0) -> float:
        """Variance of one reading: noise, noise that grows with the reading, rounding, and what the reading
        moves by (`slope_ppmps`) in the time that is not known.

        Undoing the lag multiplies a reading's change by fifteen at 10 Hz: without the last part, a tick that
        comes late at a plume's edge passes for twice the concentration.
        """
        grown_ppm, moved_ppm = self.noise_fraction * reading_ppm, self.time_sd_s * slope_ppmps
        return (
            self.noise_ppm**2 + grown_ppm * grown_ppm + moved_ppm * moved_ppm + self.resolution_ppm**2 / 12.0
        )


class Ahead(NamedTuple):
    """A step in time of both filters' states, calm air's first (8 x 8, block diagonal), and what it adds of noise.

    The noise is `noise + plume_rate_variance * plume_rate_noise`, so that the filter can follow how lively the air
    is without a new exponential of a matrix every tick.
    """

    transition: Array
    noise: Array
    """Of calm air whole, of a plume what its rate does not add."""
    plume_rate_noise: Array
    coast_s: float
    """What the excess gains per rate."""
    rate_kept: float
    """Share of the rate that is left."""
    excess_noise: float
    """What a rate of variance 1 adds to the excess' variance."""
    background_noise: float
    """What the background's variance grows by."""


class Co2Model:
    """Transition matrices of the state over any time, kept for the steps that recur."""

    def __init__(self, config: Co2FilterConfig) -> None:
        self.config = config
        self._a = np.zeros((STATES, STATES))
        self._a[EXCESS, RATE] = 1.0
        self._a[RATE, RATE] = -1.0 / config.rate_time_s
        self._a[READING, [EXCESS, BACKGROUND, READING]] = np.array([1.0, 1.0, -1.0]) / config.lag_s
        self._kept: dict[int, Ahead] = {}

    def ahead(self, dt_s: float) -> Ahead:
        """The step over `dt_s`, to the millisecond."""
        key = round(dt_s * 1000.0)
        found = self._kept.get(key)
        if found is None:
            if len(self._kept) > 2000:
                self._kept.clear()
            found = self._kept[key] = self._discrete(key / 1000.0)
        return found

    def _discrete(self, dt_s: float) -> Ahead:
        # Imported late: it costs a second and 95 MB, and only a process that filters shall pay.
        from filterpy.common import van_loan_discretization

        config = self.config
        rate = np.zeros((STATES, 1))
        rate[RATE, 0] = np.sqrt(2.0 / config.rate_time_s)  # for a stationary rate of variance 1
        background = np.zeros((STATES, 1))
        background[BACKGROUND, 0] = config.drift_ppm_per_sqrt_hour / 60.0
        # The exponential loses its digits where the time is long against the lag: short steps, doubled.
        doublings = max(0, math.ceil(math.log2(max(dt_s, 1e-3) / min(0.5, config.lag_s))))
        short_s = dt_s / 2**doublings
        transition, rate_noise = van_loan_discretization(self._a, rate, short_s)
        _, background_noise = van_loan_discretization(self._a, background, short_s)
        for _ in range(doublings):
            rate_noise = transition @ rate_noise @ transition.T + rate_noise
            background_noise = transition @ background_noise @ transition.T + background_noise
            transition = transition @ transition
        rate_noise, background_noise = _symmetric(rate_noise), _symmetric(background_noise)
        calm_noise = rate_noise * config.rate_floor_ppmps**2 + background_noise
        return Ahead(
            _both(transition, transition),
            _both(calm_noise, background_noise),
            _both(np.zeros((STATES, STATES)), rate_noise),
            coast_s=float(transition[EXCESS, RATE]),
            rate_kept=float(transition[RATE, RATE]),
            excess_noise=float(rate_noise[EXCESS, EXCESS]),
            background_noise=float(background_noise[BACKGROUND, BACKGROUND]),
        )


@functools.lru_cache(maxsize=16)
def shared_model(config: Co2FilterConfig) -> Co2Model:
    """One model for all filters of these settings: exponentials of matrices are the dearest part of a start."""
    return Co2Model(config)


def _both(calm: Array, plume: Array) -> Array:
    both = np.zeros((2 * STATES, 2 * STATES))
    both[CALM, CALM], both[PLUME, PLUME] = calm, plume
    return both


def _symmetric(matrix: Any) -> Array:
    return np.asarray(0.5 * (matrix + matrix.T), dtype=np.float64)
