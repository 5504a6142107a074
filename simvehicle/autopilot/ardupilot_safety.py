"""What keeps an ArduCopter on the ground and what brings it down: boot, arming checks, failsafes, fence.

Texts, order and delays are those of the recorded flight of ArduCopter 4.6.3 where it shows them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot import telemetry_messages as streams
from simvehicle.autopilot.ardupilot_modes import ARMABLE, NEED_POSITION, ArduPilotMode
from simvehicle.autopilot.fences import outside
from simvehicle.autopilot.maneuvers import Land

if TYPE_CHECKING:
    from simvehicle.autopilot.ardupilot import ArduPilot

_INFO, _NOTICE, _WARNING, _CRITICAL = (
    mavlink.MAV_SEVERITY_INFO,
    mavlink.MAV_SEVERITY_NOTICE,
    mavlink.MAV_SEVERITY_WARNING,
    mavlink.MAV_SEVERITY_CRITICAL,
)
_READY_S = 41.5
"""When the recorded vehicle was ready; its boot is stretched to `ready_after_s`."""
_ALIGNED_S, _GPS_S, _ORIGIN_S = 5.8, 9.7, 19.9
_BOOT_TEXTS = (
    (0.2, "Calibrating barometer"),
    (1.8, "Barometer 1 calibration complete"),
    (1.8, "Barometer 2 calibration complete"),
    (2.3, "ArduPilot Ready"),
    (2.3, "AHRS: DCM active"),
    (2.6, "RC7: SaveWaypoint LOW"),
    (4.3, "EKF3 IMU0 initialised"),
    (4.3, "EKF3 IMU1 initialised"),
    (4.3, "AHRS: EKF3 active"),
    (5.7, "EKF3 IMU0 tilt alignment complete"),
    (5.7, "EKF3 IMU1 tilt alignment complete"),
    (_ALIGNED_S, "EKF3 IMU0 MAG0 initial yaw alignment complete"),
    (_ALIGNED_S, "EKF3 IMU1 MAG0 initial yaw alignment complete"),
    (_GPS_S, "GPS 1: probing for u-blox at 230400 baud"),
    (_GPS_S, "GPS 1: detected u-blox"),
    (_ORIGIN_S, "EKF3 IMU0 origin set"),
    (_ORIGIN_S, "Field Elevation Set: {elevation:.0f}m"),
    (_ORIGIN_S + 0.2, "EKF3 IMU1 origin set"),
    (41.3, "EKF3 IMU0 is using GPS"),
    (_READY_S, "EKF3 IMU1 is using GPS"),
)
_PREARM_EVERY_S = 30.0
_TIMESYNC_EVERY_S = 10.0
_GPS_GONE_S = 8.0
_GPS_BACK_S = 1.2
_LAND_PAUSE_S = 4.0
"""Between the failsafe's LAND and the descent."""
_YAW_ALIGNED_ABOVE_M = 2.5

_PRESENT = 0x5371FC0F
_GPS_BIT, _XY_BITS, _LOGGING, _FENCE = 0x20, 0x6000, 0x01000000, 0x00100000
_AHRS, _BATTERY, _PREARM = 0x00200000, 0x02000000, 0x10000000
_ENABLED, _HEALTHY = 0x52419C0F, 0x4751FC0F
"""SYS_STATUS sensor bits as recorded; bits of the list above are added and taken away."""

_EKF_NOT_YET, _EKF_STILL, _EKF_GOOD, _EKF_LOST = 1024, 167, 831, 37


