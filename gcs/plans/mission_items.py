"""Plans as the mission protocol carries them: items with integer coordinates, numbered as each autopilot wants.

Sources: "Mission Protocol" and "File Formats" pages of mavlink.io; ArduPilot keeps home as item 0 of a mission and
PX4 does not; unset parameters are NaN to PX4 and 0 to ArduPilot.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.modes import Flavour
from gcs.errors import GroundError
from mission.documents.flight_plan import (
    GLOBAL_FRAMES,
    LOCAL_FRAMES,
    MISSION_FRAME,
    Plan,
    PlanItem,
    local_ned_m,
)
from mission.geometry.frames import Geodetic, LocalFrame
from mission.geometry.geofence import Circle, Geofence, Vertex

ROUNDING_1E7 = 10
"""Read back, ArduPilot's coordinates are one or a few 1e-7 degrees off (1e-6 degrees are 11 cm)."""


class Item(msgspec.Struct, frozen=True):
    """One MISSION_ITEM_INT."""

    seq: int
    frame: int
    command: int
    param1: float
    param2: float
    param3: float
    param4: float
    x: int
    """Latitude in 1e-7 degrees in global frames, else parameter 5."""
    y: int
    z: float
    mission_type: int
    current: int = 0
    autocontinue: int = 1


def mission_items(plan: Plan, flavour: Flavour) -> list[Item]:
    """The plan's mission. For ArduPilot it begins with home, which the vehicle takes as item 0.

    Items in local frames become places about home, since no autopilot takes them. `GroundError` without a home.
    """
    items: list[Item] = []
    if flavour is Flavour.ARDUPILOT:
        home = plan.home or Geodetic(0.0, 0.0)
        x, y = _scaled((home.latitude_deg, home.longitude_deg))
        # Exactly one item of a list must be the current one: home itself where there is no other.
        frame, command, current = mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_CMD_NAV_WAYPOINT, int(not plan.items)
        items.append(Item(0, frame, command, 0, 0, 0, 0, x, y, home.amsl_m, 0, current=current))
    first = len(items)
    sequence = {item.jump_id: first + index for index, item in enumerate(plan.items) if item.jump_id}
    unset = math.nan if flavour is Flavour.PX4 else 0.0
    for index, item in enumerate(_on_earth(plan)):
        params = [unset if value is None else value for value in item.params]
        if item.command == mavlink.MAV_CMD_DO_JUMP and item.params[0] is not None:
            params[0] = float(sequence.get(int(params[0]), int(params[0])))
        first_param, second, third, fourth = params[:4]
        x, y = _integers(item)
        items.append(
            Item(
                first + index,
                item.frame,
                item.command,
                first_param,
                second,
                third,
                fourth,
                x,
                y,
                params[6],
                mavlink.MAV_MISSION_TYPE_MISSION,
                current=int(index == 0),
                autocontinue=int(item.auto_continue),
            )
        )
    return items


def _on_earth(plan: Plan) -> Iterator[PlanItem]:
    """The plan's items, those in local frames as latitude, longitude and altitude over home."""
    for item in plan.items:
        if item.frame not in LOCAL_FRAMES:
            yield item
            continue
        if plan.home is None:
            raise GroundError(f"command {item.command} is in metres about home, and the plan says no home")
        north_m, east_m, down_m = local_ned_m(item)
        place = LocalFrame(plan.home).to_geodetic((north_m, east_m, down_m))
        params = (*item.params[:4], place.latitude_deg, place.longitude_deg, -down_m)
        frame = int(mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT)
        yield msgspec.structs.replace(item, frame=frame, params=params)


def _integers(item: PlanItem) -> tuple[int, int]:
    x, y = item.params[4] or 0.0, item.params[5] or 0.0
    scale = _scale(item.frame)
    return round(x * scale), round(y * scale)


def _scale(frame: int) -> float:
    """What parameters 5 and 6 are multiplied by: https://mavlink.io/en/messages/common.html#MISSION_ITEM_INT."""
    if frame in GLOBAL_FRAMES:
        return 1e7
    return 1.0 if frame == MISSION_FRAME else 1e4


def _scaled(vertex: Vertex) -> tuple[int, int]:
    return round(vertex[0] * 1e7), round(vertex[1] * 1e7)


def plan_items(items: Sequence[Item], flavour: Flavour) -> tuple[tuple[PlanItem, ...], Geodetic | None]:
    """The inverse of `mission_items`: the plan's items, and home where the autopilot tells it."""
    home = None
    rest = list(items)
    if flavour is Flavour.ARDUPILOT and rest:
        first = rest.pop(0)
        if first.x or first.y:
            home = Geodetic(first.x * 1e-7, first.y * 1e-7, first.z)
    return tuple(_plan_item(item, index) for index, item in enumerate(rest, 1)), home


def _plan_item(item: Item, number: int) -> PlanItem:
    scale = _scale(item.frame)
    values = (item.param1, item.param2, item.param3, item.param4)
    first, second, third, fourth = (None if math.isnan(value) else value for value in values)
    altitude = None if math.isnan(item.z) else item.z
    return PlanItem(
        command=item.command,
        frame=item.frame,
        params=(first, second, third, fourth, item.x / scale, item.y / scale, altitude),
        auto_continue=bool(item.autocontinue),
        jump_id=number,
    )


