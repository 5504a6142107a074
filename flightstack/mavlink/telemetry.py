"""What the autopilot said last: MAVLink messages to numbers in the stack's units and the swarm's frame.

Only messages of one component count: the one of our own system id whose heartbeat names an autopilot.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.autopilot.authority import Authority
from flightstack.autopilot.modes import COPTER_TYPES, FLAVOURS, Duty, Flavour, mode_name, mode_of
from flightstack.autopilot.report import StatusText, TakenBy, VehicleReport
from flightstack.mavlink.statustext import TextAssembler
from mission.geometry.frames import Geodetic, LocalFrame, Vector3, wind_from

LOST_S = 5.0
"""Heartbeats come once a second; four or five missed are a lost link (MAVLink heartbeat service)."""
LANDED_STATE_STALE_S = 3.0
REBOOT_S = 5.0
"""The autopilot's clock going back by more than this is a restart, by less a late message."""
FLYING_ABOVE_HOME_M = 1.0
"""Without a landed state, an armed vehicle above this is taken to fly (until it disarms)."""
PREARM_ROUND_S = 5.0
"""ArduPilot tells what keeps it from arming every 30 s, all of it at once."""
MOVING_AIR_MPS = 0.01
"""A WIND of exactly nothing is ArduCopter's way of saying that it does not estimate wind."""

_POS_HORIZ_ABS = mavlink.EKF_POS_HORIZ_ABS
_CONST_POS_MODE = mavlink.EKF_CONST_POS_MODE
assert mavlink.ESTIMATOR_POS_HORIZ_ABS == _POS_HORIZ_ABS  # noqa: S101 (both autopilots share these two bits)
assert mavlink.ESTIMATOR_CONST_POS_MODE == _CONST_POS_MODE  # noqa: S101
_PREARM = mavlink.MAV_SYS_STATUS_PREARM_CHECK


