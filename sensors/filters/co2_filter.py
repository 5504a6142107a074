"""From CO2 readings to the excess over the background, with its variance, its age and how far to trust it.

A Kalman filter over the four states of `sensors.filters.co2_model`. What a plain one does not do is done around it:
the background is learned in clean air, the process noise follows how lively the air is, single wild readings
wait for a second that agrees, late readings are worked in where they belong, and every silence, zero,
saturation and repetition ends in a verdict with its reason.
"""

from __future__ import annotations

import collections
import math
from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np

from sensors.filters.co2_bank import Snapshot, TwoModes
from sensors.filters.co2_model import (
    BACKGROUND,
    EXCESS,
    RATE,
    READING,
    STATES,
    Co2FilterConfig,
    shared_model,
)
from sensors.filters.health import Health
from sensors.instruments.samples import InstrumentState, Quantity, Sample

__all__ = ["Co2Estimate", "Co2Filter", "Co2FilterConfig"]

_WILD_MOST: Final = 6
_CLEAN_PERIOD_S: Final = 0.5
_CLEAN_HOLD_S: Final = 20.0
_CLEAN_TIME_S: Final = 60.0


class Co2Estimate(msgspec.Struct, frozen=True):
    excess_co2_ppm: float
    """Over the background, at the inlet, now: the instrument's lag is undone."""
    variance_ppm2: float
    rate_ppmps: float
    background_co2_ppm: float
    background_variance_ppm2: float
    age_s: float
    """Since the newest reading that told something."""
    health: Health
    reason: str
    """Why the health is not good; empty where it is."""
    co2_ppm: float
    """The newest valid raw reading."""


class _Step(msgspec.Struct, frozen=True):
    """One update as it was made, so that a late reading can be put before it."""

    time_s: float
    before: Snapshot
    state_time_s: float
    value_ppm: float
    variance_ppm2: float
    clean: bool = False
    """It was the statement that the air is clean, not a reading."""


