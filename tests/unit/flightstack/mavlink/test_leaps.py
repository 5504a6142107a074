"""One wrong position between right ones is none; a second that agrees with it is a leap."""

from __future__ import annotations

import types

import pytest

from flightstack.mavlink.leaps import HomeFilter, LeapFilter, apart_m
from mission.geometry.frames import Geodetic

LATITUDE_1E7, LONGITUDE_1E7 = 384_040_000, 149_630_000


def report(boot_s: float, **changes: int) -> types.SimpleNamespace:
    fields = {
        "time_boot_ms": round(boot_s * 1000.0),
        "lat": LATITUDE_1E7,
        "lon": LONGITUDE_1E7,
        "alt": 310_000,
        "vx": 0,
        "vy": 0,
        "vz": 0,
    }
    return types.SimpleNamespace(**(fields | changes))


def flying() -> LeapFilter:
    leaps = LeapFilter()
    assert all(leaps.believes(0.1 * tick, report(50.0 + 0.1 * tick)) for tick in range(10))
    return leaps


@pytest.mark.parametrize(
    "changes",
    [
        {"lon": 55},
        {"lat": LATITUDE_1E7 + 20_000},  # 220 m
        {"alt": 99_000_000},
        {"time_boot_ms": 55_100},
        {"vy": 16_256},
    ],
)
def test_a_report_that_cannot_follow_counts_when_the_next_one_agrees(changes: dict[str, int]) -> None:
    leaps = flying()
    assert not leaps.believes(1.0, report(51.0, **changes))
    assert leaps.believes(1.1, report(51.1)), "the right one after it"
    assert not leaps.believes(1.2, report(51.2, **changes))
    again = changes | {key: value + 100 for key, value in changes.items() if key == "time_boot_ms"}
    assert leaps.believes(1.3, report(51.3, **again))


def test_two_wrong_reports_that_disagree_are_both_none() -> None:
    leaps = flying()
    assert not leaps.believes(1.0, report(51.0, lon=55))
    assert not leaps.believes(1.1, report(51.1, lat=55))
    assert leaps.believes(1.2, report(51.2))


def test_motion_delays_restarts_and_silence_are_no_leaps() -> None:
    leaps = flying()
    assert leaps.believes(1.0, report(51.0, lat=LATITUDE_1E7 + 2_700)), "30 m: a speed that flies"
    assert leaps.believes(3.0, report(51.1)), "held up for two seconds"
    assert leaps.believes(3.1, report(51.4))
    assert leaps.believes(3.2, report(1.0)), "it started again"
    assert leaps.believes(20.0, report(18.0, lon=55)), "not heard for long"


def test_distance_of_two_places() -> None:
    here = Geodetic(60.0, 10.0, 100.0)
    assert apart_m(here, Geodetic(60.001, 10.0, 100.0)) == pytest.approx(111.3, abs=0.5)
    assert apart_m(here, Geodetic(60.0, 10.002, 100.0)) == pytest.approx(111.3, abs=0.5)
    assert apart_m(here, Geodetic(60.0, 10.0, 350.0)) == pytest.approx(250.0)


@pytest.mark.parametrize("rate_hz", [2.0, 10.0])
@pytest.mark.parametrize("up_m", [10.0, 150.0, -900.0])
def test_another_estimate_for_good_is_taken_over_within_a_second_at_any_rate(
    rate_hz: float, up_m: float
) -> None:
    """A reset of the estimator, or a position after a loss: however far, it is never held back for long."""
    leaps, step_s = LeapFilter(), 1.0 / rate_hz
    assert all(leaps.believes(step_s * tick, report(50.0 + step_s * tick)) for tick in range(10))
    told_s = [step_s * tick for tick in range(10, 20)]
    believed = [leaps.believes(at_s, report(50.0 + at_s, alt=310_000 + round(up_m * 1e3))) for at_s in told_s]
    assert believed[-8:] == [True] * 8
    assert believed.index(True) * step_s <= 0.5


def test_a_home_that_has_moved_far_counts_when_it_is_told_again_and_one_near_at_once() -> None:
    homes = HomeFilter()
    here, far = Geodetic(38.404, 14.963, 310.0), Geodetic(38.41, 14.963, 310.0)
    near = Geodetic(38.4041, 14.963, 312.0)
    assert homes.believes(None, here)
    assert homes.believes(here, near)
    assert not homes.believes(near, far)
    assert homes.believes(near, near), "the right one again: the other was none"
    assert not homes.believes(near, far)
    assert homes.believes(near, far)
