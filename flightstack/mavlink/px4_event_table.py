"""The events of PX4 that are told in words, by their names in its source, and what their arguments mean.

An event's number is a hash of its name (`event_id`), so that a name is all that has to be known of it. Names and
meanings are those of PX4 1.13 to main of 2026: what a multicopter's commander, navigator, mission and logger say, and
the checks of its health report. What is not in here is told by its number.
"""

from __future__ import annotations

import struct
from typing import Final, NamedTuple

_AUTOPILOT = 1 << 24
"""The component that all of PX4's own events belong to."""
REPORT_BEGIN, REPORT_END = "commander_arming_check_summary", "commander_health_summary"
"""Between these two come the checks that fail."""

ACTIONS: Final = (
    "none",
    "a warning",
    "Position",
    "Altitude",
    "Stabilized",
    "Hold",
    "Return",
    "Land",
    "a blind descent",
    "disarming",
    "termination",
)
"""failsafe_action_t"""
CAUSES: Final = (
    "Failsafe",
    "Manual control loss",
    "Ground station connection loss",
    "Low battery",
    "Critical battery",
    "Emergency battery",
    "Low remaining flight time",
)
"""failsafe_cause_t"""
_ARMED_BY: Final = (
    "nobody",
    "stick gesture",
    "RC switch",
    "internal command",
    "external command",
    "mission start",
    "landing",
    "auto preflight disarming",
    "kill switch",
    "RC (auto)",
    "shutdown",
    "unit test",
    "unit test",
    "RC button",
    "failsafe",
)
"""arm_disarm_reason_t"""
_MODES: Final = (
    "Manual",
    "Altitude",
    "Position",
    "Mission",
    "Hold",
    "Return",
    "Acro",
    "Offboard",
    "Stabilized",
    "Position Slow",
    "Takeoff",
    "Land",
    "Follow Target",
    "Precision Landing",
    "Orbit",
    "VTOL Takeoff",
)
"""navigation_mode_t"""
_WORDS: Final = {"a": ACTIONS, "c": CAUSES, "r": _ARMED_BY, "m": _MODES}


class KnownEvent(NamedTuple):
    name: str
    arguments: str
    """Their types in order: `struct`'s letters, and of `_WORDS` those of the enumerations (one byte each)."""
    text: str
    """With {0}, {1} … for the arguments."""

    def told(self, arguments: bytes) -> str:
        letters = "".join("B" if letter in _WORDS else letter for letter in self.arguments)
        values = struct.unpack_from("<" + letters, arguments)
        words = (_WORDS.get(letter) for letter in self.arguments)
        return self.text.format(*map(_in_words, values, words))


def _in_words(value: float, words: tuple[str, ...] | None) -> str | float:
    if words is None:
        return value
    return words[int(value)] if value < len(words) else f"{int(value)}"


def event_id(name: str) -> int:
    """The number of an event: 24 bits of the FNV-1a hash of its name, and its component above them."""
    state = 0x811C9DC5
    for byte in name.encode():
        state = (state ^ byte) * 0x01000193 & 0xFFFFFFFF
    return state & 0xFFFFFF | _AUTOPILOT


