"""What keeps a PX4 vehicle on the ground: preflight checks, and disarming by itself.

After the PX4 user guide, safety configuration (https://docs.px4.io/v1.15/en/config/safety.html), and a recorded one.
"""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot.commands import ACCEPTED, REJECTED
from simvehicle.autopilot.flight import Flight
from simvehicle.autopilot.parameters import Parameters
from simvehicle.autopilot.px4_estimate import Px4Estimate
from simvehicle.autopilot.px4_failsafes import Px4Failsafes
from simvehicle.autopilot.px4_mode_control import Px4ModeControl
from simvehicle.autopilot.px4_report import Px4Report
from simvehicle.autopilot.px4_voice import Px4Voice

_INFO, _CRITICAL = mavlink.MAV_SEVERITY_INFO, mavlink.MAV_SEVERITY_CRITICAL
_GYRO_ACC_MAG_BARO = 0x1 | 0x2 | 0x4 | 0x8
_GPS, _MOTORS, _FENCE, _AHRS, _BATTERY, _PREARM = 0x20, 0x8000, 0x100000, 0x200000, 0x2000000, 0x10000000
_ALL = _GYRO_ACC_MAG_BARO | _GPS | _MOTORS | _FENCE | _AHRS | _BATTERY | _PREARM
_EXTERNAL_COMMAND, _LANDING, _INACTION = 4, 6, 7
"""Reasons for arming and disarming."""


class Px4Arming:
    """A `HealthReport`."""

    def __init__(
        self,
        flight: Flight,
        parameters: Parameters,
        estimate: Px4Estimate,
        modes: Px4ModeControl,
        failsafes: Px4Failsafes,
        report: Px4Report,
        voice: Px4Voice,
    ) -> None:
        self._flight = flight
        self._parameters = parameters
        self._estimate = estimate
        self._modes = modes
        self._failsafes = failsafes
        self._report = report
        self._voice = voice
        self._landed_since_s = 0.0

    def can_arm(self) -> bool:
        """In the mode that it happens to be in."""
        return self._report.can_arm(self._modes.mode)

    def arm(self, *, forced: bool) -> int:
        """MAV_RESULT"""
        if self._flight.armed:
            return ACCEPTED
        if not forced and not self.can_arm():
            denied = "Arming denied: Resolve system health failures first"
            self._voice.tell("commander_arm_denied_resolve_failures", _CRITICAL, text=denied)
            return REJECTED
        reason = bytes([_EXTERNAL_COMMAND])
        self._voice.tell("commander_armed_by", _INFO, reason, text="Armed by external command")
        self._modes.arm()
        return ACCEPTED

    def disarm(self) -> None:
        """Somebody wants it."""
        if self._flight.armed:
            self._flight.disarm("Disarmed by external command\t", _INFO)
            self._voice.tell("commander_disarmed_by", _INFO, bytes([_EXTERNAL_COMMAND]))

    def disarm_on_the_ground(self, now_s: float) -> None:
        flight, p = self._flight, self._parameters
        flew = self._modes.has_flown
        if not flight.landed or not flight.armed or (flight.wants_to_fly and not flew):
            self._landed_since_s = now_s
        waits_s = p["COM_DISARM_LAND" if flew else "COM_DISARM_PRFLT"]
        if flight.armed and waits_s > 0.0 and now_s - self._landed_since_s > waits_s:
            flight.disarm(
                "Disarmed by landing\t" if flew else "Disarmed by auto preflight disarming\t", _INFO
            )
            self._voice.tell("commander_disarmed_by", _INFO, bytes([_LANDING if flew else _INACTION]))
            flight.failsafe = False

    def health(self) -> tuple[int, int, int]:
        enabled = _ALL if self._parameters["GF_ACTION"] else _ALL & ~_FENCE
        healthy = _GYRO_ACC_MAG_BARO | _MOTORS | _FENCE
        if self._flight.vehicle.estimator.gps and self._estimate.gps_detected:
            healthy |= _GPS
        if self._estimate.position_ok:
            healthy |= _AHRS
        if self._failsafes.battery_level < 2:
            healthy |= _BATTERY
        if self._failsafes.breached:
            healthy &= ~_FENCE
        if self._flight.armed or self.can_arm():
            healthy |= _PREARM
        return _ALL, enabled, healthy