class Telemetry:
    """Takes messages in `accept`; everything else reads its attributes."""

    def __init__(self, system: int, frame: LocalFrame, flavour: Flavour) -> None:
        self.system = system
        self._frame = frame
        self._configured_flavour = flavour
        self._component: int | None = None
        self._texts = TextAssembler()
        self._handlers: dict[int, Callable[[float, Any], None]] = {
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: self._sys_status,
            mavlink.MAVLINK_MSG_ID_ATTITUDE: self._attitude,
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self._global_position,
            mavlink.MAVLINK_MSG_ID_HOME_POSITION: self._home_position,
            mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: self._extended_sys_state,
            mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: self._estimator,
            mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: self._estimator,
            mavlink.MAVLINK_MSG_ID_WIND: self._wind_from,
            mavlink.MAVLINK_MSG_ID_WIND_COV: self._wind_vector,
            mavlink.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT: self._named_value,
            mavlink.MAVLINK_MSG_ID_STATUSTEXT: self._statustext,
        }
        self.authority = Authority()
        self.foreign_system: int | None = None
        """The system id of an autopilot on this link that is not ours."""
        self.boots = 0
        """How many restarts of the autopilot were seen."""
        self.new_texts: list[StatusText] = []
        self.new_values: list[tuple[str, float]] = []
        self.new_wind: tuple[Vector3, float | None] | None = None
        """The newest wind estimate (NED, m/s) and its standard deviation since `clear_news`."""
        self._forget()

    def _forget(self) -> None:
        """The state of a vehicle of which nothing is known but perhaps that it exists."""
        self.heartbeat_s: float | None = None
        self.flavour = Flavour.UNKNOWN
        self.autopilot_type = mavlink.MAV_AUTOPILOT_INVALID
        self.vehicle_type = mavlink.MAV_TYPE_GENERIC
        self.armed = False
        self.custom_mode: int | None = None
        self.received_s: dict[int, float] = {}
        """When a message of each kind came last."""
        self.boot_ms: int | None = None
        self.landed_state = mavlink.MAV_LANDED_STATE_UNDEFINED
        self.estimator_flags: int | None = None
        self.prearm: bool | None = None
        """The autopilot's own verdict on arming; None where it does not give one."""
        self.geodetic: Geodetic | None = None
        self.position_s: float | None = None
        self._position_ned_m: Vector3 | None = None
        self.velocity_ned_mps: Vector3 | None = None
        self.attitude_rad: Vector3 | None = None
        self.home: Geodetic | None = None
        self._home_ned_m: Vector3 | None = None
        self.battery_fraction: float | None = None
        self.battery_voltage_v: float | None = None
        self._was_high = False
        self.has_flown = False
        """In the air at least once since it was armed."""
        self.prearm_texts: dict[str, float] = {}
        """ArduPilot's newest round of "PreArm: …" texts, and when each came."""

    # -- messages -------------------------------------------------------------------------------------------

    def accept(self, now_s: float, message: Any) -> bool:
        """Take one message in; False if it is not from our autopilot."""
        header = message.get_header()
        kind: int = header.msgId
        if kind == mavlink.MAVLINK_MSG_ID_HEARTBEAT and not self._choose(now_s, header, message):
            return False
        if header.srcSystem != self.system or header.srcComponent != self._component:
            return False
        self.received_s[kind] = now_s
        if kind == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            self._heartbeat(now_s, message)
        elif (handler := self._handlers.get(kind)) is not None:
            handler(now_s, message)
        return True

    def flush(self, now_s: float) -> None:
        """Give out a long status text whose last part never came."""
        for severity, text in self._texts.expire(now_s):
            self._text(now_s, severity, text)

    def _choose(self, now_s: float, header: Any, message: Any) -> bool:
        """Is this the heartbeat of our autopilot? The first one heard stays it until it is lost."""
        if message.autopilot == mavlink.MAV_AUTOPILOT_INVALID or message.type == mavlink.MAV_TYPE_GCS:
            return False
        if header.srcSystem != self.system:
            self.foreign_system = int(header.srcSystem)
            return False
        if header.srcComponent != self._component:
            if self._component is not None and self.is_connected(now_s):
                return False
            self._component = header.srcComponent
        return True

    def _heartbeat(self, now_s: float, message: Any) -> None:
        self.heartbeat_s = now_s
        self.autopilot_type = message.autopilot
        self.vehicle_type = message.type
        told = FLAVOURS.get(message.autopilot, Flavour.UNKNOWN)
        wanted = self._configured_flavour
        self.flavour = told if wanted is Flavour.UNKNOWN or wanted is told else Flavour.UNKNOWN
        self.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        self.custom_mode = int(message.custom_mode)
        if not self.armed:
            self._was_high = self.has_flown = False
        elif self.is_airborne(now_s):
            self.has_flown = True
        self.authority.heartbeat(now_s, self.flavour, self.armed, self.custom_mode, message.system_status)

    def _is_old(self, boot_ms: int) -> bool:
        """Is this measurement older than the newest? A clock far back is a restart: what was known is void."""
        newest = self.boot_ms
        if newest is not None and boot_ms < newest:
            if newest - boot_ms < REBOOT_S * 1000.0:
                return True
            heartbeat_s, component = self.heartbeat_s, self._component
            self._forget()
            self.boots += 1
            self.heartbeat_s, self._component = heartbeat_s, component
        self.boot_ms = boot_ms
        return False

    def _global_position(self, now_s: float, message: Any) -> None:
        if self._is_old(message.time_boot_ms) or (message.lat == 0 and message.lon == 0):
            return
        latitude_deg, longitude_deg = message.lat * 1e-7, message.lon * 1e-7
        if not (abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0) or not self.estimator_is_good:
            return
        self.geodetic = Geodetic(latitude_deg, longitude_deg, message.alt * 1e-3)
        self._position_ned_m = None
        self.position_s = now_s
        self.velocity_ned_mps = (message.vx * 0.01, message.vy * 0.01, message.vz * 0.01)
        if self.armed and self.home is not None:
            self._was_high |= self.geodetic.amsl_m - self.home.amsl_m > FLYING_ABOVE_HOME_M

    def _attitude(self, _now_s: float, message: Any) -> None:
        attitude_rad = (message.roll, message.pitch, message.yaw)
        if all(map(math.isfinite, attitude_rad)):
            self.attitude_rad = attitude_rad

    def _home_position(self, _now_s: float, message: Any) -> None:
        if message.latitude == 0 and message.longitude == 0:
            return
        latitude_deg, longitude_deg = message.latitude * 1e-7, message.longitude * 1e-7
        if abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0:
            self.home = Geodetic(latitude_deg, longitude_deg, message.altitude * 1e-3)
            self._home_ned_m = None

    def _extended_sys_state(self, now_s: float, message: Any) -> None:
        self.landed_state = message.landed_state
        self.has_flown |= self.is_airborne(now_s)

    def _estimator(self, _now_s: float, message: Any) -> None:
        self.estimator_flags = int(message.flags)

    def _sys_status(self, _now_s: float, message: Any) -> None:
        present = message.onboard_control_sensors_present & _PREARM
        self.prearm = bool(message.onboard_control_sensors_health & _PREARM) if present else None
        remaining = message.battery_remaining
        self.battery_fraction = min(remaining / 100.0, 1.0) if remaining >= 0 else None
        unknown_mv = 0xFFFF
        voltage_mv = message.voltage_battery
        self.battery_voltage_v = voltage_mv * 1e-3 if 0 < voltage_mv < unknown_mv else None
        if self.prearm:
            self.prearm_texts.clear()

    def _wind_from(self, _now_s: float, message: Any) -> None:
        values = (message.speed, message.direction, message.speed_z)
        if all(map(math.isfinite, values)) and message.speed > MOVING_AIR_MPS:
            # ArduPilot's speed is the length of the whole vector, its direction that of the horizontal part.
            horizontal_mps = math.sqrt(max(message.speed**2 - message.speed_z**2, 0.0))
            north_mps, east_mps, _ = wind_from(horizontal_mps, message.direction)
            self.new_wind = ((north_mps, east_mps, message.speed_z), None)

    def _wind_vector(self, _now_s: float, message: Any) -> None:
        north_mps, east_mps, down_mps = message.wind_x, message.wind_y, message.wind_z
        if not (math.isfinite(north_mps) and math.isfinite(east_mps)):
            return
        if math.hypot(north_mps, east_mps) > MOVING_AIR_MPS:
            down_mps = down_mps if math.isfinite(down_mps) else 0.0
            # horiz_accuracy is the estimate's own uncertainty (0: unknown); var_horiz is the gusts', as a
            # standard deviation in spite of its name.
            sds_mps = [s for s in (message.horiz_accuracy, message.var_horiz) if math.isfinite(s) and s > 0.0]
            self.new_wind = ((north_mps, east_mps, down_mps), max(sds_mps, default=None))

    def _named_value(self, _now_s: float, message: Any) -> None:
        if math.isfinite(message.value):
            self.new_values.append((message.name, message.value))

    def _statustext(self, now_s: float, message: Any) -> None:
        for severity, text in self._texts.add(
            now_s, message.severity, message.text, message.id, message.chunk_seq
        ):
            self._text(now_s, severity, text)

    def _text(self, now_s: float, severity: int, text: str) -> None:
        self.new_texts.append(StatusText(severity, text))
        self.authority.text(now_s, text)
        if text.startswith("PreArm:"):
            # Each round lists all that fails now: what an earlier one said may be over, or have other numbers in it.
            self.prearm_texts = {t: at for t, at in self.prearm_texts.items() if now_s - at < PREARM_ROUND_S}
            self.prearm_texts[text] = now_s

    # -- findings -------------------------------------------------------------------------------------------

    @property
    def component(self) -> int:
        """The component id of our autopilot, the usual one before its first heartbeat."""
        return mavlink.MAV_COMP_ID_AUTOPILOT1 if self._component is None else self._component

    def is_connected(self, now_s: float) -> bool:
        return self.heartbeat_s is not None and now_s - self.heartbeat_s < LOST_S

    @property
    def estimator_is_good(self) -> bool:
        """Does the estimator vouch for an absolute horizontal position, as far as it says anything?"""
        flags = self.estimator_flags
        return flags is None or flags & (_POS_HORIZ_ABS | _CONST_POS_MODE) == _POS_HORIZ_ABS

    def is_airborne(self, now_s: float) -> bool:
        if not self.armed:
            return False
        heard_s = self.received_s.get(mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE)
        fresh = heard_s is not None and now_s - heard_s < LANDED_STATE_STALE_S
        if fresh and self.landed_state != mavlink.MAV_LANDED_STATE_UNDEFINED:
            return bool(self.landed_state != mavlink.MAV_LANDED_STATE_ON_GROUND)
        return self._was_high

    def position_ned_m(self) -> Vector3 | None:
        if self._position_ned_m is None and self.geodetic is not None:
            self._position_ned_m = self._frame.to_ned(self.geodetic)
        return self._position_ned_m

    def home_ned_m(self) -> Vector3 | None:
        if self._home_ned_m is None and self.home is not None:
            self._home_ned_m = self._frame.to_ned(self.home)
        return self._home_ned_m

    def unready_reason(self, now_s: float) -> str:
        """What stands against arming, "" if nothing that is known does."""
        if not self.is_connected(now_s):
            if self.foreign_system is not None:
                return (
                    f"the autopilot on this link has system id {self.foreign_system}, this drone is "
                    f"{self.system}: set its SYSID_THISMAV (PX4: MAV_SYS_ID) to {self.system}"
                )
            return "no heartbeat of the autopilot: check the cable, the baud rate and autopilot.link"
        if self.flavour is Flavour.UNKNOWN:
            told = FLAVOURS.get(self.autopilot_type)
            if told is not None:
                return f"autopilot.flavour says {self._configured_flavour}, the autopilot itself {told}"
            return f"autopilot type {self.autopilot_type} is neither ArduPilot nor PX4"
        if self.vehicle_type not in COPTER_TYPES:
            return f"vehicle type {self.vehicle_type} (MAV_TYPE) is not a multicopter or helicopter"
        return self._estimates_missing() or self._prearm_missing()

    def _estimates_missing(self) -> str:
        if self.estimator_flags is None and self.flavour is Flavour.ARDUPILOT:
            return "no estimator report yet (EKF_STATUS_REPORT)"
        if not self.estimator_is_good:
            return f"the estimator has no absolute position yet (flags {self.estimator_flags})"
        if self.geodetic is None:
            return "no position yet (GLOBAL_POSITION_INT)"
        if self.home is None:
            return "home is not set yet (HOME_POSITION)"
        return ""

    def _prearm_missing(self) -> str:
        if mavlink.MAVLINK_MSG_ID_SYS_STATUS not in self.received_s:
            return "no system status yet (SYS_STATUS)"
        # PX4's verdict is about the mode that it happens to be in (a manual one fails without a remote control):
        # there the attempt to arm tells.
        if self.prearm is False and self.flavour is Flavour.ARDUPILOT:
            return "; ".join(self.prearm_texts) or "the autopilot's pre-arm checks fail"
        return ""

    def age_s(self, now_s: float, kind: int) -> float | None:
        at_s = self.received_s.get(kind)
        return None if at_s is None else now_s - at_s

    @property
    def is_ours(self) -> bool:
        """The vehicle is in the mode in which it follows our setpoints, and nobody took it from us."""
        if self.flavour is Flavour.UNKNOWN or self.authority.taken_by is not TakenBy.NOBODY:
            return False
        return self.custom_mode == mode_of(self.flavour, Duty.CONTROL)

    def clear_news(self) -> None:
        """The reports so far have told what was new."""
        self.new_texts.clear()
        self.new_values.clear()
        self.new_wind = None

    def report(self, now_s: float, refusal: str, notes: tuple[str, ...]) -> VehicleReport:
        """The snapshot for `now_s`; `refusal` is why the autopilot last refused to arm, if it did."""
        authority = self.authority
        reason = self.unready_reason(now_s)
        attitude_rad = self.attitude_rad
        wind_ned_mps, wind_sd_mps = self.new_wind or (None, None)
        mode = "" if self.custom_mode is None else mode_name(self.flavour, self.custom_mode)
        return VehicleReport(
            connected=self.is_connected(now_s),
            heartbeat_age_s=None if self.heartbeat_s is None else now_s - self.heartbeat_s,
            flavour=self.flavour,
            armed=self.armed,
            airborne=self.is_airborne(now_s),
            mode=mode,
            mode_ours=self.is_ours,
            taken_by=authority.taken_by,
            taken_reason=authority.taken_reason,
            ready=not reason,
            ready_reason=reason or refusal,
            position_ned_m=self.position_ned_m(),
            position_age_s=None if self.position_s is None else now_s - self.position_s,
            velocity_ned_mps=self.velocity_ned_mps,
            attitude_rad=attitude_rad,
            attitude_age_s=self.age_s(now_s, mavlink.MAVLINK_MSG_ID_ATTITUDE),
            heading_rad=None if attitude_rad is None else attitude_rad[2] % math.tau,
            home_ned_m=self.home_ned_m(),
            battery_fraction=self.battery_fraction,
            battery_voltage_v=self.battery_voltage_v,
            wind_ned_mps=wind_ned_mps,
            wind_sd_mps=wind_sd_mps,
            failsafe=authority.failsafe,
            failsafe_reason=authority.failsafe_reason if authority.failsafe else "",
            named_values=tuple(self.new_values),
            new_texts=tuple(self.new_texts),
            notes=notes,
        )
