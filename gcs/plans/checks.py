"""Plans before they are flown: what is wrong with one, found on the ground."""

from __future__ import annotations

import itertools
import logging
import math
import pathlib

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.plans.item_checks import item_problems, item_warnings, vehicle_problem
from gcs.station_config import GroundConfig
from mission.documents.flight_plan import (
    AMSL_FRAMES,
    GLOBAL_FRAMES,
    LOCAL_FRAMES,
    RELATIVE_FRAMES,
    Plan,
    PlanItem,
    local_ned_m,
)
from mission.documents.plan_file import read_fence
from mission.geometry.frames import Geodetic, LocalFrame
from mission.geometry.geofence import WIDEST_M, Geofence, LocalFence, LocalPoint

log = logging.getLogger("gcs.plans")

CEILING_M = 120.0
"""What most countries allow without a permit, over the ground; here over the launch point."""

_ARDUPILOT_VERTICES = 255
"""Of one polygon: it counts them in one byte."""
_ON_THE_GROUND = frozenset({mavlink.MAV_CMD_NAV_LAND, mavlink.MAV_CMD_NAV_VTOL_LAND})
_TAKE_OFFS = frozenset({mavlink.MAV_CMD_NAV_TAKEOFF, mavlink.MAV_CMD_NAV_VTOL_TAKEOFF})


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
    fence, warnings = read_fence(file.parent / config.plan)
    for warning in warnings:
        log.warning("%s: %s", file.parent / config.plan, warning)
    return fence


def check_plan(plan: Plan, file: str, *, ceiling_m: float = CEILING_M) -> PlanCheck:
    """Look for everything that can be found without a vehicle."""
    errors: list[str] = []
    warnings: list[str] = [*plan.warnings, *item_warnings(plan)]
    problem = vehicle_problem(plan)
    errors += [problem] if problem else []
    errors += item_problems(plan)
    if plan.home is not None and (plan.home.latitude_deg, plan.home.longitude_deg) == (0.0, 0.0):
        warnings.append("the planned home position is 0, 0, which stands for none")
        plan = msgspec.structs.replace(plan, home=None)
    fence = _checked_fence(plan, errors)
    origin = plan.home or _first_place(plan) or Geodetic(0.0, 0.0)
    frame = LocalFrame(Geodetic(origin.latitude_deg, origin.longitude_deg, 0.0))
    waypoints = _waypoints(plan, frame)
    if plan.home is None and "mission" in plan.holds:
        warnings.append("no planned home position: the launch point cannot be checked against the geofence")
    if not plan.items and plan.geofence is None and not plan.rally:
        warnings.append("the plan is empty: no items, no geofence, no rally points")
    if plan.geofence is None:
        warnings.append("no geofence")
    elif fence is not None:
        _check_inside(plan, LocalFence(frame, fence), frame, waypoints, errors)
        warnings += [*_nested(fence), *_many_vertices(fence)]
    _check_distances(plan, waypoints, frame, errors)
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


def _nested(fence: Geofence) -> list[str]:
    """Inclusion areas are a union: one inside another changes nothing, and is probably meant as an exclusion."""
    found = []
    for (a, inner), (b, outer) in itertools.permutations(enumerate(fence.inclusion), 2):
        frame = LocalFrame(Geodetic(*outer[0]))
        area = LocalFence(frame, Geofence(inclusion=(outer,)))
        points = [frame.to_ned(Geodetic(*vertex))[:2] for vertex in inner]
        if set(inner) != set(outer) and all(area.contains(*point) for point in points):
            found.append(
                f"geofence inclusion polygon {a} lies within inclusion polygon {b} and changes nothing; "
                "if it is to be stayed out of, make it an exclusion"
            )
    return found


def _many_vertices(fence: Geofence) -> list[str]:
    return [
        f"a geofence polygon of {len(polygon)} vertices: ArduPilot takes {_ARDUPILOT_VERTICES}; draw it simpler"
        for polygon in (*fence.inclusion, *fence.exclusion)
        if len(polygon) > _ARDUPILOT_VERTICES
    ]


def _check_distances(plan: Plan, waypoints: list[_Waypoint], frame: LocalFrame, errors: list[str]) -> None:
    places = [(f"item {w.number}", w.point) for w in waypoints]
    places += [(f"rally point {i}", frame.to_ned(point)[:2]) for i, point in enumerate(plan.rally, 1)]
    for name, point in places:
        away_m = math.hypot(*point)
        if away_m > WIDEST_M:
            where = "the planned home position" if plan.home else "the plan's first place"
            errors.append(
                f"{name} is {away_m / 1000.0:.0f} km from {where}: a wrong sign, or latitude and longitude swapped?"
            )


