"""OBSTACLE_DISTANCE exactly as it is defined."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from flightstack.mavlink.obstacle_distance import ranges_of

NORTH, LOCAL, BODY_NED, BODY_FRD, MISSION = 0, 1, 8, 12, 2


def message(**changed: Any) -> Any:
    fields = {
        "distances": [2001] * 36 + [65535] * 36,
        "increment": 10,
        "increment_f": 0.0,
        "min_distance": 20,
        "max_distance": 2000,
        "angle_offset": 0.0,
        "frame": BODY_FRD,
    }
    return SimpleNamespace(**fields | changed)


def distances(**by_index: int) -> list[int]:
    values = [2001] * 36 + [65535] * 36
    for name, distance_cm in by_index.items():
        values[int(name.removeprefix("i"))] = distance_cm
    return values


def degrees(bearing_rad: float) -> float:
    return math.degrees(bearing_rad)


def test_values_mean_what_they_are_defined_to() -> None:
    ranges = ranges_of(message(distances=distances(i0=0, i1=5, i2=2000, i3=2001, i4=65535, i5=65534)), 0.0)
    assert ranges is not None
    assert [range_m for _, range_m in ranges.beams[:5]] == [0.0, 0.05, 20.0, math.inf, math.inf]
    assert len(ranges.beams) == 35, "what is unknown is no beam"
    assert degrees(ranges.beams[4][0]) == pytest.approx(50.0)
    assert (ranges.reach_m, degrees(ranges.width_rad)) == (pytest.approx(20.0), pytest.approx(10.0))


@pytest.mark.parametrize(
    ("frame", "offset_deg", "yaw_deg", "first_deg"),
    [
        (BODY_FRD, 0.0, 90.0, 90.0),
        (BODY_FRD, 30.0, 350.0, 20.0),
        (BODY_FRD, -45.0, 0.0, 315.0),
        (BODY_NED, 0.0, 90.0, 90.0),
        (NORTH, 0.0, 90.0, 0.0),
        (LOCAL, 10.0, 90.0, 10.0),
        (BODY_FRD, math.nan, 90.0, 90.0),
    ],
)
def test_index_0_is_at_the_offset_from_the_nose_or_from_north(
    frame: int, offset_deg: float, yaw_deg: float, first_deg: float
) -> None:
    ranges = ranges_of(message(frame=frame, angle_offset=offset_deg), math.radians(yaw_deg))
    assert ranges is not None
    first, second = (degrees(bearing_rad) for bearing_rad, _ in ranges.beams[:2])
    assert first == pytest.approx(first_deg)
    assert (second - first) % 360.0 == pytest.approx(10.0), "clockwise"


def test_the_float_increment_is_used_where_there_is_one() -> None:
    ranges = ranges_of(message(increment=5, increment_f=2.5, distances=[300] * 72), 0.0)
    assert ranges is not None
    assert degrees(ranges.beams[71][0]) == pytest.approx(177.5)
    ranges = ranges_of(message(increment=60, distances=[300] * 72), 0.0)
    assert ranges is not None
    assert len(ranges.beams) == 6, "once around"
    ranges = ranges_of(message(increment_f=-90.0, distances=[300] * 72), 0.0)
    assert ranges is not None
    assert [round(degrees(bearing_rad)) for bearing_rad, _ in ranges.beams] == [0, 270, 180, 90]


@pytest.mark.parametrize(
    "changed",
    [{"increment": 0}, {"increment": 0, "increment_f": math.nan}, {"max_distance": 0}, {"frame": MISSION}],
)
def test_what_says_nothing_is_none(changed: dict[str, Any]) -> None:
    assert ranges_of(message(**changed), 0.0) is None


def test_without_a_heading_a_body_frame_says_nothing() -> None:
    assert ranges_of(message(), None) is None
    assert ranges_of(message(frame=NORTH), None) is not None