def fence_items(fence: Geofence) -> list[Item]:
    """Every vertex of every polygon (each says how many its polygon has), and the circles."""
    items: list[Item] = []

    def add(command: int, param1: float, vertex: Vertex) -> None:
        x, y = _scaled(vertex)
        frame, kind = mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_MISSION_TYPE_FENCE
        items.append(Item(len(items), frame, command, param1, 0.0, 0.0, 0.0, x, y, 0.0, kind))

    inclusion = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
    exclusion = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION
    for command, polygons in ((inclusion, fence.inclusion), (exclusion, fence.exclusion)):
        for polygon in polygons:
            for vertex in polygon:
                add(command, float(len(polygon)), vertex)
    for circle in fence.inclusion_circles:
        add(mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, circle.radius_m, _center(circle))
    for circle in fence.exclusion_circles:
        add(mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION, circle.radius_m, _center(circle))
    return items


def _center(circle: Circle) -> Vertex:
    return circle.latitude_deg, circle.longitude_deg


def fence_of(items: Sequence[Item]) -> Geofence | None:
    """The inverse of `fence_items`; None for no items. ValueError where a polygon is not complete."""
    polygons: dict[int, list[tuple[Vertex, ...]]] = {
        mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION: [],
        mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION: [],
    }
    circles: dict[int, list[Circle]] = {
        mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION: [],
        mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION: [],
    }
    index = 0
    while index < len(items):
        item = items[index]
        if item.command in polygons:
            count = int(item.param1)
            corners = items[index : index + count]
            if count < 1 or len(corners) < count or any(c.command != item.command for c in corners):
                raise ValueError(f"fence item {index}: its polygon of {count} vertices is not complete")
            polygons[item.command].append(tuple((c.x * 1e-7, c.y * 1e-7) for c in corners))
            index += count
            continue
        if item.command in circles:
            circles[item.command].append(Circle(item.x * 1e-7, item.y * 1e-7, item.param1))
        index += 1
    inclusion, exclusion = polygons.values()
    round_in, round_out = circles.values()
    if not (inclusion or exclusion or round_in or round_out):
        return None
    return Geofence(tuple(inclusion), tuple(exclusion), tuple(round_in), tuple(round_out))


def rally_items(points: Sequence[Geodetic]) -> list[Item]:
    """Rally points; their altitude is over home, as plan files hold it."""
    items = []
    for index, point in enumerate(points):
        x, y = _scaled((point.latitude_deg, point.longitude_deg))
        frame, kind = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_MISSION_TYPE_RALLY
        command = mavlink.MAV_CMD_NAV_RALLY_POINT
        items.append(Item(index, frame, command, 0.0, 0.0, 0.0, 0.0, x, y, point.amsl_m, kind))
    return items


def rally_points(items: Sequence[Item]) -> tuple[Geodetic, ...]:
    return tuple(Geodetic(item.x * 1e-7, item.y * 1e-7, item.z) for item in items)


def differences(sent: Sequence[Item], read: Sequence[Item]) -> list[str]:
    """What the vehicle holds that is not what was sent, but for the rounding that autopilots do."""
    if len(sent) != len(read):
        return [f"{len(read)} items instead of {len(sent)}"]
    found = []
    for index, (mine, theirs) in enumerate(zip(sent, read, strict=True)):
        if mine.command != theirs.command:
            found.append(f"item {index} is command {theirs.command} instead of {mine.command}")
        elif abs(mine.x - theirs.x) > ROUNDING_1E7 or abs(mine.y - theirs.y) > ROUNDING_1E7:
            found.append(f"item {index} is at another place")
        elif not math.isnan(mine.z) and abs(mine.z - theirs.z) > 0.1:
            found.append(f"item {index} is at {theirs.z:.1f} m instead of {mine.z:.1f} m")
        elif abs(mine.param1 - theirs.param1) > 0.01 * max(1.0, abs(mine.param1)):
            found.append(f"item {index} has parameter 1 of {theirs.param1:g} instead of {mine.param1:g}")
    return found


class FenceAction(msgspec.Struct, frozen=True):
    """What a vehicle does at its fence, as the parameters that each autopilot has for it."""

    ardupilot: int
    """FENCE_ACTION."""
    px4: int
    """GF_ACTION."""


FENCE_ACTIONS = {
    "report": FenceAction(0, 1),
    "rtl": FenceAction(1, 3),
    "land": FenceAction(2, 5),
    "hold": FenceAction(4, 2),
}
"""PX4's 4 (terminate) cuts the motors in the air and is not offered."""
_ARDUPILOT_POLYGONS = 4
"""Bit of FENCE_TYPE: uploaded polygons and circles."""
_ARDUPILOT_UNION = 2
"""Bit of FENCE_OPTIONS: inside any inclusion area is enough; without it a vehicle must be inside all."""


def fence_parameters(
    fence: Geofence, action: FenceAction, flavour: Flavour, present: dict[str, float]
) -> dict[str, float]:
    """The parameters without which an uploaded fence does nothing, in the order to set them.

    `present` holds the vehicle's FENCE_TYPE and FENCE_OPTIONS (ArduPilot), whose other bits are kept.
    """
    if flavour is Flavour.PX4:
        return {"GF_ACTION": float(action.px4)}
    wanted = {"FENCE_TYPE": float(int(present.get("FENCE_TYPE", 0)) | _ARDUPILOT_POLYGONS)}
    if len(fence.inclusion) + len(fence.inclusion_circles) > 1:
        wanted["FENCE_OPTIONS"] = float(int(present.get("FENCE_OPTIONS", 0)) | _ARDUPILOT_UNION)
    wanted["FENCE_ACTION"] = float(action.ardupilot)
    wanted["FENCE_ENABLE"] = 1.0
    return wanted
