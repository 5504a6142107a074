"""Telemetry of where a vehicle is and how it moves: one method a message.

A method returns the message, or None where there is nothing to tell yet.
"""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mission.geometry.frames import Vector3
from simvehicle.autopilot.flight import Flight
from simvehicle.autopilot.message_streams import Build
from simvehicle.autopilot.reports import EstimatorReport
from simvehicle.vehicle.dynamics import DRAG_PER_S, GRAVITY_MPS2, in_body, quaternion_of
from simvehicle.world.atmosphere import air_pressure_pa

_NAN = math.nan


class MotionTelemetry:
    def __init__(self, flight: Flight, estimate: EstimatorReport, gps_fix_type: int) -> None:
        self._flight = flight
        self._estimate = estimate
        self._gps_fix_type = gps_fix_type

    def messages(self) -> dict[int, Build]:
        return {
            mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: self._gps_raw,
            mavlink.MAVLINK_MSG_ID_ATTITUDE: self._attitude,
            mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: self._attitude_quaternion,
            mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: self._local_position,
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self._global_position,
            mavlink.MAVLINK_MSG_ID_RAW_IMU: self._raw_imu,
            mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: self._highres_imu,
            mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE: self._scaled_pressure,
            mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: self._servo_output,
            mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: self._origin,
            mavlink.MAVLINK_MSG_ID_HOME_POSITION: self._home,
            mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: self._nav_controller,
            mavlink.MAVLINK_MSG_ID_VFR_HUD: self._vfr_hud,
            mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: self._target_global,
            mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: self._target_local,
            mavlink.MAVLINK_MSG_ID_ALTITUDE: self._altitude,
            mavlink.MAVLINK_MSG_ID_VIBRATION: self._vibration,
            mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR: self._distance,
        }

    def _boot_ms(self) -> int:
        return int(self._flight.time_s * 1000)

    def _boot_us(self) -> int:
        return int(self._flight.time_s * 1e6)

    def _gps_raw(self) -> Any:
        if not self._estimate.gps_detected:
            return mavlink.MAVLink_gps_raw_int_message(0, 0, 0, 0, 0, 65535, 65535, 0, 0, 0)
        at = self._flight.here
        north, east, _ = self._flight.nav.velocity_mps
        fixed = self._flight.vehicle.estimator.gps
        return mavlink.MAVLink_gps_raw_int_message(
            self._boot_us(),
            self._gps_fix_type if fixed else mavlink.GPS_FIX_TYPE_NO_FIX,
            round(at.latitude_deg * 1e7),
            round(at.longitude_deg * 1e7),
            round(at.amsl_m * 1000),
            121,
            200,
            round(math.hypot(north, east) * 100),
            _centidegrees(math.atan2(east, north)),
            10 if fixed else 3,
            alt_ellipsoid=round(at.amsl_m * 1000),
            h_acc=300,
            v_acc=300,
        )

    def _attitude(self) -> Any:
        return mavlink.MAVLink_attitude_message(
            self._boot_ms(), *self._flight.vehicle.body.attitude_rad, *self._flight.vehicle.body.rates_radps
        )

    def _attitude_quaternion(self) -> Any:
        quaternion = quaternion_of(self._flight.vehicle.body.attitude_rad)
        return mavlink.MAVLink_attitude_quaternion_message(
            self._boot_ms(), *quaternion, *self._flight.vehicle.body.rates_radps
        )

    def _local_position(self) -> Any | None:
        if not self._estimate.ready:
            return None
        return mavlink.MAVLink_local_position_ned_message(
            self._boot_ms(), *self._flight.nav.position_m, *self._flight.nav.velocity_mps
        )

    def _global_position(self) -> Any | None:
        if not self._flight.origin_is_set:
            return mavlink.MAVLink_global_position_int_message(
                self._boot_ms(), 0, 0, 0, 0, 0, 0, 0, _centidegrees(self._flight.nav.yaw_rad)
            )
        at = self._flight.here
        north, east, down = self._flight.nav.velocity_mps
        home = self._flight.home
        above_home_m = 0.0 if home is None else at.amsl_m - home.amsl_m
        return mavlink.MAVLink_global_position_int_message(
            self._boot_ms(),
            round(at.latitude_deg * 1e7),
            round(at.longitude_deg * 1e7),
            round(at.amsl_m * 1000),
            round(above_home_m * 1000),
            round(north * 100),
            round(east * 100),
            round(down * 100),
            _centidegrees(self._flight.nav.yaw_rad),
        )

    def _specific_force(self) -> Vector3:
        """What the accelerometers feel, body frame, m/s^2."""
        body = self._flight.vehicle.body
        if body.on_ground:
            return 0.0, 0.0, -GRAVITY_MPS2
        north, east, down = (
            t - DRAG_PER_S * (v - w)
            for t, v, w in zip(body.thrust, body.velocity, self._flight.vehicle.wind_ned_mps, strict=True)
        )
        return in_body((north, east, down), body.attitude_rad)

    def _raw_imu(self) -> Any:
        forces = (round(f / GRAVITY_MPS2 * 1000) for f in self._specific_force())
        rates = (round(r * 1000) for r in self._flight.vehicle.body.rates_radps)
        return mavlink.MAVLink_raw_imu_message(self._boot_us(), *forces, *rates, 0, 0, 0)

    def _highres_imu(self) -> Any:
        fields = 0x3F | 0x1E00
        return mavlink.MAVLink_highres_imu_message(
            self._boot_us(),
            *self._specific_force(),
            *self._flight.vehicle.body.rates_radps,
            0.21,
            0.0,
            0.42,
            self._pressure_hpa(),
            0.0,
            self._flight.vehicle.amsl_m,
            20.0,
            fields,
        )

    def _pressure_hpa(self) -> float:
        return air_pressure_pa(self._flight.vehicle.amsl_m) / 100.0

    def _scaled_pressure(self) -> Any:
        return mavlink.MAVLink_scaled_pressure_message(self._boot_ms(), self._pressure_hpa(), 0.0, 2000)

    def _servo_output(self) -> Any:
        pulse_us = (
            round(1000 + 1000 * self._flight.vehicle.body.throttle_fraction) if self._flight.armed else 1000
        )
        return mavlink.MAVLink_servo_output_raw_message(
            self._boot_us() & 0xFFFFFFFF, 0, *[pulse_us] * 4, 0, 0, 0, 0
        )

    def _origin(self) -> Any | None:
        if not self._flight.origin_is_set:
            return None
        at = self._flight.vehicle.estimator.geodetic((0.0, 0.0, 0.0))
        return mavlink.MAVLink_gps_global_origin_message(
            round(at.latitude_deg * 1e7),
            round(at.longitude_deg * 1e7),
            round(at.amsl_m * 1000),
            self._boot_us(),
        )

    def _home(self) -> Any | None:
        at = self._flight.home
        if at is None or self._flight.home_m is None:
            return None
        return mavlink.MAVLink_home_position_message(
            round(at.latitude_deg * 1e7),
            round(at.longitude_deg * 1e7),
            round(at.amsl_m * 1000),
            *self._flight.home_m,
            [_NAN] * 4,
            0.0,
            0.0,
            0.0,
            self._boot_us(),
        )

    def _target(self) -> Vector3 | None:
        motion = self._flight.motion
        if not self._flight.armed or motion.horizontal_m is None:
            return None
        down_m = self._flight.nav.position_m[2] if motion.down_m is None else motion.down_m
        return motion.horizontal_m[0], motion.horizontal_m[1], down_m

    def _nav_controller(self) -> Any:
        roll, pitch, yaw = (math.degrees(angle) for angle in self._flight.vehicle.body.attitude_rad)
        target = self._target()
        if target is None:
            return mavlink.MAVLink_nav_controller_output_message(roll, pitch, round(yaw), 0, 0, 0.0, 0.0, 0.0)
        north, east, down = (t - p for t, p in zip(target, self._flight.nav.position_m, strict=True))
        bearing_deg = round(math.degrees(math.atan2(east, north)))
        distance_m = min(65535, round(math.hypot(north, east)))
        return mavlink.MAVLink_nav_controller_output_message(
            roll, pitch, round(yaw), bearing_deg, distance_m, -down, 0.0, 0.0
        )

    def _vfr_hud(self) -> Any:
        north, east, down = self._flight.nav.velocity_mps
        ground_mps = math.hypot(north, east)
        amsl_m = self._flight.here.amsl_m if self._flight.origin_is_set else 0.0
        throttle = round(100 * self._flight.vehicle.body.throttle_fraction) if self._flight.armed else 0
        heading_deg = round(math.degrees(self._flight.nav.yaw_rad)) % 360
        return mavlink.MAVLink_vfr_hud_message(ground_mps, ground_mps, heading_deg, throttle, amsl_m, -down)

    def _target_mask(self) -> int:
        return 0x0DF8 if self._flight.motion.horizontal_m is not None else 0x0DC7

    def _target_global(self) -> Any | None:
        target = self._target()
        if target is None:
            return None
        at = self._flight.vehicle.estimator.geodetic(target)
        return mavlink.MAVLink_position_target_global_int_message(
            self._boot_ms(),
            mavlink.MAV_FRAME_GLOBAL,
            self._target_mask(),
            round(at.latitude_deg * 1e7),
            round(at.longitude_deg * 1e7),
            at.amsl_m,
            *[0.0] * 8,
        )

    def _target_local(self) -> Any | None:
        if not self._flight.armed:
            return None
        position = self._target() or (0.0, 0.0, 0.0)
        north, east = self._flight.motion.horizontal_mps or (0.0, 0.0)
        velocity = (north, east, self._flight.motion.down_mps or 0.0)
        return mavlink.MAVLink_position_target_local_ned_message(
            self._boot_ms(),
            mavlink.MAV_FRAME_LOCAL_NED,
            self._target_mask(),
            *position,
            *velocity,
            *[0.0] * 5,
        )

    def _altitude(self) -> Any:
        above_m = -self._flight.nav.position_m[2]
        return mavlink.MAVLink_altitude_message(
            self._boot_us(),
            above_m,
            self._flight.vehicle.amsl_m,
            above_m,
            self._flight.above_home_m,
            _NAN,
            -self._flight.vehicle.body.position[2],
        )

    def _vibration(self) -> Any:
        level = 0.8 if not self._flight.landed else 0.003
        return mavlink.MAVLink_vibration_message(self._boot_us(), level, level, level, 0, 0, 0)

    def _distance(self) -> Any:
        """The downward rangefinder: 0.2 m to 40 m."""
        above_cm = round(max(0.0, -self._flight.vehicle.body.position[2]) * 100)
        return mavlink.MAVLink_distance_sensor_message(
            self._boot_ms(),
            20,
            4000,
            max(20, min(4001, above_cm)),
            mavlink.MAV_DISTANCE_SENSOR_LASER,
            0,
            25,
            0,
        )


def _centidegrees(angle_rad: float) -> int:
    return round(math.degrees(angle_rad) * 100) % 36000
