"""Whether a survey may start from where a drone stands."""

from __future__ import annotations

from mission.geometry.frames import Vector3
from mission.geometry.geofence import LocalFence
from mission.geometry.known_obstacles import LocalObstacles

LEVEL_M = 5.0
"""How far a launch point may be above or below the origin: a GPS's error, not a wrong altitude in the file."""


def unfit(
    position_ned_m: Vector3,
    fence: LocalFence | None,
    fence_margin_m: float,
    origin_amsl_m: float,
    obstacles: LocalObstacles | None = None,
) -> str:
    """Why no survey may start here, with how to mend it, or nothing."""
    north_m, east_m, down_m = position_ned_m
    if fence is not None:
        clearance_m = fence.clearance_m(north_m, east_m)
        if clearance_m < fence_margin_m:
            where = f"{-clearance_m:.0f} m outside" if clearance_m < 0.0 else f"{clearance_m:.1f} m from"
            return f"the launch point is {where} the geofence: move the drone or widen the fence"
    if obstacles is not None and not obstacles.is_free(north_m, east_m, 0.0):
        away_m = obstacles.beside_walls_m(north_m, east_m, 0.0)
        where = f"{away_m:.1f} m from an obstacle" if away_m > 0.0 else "inside an obstacle"
        return f"the launch point is {where}, {obstacles.margin_m:g} m are to be kept: move the drone"
    if abs(down_m) > LEVEL_M:
        side = "above" if down_m < 0.0 else "below"
        return (
            f"the launch point is {abs(down_m):.0f} m {side} the origin of the swarm's frame, from which "
            f"all altitudes count: set origin.amsl_m to {origin_amsl_m - down_m:.0f}"
        )
    return ""
