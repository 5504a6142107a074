"""The agent's own vehicle: what every client reads of one, and what only the agent needs of it.

Only messages of one component count: the autopilot of our own system id (`flightstack.mavlink.role`).
"""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.autopilot.authority import Authority
from flightstack.autopilot.report import TakenBy, VehicleReport
from flightstack.mavlink import vehicle_state
from flightstack.mavlink.codec import MavlinkMessage
from flightstack.mavlink.modes import COPTER_TYPES, FLAVOURS, Duty, Flavour, mode_of, way_down
from flightstack.mavlink.obstacle_distance import Ranges, ranges_of
from flightstack.mavlink.role import AUTOPILOT_COMPONENT, Role, role_of, why_not_flown
from flightstack.mavlink.statustext import StatusText
from flightstack.mavlink.vehicle_state import (
    HEARTBEAT_LOST_S,
    VehicleState,
)
from mission.geometry.frames import LocalFrame, Vector3, wind_from

FIRST_HEARTBEAT_S = 3.0
"""Heartbeats come once a second: so long after the start their absence means nothing."""
NO_HEARTBEAT_YET = "no heartbeat of the autopilot yet"
NO_HEARTBEAT = "no heartbeat of the autopilot: check the cable, the baud rate and autopilot.link"
PREARM_ROUND_S = 5.0
"""ArduPilot tells what keeps it from arming every 30 s, all of it at once."""
MOVING_AIR_MPS = 0.01
"""A WIND of exactly nothing is ArduCopter's way of saying that it does not estimate wind."""

RANGES_FRESH_S = 1.0
"""A look around that is older says nothing of what is around now."""

STATES = vehicle_state.STATES | {
    mavlink.MAVLINK_MSG_ID_WIND,
    mavlink.MAVLINK_MSG_ID_WIND_COV,
    mavlink.MAVLINK_MSG_ID_OBSTACLE_DISTANCE,
}
EVENTS = vehicle_state.EVENTS | {
    mavlink.MAVLINK_MSG_ID_PARAM_VALUE,
    mavlink.MAVLINK_MSG_ID_PARAM_ERROR,
    mavlink.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT,
    mavlink.MAVLINK_MSG_ID_MISSION_COUNT,
    mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT,
    mavlink.MAVLINK_MSG_ID_MISSION_ACK,
}
"""With STATES the only messages that the agent decodes."""