_TOLD = """
commander_arm_denied_calibrating||Arming denied: calibrating
commander_arm_denied_throttle_unsafe||Arming denied: throttle not in safe position
commander_arm_denied_throttle_center||Arming denied: throttle not centered
commander_arm_denied_throttle_high||Arming denied: high throttle
commander_arm_denied_throttle_not_zero||Arming denied: throttle above center
commander_arm_denied_not_disarmed||Arming denied: not disarmed
commander_arm_denied_resolve_failures||Arming denied: Resolve system health failures first
commander_armed_by|r|Armed by {0}
commander_disarmed_by|r|Disarmed by {0}
commander_disarm_denied_not_landed||Disarming denied: not landed
commander_landing_detected||Landing detected
commander_takeoff_detected||Takeoff detected
commander_landing_current_pos||Landing at current position
commander_rtl||Returning to launch
commander_mission_start_denied_no_mission||Mission start denied: no valid mission
commander_modeswitch_not_avail|Im|Switching to {1} is currently not possible
commander_modeswitch_not_possible|Im|Switching to {1} is currently not possible
commander_mode_fallback_internal||External mode is unresponsive, falling back to an internal one
commander_unsupported_auto_mode||Unsupported auto mode
commander_unsupported_main_mode||Unsupported main mode
commander_unsupported_base_mode||Unsupported base mode
commander_failsafe_enter_generic|Ia|Failsafe activated: switching to {1}
commander_failsafe_enter_generic_hold|IaH|Failsafe activated: Hold, switching to {1} in {2} seconds
commander_failsafe_enter_autopilot_disengaged|Ia|Failsafe activated: autopilot disengaged, switching to {1}
commander_failsafe_enter_generic_warn|I|Failsafe warning
commander_failsafe_enter|Iac|Failsafe activated: {2}: switching to {1}
commander_failsafe_enter_hold|IaHc|Failsafe activated: {3}: Hold, switching to {1} in {2} seconds
commander_failsafe_enter_warn|Ic|Failsafe warning: {1}
commander_failsafe_enter_low_bat||Low battery level, return advised
commander_failsafe_enter_crit_bat_warn||Critical battery level, land now
commander_failsafe_enter_crit_low_bat_warn||Emergency battery level, land immediately
commander_failsafe_enter_low_flight_time_warn||Low remaining flight time, return advised
commander_low_bat_shutdown||Dangerously low battery: shutting system down
commander_gcs_lost||Connection to ground control station lost
commander_dl_lost||Connection to ground control station lost
commander_dl_regained||Connection to ground control station regained
commander_mission_comp_lost||Connection to mission computer lost
commander_onboard_ctrl_regained||Onboard controller regained
commander_rc_lost||Manual control lost
commander_rc_regained|f|Manual control regained after {0:.1f} s
commander_rc_override||Pilot took over using sticks
failsafe_rc_override||Pilot took over using sticks
commander_kill_sw_engaged||Kill engaged
commander_kill_sw_disengaged||Kill disengaged
commander_failure_detector_motor||Motor failure detected
mission_execute||Executing Mission
mission_finished||Mission finished, landed
mission_finished_loiter||Mission finished, loitering
mission_not_valid_refuse||No valid mission available, refusing takeoff
mission_failed_to_read_wp|H|Waypoint {0} could not be read from storage
navigator_takeoff_default_alt|f|Using default takeoff altitude: {0:.1f} m
navigator_takeoff_already_higher||Already higher than takeoff altitude (not descending)
navigator_reposition_outside_geofence||Reposition is outside geofence
navigator_change_altitude_outside_geofence||Altitude change is outside geofence
navigator_terrain_collision_risk||Terrain collision risk, descent is stopped
navigator_mission_failure_heading||Mission failure: unable to reach heading within timeout
navigator_geofence_invalid_against_home||Geofence invalid, doesn't contain Home position
navigator_geofence_invalid_against_cur_pos||Geofence invalid, doesn't contain current vehicle position
navigator_geofence_import_failed||Geofence: import error
navigator_mis_geofence_violation|h|Geofence violation for waypoint {0}
navigator_mis_geofence_no_home||Geofence requires a valid home position
navigator_mis_geofence_no_home2||Geofence requires a valid home position
navigator_mis_first_wp_far|I|First waypoint far away from Home: {0} m: correct mission loaded?
navigator_mis_no_home_rel_alt|h|Mission rejected: no Home position, waypoint {0} uses relative altitude
navigator_mis_unsup_cmd|hH|Mission rejected: item {0}: unsupported command {1}
navigator_mis_starts_w_landing||Mission rejected: starts with landing
navigator_mis_starts_w_landing2||Mission rejected: starts with landing
navigator_mis_takeoff_missing||Mission rejected: takeoff waypoint required
navigator_mis_takeoff_not_first||Mission rejected: takeoff is not the first waypoint item
navigator_mis_takeoff_too_low|f|Mission rejected: takeoff altitude too low, minimum {0:.1f} m
navigator_mis_takeoff_or_land_missing||Mission rejected: takeoff or landing item missing
navigator_mis_land_missing||Mission rejected: landing waypoint or pattern required
navigator_mis_land_before_rtl||Mission rejected: land start item before RTL item is not possible
navigator_mis_multiple_land||Mission rejected: more than one land start command
navigator_mis_invalid_land||Mission rejected: invalid land start
navigator_mis_add_land_or_rm_to||Mission rejected: add landing item or remove takeoff
navigator_mis_vtol_items||Mission rejected: it has VTOL items and the vehicle is no VTOL
mavlink_mission_op_timeout||Operation timeout, aborting transfer
mavlink_mission_sync_timeout||Mission sync timeout, aborting transfer
mavlink_mission_storage_failure||Mission: unable to write to storage
mavlink_mission_storage_write_failure2||Mission: unable to write to storage
mavlink_mission_storage_write_failure3||Mission: unable to write to storage
mavlink_mission_wp_index_exceeds_list|H|Waypoint index exceeds the list's capacity ({0})
rtl_land_at_destination||RTL: land at destination
rtl_completed_loiter||RTL: completed, loitering
vrtl_return_at|ii|RTL: start return at {0} m ({1} m above destination)
check_high_wind_warning|f|High wind speed detected ({0:.1f} m/s), landing advised
check_above_wind_limits_warning|f|Wind speed above limit ({0:.1f} m/s), landing advised
check_estimator_gnss_fusion_stopped||GNSS data fusion stopped
check_estimator_gnss_fusion_started||GNSS data fusion started
check_estimator_position_failure_imminent||Estimated position error is approaching the failsafe threshold
logger_open_file_time|HBBBBB|logging: opening log file {0}-{1}-{2}/{3}_{4}_{5}.ulg
logger_open_file_sess|HH|logging: opening log file sess{0}/log{1}.ulg
logger_storage_full|I|Storage full: {0} MiB free
"""