def _check_altitudes(
    plan: Plan, waypoints: list[_Waypoint], ceiling_m: float, errors: list[str], warnings: list[str]
) -> None:
    for waypoint in waypoints:
        above_home_m = waypoint.above_home_m
        if above_home_m is None:
            warnings.append(f"item {waypoint.number}: its altitude is not over home and cannot be checked")
        elif above_home_m > ceiling_m:
            errors.append(_too_high(f"item {waypoint.number}", above_home_m, ceiling_m))
        elif above_home_m <= 0.0 and not waypoint.lands:
            errors.append(_too_low(f"item {waypoint.number}", above_home_m))
    for number, item in enumerate(plan.items, 1):
        if item.command in _TAKE_OFFS and _place(item) is None:
            above_home_m = _above_home_m(plan, item)
            if above_home_m is not None and above_home_m > ceiling_m:
                errors.append(_too_high(f"item {number}", above_home_m, ceiling_m))
            elif above_home_m is not None and above_home_m <= 0.0:
                errors.append(_too_low(f"item {number}", above_home_m))
    for index, rally in enumerate(plan.rally, 1):
        if rally.amsl_m > ceiling_m:
            errors.append(_too_high(f"rally point {index}", rally.amsl_m, ceiling_m))
        elif rally.amsl_m <= 0.0:
            errors.append(_too_low(f"rally point {index}", rally.amsl_m))
    first = next((item for item in plan.items if _is_navigation(item)), None)
    if first is not None and first.command not in _TAKE_OFFS:
        warnings.append(
            "the first navigation item is no take-off: a vehicle on the ground cannot start with it"
        )


def _too_high(what: str, above_home_m: float, ceiling_m: float) -> str:
    return f"{what} is {above_home_m:.0f} m above home, over the ceiling of {ceiling_m:.0f} m"


def _too_low(what: str, above_home_m: float) -> str:
    return f"{what} is {above_home_m:.0f} m above home: at or under the launch"


def _waypoints(plan: Plan, frame: LocalFrame) -> list[_Waypoint]:
    found = []
    for number, item in enumerate(plan.items, 1):
        point = _point(plan, item, frame)
        if point is not None:
            lands = item.command in _ON_THE_GROUND
            found.append(_Waypoint(number, point, _above_home_m(plan, item), lands))
    return found


def _point(plan: Plan, item: PlanItem, frame: LocalFrame) -> LocalPoint | None:
    if item.frame in LOCAL_FRAMES and _is_navigation(item) and plan.home is not None:
        return local_ned_m(item)[:2]
    place = _place(item)
    return None if place is None else frame.to_ned(place)[:2]


def _is_navigation(item: PlanItem) -> bool:
    return item.command <= int(mavlink.MAV_CMD_NAV_LAST)


def _place(item: PlanItem) -> Geodetic | None:
    """Where the item is; None for one without a place on the earth, and for "here" (0, 0 or nothing given)."""
    latitude_deg, longitude_deg = item.params[4], item.params[5]
    if item.frame not in GLOBAL_FRAMES or not _is_navigation(item):
        return None
    if latitude_deg is None or longitude_deg is None or (latitude_deg == 0.0 and longitude_deg == 0.0):
        return None
    return Geodetic(latitude_deg, longitude_deg)


def _first_place(plan: Plan) -> Geodetic | None:
    """Somewhere in the plan, from which the rest is measured where it says no home."""
    found = next((place for item in plan.items if (place := _place(item)) is not None), None)
    if found is None and plan.rally:
        found = plan.rally[0]
    corner = plan.geofence.first_point() if plan.geofence is not None else None
    return found or (Geodetic(*corner) if corner is not None else None)


def _above_home_m(plan: Plan, item: PlanItem) -> float | None:
    altitude_m = item.params[6]
    if item.frame in LOCAL_FRAMES:
        return -local_ned_m(item)[2]
    if altitude_m is None:
        return None
    if item.frame in RELATIVE_FRAMES:
        return altitude_m
    if item.frame in AMSL_FRAMES and plan.home is not None:
        return altitude_m - plan.home.amsl_m
    return None


def _distance_m(a: LocalPoint, b: LocalPoint) -> float:
    return math.dist(a, b)


def _areas(fence: Geofence) -> int:
    polygons = len(fence.inclusion) + len(fence.exclusion)
    return polygons + len(fence.inclusion_circles) + len(fence.exclusion_circles)
