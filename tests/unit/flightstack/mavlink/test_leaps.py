"""One wrong position between right ones is none; a second that agrees with it is a leap."""

from __future__ import annotations

import types

import pytest

from flightstack.mavlink.leaps import LeapFilter, apart_m
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
