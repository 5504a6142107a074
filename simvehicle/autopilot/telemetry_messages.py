"""The messages that a simulated autopilot can stream or be asked for: one function each.

A function gets the autopilot and returns the message, or None where there is nothing to tell yet.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot.mission_run import MissionRun
from simvehicle.autopilot.missions import MISSION
from simvehicle.vehicle.dynamics import DRAG_PER_S, GRAVITY_MPS2, in_body, quaternion_of

if TYPE_CHECKING:
    from mission.geometry.frames import Vector3
    from simvehicle.autopilot.core import Autopilot

_NAN = math.nan


def build(autopilot: Autopilot, message_id: int) -> Any | None:
    return BUILDERS[message_id](autopilot)


def heartbeat(a: Autopilot) -> Any:
    if a.time_s < 2.5 * a.ready_after_s / 41.5:
        status = mavlink.MAV_STATE_CALIBRATING
    elif a.failsafe:
        status = mavlink.MAV_STATE_CRITICAL
    else:
        status = mavlink.MAV_STATE_STANDBY if a.landed and a.idle_status else mavlink.MAV_STATE_ACTIVE
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR, a.mav_autopilot, a.base_mode(), a.custom_mode, status, 3
    )


def _boot_ms(a: Autopilot) -> int:
    return int(a.time_s * 1000)


def _boot_us(a: Autopilot) -> int:
    return int(a.time_s * 1e6)


def _centidegrees(angle_rad: float) -> int:
    return round(math.degrees(angle_rad) * 100) % 36000


def _sys_status(a: Autopilot) -> Any:
    present, enabled, healthy = a.health()
    battery = a.battery
    return mavlink.MAVLink_sys_status_message(
        present,
        enabled,
        healthy,
        load=250,
        voltage_battery=round(battery.volts * 1000),
        current_battery=round(battery.current_a * 100),
        battery_remaining=round(battery.fraction * 100),
        drop_rate_comm=0,
        errors_comm=0,
        errors_count1=0,
        errors_count2=0,
        errors_count3=0,
        errors_count4=0,
    )


def _system_time(a: Autopilot) -> Any:
    """Unix time is unknown to a vehicle in simulated time: 0, as before the first fix."""
    return mavlink.MAVLink_system_time_message(0, _boot_ms(a))


def _gps_raw(a: Autopilot) -> Any:
    if not a.gps_detected:
        return mavlink.MAVLink_gps_raw_int_message(0, 0, 0, 0, 0, 65535, 65535, 0, 0, 0)
    at = a.estimator.geodetic(a.nav.position_m)
    north, east, _ = a.nav.velocity_mps
    fixed = a.estimator.gps
    return mavlink.MAVLink_gps_raw_int_message(
        _boot_us(a),
        a.gps_fix_type if fixed else mavlink.GPS_FIX_TYPE_NO_FIX,
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


def _attitude(a: Autopilot) -> Any:
    return mavlink.MAVLink_attitude_message(_boot_ms(a), *a.body.attitude_rad, *a.body.rates_radps)


def _attitude_quaternion(a: Autopilot) -> Any:
    quaternion = quaternion_of(a.body.attitude_rad)
    return mavlink.MAVLink_attitude_quaternion_message(_boot_ms(a), *quaternion, *a.body.rates_radps)


def _local_position(a: Autopilot) -> Any | None:
    if not a.ready:
        return None
    return mavlink.MAVLink_local_position_ned_message(_boot_ms(a), *a.nav.position_m, *a.nav.velocity_mps)


def _global_position(a: Autopilot) -> Any | None:
    if not a.origin_is_set:
        return mavlink.MAVLink_global_position_int_message(
            _boot_ms(a), 0, 0, 0, 0, 0, 0, 0, _centidegrees(a.nav.yaw_rad)
        )
    at = a.estimator.geodetic(a.nav.position_m)
    north, east, down = a.nav.velocity_mps
    home = a.home
    above_home_m = 0.0 if home is None else at.amsl_m - home.amsl_m
    return mavlink.MAVLink_global_position_int_message(
        _boot_ms(a),
        round(at.latitude_deg * 1e7),
        round(at.longitude_deg * 1e7),
        round(at.amsl_m * 1000),
        round(above_home_m * 1000),
        round(north * 100),
        round(east * 100),
        round(down * 100),
        _centidegrees(a.nav.yaw_rad),
    )


def _specific_force(a: Autopilot) -> Vector3:
    """What the accelerometers feel, body frame, m/s^2."""
    body = a.body
    if body.on_ground:
        return 0.0, 0.0, -GRAVITY_MPS2
    north, east, down = (
        t - DRAG_PER_S * (v - w) for t, v, w in zip(body.thrust, body.velocity, a.wind_ned_mps, strict=True)
    )
    return in_body((north, east, down), body.attitude_rad)


def _raw_imu(a: Autopilot) -> Any:
    forces = (round(f / GRAVITY_MPS2 * 1000) for f in _specific_force(a))
    rates = (round(r * 1000) for r in a.body.rates_radps)
    return mavlink.MAVLink_raw_imu_message(_boot_us(a), *forces, *rates, 0, 0, 0)


def _highres_imu(a: Autopilot) -> Any:
    fields = 0x3F | 0x1E00
    return mavlink.MAVLink_highres_imu_message(
        _boot_us(a),
        *_specific_force(a),
        *a.body.rates_radps,
        0.21,
        0.0,
        0.42,
        _pressure_hpa(a),
        0.0,
        _amsl_m(a),
        20.0,
        fields,
    )


def _amsl_m(a: Autopilot) -> float:
    return a.world.frame.origin.amsl_m - a.body.position[2]


def _pressure_hpa(a: Autopilot) -> float:
    """The International Standard Atmosphere at the vehicle's altitude."""
    return float(1013.25 * (1.0 - 2.25577e-5 * _amsl_m(a)) ** 5.25588)


