"""What an autopilot said last: MAVLink messages to numbers in the stack's units and a local frame.

Agent and ground station read vehicles by this, and each adds what only it needs. One object is one component on one
link; who is listened to is its owner's choice.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.codec import MavlinkMessage
from flightstack.mavlink.crash import CrashWatch
from flightstack.mavlink.dialect import CurrentEventSequenceMessage, EventMessage
from flightstack.mavlink.leaps import HomeFilter, LeapFilter
from flightstack.mavlink.modes import COPTER_TYPES, FLAVOURS, Duty, Flavour, mode_name, mode_of
from flightstack.mavlink.px4_events import Px4Events
from flightstack.mavlink.role import Role, role_of
from flightstack.mavlink.statustext import StatusText, TextAssembler
from mission.geometry.frames import Geodetic, LocalFrame, Vector3

HEARTBEAT_LOST_S: Final = 5.0
"""Heartbeats come once a second; four or five missed are a lost link (MAVLink heartbeat service)."""
FRESH_S: Final = 3.0
"""A value whose stream has been silent for longer is not used to decide anything."""
REBOOT_S: Final = 5.0
"""The autopilot's clock going back by more than this is a restart, by less a late message."""
FALLS_FOR_S: Final = 20.0
"""A vehicle that was disarmed in the air has come down by then."""
WRECK_BELOW_M: Final = 5.0
"""Over home: an armed wreck that seems to lie higher may be none."""
FLYING_ABOVE_HOME_M: Final = 1.0
"""Without a landed state, an armed vehicle above this is taken to fly (until it disarms)."""

STATES: Final = frozenset(
    (
        mavlink.MAVLINK_MSG_ID_HEARTBEAT,
        mavlink.MAVLINK_MSG_ID_SYS_STATUS,
        mavlink.MAVLINK_MSG_ID_BATTERY_STATUS,
        mavlink.MAVLINK_MSG_ID_ATTITUDE,
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        mavlink.MAVLINK_MSG_ID_HOME_POSITION,
        mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
        mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS,
        CurrentEventSequenceMessage.id,
    )
)
"""The messages of which the newest is kept."""

EVENTS: Final = frozenset(
    (mavlink.MAVLINK_MSG_ID_STATUSTEXT, mavlink.MAVLINK_MSG_ID_COMMAND_ACK, EventMessage.id)
)
"""The messages of which every one counts."""

_POS_HORIZ_ABS = mavlink.EKF_POS_HORIZ_ABS
_CONST_POS_MODE = mavlink.EKF_CONST_POS_MODE
assert mavlink.ESTIMATOR_POS_HORIZ_ABS == _POS_HORIZ_ABS  # noqa: S101 (both autopilots share these two bits)
assert mavlink.ESTIMATOR_CONST_POS_MODE == _CONST_POS_MODE  # noqa: S101


