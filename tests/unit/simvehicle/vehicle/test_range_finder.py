"""The range finder that looks around, and what it says over MAVLink."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightstack.mavlink.codec import MavlinkCodec
from flightstack.mavlink.obstacle_distance import ranges_of
from simvehicle.autopilot.obstacle_report import obstacle_distance
from simvehicle.vehicle.range_finder import RangeFinder, RangeFinderConfig
from simvehicle.world.fields import OPEN_GROUND
from simvehicle.world.obstacles import Obstacles
from simvehicle.world.world_config import PolygonalObstacle, RectangularObstacle

WALL = RectangularObstacle(
    centre_north_m=12.0, centre_east_m=0.0, length_north_m=4.0, length_east_m=40.0, top_above_home_m=20.0
)
CORNER = PolygonalObstacle(corners_north_east_m=((-8.0, -8.0), (-8.0, -20.0), (-20.0, -14.0)))
STANDING = Obstacles((WALL, CORNER))
EXACT = RangeFinderConfig(noise_sd_m=0.0)


def finder(config: RangeFinderConfig = EXACT) -> RangeFinder:
    return RangeFinder(config, STANDING, system=1, seed=1)


def test_beams_go_clockwise_from_the_nose() -> None:
    ahead = finder().measure((0.0, 0.0, -10.0), 0.0)
    assert ahead[0] == pytest.approx(10.0)
    assert ahead[9] == math.inf
    to_the_east = finder().measure((0.0, 0.0, -10.0), math.pi / 2.0)
    assert to_the_east[27] == pytest.approx(10.0), "the wall is on the left"
    assert finder().measure((0.0, 0.0, -25.0), 0.0)[0] == math.inf, "above its top"


def test_silence_lies_and_noise() -> None:
    lying = finder()
    lying.lies_m = 3.0
    assert lying.measure((0.0, 0.0, -10.0), 0.0)[0] == pytest.approx(13.0)
    lying.lies_m = -30.0
    assert lying.measure((0.0, 0.0, -10.0), 0.0)[0] == 0.0
    noisy = [finder(RangeFinderConfig(noise_sd_m=0.5)).measure((0.0, 0.0, -10.0), 0.0)[0] for _ in range(2)]
    assert noisy[0] == noisy[1] != 10.0, "by the seed"
    assert RangeFinder(EXACT, OPEN_GROUND, system=1, seed=1).measure((0.0, 0.0, -1.0), 0.0) == [math.inf] * 36


@settings(max_examples=100, deadline=None)
@given(
    north_m=st.floats(-30.0, 30.0), east_m=st.floats(-30.0, 30.0), up_m=st.floats(0.0, 40.0),
    bearing_rad=st.floats(0.0, 6.3),
)  # fmt: skip
def test_a_look_around_is_what_single_beams_are(
    north_m: float, east_m: float, up_m: float, bearing_rad: float
) -> None:
    at = (north_m, east_m, -up_m)
    around = STANDING.ranges_around_m(at, np.array([bearing_rad, 1.0]))
    assert around.tolist() == pytest.approx([STANDING.range_m(at, bearing_rad), STANDING.range_m(at, 1.0)])


@pytest.mark.parametrize("beams", [1, 4, 36, 72])
def test_what_is_said_is_what_was_seen(beams: int) -> None:
    looking = finder(RangeFinderConfig(beams=beams, noise_sd_m=0.0))
    yaw_rad = 0.7
    seen_m = looking.measure((0.0, 0.0, -10.0), yaw_rad)
    frame = MavlinkCodec(1, 196).encode(obstacle_distance(seen_m, looking, 1_000_000))
    (message,) = MavlinkCodec(1, 191, frozenset((330,))).receive(0.0, frame)
    assert (message.component, message.fields.max_distance) == (196, 2500)
    assert list(message.fields.distances[beams:]) == [65535] * (72 - beams)
    ranges = ranges_of(message.fields, yaw_rad)
    assert ranges is not None
    assert [range_m for _, range_m in ranges.beams] == pytest.approx(seen_m, abs=0.006)
    assert ranges.beams[0][0] == pytest.approx(yaw_rad)
    assert ranges.reach_m == 25.0