def _scaled_pressure(a: Autopilot) -> Any:
    return mavlink.MAVLink_scaled_pressure_message(_boot_ms(a), _pressure_hpa(a), 0.0, 2000)


def _servo_output(a: Autopilot) -> Any:
    pulse_us = round(1000 + 1000 * a.body.throttle_fraction) if a.armed else 1000
    return mavlink.MAVLink_servo_output_raw_message(_boot_us(a) & 0xFFFFFFFF, 0, *[pulse_us] * 4, 0, 0, 0, 0)


def _mission_current(a: Autopilot) -> Any:
    items = a.missions.lists[MISSION]
    running = isinstance(a.maneuver, MissionRun)
    if not items:
        state = mavlink.MISSION_STATE_NO_MISSION
    elif a.mission_complete:
        state = mavlink.MISSION_STATE_COMPLETE
    elif running:
        state = mavlink.MISSION_STATE_ACTIVE
    else:
        state = a.mission_idle_state()
    total = max(0, len(items) - a.mission_rules()[0])
    current = min(a.mission_next, max(0, len(items) - 1))
    return mavlink.MAVLink_mission_current_message(current, total, state, 1 if running else 0)


def _origin(a: Autopilot) -> Any | None:
    if not a.origin_is_set:
        return None
    at = a.estimator.geodetic((0.0, 0.0, 0.0))
    return mavlink.MAVLink_gps_global_origin_message(
        round(at.latitude_deg * 1e7), round(at.longitude_deg * 1e7), round(at.amsl_m * 1000), _boot_us(a)
    )


def _home(a: Autopilot) -> Any | None:
    at = a.home
    if at is None or a.home_m is None:
        return None
    return mavlink.MAVLink_home_position_message(
        round(at.latitude_deg * 1e7),
        round(at.longitude_deg * 1e7),
        round(at.amsl_m * 1000),
        *a.home_m,
        [_NAN] * 4,
        0.0,
        0.0,
        0.0,
        _boot_us(a),
    )


def _target(a: Autopilot) -> Vector3 | None:
    motion = a.motion
    if not a.armed or motion.horizontal_m is None:
        return None
    down_m = a.nav.position_m[2] if motion.down_m is None else motion.down_m
    return motion.horizontal_m[0], motion.horizontal_m[1], down_m


def _nav_controller(a: Autopilot) -> Any:
    roll, pitch, yaw = (math.degrees(angle) for angle in a.body.attitude_rad)
    target = _target(a)
    if target is None:
        return mavlink.MAVLink_nav_controller_output_message(roll, pitch, round(yaw), 0, 0, 0.0, 0.0, 0.0)
    north, east, down = (t - p for t, p in zip(target, a.nav.position_m, strict=True))
    bearing_deg = round(math.degrees(math.atan2(east, north)))
    distance_m = min(65535, round(math.hypot(north, east)))
    return mavlink.MAVLink_nav_controller_output_message(
        roll, pitch, round(yaw), bearing_deg, distance_m, -down, 0.0, 0.0
    )


def _rc_channels(a: Autopilot) -> Any:
    return mavlink.MAVLink_rc_channels_message(_boot_ms(a), 8, *a.rc_us, *[0] * 10, 255)


def _vfr_hud(a: Autopilot) -> Any:
    north, east, down = a.nav.velocity_mps
    ground_mps = math.hypot(north, east)
    amsl_m = a.estimator.geodetic(a.nav.position_m).amsl_m if a.origin_is_set else 0.0
    throttle = round(100 * a.body.throttle_fraction) if a.armed else 0
    heading_deg = round(math.degrees(a.nav.yaw_rad)) % 360
    return mavlink.MAVLink_vfr_hud_message(ground_mps, ground_mps, heading_deg, throttle, amsl_m, -down)


def _target_mask(a: Autopilot) -> int:
    return 0x0DF8 if a.motion.horizontal_m is not None else 0x0DC7


def _target_global(a: Autopilot) -> Any | None:
    target = _target(a)
    if target is None:
        return None
    at = a.estimator.geodetic(target)
    return mavlink.MAVLink_position_target_global_int_message(
        _boot_ms(a),
        mavlink.MAV_FRAME_GLOBAL,
        _target_mask(a),
        round(at.latitude_deg * 1e7),
        round(at.longitude_deg * 1e7),
        at.amsl_m,
        *[0.0] * 8,
    )