_CHECKS = """
check_modes_angular_velocity||Angular velocity not valid
check_modes_attitude||No valid attitude estimate
check_modes_local_pos||No valid position estimate
check_modes_global_pos||No valid global position estimate
check_modes_local_alt||No valid altitude estimate
check_modes_mission||No valid mission available
check_modes_offboard_signal||No offboard signal
check_modes_offboard_signal_lost||No offboard signal
check_modes_offboard_no_attitude||Offboard requires an attitude estimate
check_modes_offboard_no_local_position||Offboard requires a local position
check_modes_offboard_no_local_velocity||Offboard requires a local velocity
check_modes_home_position||Home position not set
check_modes_manual_control||No manual control input
check_modes_cannot_takeoff||Mode not suitable for arming
check_rc_dl_no_dllink||No connection to the ground control station
check_accel_missing|B|Accelerometer {0} missing
check_accel_no_data|B|No valid data from accelerometer {0}
check_accel_not_calibrated|B|Accelerometer {0} uncalibrated
check_gyro_missing|B|Gyro {0} missing
check_gyro_no_data|B|No valid data from gyro {0}
check_gyro_not_calibrated|B|Gyro {0} uncalibrated
check_mag_missing|B|Compass {0} missing
check_mag_no_data|B|No valid data from compass {0}
check_mag_not_calibrated|B|Compass {0} uncalibrated
check_mag_fault|B|Estimator fault due to compass {0}
check_mag_consistency||Compasses inconsistent
check_baro_missing|B|Barometer {0} missing
check_baro_no_data|B|No valid data from barometer {0}
check_imu_accel_inconsistent|B|Accelerometer {0} inconsistent
check_imu_gyro_inconsistent|B|Gyro {0} inconsistent
check_battery_missing|B|Battery {0} missing
check_battery_disconnected|B|Battery {0} disconnected
check_battery_low||Low battery
check_battery_critical||Critical battery
check_battery_emergency||Emergency battery level
check_battery_unhealthy||Battery unhealthy
check_battery_rem_flight_time_low||Remaining flight time low
check_avionics_power_low|f|Avionics power low: {0:.2f} V
check_avionics_power_high|f|Avionics power high: {0:.2f} V
check_avionics_power_missing||Power module not connected
check_missing_system_power||System power unavailable
check_cpuload_too_high|f|CPU load too high: {0:.0f} %
check_ram_usage_too_high|f|RAM usage too high: {0:.0f} %
check_missing_cpuload||No CPU and RAM load information
check_missing_fmu_sdcard||Missing FMU SD card
check_hardfault_present||Crash dumps present on SD card
check_estimator_missing_data||Waiting for the estimator to initialize
check_estimator_gps_fix_too_low||GPS fix too low
check_estimator_gps_num_sats_too_low||Not enough GPS satellites
check_estimator_gps_pdop_too_high||GPS PDOP too high
check_estimator_gps_hor_pos_err_too_high||GPS horizontal position error too high
check_estimator_gps_vert_pos_err_too_high||GPS vertical position error too high
check_estimator_gps_speed_acc_too_low||GPS speed accuracy too low
check_estimator_gps_hor_pos_drift_too_high||GPS horizontal position drift too high
check_estimator_gps_vert_pos_drift_too_high||GPS vertical position drift too high
check_estimator_gps_hor_speed_drift_too_high||GPS horizontal speed drift too high
check_estimator_gps_vert_speed_drift_too_high||GPS vertical speed drift too high
check_estimator_gps_not_fusing||Estimator not using GPS
check_estimator_gps_generic||Poor GPS quality
check_estimator_gps_spoofed||GPS signal spoofed
check_estimator_gps_jammed||GPS signal jammed
check_estimator_gps_jamming_critical||GPS jamming detected
check_estimator_low_position_accuracy||Position estimate has low accuracy
check_estimator_heading_not_stable||Heading estimate invalid
check_estimator_heading_no_source||No heading reference
check_estimator_hgt_not_stable||Height estimate not stable
check_estimator_hor_pos_not_stable||Horizontal position unstable
check_estimator_hor_vel_not_stable||Horizontal velocity unstable
check_estimator_vert_vel_not_stable||Vertical velocity unstable
check_estimator_mag_interference||Strong magnetic interference
check_estimator_mag_fault||Stopping compass use
check_estimator_high_accel_bias||High accelerometer bias
check_estimator_high_gyro_bias||High gyro bias
check_gnss_receiver_offline|B|GPS {0} offline
check_gnss_receiver_no_fix|B|GPS {0} lost fix
check_gf_no_home||Geofence RTL requires a valid home
check_gf_violation_custom_gf||Geofence violation: approaching or outside geofence
check_gf_violation_max_alt||Geofence violation: exceeding maximum altitude above Home
check_gf_violation_max_hor_dist||Geofence violation: exceeding maximum distance to Home
check_gf_violation||Geofence violation
check_failure_detector_alt||Altitude failure detected
check_failure_detector_pitch||Attitude failure detected
check_failure_detector_roll||Attitude failure detected
check_failure_detector_ext||Failure triggered by external system
check_failure_detector_imbalanced_prop||Imbalanced propeller detected
check_failure_detector_motor||Motor failure detected
check_motor_undercurrent|B|Motor {0} undercurrent detected
check_motor_overcurrent|B|Motor {0} overcurrent detected
check_escs_telem_missing||ESC telemetry missing
check_escs_not_all_armed||Not all ESCs are armed
check_escs_offline|B|ESC {0} offline
check_man_control_kill_engaged||Kill switch engaged
check_man_control_rtl_engaged||RTL switch engaged
check_mission_failure||Mission cannot be completed
check_system_safety_button||Press safety button first
check_system_usb_connected||USB connected
check_system_no_global_pos||Global position estimate required
check_system_no_home_pos||Home position required
check_system_flight_term_active||Flight termination active
check_system_arm_auth_failed||Arm authorization denied
check_armable_configuration||Vehicle is in safety configuration
check_parachute_missing||Parachute system missing
check_flight_time_limit||Maximum flight time reached
check_wind_too_high|f|Wind speed is above limit ({0:.1f} m/s)
check_airspeed_no_data||No airspeed data
check_airspeed_invalid||Airspeed invalid
check_distance_sensor_missing|B|Distance sensor {0} missing
check_distance_sensor_invalid|B|No valid data from distance sensor {0}
"""


def _table(lines: str) -> dict[int, KnownEvent]:
    known = (KnownEvent(*line.split("|")) for line in lines.split("\n") if line)
    return {event_id(event.name): event for event in known}


TOLD: Final = _table(_TOLD)
"""What happens, by number."""
CHECKS: Final = _table(_CHECKS)
"""Checks that fail, by number. The arguments come after the modes that they keep from arming, and a component."""