class ArduPilotSafety:
    """One per vehicle; `step` is called ten times a second."""

    def __init__(self, autopilot: ArduPilot) -> None:
        self._a = autopilot
        self._stretch = autopilot.ready_after_s / _READY_S
        self._texts = list(_BOOT_TEXTS)
        self._prearm_due_s = 30.3
        self._timesync_due_s = 9.9
        self.booted = False
        self.gps_detected = False
        self.ekf_failed = False
        self._lane_switched_s: float | None = None
        self._gps_good_s: float | None = None
        self._yaw_aligned = False
        self._battery_low_s: float | None = None
        self._battery_critical_s: float | None = None
        self.battery_low = False
        self.battery_critical = False
        self._gcs_lost = False
        self.breached = 0
        """MAV: FENCE_BREACH_NONE, or what was breached."""
        self._breaches = 0
        self._breach_time_ms = 0
        self._landed_since_s = 0.0
        self._prearm_soon_s: float | None = None

    @property
    def time_left_s(self) -> float:
        """Until the vehicle is ready."""
        return self._a.ready_after_s - self._a.time_s

    def _reached(self, recorded_s: float) -> bool:
        return self._a.time_s + 1e-9 >= recorded_s * self._stretch

    # -- every tenth of a second ----------------------------------------------------------------------------

    def step(self, now_s: float) -> None:
        self._boot()
        time_s = self._a.time_s
        if time_s >= self._timesync_due_s:
            self._timesync_due_s += _TIMESYNC_EVERY_S
            self._a.broadcast(mavlink.MAVLink_timesync_message(0, int(time_s * 1e9) + 1))
        self._prearm_texts(time_s)
        self._gps(now_s)
        self._battery(now_s)
        self._ground_station(now_s)
        self._fence()
        self._disarm_on_the_ground(now_s)
        a = self._a
        a.failsafe = self.ekf_failed or self.battery_low or self.battery_critical or self._gcs_lost

    def _boot(self) -> None:
        a = self._a
        self.booted = True
        while self._texts and self._reached(self._texts[0][0]):
            _, text = self._texts.pop(0)
            a.say(_INFO, text.format(elevation=a.world.frame.origin.amsl_m))
        self.gps_detected = self._reached(_GPS_S)
        if not a.origin_is_set and self._reached(_ORIGIN_S):
            a.set_origin()
            self._tell_home()
        elif a.origin_is_set and not a.armed and not self.ekf_failed:
            a.home_m = a.nav.home_m = a.nav.position_m  # until it is armed home is where it stands

    def _tell_home(self) -> None:
        for message_id in (mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, mavlink.MAVLINK_MSG_ID_HOME_POSITION):
            message = streams.build(self._a, message_id)
            if message is not None:
                self._a.broadcast(message)

    def _prearm_texts(self, time_s: float) -> None:
        soon = self._prearm_soon_s is not None and time_s >= self._prearm_soon_s
        if not (soon or time_s >= self._prearm_due_s):
            return
        self._prearm_soon_s = None
        if time_s >= self._prearm_due_s:
            self._prearm_due_s += _PREARM_EVERY_S
        if not self._a.armed:
            for text in self.failures():
                self._a.say(_CRITICAL, f"PreArm: {text}")

    def failures(self) -> list[str]:
        """Why it cannot be armed now."""
        a = self._a
        texts: list[str] = []
        if not self._reached(_ALIGNED_S):
            texts += [
                "Need Alt Estimate",
                "Accels inconsistent",
                "EKF attitude is bad",
                "AHRS: waiting for home",
            ]
        elif not self._reached(_ORIGIN_S):
            texts.append("AHRS: waiting for home")
        elif not a.position_ok:
            texts.append("Need Position Estimate")
        if self.battery_low or self.battery_critical:
            kind = "critical" if self.battery_critical else "low"
            texts += [f"Battery 1 {kind} voltage failsafe", "Battery failsafe"]
        if self.breached:
            texts.append("Vehicle breaching Polygon fence")
        if a.body.failed or a.crashed:
            texts.append("Motors: SIM motor failed")
        return texts

    def try_to_arm(self, *, forced: bool) -> bool:
        a = self._a
        if a.armed:
            return True
        failures = [] if forced or not a.parameters["ARMING_CHECK"] else self.failures()
        if a.mode not in ARMABLE:
            failures.append("Mode not armable")
        if failures:
            for text in failures:
                a.say(_CRITICAL, f"Arm: {text}")
            return False
        a.say(_INFO, "Arming motors")
        a.arm()
        self._tell_home()
        self._landed_since_s = a.armed_s
        self._yaw_aligned = False
        a.enter()
        return True

    def disarmed(self) -> None:
        a = self._a
        if self._lane_switched_s is not None:
            self._lane_switched_s = None
            a.say(_WARNING, "EKF primary changed:0")
        self.breached = 0
        self._prearm_soon_s = a.time_s + 1.0

    def _disarm_on_the_ground(self, now_s: float) -> None:
        a = self._a
        if not a.landed or a.motion_wants_to_fly:
            self._landed_since_s = now_s
        delay_s = a.parameters["DISARM_DELAY"]
        if a.armed and delay_s > 0.0 and now_s - self._landed_since_s > delay_s:
            a.disarm("Disarming motors")

    # -- failsafes ------------------------------------------------------------------------------------------

    def _gps(self, now_s: float) -> None:
        a = self._a
        if not self._yaw_aligned and a.armed and a.above_home_m > _YAW_ALIGNED_ABOVE_M:
            self._yaw_aligned = True
            for imu in (0, 1):
                a.say(_INFO, f"EKF3 IMU{imu} MAG0 in-flight yaw alignment complete")
        if a.estimator.gps:
            self._gps_good_s = now_s if self._gps_good_s is None else self._gps_good_s
            if self.ekf_failed and now_s - self._gps_good_s > _GPS_BACK_S:
                self.ekf_failed = False
                a.say(_CRITICAL, "EKF Failsafe Cleared")
            return
        self._gps_good_s = None
        if not a.ready or a.estimator.lost_for_s(now_s) < _GPS_GONE_S or self.ekf_failed:
            return
        if self._lane_switched_s is None:
            self._lane_switched_s = now_s
            a.say(_CRITICAL, "EKF3 lane switch 1")
            a.say(_WARNING, "EKF primary changed:1")
        elif now_s > self._lane_switched_s:
            self.ekf_failed = True
            a.say(_CRITICAL, "EKF variance")
            self._ekf_failsafe()

    def _ekf_failsafe(self) -> None:
        a, action = self._a, int(self._a.parameters["FS_EKF_ACTION"])
        if not a.armed or a.landed or action == 0:
            return
        mode = ArduPilotMode.ALT_HOLD if action == 2 else ArduPilotMode.LAND
        if a.mode is ArduPilotMode.LAND:
            a.maneuver = Land(with_position=False)
        elif (a.mode in NEED_POSITION or action == 3) and a.set_mode(mode):
            if mode is ArduPilotMode.LAND:
                a.maneuver = Land(with_position=False, pause_s=_LAND_PAUSE_S)
            a.say(_CRITICAL, f"EKF Failsafe: changed to {mode.name} Mode")

    def _battery(self, now_s: float) -> None:
        a, p = self._a, self._a.parameters
        volts, left_mah = a.battery.volts, p["BATT_CAPACITY"] - a.battery.used_mah
        low = volts < p["BATT_LOW_VOLT"] or left_mah < p["BATT_LOW_MAH"]
        critical = volts < p["BATT_CRT_VOLT"] or left_mah < p["BATT_CRT_MAH"]
        self._battery_low_s = (now_s if self._battery_low_s is None else self._battery_low_s) if low else None
        self._battery_critical_s = (
            (now_s if self._battery_critical_s is None else self._battery_critical_s) if critical else None
        )
        timer_s = p["BATT_LOW_TIMER"]
        if self._battery_critical_s is not None and not self.battery_critical:
            if now_s - self._battery_critical_s >= timer_s:
                self.battery_critical = self.battery_low = True
                self._battery_failsafe("critical", int(p["BATT_FS_CRT_ACT"]))
        elif (
            self._battery_low_s is not None
            and not self.battery_low
            and now_s - self._battery_low_s >= timer_s
        ):
            self.battery_low = True
            self._battery_failsafe("low", int(p["BATT_FS_LOW_ACT"]))

    def _battery_failsafe(self, kind: str, action: int) -> None:
        a = self._a
        used_mah = a.battery.used_mah
        a.say(_WARNING, f"Battery 1 is {kind} {a.battery.volts:.2f}V used {used_mah:.0f} mAh")
        a.say(_WARNING, "Battery Failsafe")
        self._act(
            {
                1: ArduPilotMode.LAND,
                2: ArduPilotMode.RTL,
                3: ArduPilotMode.SMART_RTL,
                4: ArduPilotMode.SMART_RTL,
                6: ArduPilotMode.RTL,
                7: ArduPilotMode.BRAKE,
            }.get(action)
        )
        if action == 5:
            a.disarm("Battery Failsafe: terminating", _CRITICAL)

    def _act(self, mode: ArduPilotMode | None) -> None:
        """Enter a failsafe's mode, or LAND where that one cannot be. A landing goes on only if FS_OPTIONS says so."""
        a = self._a
        goes_on = a.mode is ArduPilotMode.LAND and int(a.parameters["FS_OPTIONS"]) & 8
        if mode is None or not a.armed or a.mode is mode or goes_on:
            return
        if a.landed:
            a.disarm("Disarming motors")
        elif not a.set_mode(mode):
            a.set_mode(ArduPilotMode.LAND)

    def _ground_station(self, now_s: float) -> None:
        a, p = self._a, self._a.parameters
        heard_s = a.gcs_heard_s.get(int(p["SYSID_MYGCS"]))
        if not p["FS_GCS_ENABLE"] or heard_s is None:
            return
        lost = now_s - heard_s > p["FS_GCS_TIMEOUT"]
        if lost and not self._gcs_lost:
            self._gcs_lost = True
            a.say(_WARNING, "GCS Failsafe")
            pilots = int(p["FS_OPTIONS"]) & 16 and a.mode in (
                ArduPilotMode.STABILIZE,
                ArduPilotMode.ALT_HOLD,
                ArduPilotMode.LOITER,
            )
            if not pilots:
                actions = {
                    1: ArduPilotMode.RTL,
                    2: ArduPilotMode.RTL,
                    3: ArduPilotMode.SMART_RTL,
                    4: ArduPilotMode.SMART_RTL,
                    5: ArduPilotMode.LAND,
                    6: ArduPilotMode.RTL,
                    7: ArduPilotMode.BRAKE,
                }
                self._act(actions.get(int(p["FS_GCS_ENABLE"])))
        elif not lost and self._gcs_lost:
            self._gcs_lost = False
            a.say(_WARNING, "GCS Failsafe Cleared")

    def _fence(self) -> None:
        a, p = self._a, self._a.parameters
        if not p["FENCE_ENABLE"] or not a.armed:
            return
        north, east, _ = a.nav.position_m
        kinds = int(p["FENCE_TYPE"])
        union = bool(int(p["FENCE_OPTIONS"]) & 2)
        now, name = 0, ""
        if kinds & 1 and a.above_home_m > p["FENCE_ALT_MAX"]:
            now, name = mavlink.FENCE_BREACH_MAXALT, "Max Alt"
        elif kinds & 2 and math.dist((north, east), a.nav.home_m[:2]) > p["FENCE_RADIUS"]:
            now, name = mavlink.FENCE_BREACH_BOUNDARY, "Circle"
        elif kinds & 4 and outside(a.fence, north, east, any_inclusion=union):
            now, name = mavlink.FENCE_BREACH_BOUNDARY, "Polygon"
        elif kinds & 8 and not a.landed and a.above_home_m < p["FENCE_ALT_MIN"]:
            now, name = mavlink.FENCE_BREACH_MINALT, "Min Alt"
        before, self.breached = self.breached, int(now)
        if now and not before:
            self._breaches += 1
            self._breach_time_ms = int(a.time_s * 1000)
            a.say(_NOTICE, f"{name} fence breached")
            a.say(_INFO, "Manual recovery started")
            action = int(p["FENCE_ACTION"])
            self._act(
                {
                    1: ArduPilotMode.RTL,
                    2: ArduPilotMode.LAND,
                    3: ArduPilotMode.SMART_RTL,
                    4: ArduPilotMode.BRAKE,
                    5: ArduPilotMode.SMART_RTL,
                }.get(action)
            )
            a.announce_mode()
            a.broadcast(self.fence_status())
        elif before and not now:
            a.say(_NOTICE, "Fence breach cleared")

    # -- what messages tell ---------------------------------------------------------------------------------

    def fence_status(self) -> Any:
        breached = self.breached
        return mavlink.MAVLink_fence_status_message(
            1 if breached else 0, self._breaches, breached, self._breach_time_ms, 0
        )

    def estimator_flags(self) -> int:
        if self.ekf_failed:
            return _EKF_LOST
        if self.time_left_s <= 0.0:
            return _EKF_GOOD
        return _EKF_STILL if self._reached(_ALIGNED_S) else _EKF_NOT_YET

    def health(self) -> tuple[int, int, int]:
        a = self._a
        present, enabled, healthy = _PRESENT, _ENABLED, _HEALTHY
        if self.gps_detected:
            present, enabled = present | _GPS_BIT, enabled | _GPS_BIT
            healthy |= _GPS_BIT if a.estimator.gps else 0
        if a.mode not in (ArduPilotMode.STABILIZE, ArduPilotMode.ALT_HOLD):
            enabled |= 0x2000 if self.ekf_failed else _XY_BITS
        if self.ekf_failed:
            healthy &= ~0x4000
        if a.origin_is_set:
            enabled, healthy = enabled | _AHRS, healthy | _AHRS
        if a.armed:
            enabled |= _LOGGING
        if a.parameters["FENCE_ENABLE"]:
            enabled |= _FENCE
        if self.breached:
            healthy &= ~_FENCE
        if self.battery_low:
            healthy &= ~_BATTERY
        if a.armed or (a.ready and not self.failures()):
            healthy |= _PREARM
        return present, enabled, healthy
