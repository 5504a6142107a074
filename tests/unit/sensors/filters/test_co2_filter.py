"""The CO2 filter, case by case: what it knows, what it refuses, and what it says about it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sensors.filters.co2_filter import Co2Estimate, Co2Filter, Co2FilterConfig
from sensors.filters.filter_settings import co2_filter_config
from sensors.filters.health import Health
from sensors.instruments.samples import InstrumentState, Quantity, Sample

TICK_S = 0.1


def reading(time_s: float, ppm: float, name: str = "co2") -> Sample:
    return Sample(time_s, name, InstrumentState.MEASURING, co2_ppm=ppm, quantity=Quantity.CO2)


def trouble(time_s: float, state: InstrumentState, reason: str) -> Sample:
    return Sample(time_s, "co2", state, reason=reason, quantity=Quantity.CO2)


class Bench:
    """A filter, an instrument with a lag of 1.5 s and 1 ppm of noise, and a clock."""

    def __init__(self, config: Co2FilterConfig | None = None, background_ppm: float = 420.0) -> None:
        self.filter = Co2Filter(config)
        self.rng = np.random.default_rng(11)
        self.now_s = 0.0
        self.air_ppm = self.cell_ppm = background_ppm
        self.last: Co2Estimate | None = None

    def step(self, *others: Sample, read: bool = True) -> Co2Estimate | None:
        self.now_s += TICK_S
        self.cell_ppm += (self.air_ppm - self.cell_ppm) * -math.expm1(-TICK_S / 1.5)
        own = [reading(self.now_s, self.cell_ppm + float(self.rng.normal()))] if read else []
        self.last = self.filter.step(self.now_s, [*own, *others])
        return self.last

    def run(self, seconds: float, *, read: bool = True) -> Co2Estimate:
        for _ in range(round(seconds / TICK_S)):
            self.step(read=read)
        assert self.last is not None
        return self.last


def test_nothing_before_the_first_reading_but_a_reason() -> None:
    filter_ = Co2Filter()
    assert filter_.step(1.0, []) is None
    assert filter_.verdict == (Health.BAD, "no reading yet")
    assert filter_.step(1.1, [trouble(1.1, InstrumentState.WARMING, "warming up, 31.0 C")]) is None
    assert filter_.verdict == (Health.BAD, "warming up, 31.0 C")


def test_background_is_learned_in_clean_air() -> None:
    bench = Bench(background_ppm=433.0)
    first = bench.run(2.0)
    assert (first.health, "background" in first.reason) == (Health.DEGRADED, True)
    later = bench.run(20.0)
    assert later.health is Health.GOOD
    assert later.background_co2_ppm == pytest.approx(433.0, abs=2.0)
    assert abs(later.excess_co2_ppm) < 3.0
    assert 0.5 < math.sqrt(later.variance_ppm2) < 4.0


def test_a_given_background_holds_inside_a_plume() -> None:
    bench = Bench(Co2FilterConfig(background_co2_ppm=420.0), background_ppm=520.0)
    estimate = bench.run(5.0)
    assert estimate.health is Health.GOOD
    assert estimate.excess_co2_ppm == pytest.approx(100.0, abs=8.0)


def test_a_start_in_the_plume_is_mended_when_the_reading_falls_below() -> None:
    bench = Bench(background_ppm=460.0)
    bench.run(20.0)
    bench.air_ppm = 420.0
    estimate = bench.run(60.0)
    assert estimate.background_co2_ppm == pytest.approx(420.0, abs=4.0)
    assert abs(estimate.excess_co2_ppm) < 4.0


def test_a_slow_drift_is_followed_and_a_plume_is_not_swallowed() -> None:
    bench = Bench()
    bench.run(20.0)
    for _ in range(6000):
        bench.air_ppm += 6.0 / 6000
        bench.step()
    assert bench.last is not None
    assert bench.last.background_co2_ppm == pytest.approx(426.0, abs=3.0)
    bench.air_ppm += 60.0
    assert bench.run(120.0).excess_co2_ppm == pytest.approx(60.0, abs=8.0)


def test_the_estimate_leads_the_reading_at_an_edge() -> None:
    bench = Bench()
    bench.run(20.0)
    bench.air_ppm = 720.0
    estimate = bench.run(1.5)
    assert bench.cell_ppm - 420.0 < 200.0
    assert estimate.excess_co2_ppm == pytest.approx(300.0, abs=60.0)
    assert bench.run(3.0).excess_co2_ppm == pytest.approx(300.0, abs=15.0)


def test_late_ticks_do_not_pass_for_a_higher_plume() -> None:
    """A narrow plume of 5,000 ppm, each reading up to 0.1 s older than its stamp: undoing the lag multiplies
    that error."""
    rng = np.random.default_rng(3)
    filter_, fine_s, cells_ppm, cell_ppm, highest_ppm = Co2Filter(), 0.01, [], 420.0, 0.0
    for i in range(3000):
        excess_ppm = 5000.0 * math.exp(-0.5 * ((fine_s * i - 20.0) / 1.0) ** 2)
        cell_ppm += (420.0 + excess_ppm - cell_ppm) * -math.expm1(-fine_s / 1.5)
        cells_ppm.append(cell_ppm)
    squares = []
    for i in range(10, 3000, 10):
        now_s, value_ppm = fine_s * i, cells_ppm[i - int(rng.integers(0, 11))]
        value_ppm += math.hypot(1.0, 0.002 * value_ppm) * float(rng.normal())
        estimate = filter_.step(now_s, [reading(now_s, value_ppm)])
        assert estimate is not None
        highest_ppm = max(highest_ppm, estimate.excess_co2_ppm)
        truth_ppm = 5000.0 * math.exp(-0.5 * ((now_s - 20.0) / 1.0) ** 2)
        if truth_ppm > 500.0:
            squares.append((estimate.excess_co2_ppm - truth_ppm) ** 2 / estimate.variance_ppm2)
    assert highest_ppm < 6000.0
    assert np.mean(squares) < 5.0


@pytest.mark.parametrize("inside_s", [0.0, 20.0])
@pytest.mark.parametrize("given_ppm", [None, 600.0])
def test_a_drone_that_began_inside_a_plume_learns_the_background_outside(
    inside_s: float, given_ppm: float | None
) -> None:
    bench = Bench(Co2FilterConfig(background_co2_ppm=given_ppm))
    bench.cell_ppm = bench.air_ppm = 1000.0
    bench.step()
    if inside_s:
        bench.run(inside_s)
    bench.air_ppm, told = 420.0, []
    for _ in range(150):
        estimate = bench.step()
        assert estimate is not None
        told.append((estimate.health, estimate.reason, estimate.excess_co2_ppm))
    bad = [t for t in told if t[0] is Health.BAD]
    assert "began inside a plume" in bad[-1][1]
    assert sum(abs(excess_ppm) > 600.0 for health, _, excess_ppm in told if health is not Health.BAD) < 5
    assert bench.run(10.0).health is Health.GOOD
    assert bench.run(1.0).background_co2_ppm == pytest.approx(420.0, abs=6.0)
    assert bench.run(1.0).excess_co2_ppm == pytest.approx(0.0, abs=6.0)


def test_one_spark_is_refused_and_two_are_an_edge() -> None:
    bench = Bench()
    bench.run(20.0)
    bench.step(read=False)
    sparked = bench.filter.step(bench.now_s, [reading(bench.now_s, 900.0)])
    assert sparked is not None
    assert abs(sparked.excess_co2_ppm) < 5.0
    assert bench.run(1.0).excess_co2_ppm == pytest.approx(0.0, abs=5.0)
    bench.cell_ppm = bench.air_ppm = 900.0  # the instrument itself jumps: a faster one than believed
    assert bench.run(2.0).excess_co2_ppm == pytest.approx(480.0, abs=30.0)


def test_many_sparks_are_told() -> None:
    bench = Bench()
    bench.run(20.0)
    for tick in range(30):
        bench.step()
        if tick % 3 == 0:
            bench.now_s += 0.01
            bench.last = bench.filter.step(bench.now_s, [reading(bench.now_s, 3000.0)])
    assert bench.last is not None
    assert (bench.last.health, "wild" in bench.last.reason) == (Health.DEGRADED, True)
    assert abs(bench.last.excess_co2_ppm) < 10.0


@pytest.mark.parametrize(
    ("state", "reason"),
    [
        (InstrumentState.SILENT, "/dev/ttysba5: unplugged"),
        (InstrumentState.ZEROING, "zeroing 3 of 25"),
        (InstrumentState.ERROR, "too hot"),
    ],
)
def test_trouble_ages_the_estimate_and_says_why(state: InstrumentState, reason: str) -> None:
    bench = Bench()
    good = bench.run(20.0)
    bench.step(trouble(bench.now_s, state, reason), read=False)
    degraded = bench.run(1.5, read=False)
    assert (degraded.health, degraded.reason) == (Health.DEGRADED, reason)
    assert degraded.age_s == pytest.approx(1.6, abs=0.11)
    assert degraded.variance_ppm2 > 2.0 * good.variance_ppm2
    bad = bench.run(2.0, read=False)
    assert (bad.health, bad.reason) == (Health.BAD, reason)
    back = bench.run(2.0)
    assert back.health is Health.GOOD
    assert back.background_co2_ppm == pytest.approx(good.background_co2_ppm, abs=1.5), (
        "the background outlives it"
    )


def test_a_stuck_instrument_is_no_instrument() -> None:
    bench = Bench()
    bench.run(20.0)
    healths = []
    for _ in range(150):
        bench.now_s += TICK_S
        estimate = bench.filter.step(bench.now_s, [reading(bench.now_s, 421.37)])
        assert estimate is not None
        healths.append((estimate.health, estimate.reason))
    assert healths[30][0] is Health.DEGRADED
    assert healths[-1] == (Health.BAD, "stuck at 421.37 ppm for 15 s")


def test_an_instrument_asked_too_often_gains_no_false_certainty() -> None:
    """Each reading given five times over, as one polled at 10 Hz that measures twice a second would."""
    once, often = Co2Filter(), Co2Filter()
    rng = np.random.default_rng(2)
    single = repeated = None
    for tick in range(400):
        now_s, ppm = 0.1 * tick, 0.0
        if tick % 5 == 0:
            ppm = 420.0 + float(rng.normal())
            single = once.step(now_s, [reading(now_s, ppm)])
            last = ppm
        repeated = often.step(now_s, [reading(now_s, last)])
    assert single is not None
    assert repeated is not None
    assert repeated.background_variance_ppm2 == pytest.approx(single.background_variance_ppm2, rel=0.1)


def test_saturation_is_a_lower_bound() -> None:
    bench = Bench()
    bench.run(20.0)
    bench.air_ppm = 2600.0
    estimate = None
    while bench.cell_ppm < 2000.0:
        estimate = bench.step()
    for _ in range(20):
        bench.now_s += TICK_S
        full = Sample(
            bench.now_s,
            "co2",
            InstrumentState.ERROR,
            reason="saturated at the end of its range, 2000 ppm",
            quantity=Quantity.CO2,
            co2_at_least_ppm=2000.0,
        )
        estimate = bench.filter.step(bench.now_s, [full])
    assert estimate is not None
    assert (estimate.health, estimate.reason) == (
        Health.DEGRADED,
        "saturated at the end of its range, 2000 ppm",
    )
    assert estimate.excess_co2_ppm > 1400.0
    assert math.sqrt(estimate.variance_ppm2) > 50.0


def test_readings_out_of_order_are_worked_in() -> None:
    orderly, shuffled = Co2Filter(), Co2Filter()
    rng = np.random.default_rng(7)
    readings = [
        reading(0.1 * i, 420.0 + (40.0 if i > 250 else 0.0) + float(rng.normal())) for i in range(400)
    ]
    for i, sample in enumerate(readings):
        a = orderly.step(0.1 * i, [sample])
        late = readings[i - 3] if i % 7 == 3 else None
        now = [] if i % 7 == 0 else [sample]
        b = shuffled.step(0.1 * i, [*now, *([late] if late is not None else [])])
    assert a is not None
    assert b is not None
    assert b.excess_co2_ppm == pytest.approx(a.excess_co2_ppm, abs=0.5 * math.sqrt(a.variance_ppm2))
    assert b.variance_ppm2 == pytest.approx(a.variance_ppm2, rel=0.4)
    assert b.background_co2_ppm == pytest.approx(a.background_co2_ppm, abs=1.0)


def test_a_clock_set_back_restarts_with_the_background_known() -> None:
    bench = Bench()
    before = bench.run(30.0)
    bench.now_s = 2.0
    after = bench.run(3.0)
    assert after.health is Health.GOOD
    assert after.background_co2_ppm == pytest.approx(before.background_co2_ppm, abs=1.5)


def test_only_the_configured_instrument_counts() -> None:
    filter_ = Co2Filter(Co2FilterConfig(instrument="left"))
    assert filter_.step(0.0, [reading(0.0, 500.0, "right")]) is None
    assert filter_.step(0.1, [reading(0.1, 420.0, "left")]) is not None
    wind = Sample(0.2, "mast", InstrumentState.ERROR, reason="blocked", quantity=Quantity.WIND)
    other = Co2Filter()
    assert other.step(0.2, [wind]) is None
    assert other.verdict[1] == "no reading yet", "an anemometer's trouble is not the CO2 instrument's"


def test_a_slow_instrument_has_its_own_patience() -> None:
    config = co2_filter_config("k30")
    assert (config.lag_s, config.resolution_ppm) == (20.0, 1.0)
    filter_ = Co2Filter(config)
    estimate = None
    for tick in range(300):
        now_s = 0.1 * tick
        samples = [reading(now_s, 430.0 + (tick // 20) % 3)] if tick % 20 == 0 else []
        estimate = filter_.step(now_s, samples)
    assert estimate is not None
    assert estimate.health is Health.GOOD


steps = st.lists(
    st.tuples(
        st.floats(-5.0, 30.0),
        st.one_of(
            st.none(), st.floats(allow_nan=True, allow_infinity=True), st.floats(0.0, 5000.0), st.just(421.0)
        ),
        st.sampled_from(list(InstrumentState)),
    ),
    max_size=60,
)


@settings(max_examples=80, deadline=None)
@given(steps=steps)
def test_no_history_of_samples_breaks_it(steps: list[tuple[float, float | None, InstrumentState]]) -> None:
    filter_ = Co2Filter()
    now_s = 0.0
    for dt_s, ppm, state in steps:
        now_s += dt_s
        sample = Sample(now_s - 0.05, "co2", state, reason="x", co2_ppm=ppm, quantity=Quantity.CO2)
        estimate = filter_.step(now_s, [sample])
        if estimate is None:
            continue
        numbers = (
            estimate.excess_co2_ppm,
            estimate.variance_ppm2,
            estimate.rate_ppmps,
            estimate.background_co2_ppm,
        )
        assert all(math.isfinite(n) for n in numbers)
        assert estimate.variance_ppm2 > 0.0
        assert (estimate.health is Health.GOOD) == (estimate.reason == "")
