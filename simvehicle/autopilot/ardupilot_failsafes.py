"""What brings an ArduCopter home or down by itself: estimator, battery, ground station, fence.

Texts, order and delays are those of the recorded flight of ArduCopter 4.6.3 where it shows them.
"""

from __future__ import annotations

from collections.abc import Mapping

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot.announcer import Announcer
from simvehicle.autopilot.ardupilot_estimate import ArduPilotEstimate
from simvehicle.autopilot.ardupilot_fence import ArduPilotFence
from simvehicle.autopilot.ardupilot_mode_control import ArduPilotModeControl
from simvehicle.autopilot.ardupilot_modes import NEED_POSITION, ArduPilotMode
from simvehicle.autopilot.flight import Flight
from simvehicle.autopilot.maneuvers import Land
from simvehicle.autopilot.parameters import Parameters

_INFO, _WARNING, _CRITICAL = (
    mavlink.MAV_SEVERITY_INFO,
    mavlink.MAV_SEVERITY_WARNING,
    mavlink.MAV_SEVERITY_CRITICAL,
)
_GPS_GONE_S = 8.0
_GPS_BACK_S = 1.2
_LAND_PAUSE_S = 4.0
"""Between the failsafe's LAND and the descent."""
_YAW_ALIGNED_ABOVE_M = 2.5
_BATTERY_ACTIONS = {
    1: ArduPilotMode.LAND,
    2: ArduPilotMode.RTL,
    3: ArduPilotMode.SMART_RTL,
    4: ArduPilotMode.SMART_RTL,
    6: ArduPilotMode.RTL,
    7: ArduPilotMode.BRAKE,
}
"""BATT_FS_LOW_ACT and BATT_FS_CRT_ACT"""
_GROUND_STATION_ACTIONS = {
    1: ArduPilotMode.RTL,
    2: ArduPilotMode.RTL,
    3: ArduPilotMode.SMART_RTL,
    4: ArduPilotMode.SMART_RTL,
    5: ArduPilotMode.LAND,
    6: ArduPilotMode.RTL,
    7: ArduPilotMode.BRAKE,
}
"""FS_GCS_ENABLE"""
_REMOTE_CONTROL_ACTIONS = {
    1: ArduPilotMode.RTL,
    2: ArduPilotMode.RTL,
    3: ArduPilotMode.LAND,
    4: ArduPilotMode.SMART_RTL,
    5: ArduPilotMode.SMART_RTL,
    6: ArduPilotMode.RTL,
    7: ArduPilotMode.BRAKE,
}
"""FS_THR_ENABLE (https://ardupilot.org/copter/docs/radio-failsafe.html)"""
_FLIES_ON_GUIDED = 4
"""Bit of FS_OPTIONS: the loss of the remote control does not end GUIDED."""


