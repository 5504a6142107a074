"""How ArduCopter comes up: its boot, its estimator and its first fix, with the recorded vehicle's words and times."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot.announcer import Announcer
from simvehicle.autopilot.flight import Flight

RECORDED_READY_S = 41.5
"""When the recorded vehicle was ready; its boot is stretched to `ready_after_s`."""
ALIGNED_S, GPS_S, ORIGIN_S = 5.8, 9.7, 19.9
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
    (ALIGNED_S, "EKF3 IMU0 MAG0 initial yaw alignment complete"),
    (ALIGNED_S, "EKF3 IMU1 MAG0 initial yaw alignment complete"),
    (GPS_S, "GPS 1: probing for u-blox at 230400 baud"),
    (GPS_S, "GPS 1: detected u-blox"),
    (ORIGIN_S, "EKF3 IMU0 origin set"),
    (ORIGIN_S, "Field Elevation Set: {elevation:.0f}m"),
    (ORIGIN_S + 0.2, "EKF3 IMU1 origin set"),
    (41.3, "EKF3 IMU0 is using GPS"),
    (RECORDED_READY_S, "EKF3 IMU1 is using GPS"),
)
_TIMESYNC_EVERY_S = 10.0
_EKF_NOT_YET, _EKF_STILL, _EKF_GOOD, _EKF_LOST = 1024, 167, 831, 37


class ArduPilotEstimate:
    """An `EstimatorReport`; `step` is called ten times a second."""

    def __init__(self, flight: Flight, announcer: Announcer) -> None:
        self._flight = flight
        self._announcer = announcer
        self._stretch = flight.ready_after_s / RECORDED_READY_S
        self._texts = list(_BOOT_TEXTS)
        self._timesync_due_s = 9.9
        self._booted = False
        self._gps_detected = False
        self.lost = False
        """The EKF has failed: there is no horizontal position. The GPS failsafe says so."""

    @property
    def ready(self) -> bool:
        return self._booted and self._flight.ready_after_s - self._flight.time_s <= 0.0

    @property
    def gps_detected(self) -> bool:
        return self._gps_detected

    @property
    def position_ok(self) -> bool:
        return self.ready and not self.lost

    def flags(self) -> int:
        if self.lost:
            return _EKF_LOST
        if self._flight.ready_after_s - self._flight.time_s <= 0.0:
            return _EKF_GOOD
        return _EKF_STILL if self.has_reached(ALIGNED_S) else _EKF_NOT_YET

    def has_reached(self, recorded_s: float) -> bool:
        """What the recorded vehicle had reached after so long."""
        return self._flight.time_s + 1e-9 >= recorded_s * self._stretch

    def step(self) -> None:
        flight = self._flight
        self._booted = True
        while self._texts and self.has_reached(self._texts[0][0]):
            _, text = self._texts.pop(0)
            elevation_m = flight.vehicle.world.frame.origin.amsl_m
            self._announcer.say(mavlink.MAV_SEVERITY_INFO, text.format(elevation=elevation_m))
        self._gps_detected = self.has_reached(GPS_S)
        if not flight.origin_is_set and self.has_reached(ORIGIN_S):
            flight.set_origin()
            self.tell_home()
        elif flight.origin_is_set and not flight.armed and not self.lost:
            flight.set_home(flight.nav.position_m)  # until it is armed home is where it stands
        time_s = flight.time_s
        if time_s >= self._timesync_due_s:
            self._timesync_due_s += _TIMESYNC_EVERY_S
            self._announcer.broadcast(mavlink.MAVLink_timesync_message(0, int(time_s * 1e9) + 1))

    def tell_home(self) -> None:
        for message_id in (mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, mavlink.MAVLINK_MSG_ID_HOME_POSITION):
            self._announcer.tell(message_id)