class VehicleState:
    """Takes messages in `accept`; everything else reads its attributes. Times are the receiver's own, in seconds."""

    def __init__(self, system: int, component: int, frame: LocalFrame | None) -> None:
        """`frame`: of the positions; None where it is not known, there are no positions in it then."""
        self.system = system
        self.component = component
        self.boots = 0
        """How many restarts of the autopilot were seen."""
        self.new_texts: list[StatusText] = []
        """Whole status texts, oldest first, until the owner takes them."""
        self.role = Role.UNKNOWN
        self.heartbeat_s: float | None = None
        self.flavour = Flavour.UNKNOWN
        self.autopilot_type = mavlink.MAV_AUTOPILOT_INVALID
        self.vehicle_type = mavlink.MAV_TYPE_GENERIC
        self.armed = False
        self.system_status = mavlink.MAV_STATE_UNINIT
        self.custom_mode: int | None = None
        self.mode_since_s = 0.0
        """When the heartbeat first told the present mode."""
        self.contested_s: float | None = None
        """When another autopilot last spoke under this one's ids."""
        self._frame = frame
        self._texts = TextAssembler()
        self.events = Px4Events()
        self._handlers: dict[int, Callable[[float, Any], None]] = {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self._heartbeat,
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: self._sys_status,
            mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: self._battery_status,
            mavlink.MAVLINK_MSG_ID_ATTITUDE: self._attitude,
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self._global_position,
            mavlink.MAVLINK_MSG_ID_HOME_POSITION: self._home_position,
            mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: self._extended_sys_state,
            mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: self._estimator,
            mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: self._estimator,
            mavlink.MAVLINK_MSG_ID_STATUSTEXT: self._statustext,
            EventMessage.id: self._event,
            CurrentEventSequenceMessage.id: self._event_sequence,
        }
        self._forget()

    def _forget(self) -> None:
        """Nothing but the heartbeat's own facts is known: every heartbeat tells them anew."""
        self.received_s: dict[int, float] = {}
        """When a message of each kind came last."""
        self.received_count: dict[int, int] = {}
        """How many of each kind came."""
        self.boot_ms: int | None = None
        self._leaps = LeapFilter()
        self._homes = HomeFilter()
        self.landed_state = mavlink.MAV_LANDED_STATE_UNDEFINED
        self.estimator_flags: int | None = None
        self.prearm: bool | None = None
        """The autopilot's own verdict on arming; None where it does not give one."""
        self.geodetic: Geodetic | None = None
        self.position_s: float | None = None
        self._position_ned_m: Vector3 | None = None
        self._relative_alt_m = 0.0
        self.velocity_ned_mps: Vector3 | None = None
        self.attitude_rad: Vector3 | None = None
        self.home: Geodetic | None = None
        self._home_ned_m: Vector3 | None = None
        self.battery_fraction: float | None = None
        self.battery_voltage_v: float | None = None
        self._was_high = False
        self._crash = CrashWatch()
        self._armed_s = -math.inf
        """When it was last armed."""

    # -- messages -------------------------------------------------------------------------------------------

    def accept(self, now_s: float, message: MavlinkMessage) -> None:
        """Take one message of this component in."""
        kind = message.kind
        self.received_s[kind] = now_s
        self.received_count[kind] = self.received_count.get(kind, 0) + 1
        handler = self._handlers.get(kind)
        if handler is not None:
            handler(now_s, message.fields)

    def flush(self, now_s: float) -> None:
        """Give out what has waited in vain, for the rest of a text or for its event; call it every tick."""
        for text in self._texts.expire(now_s):
            self._told(now_s, text)
        for text in self.events.expire(now_s):
            self._text(now_s, text)

    def takes(self, now_s: float, heartbeat: Any) -> bool:
        """Is this heartbeat this component's own? What has shown itself to be an autopilot stays the one that it is
        until it is lost: whoever else uses its ids, another aircraft even, must not become it in flight."""
        if self.role is not Role.AUTOPILOT:
            return True
        if role_of(self.system, self.component, heartbeat) is not Role.AUTOPILOT:
            return False
        if (heartbeat.autopilot, heartbeat.type) == (self.autopilot_type, self.vehicle_type):
            return True
        if self.is_connected(now_s):
            self.contested_s = now_s
            return False
        return True

    def _heartbeat(self, now_s: float, fields: Any) -> None:
        if not self.takes(now_s, fields):
            return
        was_autopilot = self.role is Role.AUTOPILOT
        self.heartbeat_s = now_s
        self.role = role_of(self.system, self.component, fields)
        if self.role is not Role.AUTOPILOT:
            return
        if was_autopilot and (fields.autopilot, fields.type) != (self.autopilot_type, self.vehicle_type):
            self._forget()
            self.boots += 1
        self.autopilot_type = fields.autopilot
        self.vehicle_type = fields.type
        self.flavour = FLAVOURS.get(fields.autopilot, Flavour.UNKNOWN)
        self.system_status = fields.system_status
        armed, self.armed = self.armed, bool(fields.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        if self.armed and not armed:
            self._crash = CrashWatch()
        self._armed_s = now_s if self.armed else self._armed_s
        if not self.armed:
            self._was_high = False
        if fields.custom_mode != self.custom_mode:
            self.custom_mode = fields.custom_mode
            self.mode_since_s = now_s

    def _is_old(self, boot_ms: int) -> bool:
        """Is this measurement older than the newest? A clock far back is a restart: what was measured is void."""
        newest = self.boot_ms
        if newest is not None and boot_ms < newest:
            if newest - boot_ms < REBOOT_S * 1000.0:
                return True
            self._forget()
            self.boots += 1
        self.boot_ms = boot_ms
        return False

    def _global_position(self, now_s: float, fields: Any) -> None:
        if not self._leaps.believes(now_s, fields) or self._is_old(fields.time_boot_ms):
            return
        if fields.lat == 0 and fields.lon == 0:
            return
        self._look_for_a_fall(now_s, fields)
        latitude_deg, longitude_deg = fields.lat * 1e-7, fields.lon * 1e-7
        if not (abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0) or not self.estimator_is_good:
            return
        self.geodetic = Geodetic(latitude_deg, longitude_deg, fields.alt * 1e-3)
        self._position_ned_m = None
        self.position_s = now_s
        self._relative_alt_m = fields.relative_alt * 1e-3
        self.velocity_ned_mps = (fields.vx * 0.01, fields.vy * 0.01, fields.vz * 0.01)
        if self.armed:
            self._was_high |= (self.above_home_m or 0.0) > FLYING_ABOVE_HOME_M

    def _look_for_a_fall(self, now_s: float, fields: Any) -> None:
        """Also where the estimator vouches for nothing, which an impact upsets, and after a disarming in the air."""
        if now_s - self._armed_s < FALLS_FOR_S:
            velocity_ned_mps = (fields.vx * 0.01, fields.vy * 0.01, fields.vz * 0.01)
            landing = self.in_mode(Duty.LAND) or self.in_mode(Duty.RETURN)
            self._crash.moved(
                fields.time_boot_ms * 1e-3,
                velocity_ned_mps,
                fields.alt * 1e-3,
                fields.relative_alt * 1e-3,
                landing=landing,
                armed=self.armed,
            )

    def _attitude(self, _now_s: float, fields: Any) -> None:
        attitude_rad = (fields.roll, fields.pitch, fields.yaw)
        if all(map(math.isfinite, attitude_rad)):
            self.attitude_rad = attitude_rad
            if self.armed:
                self._crash.leaned(fields.time_boot_ms * 1e-3, fields.roll, fields.pitch)

    def _home_position(self, _now_s: float, fields: Any) -> None:
        if fields.latitude == 0 and fields.longitude == 0:
            return
        latitude_deg, longitude_deg = fields.latitude * 1e-7, fields.longitude * 1e-7
        if abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0:
            home = Geodetic(latitude_deg, longitude_deg, fields.altitude * 1e-3)
            if self._homes.believes(self.home, home):
                self.home, self._home_ned_m = home, None

    def _extended_sys_state(self, _now_s: float, fields: Any) -> None:
        self.landed_state = fields.landed_state

    def _estimator(self, _now_s: float, fields: Any) -> None:
        self.estimator_flags = fields.flags

    def _sys_status(self, _now_s: float, fields: Any) -> None:
        verdict = mavlink.MAV_SYS_STATUS_PREARM_CHECK
        present = fields.onboard_control_sensors_present & verdict
        self.prearm = bool(fields.onboard_control_sensors_health & verdict) if present else None
        self.battery_fraction = _battery_fraction(fields.battery_remaining)
        unknown_mv = 0xFFFF
        voltage_mv = fields.voltage_battery
        self.battery_voltage_v = voltage_mv * 1e-3 if 0 < voltage_mv < unknown_mv else None

    def _battery_status(self, _now_s: float, fields: Any) -> None:
        """Of several batteries the first counts."""
        fraction = _battery_fraction(fields.battery_remaining)
        if fields.id == 0 and fraction is not None:
            self.battery_fraction = fraction

    def _statustext(self, now_s: float, fields: Any) -> None:
        for text in self._texts.add(now_s, fields.severity, fields.text, fields.id, fields.chunk_seq):
            self._told(now_s, text)

    def _event(self, now_s: float, fields: Any) -> None:
        if self.flavour is Flavour.PX4:
            for text in self.events.event(now_s, fields, armed=self.armed):
                self._text(now_s, text)

    def _event_sequence(self, _now_s: float, fields: Any) -> None:
        if self.flavour is Flavour.PX4:
            self.events.sequence.told(fields.sequence)

    def _told(self, now_s: float, text: StatusText) -> None:
        """One whole status text; of an autopilot that sends events too, it may say what an event says."""
        for each in self.events.statustext(now_s, text):
            self._text(now_s, each)

    def _text(self, _now_s: float, text: StatusText) -> None:
        """One whole text."""
        self.new_texts.append(text)
        self._crash.told(text.text)

    # -- findings -------------------------------------------------------------------------------------------

    @property
    def mode(self) -> str:
        """In the autopilot's own words, "" before its first heartbeat."""
        return "" if self.custom_mode is None else mode_name(self.mode_table, self.custom_mode)

    def in_mode(self, duty: Duty) -> bool:
        flavour = self.mode_table
        return flavour is not Flavour.UNKNOWN and self.custom_mode == mode_of(flavour, duty)

    @property
    def mode_table(self) -> Flavour:
        """Whose table of modes holds; UNKNOWN: none of ours. ArduPilot's planes have one where 6 is no return."""
        is_plane = self.flavour is Flavour.ARDUPILOT and self.vehicle_type not in COPTER_TYPES
        return Flavour.UNKNOWN if is_plane else self.flavour

    def age_s(self, now_s: float) -> float:
        """Since the last heartbeat; infinite before the first."""
        return math.inf if self.heartbeat_s is None else now_s - self.heartbeat_s

    def message_age_s(self, now_s: float, kind: int) -> float:
        """Since the last message of this kind; infinite before the first."""
        received_s = self.received_s.get(kind)
        return math.inf if received_s is None else now_s - received_s

    def position_age_s(self, now_s: float) -> float:
        """Since the newest position that the estimator vouched for; infinite before the first."""
        return math.inf if self.position_s is None else now_s - self.position_s

    def is_connected(self, now_s: float) -> bool:
        return self.age_s(now_s) < HEARTBEAT_LOST_S

    def is_contested(self, now_s: float) -> bool:
        """Whether another autopilot speaks under this one's ids."""
        return self.contested_s is not None and now_s - self.contested_s < HEARTBEAT_LOST_S

    @property
    def crash(self) -> str:
        """How it crashed since it was armed, "" if it did not, or if it flew on."""
        return self._crash.reason

    def believe_crashed(self, how: str) -> None:
        """Somebody who knows more says so."""
        self._crash.reason = self._crash.reason or how

    @property
    def estimator_is_good(self) -> bool:
        """Does the estimator vouch for an absolute horizontal position, as far as it says anything?"""
        flags = self.estimator_flags
        if flags is None:
            return True
        # ArduPilot says by the constant-position bit that it only pretends to know where it is. PX4 (from 1.16 on)
        # sets it whenever it stands still, with as good a position as in the air.
        pretends = self.flavour is not Flavour.PX4 and flags & _CONST_POS_MODE
        return bool(flags & _POS_HORIZ_ABS) and not pretends

    @property
    def above_home_m(self) -> float | None:
        """Height over HOME_POSITION, or what the autopilot gives as such while that is not known."""
        if self.geodetic is None:
            return None
        return self._relative_alt_m if self.home is None else self.geodetic.amsl_m - self.home.amsl_m

    def flies(self, now_s: float) -> bool | None:
        """Whether it is in the air: as it says itself, else by its height; None: it is armed and nothing tells.

        A vehicle that has been high stays in the air until it is disarmed: low over ground that rises is not landed.
        A wreck does not fly, whatever its autopilot says. One that is armed and not near the height of home is kept
        clear of all the same: it may be none, and there nobody has to pass.
        """
        if not self.armed:
            return False
        if self.crash:
            return (self.above_home_m or 0.0) > WRECK_BELOW_M
        if (
            self.landed_state != mavlink.MAV_LANDED_STATE_UNDEFINED
            and self.message_age_s(now_s, mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE) < FRESH_S
        ):
            return bool(self.landed_state != mavlink.MAV_LANDED_STATE_ON_GROUND)
        if self._was_high:
            return True
        above_home_m = self.above_home_m
        if above_home_m is None or self.position_age_s(now_s) > FRESH_S:
            return None
        return above_home_m > FLYING_ABOVE_HOME_M

    @property
    def position_ned_m(self) -> Vector3 | None:
        """The newest position that the estimator vouched for."""
        if self._position_ned_m is None and self.geodetic is not None and self._frame is not None:
            self._position_ned_m = self._frame.to_ned(self.geodetic)
        return self._position_ned_m

    @property
    def home_ned_m(self) -> Vector3 | None:
        """Where the autopilot will return to."""
        if self._home_ned_m is None and self.home is not None and self._frame is not None:
            self._home_ned_m = self._frame.to_ned(self.home)
        return self._home_ned_m


def _battery_fraction(percent: int) -> float | None:
    return min(percent / 100.0, 1.0) if percent >= 0 else None