class Co2Filter:
    """The filter of one CO2 instrument. Give `step` every sample of the tick, whoever made it; it takes its
    own."""

    def __init__(self, config: Co2FilterConfig | None = None) -> None:
        self.config = config or Co2FilterConfig()
        self._model = shared_model(self.config)
        self._bank = TwoModes(self._model)
        self._now_s: float | None = None
        self._time_s: float | None = None
        """Time of the filter's state; None: it has none."""
        self._background: tuple[float, float, float] | None = None
        """Mean (ppm) and variance of the background, once learned, and when that was."""
        self._heard_s = -math.inf
        self._raw_ppm = 0.0
        self._news_s = -math.inf
        self._same_since_s = -math.inf
        self._trouble: Sample | None = None
        self._saturated_s = -math.inf
        self._zeroed = False
        self._held: tuple[float, float] | None = None
        self._verdicts: collections.deque[bool] = collections.deque(maxlen=30)
        self._below_s = -math.inf
        self._too_high = False
        """The background that was learned or given has turned out too high; it is being learned anew."""
        self._clean_until_s = -math.inf
        self._clean_since_s: float | None = None
        self._clean_last_s = -math.inf
        self._steps: collections.deque[_Step] = collections.deque(maxlen=40)
        self._told: tuple[Health, str] = (Health.BAD, "no reading yet")
        self.log_likelihood = 0.0
        """Of all readings so far under the filter's own predictions: what tuning makes as large as it can."""
        self.refused = 0
        """Readings that the innovation gate has turned away so far."""

    @property
    def verdict(self) -> tuple[Health, str]:
        """Health and its reason after the last step; there also while `step` returns None."""
        return self._told

    def step(self, now_s: float, samples: Sequence[Sample]) -> Co2Estimate | None:
        """The estimate at `now_s` with these samples in it; None while there is no number at all.

        An estimate whose health is bad keeps its last number for display; nothing may be decided on it.
        """
        if self._now_s is not None and now_s < self._now_s:
            self._restart()  # a clock set back: ages and lags mean nothing any more
        self._now_s = now_s
        mine = [s for s in samples if self._is_mine(s)]
        if len(mine) > 1:
            mine.sort(key=lambda s: s.time_s)
        for sample in mine:
            self._take(sample, now_s)
        return self._estimate(now_s)

    def _is_mine(self, sample: Sample) -> bool:
        if self.config.instrument is not None:
            return sample.instrument == self.config.instrument
        return sample.co2_ppm is not None or sample.quantity is Quantity.CO2

    def _take(self, sample: Sample, now_s: float) -> None:
        time_s = min(sample.time_s, now_s)
        value_ppm = sample.co2_ppm
        if sample.state is InstrumentState.MEASURING and value_ppm is not None:
            if not (math.isfinite(value_ppm) and math.isfinite(time_s) and 0.0 <= value_ppm < 1.0e6):
                return
            self._trouble = None
            self._measure(time_s, value_ppm)
        elif sample.co2_at_least_ppm is not None:
            self._trouble = sample
            self._saturate(time_s, sample.co2_at_least_ppm)
        else:
            self._trouble = sample
            self._zeroed = self._zeroed or sample.state is InstrumentState.ZEROING

    # -- readings ------------------------------------------------------------------------------------------

    def _measure(self, time_s: float, value_ppm: float) -> None:
        config = self.config
        repeated = value_ppm == self._raw_ppm and self._news_s > -math.inf
        if not repeated:
            self._same_since_s = time_s
        if self._time_s is not None and time_s < self._time_s:
            self._work_in_late(time_s, value_ppm)
            return
        self._raw_ppm, self._heard_s = value_ppm, time_s
        # An instrument that is asked more often than it measures says the same again: that is no second
        # reading. Where the rounding is coarse against the noise, the same number twice is two readings.
        if repeated and config.resolution_ppm < 0.1 * config.noise_ppm:
            return
        if self._time_s is None or time_s - self._time_s > config.lost_s:
            self._begin(time_s, value_ppm)
        elif self._background_is_too_high(time_s, value_ppm):
            self._background, self._too_high = None, True
            self._begin(time_s, value_ppm)
        else:
            self._update(time_s, value_ppm)
        self._news_s = time_s
        self._learn_background(time_s)
        if time_s >= self._clean_until_s:
            self._too_high = False
            variance = self._bank.p[BACKGROUND][BACKGROUND]
            self._background = (self._bank.x[BACKGROUND], variance, time_s)

    def _begin(self, time_s: float, value_ppm: float) -> None:
        """Start with this reading; the background is kept from before, given, or taken from it."""
        config = self.config
        noise_var = config.reading_variance_ppm2(value_ppm)
        known = self._background_now(time_s)
        if known is not None:
            background_ppm, background_var = known
            excess_ppm = value_ppm - background_ppm
            excess_var = (20.0 + 0.5 * abs(excess_ppm)) ** 2
            rate_var = config.rate_floor_ppmps**2 + (config.rate_per_s * excess_ppm) ** 2
            # The reading trails the air by up to a lag's worth of its rate, and shares the errors of both its
            # parts.
            reading_var = excess_var + background_var + config.lag_s**2 * rate_var
            shared_var, opposed_var = background_var, 0.0
        else:
            # In clean air the reading is the background but for its noise and what clean air departs by; the
            # three errors of excess, background and reading are two independent ones.
            self._clean_until_s = time_s + config.clean_start_s
            background_ppm, excess_ppm = value_ppm, 0.0
            excess_var, rate_var = (3.0 * config.clean_sd_ppm) ** 2, config.rate_floor_ppmps**2
            background_var, reading_var = excess_var + noise_var, noise_var
            shared_var, opposed_var = noise_var, -excess_var
        self._zeroed = False
        p = np.zeros((STATES, STATES))
        p[EXCESS, EXCESS], p[RATE, RATE], p[BACKGROUND, BACKGROUND] = excess_var, rate_var, background_var
        p[READING, READING] = reading_var
        p[EXCESS, BACKGROUND] = p[BACKGROUND, EXCESS] = opposed_var
        p[READING, BACKGROUND] = p[BACKGROUND, READING] = shared_var
        p[READING, EXCESS] = p[EXCESS, READING] = excess_var + opposed_var
        x = np.array([excess_ppm, 0.0, background_ppm, value_ppm])
        self._bank.begin(x, p, 0.5 if known is not None else 0.1)
        self._time_s, self._held = time_s, None
        self._steps.clear()
        if known is not None:
            self._correct(value_ppm, noise_var)

    def _background_is_too_high(self, time_s: float, value_ppm: float) -> bool:
        """Whether this is the second reading in a row that is far below the background.

        A reading is an average of the air before it, and air has no less than the background: the drone began
        inside a plume. No correction of the filter's state is enough then; the lag would make swings of it.
        """
        x, p = self._bank.x, self._bank.p
        variance = self.config.reading_variance_ppm2(value_ppm) + max(p[BACKGROUND][BACKGROUND], 0.0)
        least_ppm = x[BACKGROUND] - self.config.gate_sd * (math.sqrt(variance) + self.config.clean_sd_ppm)
        before_s, self._below_s = self._below_s, time_s if value_ppm < least_ppm else -math.inf
        return self._below_s - before_s <= self.config.lost_s

    def _background_now(self, time_s: float) -> tuple[float, float] | None:
        """The background's mean and variance as known from before or as given; None: it has to be learned."""
        config = self.config
        if self._background is None:
            if config.background_co2_ppm is None or self._too_high:
                return None
            return config.background_co2_ppm, config.background_sd_ppm**2
        mean_ppm, variance, known_s = self._background
        variance += max(time_s - known_s, 0.0) * config.drift_ppm_per_sqrt_hour**2 / 3600.0
        return mean_ppm, variance + (config.zero_step_ppm**2 if self._zeroed else 0.0)

    def _update(self, time_s: float, value_ppm: float) -> None:
        before = (self._bank.snapshot(), self._time_s)
        variance = self._reading_variance(value_ppm)
        self._predict_to(time_s)
        innovation, nis = self._bank.innovation(value_ppm, variance, READING)
        if nis > self.config.gate_sd**2:
            if not self._confirmed(time_s, innovation):
                self._verdicts.append(False)
                self.refused += 1
                return
        else:
            self._held = None
        self._verdicts.append(True)
        self._remember(time_s, before, value_ppm, variance)
        self._correct(value_ppm, variance)

    def _reading_variance(self, value_ppm: float) -> float:
        """Of the next reading, as steep as the instrument's response is now."""
        x = self._bank.x
        slope_ppmps = (x[EXCESS] + x[BACKGROUND] - x[READING]) / self.config.lag_s
        return self.config.reading_variance_ppm2(value_ppm, slope_ppmps)

    def _confirmed(self, time_s: float, innovation_ppm: float) -> bool:
        """Whether this wild reading is the second in a row on the same side: a plume's edge and not a
        spark."""
        held, self._held = self._held, (time_s, innovation_ppm)
        if held is None or time_s - held[0] > 1.0 or held[1] * innovation_ppm <= 0.0:
            return False
        self._held = None
        # The reading moved by `innovation` although it trails the air: the air moved by a multiple of that.
        moved_ppm = innovation_ppm * max(1.0, self.config.lag_s / max(time_s - held[0], 0.05))
        extra = np.zeros(STATES)
        extra[EXCESS], extra[RATE] = moved_ppm**2, (moved_ppm / self.config.rate_time_s) ** 2
        extra[READING] = innovation_ppm**2
        self._bank.widen(extra)
        return True

    def _work_in_late(self, time_s: float, value_ppm: float) -> None:
        """Put a reading that comes out of order where it belongs, and make the later updates again after
        it."""
        later = [s for s in self._steps if s.time_s > time_s]
        if not later or self._time_s is None or self._time_s - time_s > self.config.late_s:
            return
        first = later[0]
        if first.state_time_s > time_s:
            return  # older than the beginning of what is remembered
        end_s = self._time_s
        for _ in later:
            self._steps.pop()
        self._bank.restore(first.before)
        self._time_s = first.state_time_s
        again = [(time_s, value_ppm, self._reading_variance(value_ppm), False)]
        again += [(s.time_s, s.value_ppm, s.variance_ppm2, s.clean) for s in later]
        for moment_s, value, variance, clean in again:
            before = (self._bank.snapshot(), self._time_s)
            self._predict_to(moment_s)
            self._remember(moment_s, before, value, variance, clean)
            if clean:
                self._state_clean(variance)
            else:
                self._correct(value, variance)
        self._predict_to(end_s)

    def _remember(
        self,
        time_s: float,
        before: tuple[Snapshot, float | None],
        value_ppm: float,
        variance_ppm2: float,
        clean: bool = False,
    ) -> None:
        snapshot, state_time_s = before
        if state_time_s is not None:
            self._steps.append(_Step(time_s, snapshot, state_time_s, value_ppm, variance_ppm2, clean))

    def _correct(self, value_ppm: float, variance_ppm2: float) -> None:
        self.log_likelihood += self._bank.correct(value_ppm, variance_ppm2, READING)

    def _saturate(self, time_s: float, limit_ppm: float) -> None:
        """A reading at the end of the range: the air holds at least that much."""
        if self._time_s is None or time_s - self._time_s > self.config.lost_s:
            self._begin(time_s, limit_ppm)
            return
        if time_s < self._time_s:
            return
        self._predict_to(time_s)
        if self._bank.x[READING] < limit_ppm:
            self._correct(limit_ppm, (0.02 * limit_ppm) ** 2)
        self._saturated_s = self._news_s = self._heard_s = time_s

    # -- background ----------------------------------------------------------------------------------------

    def _learn_background(self, time_s: float) -> None:
        """Clean air is where the excess is nothing: at the start, and wherever the readings allow no other
        view."""
        config = self.config
        since_s = time_s - self._clean_last_s
        if 0.0 <= since_s < _CLEAN_PERIOD_S:
            return
        x, p = self._bank.x, self._bank.p
        excess_ppm, excess_sd = x[EXCESS], math.sqrt(max(p[EXCESS][EXCESS], 0.0))
        allowance_ppm = 2.0 * (math.sqrt(max(p[BACKGROUND][BACKGROUND], 0.0)) + config.clean_sd_ppm)
        calm = abs(x[RATE]) < 3.0 * config.rate_floor_ppmps
        if not (calm and abs(excess_ppm) < allowance_ppm):
            self._clean_since_s = None
        elif self._clean_since_s is None:
            self._clean_since_s = time_s
        if time_s < self._clean_until_s:
            # The whole clean start is one statement about the air, however many readings it has.
            weight = config.clean_start_s / _CLEAN_PERIOD_S
        elif excess_ppm < -3.0 * excess_sd - config.clean_sd_ppm:
            weight = 1.0  # less than nothing is impossible: the background is lower than thought
        elif self._clean_since_s is not None and time_s - self._clean_since_s > _CLEAN_HOLD_S:
            weight = _CLEAN_TIME_S / _CLEAN_PERIOD_S
        else:
            return
        self._clean_last_s = time_s
        variance = config.clean_sd_ppm**2 * weight
        self._remember(time_s, (self._bank.snapshot(), self._time_s), 0.0, variance, clean=True)
        self._state_clean(variance)

    def _state_clean(self, variance_ppm2: float) -> None:
        # It is a statement about the background: how lively the air is must not follow from it.
        self._bank.correct(0.0, variance_ppm2, EXCESS, judge=False)

    # -- time and output -----------------------------------------------------------------------------------

    def _plume_rate_variance(self) -> float:
        """Of the concentration's rate in a plume, (ppm/s)^2.

        A plume's edges are as steep as its core is high, and where it is steep it goes on being so.
        """
        config, x = self.config, self._bank.x
        scale_ppmps = config.rate_per_s * max(x[EXCESS], 0.0)
        return config.plume_rate_ppmps**2 + scale_ppmps**2 + x[RATE] ** 2

    def _predict_to(self, time_s: float) -> None:
        if self._time_s is not None and time_s > self._time_s:
            self._bank.predict(time_s - self._time_s, self._plume_rate_variance())
            self._time_s = time_s

    def _restart(self) -> None:
        if self._background is not None:
            self._background = (*self._background[:2], math.inf)  # how long ago is not known
        self._time_s = self._held = self._clean_since_s = None
        self._heard_s = self._news_s = self._same_since_s = self._saturated_s = -math.inf
        self._clean_until_s = self._clean_last_s = -math.inf
        self._steps.clear()

    def _estimate(self, now_s: float) -> Co2Estimate | None:
        self._told = self._judge(now_s)
        if self._time_s is None:
            return None
        x, p = self._bank.x, self._bank.p
        excess_ppm, rate_ppmps, excess_var = x[EXCESS], x[RATE], p[EXCESS][EXCESS]
        background_var = p[BACKGROUND][BACKGROUND]
        if now_s - self._time_s > 5e-4:
            # The mixture carried on to now, as far as it is told: excess by its rate, everything else stays.
            ahead, chance = self._model.ahead(now_s - self._time_s), self._bank.plume_chance
            floor_var = self.config.rate_floor_ppmps**2
            rate_var = floor_var + chance * (self._plume_rate_variance() - floor_var)
            excess_ppm += ahead.coast_s * rate_ppmps
            excess_var += ahead.coast_s * (2.0 * p[EXCESS][RATE] + ahead.coast_s * p[RATE][RATE])
            excess_var += ahead.excess_noise * rate_var
            background_var += ahead.background_noise
            rate_ppmps *= ahead.rate_kept
        health, reason = self._told
        return Co2Estimate(
            excess_co2_ppm=excess_ppm,
            variance_ppm2=excess_var,
            rate_ppmps=rate_ppmps,
            background_co2_ppm=x[BACKGROUND],
            background_variance_ppm2=background_var,
            age_s=now_s - self._news_s,
            health=health,
            reason=reason,
            co2_ppm=self._raw_ppm,
        )

    def _judge(self, now_s: float) -> tuple[Health, str]:
        config = self.config
        trouble = (self._trouble.reason or self._trouble.state.value) if self._trouble is not None else ""
        if self._time_s is None:
            return Health.BAD, trouble or "no reading yet"
        if self._too_high:
            return Health.BAD, trouble or (
                f"began inside a plume: learning the background until {config.clean_start_s:g} s of clean air"
            )
        age_s = now_s - self._news_s
        same_s = self._heard_s - self._same_since_s
        if same_s > config.stuck_s and not trouble:
            return Health.BAD, f"stuck at {self._raw_ppm:g} ppm for {same_s:.0f} s"
        if now_s - self._heard_s > config.lost_s:
            return Health.BAD, trouble or self._silence(now_s)
        if age_s > config.fresh_s:
            if same_s > config.fresh_s:
                return Health.DEGRADED, f"the same reading for {same_s:.1f} s"
            return Health.DEGRADED, trouble or self._silence(now_s)
        if now_s - self._saturated_s <= config.fresh_s:
            return Health.DEGRADED, trouble or "saturated"
        if now_s < self._clean_until_s:
            return Health.DEGRADED, f"learning the background until {config.clean_start_s:g} s of clean air"
        wild = self._verdicts.count(False)
        if wild > _WILD_MOST:
            return Health.DEGRADED, f"{wild} of the last {len(self._verdicts)} readings wild"
        return Health.GOOD, ""

    def _silence(self, now_s: float) -> str:
        return f"no reading for {now_s - self._heard_s:.1f} s"
