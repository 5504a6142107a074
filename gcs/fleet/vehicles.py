"""Vehicles as their autopilots describe them over MAVLink: bytes decoded elsewhere in, facts out.

All state is kept by (link, system, component). What a component is, its own heartbeat says: an autopilot has
an `autopilot` field that is not INVALID. A companion computer or another ground station shares links and even
system ids with it, and its heartbeat says nothing about the vehicle's mode.
"""

from __future__ import annotations

import enum
import math
from collections import deque
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.autopilot.modes import FLAVOURS, Duty, Flavour, mode_name, mode_of
from mission.geometry.frames import Geodetic, LocalFrame, Vector3

STREAM_FRESH_S = 3.0
"""A value whose stream has been silent for longer is not used to decide anything."""
AIRBORNE_ABOVE_HOME_M = 1.0
"""Height that counts as flying where an armed autopilot does not say whether it flies."""
_CHUNK = 50
"""Characters in one STATUSTEXT; a longer text comes in several."""


class Source(NamedTuple):
    """Where a MAVLink message came from."""

    link: int
    """Index of the link in the configuration."""
    system: int
    component: int


class Role(enum.StrEnum):
    UNKNOWN = "unknown"
    AUTOPILOT = "autopilot"
    COMPANION = "companion"
    GROUND = "ground"
    OTHER = "other"


class HeardText(NamedTuple):
    """A STATUSTEXT of an autopilot."""

    severity: int
    """MAV_SEVERITY: 0 emergency to 7 debug."""
    text: str


class Acknowledgement(NamedTuple):
    command: int
    result: int
    """MAV_RESULT."""
    time_s: float


class Component:
    """One MAVLink component on one link. Times are the receiver's, seconds on its own clock."""

    def __init__(self, source: Source, frame: LocalFrame | None) -> None:
        self.source = source
        self.role = Role.UNKNOWN
        self.flavour = Flavour.UNKNOWN
        self.heartbeat_s: float | None = None
        self.armed = False
        self.custom_mode = 0
        self.mode_since_s = 0.0
        self.position_ned_m: Vector3 | None = None
        self.velocity_ned_mps: Vector3 | None = None
        self.geodetic: Geodetic | None = None
        self.above_home_m: float | None = None
        self.heading_rad: float | None = None
        self.home_ned_m: Vector3 | None = None
        self.battery_fraction: float | None = None
        self.acknowledgement: Acknowledgement | None = None
        """The newest COMMAND_ACK."""
        self.heard_s: dict[int, float] = {}
        """When each kind of message (by id) came last."""
        self.reports: deque[HeardText] = deque(maxlen=100)
        """STATUSTEXTs not yet taken by `take_reports`."""
        self._landed_state = mavlink.MAV_LANDED_STATE_UNDEFINED
        self._frame = frame
        self._chunks: dict[int, list[str]] = {}

    @property
    def mode(self) -> str:
        return mode_name(self.flavour, self.custom_mode)

    def in_mode(self, duty: Duty) -> bool:
        return self.flavour is not Flavour.UNKNOWN and self.custom_mode == mode_of(self.flavour, duty)

    def age_s(self, now_s: float) -> float:
        """Since the last heartbeat; infinite before the first."""
        return math.inf if self.heartbeat_s is None else now_s - self.heartbeat_s

    def position_age_s(self, now_s: float) -> float:
        heard_s = self.heard_s.get(mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT)
        return math.inf if heard_s is None or self.position_ned_m is None else now_s - heard_s

    def airborne(self, now_s: float) -> bool:
        """Whether it flies, as it says itself; without a fresh word on it, an armed vehicle that is not known
        to be on the ground counts as flying."""
        if not self.armed:
            return False
        said_s = self.heard_s.get(mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE)
        said = said_s is not None and now_s - said_s <= STREAM_FRESH_S
        if said and self._landed_state != mavlink.MAV_LANDED_STATE_UNDEFINED:
            return bool(self._landed_state != mavlink.MAV_LANDED_STATE_ON_GROUND)
        if self.above_home_m is not None and self.position_age_s(now_s) <= STREAM_FRESH_S:
            return self.above_home_m > AIRBORNE_ABOVE_HOME_M
        return True

    def take_reports(self) -> list[HeardText]:
        taken = list(self.reports)
        self.reports.clear()
        return taken

    def receive(self, now_s: float, message: Any) -> None:
        """Take one decoded pymavlink message of this component."""
        kind = message.get_msgId()
        self.heard_s[kind] = now_s
        handler = _HANDLERS.get(kind)
        if handler is not None:
            handler(self, now_s, message)

    def _heartbeat(self, now_s: float, message: Any) -> None:
        first = self.heartbeat_s is None
        self.heartbeat_s = now_s
        self.role = _role(message)
        if self.role is not Role.AUTOPILOT:
            return
        self.flavour = FLAVOURS.get(message.autopilot, Flavour.UNKNOWN)
        self.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        if first or message.custom_mode != self.custom_mode:
            self.custom_mode = message.custom_mode
            self.mode_since_s = now_s

    def _global_position(self, now_s: float, message: Any) -> None:
        del now_s
        latitude_deg, longitude_deg = message.lat * 1e-7, message.lon * 1e-7
        no_fix = message.lat == 0 and message.lon == 0
        if no_fix or not (abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0):
            return
        self.geodetic = Geodetic(latitude_deg, longitude_deg, message.alt * 1e-3)
        self.position_ned_m = self._frame.to_ned(self.geodetic) if self._frame is not None else None
        self.velocity_ned_mps = (message.vx * 0.01, message.vy * 0.01, message.vz * 0.01)
        self.above_home_m = message.relative_alt * 1e-3
        self.heading_rad = math.radians(message.hdg * 0.01) if message.hdg != 0xFFFF else None

    def _home(self, now_s: float, message: Any) -> None:
        del now_s
        latitude_deg, longitude_deg = message.latitude * 1e-7, message.longitude * 1e-7
        unset = message.latitude == 0 and message.longitude == 0
        sound = not unset and abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0
        if sound and self._frame is not None:
            self.home_ned_m = self._frame.to_ned(
                Geodetic(latitude_deg, longitude_deg, message.altitude * 1e-3)
            )

    def _battery(self, now_s: float, message: Any) -> None:
        del now_s
        # Of several batteries the first counts. (In pymavlink a message without a field "id" has its type's there.)
        second = message.get_msgId() == mavlink.MAVLINK_MSG_ID_BATTERY_STATUS and message.id != 0
        if message.battery_remaining >= 0 and not second:
            self.battery_fraction = min(message.battery_remaining / 100.0, 1.0)

    def _extended_state(self, now_s: float, message: Any) -> None:
        del now_s
        self._landed_state = message.landed_state

    def _status_text(self, now_s: float, message: Any) -> None:
        del now_s
        identity = getattr(message, "id", 0)
        if identity == 0:
            self.reports.append(HeardText(message.severity, message.text))
            return
        chunks = self._chunks.setdefault(identity, [])
        chunks.append(message.text)
        if len(message.text) < _CHUNK or len(chunks) >= 8:
            self.reports.append(HeardText(message.severity, "".join(chunks)))
            del self._chunks[identity]
        while len(self._chunks) > 8:
            del self._chunks[next(iter(self._chunks))]

    def _command_ack(self, now_s: float, message: Any) -> None:
        self.acknowledgement = Acknowledgement(message.command, message.result, now_s)


