"""Where a survey may start."""

from __future__ import annotations

from flightstack.flight.launch_point import unfit
from mission.geometry.frames import Geodetic, LocalFrame
from mission.geometry.geofence import Circle, Geofence, LocalFence
from mission.geometry.known_obstacles import KnownObstacle, LocalObstacles

FRAME = LocalFrame(Geodetic(-5.06, 151.3, 500.0))
FENCE = LocalFence(FRAME, Geofence(inclusion_circles=(Circle(-5.06, 151.3, 100.0),)))


def test_beside_an_obstacle_no_survey_starts() -> None:
    rock = KnownObstacle(corners_north_east_m=((10.0, 0.0), (10.0, 10.0), (20.0, 10.0), (20.0, 0.0)))
    obstacles = LocalObstacles(FRAME, (rock,), 3.0)
    assert unfit((0.0, 5.0, 0.0), None, 3.0, 500.0, obstacles) == ""
    close = unfit((8.0, 5.0, 0.0), None, 3.0, 500.0, obstacles)
    assert close == "the launch point is 2.0 m from an obstacle, 3 m are to be kept: move the drone"
    assert "inside an obstacle" in unfit((15.0, 5.0, 0.0), None, 3.0, 500.0, obstacles)


def test_inside_the_fence_and_level_with_the_origin_is_fit() -> None:
    assert unfit((20.0, -30.0, 3.0), FENCE, 3.0, 500.0) == ""
    assert unfit((2000.0, 0.0, 0.0), None, 3.0, 500.0) == ""


def test_outside_the_fence_is_not() -> None:
    assert "m outside the geofence: move the drone" in unfit((150.0, 0.0, 0.0), FENCE, 3.0, 500.0)
    assert "m from the geofence" in unfit((98.5, 0.0, 0.0), FENCE, 3.0, 500.0)


def test_an_origin_at_another_altitude_than_the_ground_is_told_with_the_right_one() -> None:
    """Else the guard would keep the drones so many metres over a ground that is not there."""
    assert "40 m above the origin" in unfit((0.0, 0.0, -40.0), FENCE, 3.0, 500.0)
    assert unfit((0.0, 0.0, -40.0), None, 3.0, 500.0).endswith("set origin.amsl_m to 540")
    assert unfit((0.0, 0.0, 40.0), None, 3.0, 500.0).endswith("set origin.amsl_m to 460")
