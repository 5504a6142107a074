"""What keeps a PX4 vehicle on the ground: preflight checks, and disarming by itself.

After the PX4 user guide v1.15, safety configuration: https://docs.px4.io/v1.15/en/config/safety.html.
"""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot.announcer import Announcer
from simvehicle.autopilot.commands import ACCEPTED, REJECTED
from simvehicle.autopilot.flight import Flight
from simvehicle.autopilot.parameters import Parameters
from simvehicle.autopilot.px4_estimate import Px4Estimate
from simvehicle.autopilot.px4_failsafes import Px4Failsafes
from simvehicle.autopilot.px4_mode_control import Px4ModeControl

_INFO, _CRITICAL = mavlink.MAV_SEVERITY_INFO, mavlink.MAV_SEVERITY_CRITICAL
_GYRO_ACC_MAG_BARO = 0x1 | 0x2 | 0x4 | 0x8
_GPS, _MOTORS, _FENCE, _AHRS, _BATTERY, _PREARM = 0x20, 0x8000, 0x100000, 0x200000, 0x2000000, 0x10000000
_ALL = _GYRO_ACC_MAG_BARO | _GPS | _MOTORS | _FENCE | _AHRS | _BATTERY | _PREARM


class Px4Arming:
    """A `HealthReport`."""

    def __init__(
        self,
        flight: Flight,
        parameters: Parameters,
        announcer: Announcer,
        estimate: Px4Estimate,
        modes: Px4ModeControl,
        failsafes: Px4Failsafes,
    ) -> None:
        self._flight = flight
        self._parameters = parameters
        self._announcer = announcer
        self._estimate = estimate
        self._modes = modes
        self._failsafes = failsafes
        self._told_ready = False
        self._landed_since_s = 0.0

    def tell_ready(self) -> None:
        if self._estimate.ready and not self._told_ready:
            self._told_ready = True
            self._announcer.say(_INFO, "Ready for takeoff!")

    def _failures(self) -> list[str]:
        flight, estimate, modes = self._flight, self._estimate, self._modes
        texts: list[str] = []
        if not estimate.gps_detected or not flight.vehicle.estimator.gps:
            texts.append("GPS fix too low")
        if not estimate.position_ok:
            texts.append("No valid global position estimate")
        if not flight.origin_is_set:
            texts.append("Home position not set")
        if self._failsafes.battery_level >= 2:
            texts.append("Critical battery")
        if flight.vehicle.body.failed or flight.crashed:
            texts.append("Motor failure")
        if estimate.ready and (reason := modes.why_not(modes.mode)) is not None:
            texts.append(reason)
        return texts

    def tell_failures(self) -> None:
        for reason in self._failures():
            self._announcer.say(_CRITICAL, f"Preflight Fail: {reason}")

    def arm(self, *, forced: bool) -> int:
        """MAV_RESULT"""
        if self._flight.armed:
            return ACCEPTED
        if not forced and self._failures():
            self._announcer.say(_CRITICAL, "Arming denied: Resolve system health failures first")
            self.tell_failures()
            return REJECTED
        self._announcer.say(_INFO, "Armed by external command")
        self._modes.arm()
        return ACCEPTED

    def disarm_on_the_ground(self, now_s: float) -> None:
        flight, p = self._flight, self._parameters
        flew = self._modes.has_flown
        if not flight.landed or not flight.armed or (flight.wants_to_fly and not flew):
            self._landed_since_s = now_s
        waits_s = p["COM_DISARM_LAND" if flew else "COM_DISARM_PRFLT"]
        if flight.armed and waits_s > 0.0 and now_s - self._landed_since_s > waits_s:
            flight.disarm("Disarmed by landing" if flew else "Disarmed by auto preflight disarming", _INFO)
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
        if self._flight.armed or not self._failures():
            healthy |= _PREARM
        return _ALL, enabled, healthy
