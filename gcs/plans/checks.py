"""Plans before they are flown: what is wrong with one, found on the ground."""

from __future__ import annotations

import itertools
import math
import pathlib

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.station_config import GroundConfig
from mission.documents.plan_file import Plan, PlanItem, read_plan
from mission.documents.yaml_file import DocumentError
from mission.geometry.frames import Geodetic, LocalFrame
from mission.geometry.geofence import Geofence, LocalFence, LocalPoint

CEILING_M = 120.0
"""What most countries allow without a permit, over the ground; here over the launch point."""

_RELATIVE = frozenset({mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT})
_AMSL = frozenset({mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT})
_ON_THE_GROUND = frozenset({mavlink.MAV_CMD_NAV_LAND, mavlink.MAV_CMD_NAV_VTOL_LAND})


class PlanCheck(msgspec.Struct, frozen=True):
    """What `gcs plan check` found."""

    file: str
    errors: tuple[str, ...]
    """What must not be flown."""
    warnings: tuple[str, ...]
    """What could not be checked, or is probably not meant."""
    items: int
    waypoints: int
    length_m: float
    highest_above_home_m: float | None
    lowest_above_home_m: float | None
    fence_areas: int
    rally_points: int

    @property
    def good(self) -> bool:
        return not self.errors


class _Waypoint(msgspec.Struct, frozen=True):
    number: int
    """Number of the item, from 1 as ground stations count."""
    point: LocalPoint
    above_home_m: float | None
    lands: bool


def load_fence(config: GroundConfig, file: pathlib.Path) -> Geofence | None:
    """The fence that a ground station watches: its own, or that of the plan it names."""
    if config.plan is None:
        return config.geofence
    path = file.parent / config.plan
    fence = read_plan(path).geofence
    if fence is None:
        raise DocumentError(
            str(path), "this plan has no geofence; draw one, or remove `plan` from the ground file"
        )
    for problem in fence.problems():
        raise DocumentError(str(path), problem, field="geoFence")
    return fence


def check_plan(plan: Plan, file: str, *, ceiling_m: float = CEILING_M) -> PlanCheck:
    """Look for everything that can be found without a vehicle."""
    errors: list[str] = []
    warnings: list[str] = list(plan.warnings)
    fence = _checked_fence(plan, errors)
    origin = plan.home or _first_position(plan) or Geodetic(0.0, 0.0)
    frame = LocalFrame(Geodetic(origin.latitude_deg, origin.longitude_deg, 0.0))
    waypoints = _waypoints(plan, frame)
    if plan.home is None:
        warnings.append("no planned home position: the launch point cannot be checked against the geofence")
    if not plan.items and fence is None and not plan.rally:
        warnings.append("the plan is empty: no items, no geofence, no rally points")
    if plan.geofence is None:
        warnings.append("no geofence")
    elif fence is not None:
        _check_inside(plan, LocalFence(frame, fence), frame, waypoints, errors)
    _check_altitudes(plan, waypoints, ceiling_m, errors, warnings)
    heights = [w.above_home_m for w in waypoints if w.above_home_m is not None]
    return PlanCheck(
        file,
        tuple(errors),
        tuple(warnings),
        len(plan.items),
        len(waypoints),
        sum(_distance_m(a.point, b.point) for a, b in itertools.pairwise(waypoints)),
        max(heights, default=None),
        min(heights, default=None),
        0 if fence is None else _areas(fence),
        len(plan.rally),
    )


def _checked_fence(plan: Plan, errors: list[str]) -> Geofence | None:
    if plan.geofence is None:
        return None
    problems = plan.geofence.problems()
    errors += problems
    return None if problems else plan.geofence


def _check_inside(
    plan: Plan, fence: LocalFence, frame: LocalFrame, waypoints: list[_Waypoint], errors: list[str]
) -> None:
    if plan.home is not None and not fence.contains(*frame.to_ned(plan.home)[:2]):
        errors.append("the planned home position is outside the geofence: move the launch point or the fence")
    for waypoint in waypoints:
        if not fence.contains(*waypoint.point):
            outside_m = -fence.clearance_m(*waypoint.point)
            errors.append(f"item {waypoint.number} is {outside_m:.0f} m outside the geofence")
    for a, b in itertools.pairwise(waypoints):
        inside = fence.contains(*a.point) and fence.contains(*b.point)
        if inside and not fence.path_clear(a.point, b.point):
            errors.append(f"the straight way from item {a.number} to item {b.number} leaves the geofence")
    for index, rally in enumerate(plan.rally, 1):
        if not fence.contains(*frame.to_ned(rally)[:2]):
            errors.append(f"rally point {index} is outside the geofence")


def _check_altitudes(
    plan: Plan, waypoints: list[_Waypoint], ceiling_m: float, errors: list[str], warnings: list[str]
) -> None:
    for waypoint in waypoints:
        above_home_m = waypoint.above_home_m
        if above_home_m is None:
            warnings.append(f"item {waypoint.number}: its altitude is not over home and cannot be checked")
        elif above_home_m > ceiling_m:
            errors.append(
                f"item {waypoint.number} is {above_home_m:.0f} m above home, over the ceiling of {ceiling_m:.0f} m"
            )
        elif above_home_m <= 0.0 and not waypoint.lands:
            errors.append(
                f"item {waypoint.number} is {above_home_m:.0f} m above home: at or under the launch"
            )
    first = next((item for item in plan.items if _is_navigation(item)), None)
    if first is not None and first.command != mavlink.MAV_CMD_NAV_TAKEOFF:
        warnings.append(
            "the first navigation item is no take-off: a vehicle on the ground cannot start with it"
        )


def _waypoints(plan: Plan, frame: LocalFrame) -> list[_Waypoint]:
    found = []
    for number, item in enumerate(plan.items, 1):
        place = _place(item)
        if place is None:
            continue
        north_m, east_m, _ = frame.to_ned(place)
        found.append(
            _Waypoint(number, (north_m, east_m), _above_home_m(plan, item), item.command in _ON_THE_GROUND)
        )
    return found


def _is_navigation(item: PlanItem) -> bool:
    return item.command <= int(mavlink.MAV_CMD_NAV_LAST)


def _place(item: PlanItem) -> Geodetic | None:
    """Where the item is; None for one without a place, and for "here" (0, 0 or nothing given)."""
    latitude_deg, longitude_deg = item.params[4], item.params[5]
    if not _is_navigation(item) or latitude_deg is None or longitude_deg is None:
        return None
    if latitude_deg == 0.0 and longitude_deg == 0.0:
        return None
    return Geodetic(latitude_deg, longitude_deg)


def _first_position(plan: Plan) -> Geodetic | None:
    return next((place for item in plan.items if (place := _place(item)) is not None), None)


def _above_home_m(plan: Plan, item: PlanItem) -> float | None:
    altitude_m = item.params[6]
    if altitude_m is None:
        return None
    if item.frame in _RELATIVE:
        return altitude_m
    if item.frame in _AMSL and plan.home is not None:
        return altitude_m - plan.home.amsl_m
    return None


def _distance_m(a: LocalPoint, b: LocalPoint) -> float:
    return math.dist(a, b)


def _areas(fence: Geofence) -> int:
    polygons = len(fence.inclusion) + len(fence.exclusion)
    return polygons + len(fence.inclusion_circles) + len(fence.exclusion_circles)