class ArduPilotFailsafes:
    """One per vehicle; `step` is called ten times a second."""

    def __init__(
        self,
        flight: Flight,
        parameters: Parameters,
        announcer: Announcer,
        estimate: ArduPilotEstimate,
        modes: ArduPilotModeControl,
        fence: ArduPilotFence,
        ground_heard_s: Mapping[int, float],
    ) -> None:
        self._flight = flight
        self._parameters = parameters
        self._announcer = announcer
        self._estimate = estimate
        self._modes = modes
        self._fence = fence
        self._ground_heard_s = ground_heard_s
        self._lane_switched_s: float | None = None
        self._gps_good_s: float | None = None
        self._yaw_aligned = False
        self._battery_low_s: float | None = None
        self._battery_critical_s: float | None = None
        self.battery_low = False
        self.battery_critical = False
        self._ground_lost = False
        self.unheard: set[str] = set()
        """What is missed on purpose."""
        self._remote_lost = False
        flight.after_disarming.append(self._disarmed)

    def step(self, now_s: float) -> None:
        self._gps(now_s)
        self._battery(now_s)
        self._ground_station(now_s)
        self._remote_control()
        self._fence.step(self._act)

    @property
    def active(self) -> bool:
        """One of them, the fence's excepted, has the vehicle."""
        battery = self.battery_low or self.battery_critical
        return self._estimate.lost or battery or self._ground_lost or self._remote_lost

    def armed(self) -> None:
        self._yaw_aligned = False

    def _disarmed(self) -> None:
        if self._lane_switched_s is not None:
            self._lane_switched_s = None
            self._announcer.say(_WARNING, "EKF primary changed:0")
        self._fence.breached = 0

    def _gps(self, now_s: float) -> None:
        flight, say, estimate = self._flight, self._announcer.say, self._estimate
        if not self._yaw_aligned and flight.armed and flight.above_home_m > _YAW_ALIGNED_ABOVE_M:
            self._yaw_aligned = True
            for imu in (0, 1):
                say(_INFO, f"EKF3 IMU{imu} MAG0 in-flight yaw alignment complete")
        if flight.vehicle.estimator.gps:
            self._gps_good_s = now_s if self._gps_good_s is None else self._gps_good_s
            if estimate.lost and now_s - self._gps_good_s > _GPS_BACK_S:
                estimate.lost = False
                say(_CRITICAL, "EKF Failsafe Cleared")
            return
        self._gps_good_s = None
        gone = flight.vehicle.estimator.lost_for_s(now_s) >= _GPS_GONE_S
        if not estimate.ready or not gone or estimate.lost:
            return
        if self._lane_switched_s is None:
            self._lane_switched_s = now_s
            say(_CRITICAL, "EKF3 lane switch 1")
            say(_WARNING, "EKF primary changed:1")
        elif now_s > self._lane_switched_s:
            estimate.lost = True
            say(_CRITICAL, "EKF variance")
            self._position_lost()

    def _position_lost(self) -> None:
        flight, modes, action = self._flight, self._modes, int(self._parameters["FS_EKF_ACTION"])
        if not flight.armed or flight.landed or action == 0:
            return
        mode = ArduPilotMode.ALT_HOLD if action == 2 else ArduPilotMode.LAND
        if modes.mode is ArduPilotMode.LAND:
            flight.maneuver = Land(with_position=False)
        elif (modes.mode in NEED_POSITION or action == 3) and modes.set_mode(mode):
            if mode is ArduPilotMode.LAND:
                flight.maneuver = Land(with_position=False, pause_s=_LAND_PAUSE_S)
            self._announcer.say(_CRITICAL, f"EKF Failsafe: changed to {mode.name} Mode")

    def _battery(self, now_s: float) -> None:
        p, battery = self._parameters, self._flight.vehicle.battery
        volts, left_mah = battery.volts, p["BATT_CAPACITY"] - battery.used_mah
        low = volts < p["BATT_LOW_VOLT"] or left_mah < p["BATT_LOW_MAH"]
        critical = volts < p["BATT_CRT_VOLT"] or left_mah < p["BATT_CRT_MAH"]
        self._battery_low_s = _since(self._battery_low_s, now_s, low)
        self._battery_critical_s = _since(self._battery_critical_s, now_s, critical)
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
        battery = self._flight.vehicle.battery
        self._announcer.say(
            _WARNING, f"Battery 1 is {kind} {battery.volts:.2f}V used {battery.used_mah:.0f} mAh"
        )
        self._announcer.say(_WARNING, "Battery Failsafe")
        self._act(_BATTERY_ACTIONS.get(action))
        if action == 5:
            self._flight.disarm("Battery Failsafe: terminating", _CRITICAL)

    def _act(self, mode: ArduPilotMode | None) -> None:
        """Enter a failsafe's mode, or LAND where that one cannot be. A landing goes on only if FS_OPTIONS says so."""
        modes = self._modes
        goes_on = modes.mode is ArduPilotMode.LAND and int(self._parameters["FS_OPTIONS"]) & 8
        if mode is None or not self._flight.armed or modes.mode is mode or goes_on:
            return
        if self._flight.landed:
            self._flight.disarm("Disarming motors", _INFO)
        elif not modes.set_mode(mode):
            modes.set_mode(ArduPilotMode.LAND)

    def _ground_station(self, now_s: float) -> None:
        p = self._parameters
        heard_s = self._ground_heard_s.get(int(p["SYSID_MYGCS"]))
        unheard = "ground_link" in self.unheard
        if not p["FS_GCS_ENABLE"] or (heard_s is None and not (unheard or self._ground_lost)):
            return
        lost = unheard or (heard_s is not None and now_s - heard_s > p["FS_GCS_TIMEOUT"])
        if lost and not self._ground_lost:
            self._ground_lost = True
            self._announcer.say(_WARNING, "GCS Failsafe")
            pilots = int(p["FS_OPTIONS"]) & 16 and self._modes.mode in (
                ArduPilotMode.STABILIZE,
                ArduPilotMode.ALT_HOLD,
                ArduPilotMode.LOITER,
            )
            if not pilots:
                self._act(_GROUND_STATION_ACTIONS.get(int(p["FS_GCS_ENABLE"])))
        elif not lost and self._ground_lost:
            self._ground_lost = False
            self._announcer.say(_WARNING, "GCS Failsafe Cleared")

    def _remote_control(self) -> None:
        p = self._parameters
        lost = "remote_control" in self.unheard and bool(p["FS_THR_ENABLE"])
        if lost and not self._remote_lost:
            self._announcer.say(_WARNING, "Radio Failsafe")
            if not (int(p["FS_OPTIONS"]) & _FLIES_ON_GUIDED and self._modes.mode is ArduPilotMode.GUIDED):
                self._act(_REMOTE_CONTROL_ACTIONS.get(int(p["FS_THR_ENABLE"])))
        elif self._remote_lost and not lost:
            self._announcer.say(_WARNING, "Radio Failsafe Cleared")
        self._remote_lost = lost


def _since(before_s: float | None, now_s: float, is_so: bool) -> float | None:
    """Since when something is so; None while it is not."""
    if not is_so:
        return None
    return now_s if before_s is None else before_s