_HANDLERS = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: Component._heartbeat,  # noqa: SLF001 (the class's own table)
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: Component._global_position,  # noqa: SLF001
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: Component._home,  # noqa: SLF001
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: Component._battery,  # noqa: SLF001
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: Component._battery,  # noqa: SLF001
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: Component._extended_state,  # noqa: SLF001
    mavlink.MAVLINK_MSG_ID_STATUSTEXT: Component._status_text,  # noqa: SLF001
    mavlink.MAVLINK_MSG_ID_COMMAND_ACK: Component._command_ack,  # noqa: SLF001
}


def _role(heartbeat: Any) -> Role:
    if heartbeat.type == mavlink.MAV_TYPE_GCS:
        return Role.GROUND
    if heartbeat.autopilot != mavlink.MAV_AUTOPILOT_INVALID:
        return Role.AUTOPILOT
    if heartbeat.type == mavlink.MAV_TYPE_ONBOARD_CONTROLLER:
        return Role.COMPANION
    return Role.OTHER


class Vehicles:
    """Every MAVLink component heard on any link."""

    def __init__(self, frame: LocalFrame | None) -> None:
        self._frame = frame
        self.components: dict[Source, Component] = {}

    def receive(self, now_s: float, link: int, message: Any) -> Component:
        """Take one decoded message that came over `link`; returns the component that sent it."""
        source = Source(link, message.get_srcSystem(), message.get_srcComponent())
        component = self.components.get(source)
        if component is None:
            component = self.components[source] = Component(source, self._frame)
        component.receive(now_s, message)
        return component

    def autopilots(self) -> list[Component]:
        return [c for c in self.components.values() if c.role is Role.AUTOPILOT]

    def systems(self) -> set[int]:
        """System ids of all vehicles heard so far."""
        return {c.source.system for c in self.autopilots()}

    def autopilot(self, system: int) -> Component | None:
        """The autopilot of a vehicle, on the link that it was last heard on."""
        heard = [c for c in self.autopilots() if c.source.system == system]
        return max(heard, key=lambda c: c.heartbeat_s or 0.0, default=None)

    def companion_age_s(self, system: int, now_s: float) -> float:
        """Since a companion computer of this vehicle was heard over MAVLink (autopilots forward it)."""
        ages = [
            c.age_s(now_s)
            for c in self.components.values()
            if c.source.system == system and c.role is Role.COMPANION
        ]
        return min(ages, default=math.inf)
