"""What fence an autopilot keeps by itself: asked for before each arming, so that no survey is flown against it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.autopilot.telemetry import Telemetry
from flightstack.mavlink.exchanges import REPEAT_S, REPEATS, ParameterReading
from flightstack.mavlink.modes import Flavour
from mission.geometry.frames import Vector3
from mission.geometry.geofence import Circle, Vertex

FENCE = mavlink.MAV_MISSION_TYPE_FENCE
MOST_ITEMS = 500
"""More than any autopilot stores."""

ARDUPILOT_SWITCHES = ("FENCE_ENABLE", "FENCE_AUTOENABLE")
ARDUPILOT_VALUES = (
    "FENCE_TYPE",
    "FENCE_RADIUS",
    "FENCE_ALT_MAX",
    "FENCE_ALT_MIN",
    "FENCE_MARGIN",
    "FENCE_OPTIONS",
    "AVOID_ENABLE",
)
PX4_SWITCHES = ("GF_ACTION",)
PX4_VALUES = ("GF_MAX_HOR_DIST", "GF_MAX_VER_DIST")
_WARNS = 1.0
"""A GF_ACTION that does nothing."""
_MAX_ALT, _CIRCLE, _AREAS, _MIN_ALT = 1, 2, 4, 8
"""Bits of FENCE_TYPE."""
_UNION = 2
"""Bit of FENCE_OPTIONS."""
_AVOIDS_FENCE = 1
"""Bit of AVOID_ENABLE."""


class OwnFence(msgspec.Struct, frozen=True, kw_only=True):
    """The limits that an autopilot enforces; None where it has none of the kind. Heights are over its home."""

    radius_m: float | None = None
    """Of a circle around home."""
    ceiling_m: float | None = None
    floor_m: float | None = None
    inclusions: tuple[tuple[Vertex, ...] | Circle, ...] = ()
    exclusions: tuple[tuple[Vertex, ...] | Circle, ...] = ()
    any_inclusion: bool = False
    """To be inside of one inclusion area is enough; else of all."""
    margin_m: float = 0.0
    """It holds the vehicle back so far before its lines, without a word (ArduPilot's avoidance)."""
    radius_name: str = ""
    ceiling_name: str = ""
    floor_name: str = ""
    """The parameters' names, for whoever has to change them."""

    @property
    def is_none(self) -> bool:
        return self == OwnFence()


class OwnFenceReading:
    """Asks for parameters and areas until all are known or not answered. `fence` when `done`."""

    def __init__(self) -> None:
        self.done = False
        self.fence = OwnFence()
        self.unknown: tuple[str, ...] = ()
        """What the autopilot did not tell."""
        self._parameters: ParameterReading | None = None
        self._values: dict[str, float] = {}
        self._switched = False
        self._items: _ItemReading | None = None

    def step(self, now_s: float, vehicle: Telemetry) -> list[Any]:
        if self.done:
            return []
        px4 = vehicle.flavour is Flavour.PX4
        if self._parameters is None:
            self._parameters = ParameterReading(PX4_SWITCHES if px4 else ARDUPILOT_SWITCHES)
        sent = self._parameters.step(now_s, vehicle)
        if not self._parameters.done:
            return sent
        self._values |= self._parameters.values
        if not self._switched:
            self._switched = True
            only_warns = px4 and self._values.get("GF_ACTION", 0.0) == _WARNS
            if only_warns or not any(self._values.values()):
                # An autopilot built without fences knows none of their parameters; the second switch is newer.
                missing, switch = self._parameters.missing, (PX4_SWITCHES if px4 else ARDUPILOT_SWITCHES)[0]
                self._finish(OwnFence(), missing if switch in missing else ())
                return sent
            self._parameters = ParameterReading(PX4_VALUES if px4 else ARDUPILOT_VALUES)
            return sent
        areas = px4 or bool(self._bits("FENCE_TYPE") & _AREAS)
        if areas and self._items is None:
            self._items = _ItemReading()
        if self._items is not None:
            sent += self._items.step(now_s, vehicle)
            if not self._items.done:
                return sent
        missing = self._parameters.missing + (
            ("its fence list",) if self._items and self._items.failed else ()
        )
        self._finish(self._px4() if px4 else self._ardupilot(), missing)
        return sent

    def parameter(self, vehicle: Telemetry, fields: Any) -> None:
        if self._parameters is not None:
            self._parameters.value(vehicle.flavour, fields)

    def parameter_error(self, fields: Any) -> None:
        if self._parameters is not None:
            self._parameters.error(fields)

    def mission(self, kind: int, fields: Any) -> None:
        """A message of the mission protocol came that is for us."""
        if self._items is not None and getattr(fields, "mission_type", None) == FENCE:
            self._items.hear(kind, fields)

    def _finish(self, fence: OwnFence, unknown: tuple[str, ...]) -> None:
        self.done, self.fence, self.unknown = True, fence, unknown

    def _bits(self, name: str) -> int:
        return int(self._values.get(name, 0.0))

    def _ardupilot(self) -> OwnFence:
        values, kinds = self._values, self._bits("FENCE_TYPE")
        inclusions, exclusions = self._items.areas() if self._items is not None else ((), ())
        avoids = bool(self._bits("AVOID_ENABLE") & _AVOIDS_FENCE)
        return OwnFence(
            radius_m=values.get("FENCE_RADIUS") if kinds & _CIRCLE else None,
            ceiling_m=values.get("FENCE_ALT_MAX") if kinds & _MAX_ALT else None,
            floor_m=values.get("FENCE_ALT_MIN") if kinds & _MIN_ALT else None,
            inclusions=inclusions,
            exclusions=exclusions,
            any_inclusion=bool(self._bits("FENCE_OPTIONS") & _UNION),
            margin_m=values.get("FENCE_MARGIN", 0.0) if avoids else 0.0,
            radius_name="FENCE_RADIUS",
            ceiling_name="FENCE_ALT_MAX",
            floor_name="FENCE_ALT_MIN",
        )

    def _px4(self) -> OwnFence:
        inclusions, exclusions = self._items.areas() if self._items is not None else ((), ())
        return OwnFence(
            radius_m=self._values.get("GF_MAX_HOR_DIST") or None,
            ceiling_m=self._values.get("GF_MAX_VER_DIST") or None,
            inclusions=inclusions,
            exclusions=exclusions,
            any_inclusion=True,
            radius_name="GF_MAX_HOR_DIST",
            ceiling_name="GF_MAX_VER_DIST",
        )


class OwnFenceCheck:
    """Reads it, and says whether it stands against flying."""

    def __init__(self, conflict: Callable[[OwnFence, Vector3], str]) -> None:
        """`conflict`: what of a fence around a home (NED, m) stands against flying, "" if nothing does."""
        self.reading = OwnFenceReading()
        self._conflict = conflict

    def refusal(self, home_ned_m: Vector3 | None) -> str:
        return self._conflict(self.reading.fence, home_ned_m) if home_ned_m is not None else ""

    @property
    def warning(self) -> str:
        if not self.reading.unknown:
            return ""
        return f"autopilot does not tell {', '.join(self.reading.unknown)}: its own fence is not known"


class _ItemReading:
    """The uploaded fence by the mission protocol: the count, then item after item, each repeated until it comes."""

    def __init__(self) -> None:
        self.done = False
        self.failed = False
        self._count: int | None = None
        self._items: list[Any] = []
        self._sent = 0
        self._next_s = -math.inf

    def step(self, now_s: float, vehicle: Telemetry) -> list[Any]:
        if self.done or now_s < self._next_s:
            return []
        if self._sent > REPEATS:
            self.done = self.failed = True
            return []
        self._sent += 1
        self._next_s = now_s + REPEAT_S
        target = vehicle.system, vehicle.component
        if self._count is None:
            return [mavlink.MAVLink_mission_request_list_message(*target, FENCE)]
        if len(self._items) < self._count:
            return [mavlink.MAVLink_mission_request_int_message(*target, len(self._items), FENCE)]
        self.done = True
        return [mavlink.MAVLink_mission_ack_message(*target, mavlink.MAV_MISSION_ACCEPTED, FENCE)]

    def hear(self, kind: int, fields: Any) -> None:
        if self.done:
            return
        if kind == mavlink.MAVLINK_MSG_ID_MISSION_COUNT and self._count is None:
            self._count = min(fields.count, MOST_ITEMS)
            self._again()
        elif kind == mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT and fields.seq == len(self._items):
            self._items.append(fields)
            self._again()
        elif kind == mavlink.MAVLINK_MSG_ID_MISSION_ACK and fields.type != mavlink.MAV_MISSION_ACCEPTED:
            self.done = self.failed = True

    def _again(self) -> None:
        self._sent, self._next_s = 0, -math.inf

    def areas(
        self,
    ) -> tuple[tuple[tuple[Vertex, ...] | Circle, ...], tuple[tuple[Vertex, ...] | Circle, ...]]:
        """(inclusions, exclusions)."""
        inside: list[tuple[Vertex, ...] | Circle] = []
        outside: list[tuple[Vertex, ...] | Circle] = []
        place = 0
        while place < len(self._items):
            item = self._items[place]
            point = item.x * 1e-7, item.y * 1e-7
            place += 1
            if item.command == mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION:
                inside.append(Circle(*point, item.param1))
            elif item.command == mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION:
                outside.append(Circle(*point, item.param1))
            elif item.command in _POLYGONS and item.param1 >= 1.0:
                corners = self._items[place - 1 : place - 1 + int(item.param1)]
                polygon = tuple((corner.x * 1e-7, corner.y * 1e-7) for corner in corners)
                (inside if item.command == _POLYGONS[0] else outside).append(polygon)
                place += len(corners) - 1
        return tuple(inside), tuple(outside)


_POLYGONS = (
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
)