class Telemetry(VehicleState):
    """Takes messages in `accept`; everything else reads its attributes."""

    def __init__(self, system: int, frame: LocalFrame, flavour: Flavour) -> None:
        """`flavour`: as configured; an autopilot of another one is none that we can fly. UNKNOWN: any."""
        self._configured_flavour = flavour
        self._chosen = False
        self._listening_since_s: float | None = None
        super().__init__(system, AUTOPILOT_COMPONENT, frame)
        self._handlers |= {
            mavlink.MAVLINK_MSG_ID_WIND: self._wind_from,
            mavlink.MAVLINK_MSG_ID_WIND_COV: self._wind_vector,
            mavlink.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT: self._named_value,
        }
        self.authority = Authority()
        self._unfit: tuple[str, float] | None = None
        """Why what spoke in our autopilot's place is not taken for it, and when it did."""
        self.new_values: list[tuple[str, float]] = []
        self.ranges: tuple[float, Ranges] | None = None
        """The newest look around and when it came."""
        self.new_wind: tuple[Vector3, float | None] | None = None
        """The newest wind estimate (NED, m/s) and its standard deviation since `clear_news`."""

    def flush(self, now_s: float) -> None:
        if self._listening_since_s is None:
            self._listening_since_s = now_s
        super().flush(now_s)

    def _forget(self) -> None:
        super()._forget()
        self.has_flown = False
        """In the air at least once since it was armed."""
        self.prearm_texts: dict[str, float] = {}
        """ArduPilot's newest round of "PreArm: …" texts, and when each came."""

    # -- messages -------------------------------------------------------------------------------------------

    def hear(self, now_s: float, message: MavlinkMessage) -> bool:
        """Take one message of the link in; False if it is not from our autopilot."""
        if message.kind == mavlink.MAVLINK_MSG_ID_HEARTBEAT and not self._choose(now_s, message):
            return False
        if message.kind == mavlink.MAVLINK_MSG_ID_OBSTACLE_DISTANCE:
            self._look_around(now_s, message)
            return False
        if not self._chosen or (message.system, message.component) != (self.system, self.component):
            return False
        self.accept(now_s, message)
        return True

    def _look_around(self, now_s: float, message: MavlinkMessage) -> None:
        """Of any component of our own vehicle: a range finder is one of its own, or the autopilot's."""
        if message.system != self.system:
            return
        ranges = ranges_of(message.fields, None if self.attitude_rad is None else self.attitude_rad[2])
        if ranges is not None:
            self.ranges = (now_s, ranges)

    def _choose(self, now_s: float, message: MavlinkMessage) -> bool:
        """Is this the heartbeat of our autopilot?"""
        if message.component != self.component:
            return False
        role = role_of(message.system, message.component, message.fields)
        if message.system != self.system:
            if role is Role.AUTOPILOT:
                text = (
                    f"the autopilot on this link has system id {message.system}, this drone is {self.system}"
                )
                mend = f"set its SYSID_THISMAV (PX4: MAV_SYS_ID) to {self.system}"
                self._unfit = (f"{text}: {mend}", now_s)
            return False
        if role is not Role.AUTOPILOT:
            if role is Role.OTHER:
                self._unfit = (why_not_flown(message.fields), now_s)
            return False
        if not self.takes(now_s, message.fields):
            return False
        self._chosen = True
        return True

    def _heartbeat(self, now_s: float, fields: Any) -> None:
        super()._heartbeat(now_s, fields)
        if self._configured_flavour not in (Flavour.UNKNOWN, self.flavour) or not self._is_copter:
            self.flavour = Flavour.UNKNOWN
        if not self.armed:
            self.has_flown = False
        self.has_flown |= self.is_airborne(now_s)
        self.authority.heartbeat(
            now_s, self.flavour, self.armed, int(fields.custom_mode), fields.system_status
        )

    def _extended_sys_state(self, now_s: float, fields: Any) -> None:
        super()._extended_sys_state(now_s, fields)
        self.has_flown |= self.is_airborne(now_s)

    def _sys_status(self, now_s: float, fields: Any) -> None:
        super()._sys_status(now_s, fields)
        if self.prearm:
            self.prearm_texts.clear()

    def _wind_from(self, _now_s: float, fields: Any) -> None:
        values = (fields.speed, fields.direction, fields.speed_z)
        if all(map(math.isfinite, values)) and fields.speed > MOVING_AIR_MPS:
            # ArduPilot's speed is the length of the whole vector, its direction that of the horizontal part.
            horizontal_mps = math.sqrt(max(fields.speed**2 - fields.speed_z**2, 0.0))
            north_mps, east_mps, _ = wind_from(horizontal_mps, fields.direction)
            self.new_wind = ((north_mps, east_mps, fields.speed_z), None)

    def _wind_vector(self, _now_s: float, fields: Any) -> None:
        north_mps, east_mps, down_mps = fields.wind_x, fields.wind_y, fields.wind_z
        if not (math.isfinite(north_mps) and math.isfinite(east_mps)):
            return
        if math.hypot(north_mps, east_mps) > MOVING_AIR_MPS:
            down_mps = down_mps if math.isfinite(down_mps) else 0.0
            # horiz_accuracy is the estimate's own uncertainty (0: unknown); var_horiz is the gusts', as a
            # standard deviation in spite of its name.
            sds_mps = [s for s in (fields.horiz_accuracy, fields.var_horiz) if math.isfinite(s) and s > 0.0]
            self.new_wind = ((north_mps, east_mps, down_mps), max(sds_mps, default=None))

    def _named_value(self, _now_s: float, fields: Any) -> None:
        if math.isfinite(fields.value):
            self.new_values.append((fields.name, fields.value))

    def _text(self, now_s: float, text: StatusText) -> None:
        super()._text(now_s, text)
        self.authority.text(now_s, text.text)
        if text.text.startswith("PreArm:"):
            # Each round lists all that fails now: what an earlier one said may be over, or have other numbers in it.
            self.prearm_texts = {t: at for t, at in self.prearm_texts.items() if now_s - at < PREARM_ROUND_S}
            self.prearm_texts[text.text] = now_s

    # -- findings -------------------------------------------------------------------------------------------

    def is_airborne(self, now_s: float) -> bool:
        """Where nothing tells, an armed vehicle stands on the ground: that is where it is armed."""
        return bool(self.flies(now_s))

    @property
    def _is_copter(self) -> bool:
        """Whether we know how to fly it: what has wings is heard, and asked for nothing."""
        return self.vehicle_type in COPTER_TYPES

    def unready_reason(self, now_s: float) -> str:
        """What stands against arming, "" if nothing that is known does."""
        if not self.is_connected(now_s):
            # Once ours was heard, others that pass by explain nothing.
            if self._unfit is not None and not self._chosen and now_s - self._unfit[1] < HEARTBEAT_LOST_S:
                return self._unfit[0]
            if self._listening_since_s is not None and now_s - self._listening_since_s < FIRST_HEARTBEAT_S:
                return NO_HEARTBEAT_YET
            return NO_HEARTBEAT
        if not self._is_copter:
            return f"vehicle type {self.vehicle_type} (MAV_TYPE) is not a multicopter or helicopter"
        if self.flavour is Flavour.UNKNOWN:
            told = FLAVOURS[self.autopilot_type]
            return f"autopilot.flavour says {self._configured_flavour}, the autopilot itself {told}"
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
        # PX4's verdict is about the mode that it happens to be in (a manual one fails without a remote control): its
        # report of all modes tells about ours, and where it has sent none the attempt to arm does.
        if self.flavour is Flavour.PX4:
            return "; ".join(self.events.why_not_arm(mode_of(Flavour.PX4, Duty.CONTROL), streaming=False))
        if self.prearm is False:
            return "; ".join(self.prearm_texts) or "the autopilot's pre-arm checks fail"
        return ""

    @property
    def is_ours(self) -> bool:
        """The vehicle is in the mode in which it follows our setpoints, or comes back to it by itself as soon as it
        gets them again, and nobody took it from us."""
        if self.authority.taken_by is not TakenBy.NOBODY:
            return False
        return self.in_mode(Duty.CONTROL) or self.authority.resuming

    def clear_news(self) -> None:
        """The reports so far have told what was new."""
        self.new_texts.clear()
        self.new_values.clear()
        self.new_wind = None

    def report(
        self, now_s: float, refusal: str, notes: tuple[str, ...], stood_still_s: float
    ) -> VehicleReport:
        """The snapshot for `now_s`; `refusal` is why the autopilot last refused to arm, if it did."""
        authority = self.authority
        reason = self.unready_reason(now_s)
        attitude_rad = self.attitude_rad
        received_s = self.received_s.get(mavlink.MAVLINK_MSG_ID_ATTITUDE)
        wind_ned_mps, wind_sd_mps = self.new_wind or (None, None)
        ranges, ranges_age_s = None, None
        if self.ranges is not None:
            ranges_age_s = now_s - self.ranges[0]
            ranges = self.ranges[1] if ranges_age_s <= RANGES_FRESH_S else None
        return VehicleReport(
            connected=self.is_connected(now_s),
            heartbeat_age_s=None if self.heartbeat_s is None else now_s - self.heartbeat_s,
            flavour=self.flavour,
            armed=self.armed,
            airborne=self.is_airborne(now_s),
            mode=self.mode,
            mode_ours=self.is_ours,
            way_down=None if self.custom_mode is None else way_down(self.flavour, self.custom_mode),
            taken_by=authority.taken_by,
            taken_reason=authority.taken_reason,
            ready=not reason,
            ready_reason=reason or refusal,
            position_ned_m=self.position_ned_m,
            position_age_s=None if self.position_s is None else now_s - self.position_s,
            velocity_ned_mps=self.velocity_ned_mps,
            attitude_rad=attitude_rad,
            attitude_age_s=None if received_s is None else now_s - received_s,
            heading_rad=None if attitude_rad is None else attitude_rad[2] % math.tau,
            home_ned_m=self.home_ned_m,
            battery_fraction=self.battery_fraction,
            battery_voltage_v=self.battery_voltage_v,
            wind_ned_mps=wind_ned_mps,
            wind_sd_mps=wind_sd_mps,
            crash=self.crash,
            failsafe=authority.failsafe,
            failsafe_reason=authority.failsafe_reason if authority.failsafe else "",
            ranges=ranges,
            ranges_age_s=ranges_age_s,
            named_values=tuple(self.new_values),
            new_texts=tuple(self.new_texts),
            stood_still_s=stood_still_s,
            notes=notes,
        )