def _target_local(a: Autopilot) -> Any | None:
    if not a.armed:
        return None
    position = _target(a) or (0.0, 0.0, 0.0)
    north, east = a.motion.horizontal_mps or (0.0, 0.0)
    velocity = (north, east, a.motion.down_mps or 0.0)
    return mavlink.MAVLink_position_target_local_ned_message(
        _boot_ms(a), mavlink.MAV_FRAME_LOCAL_NED, _target_mask(a), *position, *velocity, *[0.0] * 5
    )


def _altitude(a: Autopilot) -> Any:
    above_m = -a.nav.position_m[2]
    return mavlink.MAVLink_altitude_message(
        _boot_us(a), above_m, _amsl_m(a), above_m, a.above_home_m, _NAN, -a.body.position[2]
    )


def _battery(a: Autopilot) -> Any:
    battery = a.battery
    used_mah = round(battery.used_mah)
    return mavlink.MAVLink_battery_status_message(
        0,
        mavlink.MAV_BATTERY_FUNCTION_ALL,
        mavlink.MAV_BATTERY_TYPE_LIPO,
        32767,
        [round(battery.volts * 1000)] + [65535] * 9,
        round(battery.current_a * 100),
        used_mah,
        -1,
        round(battery.fraction * 100),
    )


def _version(a: Autopilot) -> Any:
    return a.version()


def _wind(a: Autopilot) -> Any | None:
    """ArduPilot's: where the wind comes from, degrees. ArduCopter estimates none without its drag parameters."""
    if a.flavour != "ardupilot" or not a.ready:
        return None
    north, east, _ = a.wind_estimate if a.estimates_wind else (0.0, 0.0, 0.0)
    from_deg = math.degrees(math.atan2(-east, -north))
    return mavlink.MAVLink_wind_message(from_deg, math.hypot(north, east), 0.0)


def _wind_cov(a: Autopilot) -> Any | None:
    """PX4's: the vector, NED; only with drag fusion on."""
    if a.flavour != "px4" or not a.estimates_wind or a.landed:
        return None
    north, east, _ = a.wind_estimate
    return mavlink.MAVLink_wind_cov_message(
        _boot_us(a), north, east, 0.0, 0.25, 0.0, a.above_home_m, 0.5, 0.0
    )


def _ekf(a: Autopilot) -> Any | None:
    if a.flavour != "ardupilot":
        return None
    variance = 0.9 if a.estimator_lost else 0.02
    return mavlink.MAVLink_ekf_status_report_message(a.estimator_flags(), variance, variance, 0.01, 0.02, 0.0)


def _estimator_status(a: Autopilot) -> Any:
    ratio = 1.5 if a.estimator_lost else 0.05
    return mavlink.MAVLink_estimator_status_message(
        _boot_us(a), a.estimator_flags(), ratio, ratio, 0.05, 0.05, 0.0, 0.0, 0.3, 0.3
    )


def _extended_state(a: Autopilot) -> Any:
    return mavlink.MAVLink_extended_sys_state_message(a.vtol_state, a.landed_state())


def _vibration(a: Autopilot) -> Any:
    level = 0.8 if not a.landed else 0.003
    return mavlink.MAVLink_vibration_message(_boot_us(a), level, level, level, 0, 0, 0)


def _fence_status(a: Autopilot) -> Any | None:
    return a.fence_status()


def _distance(a: Autopilot) -> Any:
    """The downward rangefinder: 0.2 m to 40 m."""
    above_cm = round(max(0.0, -a.body.position[2]) * 100)
    return mavlink.MAVLink_distance_sensor_message(
        _boot_ms(a), 20, 4000, max(20, min(4001, above_cm)), mavlink.MAV_DISTANCE_SENSOR_LASER, 0, 25, 0
    )


BUILDERS: dict[int, Callable[[Autopilot], Any | None]] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: heartbeat,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: _sys_status,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: _system_time,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: _gps_raw,
    mavlink.MAVLINK_MSG_ID_RAW_IMU: _raw_imu,
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE: _scaled_pressure,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: _attitude,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: _attitude_quaternion,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: _local_position,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: _global_position,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: _servo_output,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: _mission_current,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: _origin,
    mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: _nav_controller,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: _rc_channels,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: _vfr_hud,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: _target_local,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: _target_global,
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: _highres_imu,
    mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR: _distance,
    mavlink.MAVLINK_MSG_ID_ALTITUDE: _altitude,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: _battery,
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: _version,
    mavlink.MAVLINK_MSG_ID_FENCE_STATUS: _fence_status,
    mavlink.MAVLINK_MSG_ID_WIND: _wind,
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: _ekf,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: _estimator_status,
    mavlink.MAVLINK_MSG_ID_WIND_COV: _wind_cov,
    mavlink.MAVLINK_MSG_ID_VIBRATION: _vibration,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: _home,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: _extended_state,
}
