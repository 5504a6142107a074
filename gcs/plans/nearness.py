"""Whether a plan is where the vehicle is."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from mission.documents.flight_plan import GLOBAL_FRAMES, Plan
from mission.geometry.frames import Geodetic, LocalFrame
from mission.geometry.geofence import Geofence, LocalFence

FAR_M: Final = 3000.0
"""From the vehicle to the nearest place of a plan that is flown from there."""
_EARTH_RADIUS_M: Final = 6_371_000.0


def nearness_warnings(plan: Plan, vehicle: Geodetic) -> list[str]:
    """What an operator must know before this plan is flown from where the vehicle is."""
    fence = None if plan.geofence is None or plan.geofence.problems() else plan.geofence
    outside_m = 0.0
    if fence is not None:
        frame = LocalFrame(Geodetic(vehicle.latitude_deg, vehicle.longitude_deg, 0.0))
        outside_m = -LocalFence(frame, fence).clearance_m(0.0, 0.0)
        if outside_m <= 0.0:
            return []
    nearest_m = min((distance_m(vehicle, place) for place in _places(plan)), default=0.0)
    if nearest_m > FAR_M:
        return [f"the plan is {nearest_m / 1000.0:,.1f} km from the vehicle: is it the plan of this place?"]
    return [f"the vehicle is {outside_m:.0f} m outside of this fence"] if outside_m > 0.0 else []


def distance_m(a: Geodetic, b: Geodetic) -> float:
    """Over the ground, by the great circle on a sphere."""
    a_rad, b_rad = math.radians(a.latitude_deg), math.radians(b.latitude_deg)
    across = math.sin(math.radians(b.longitude_deg - a.longitude_deg) / 2.0) ** 2
    half = math.sin((b_rad - a_rad) / 2.0) ** 2 + math.cos(a_rad) * math.cos(b_rad) * across
    return 2.0 * _EARTH_RADIUS_M * math.asin(math.sqrt(min(1.0, half)))


def _places(plan: Plan) -> Iterator[Geodetic]:
    for item in plan.items:
        latitude_deg, longitude_deg = item.params[4], item.params[5]
        if item.frame in GLOBAL_FRAMES and latitude_deg and longitude_deg:
            yield Geodetic(latitude_deg, longitude_deg)
    yield from plan.rally
    yield from _corners(plan.geofence)


def _corners(fence: Geofence | None) -> Iterator[Geodetic]:
    if fence is None:
        return
    for polygon in (*fence.inclusion, *fence.exclusion):
        for latitude_deg, longitude_deg in polygon:
            yield Geodetic(latitude_deg, longitude_deg)
    for circle in (*fence.inclusion_circles, *fence.exclusion_circles):
        yield Geodetic(circle.latitude_deg, circle.longitude_deg)
