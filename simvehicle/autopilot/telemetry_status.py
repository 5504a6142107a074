"""Telemetry of how a vehicle is: modes, health, battery, mission. One method a message."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot.flight import Flight
from simvehicle.autopilot.message_streams import Build
from simvehicle.autopilot.mission_progress import MissionProgress
from simvehicle.autopilot.mission_run import MissionRun
from simvehicle.autopilot.pilot import RemoteControl
from simvehicle.autopilot.reports import EstimatorReport, HealthReport, ModeReport


class StatusTelemetry:
    def __init__(
        self,
        flight: Flight,
        progress: MissionProgress,
        remote: RemoteControl,
        modes: ModeReport,
        estimate: EstimatorReport,
        health: HealthReport,
        *,
        mav_autopilot: int,
        vtol_state: int,
        no_mission_total: int,
    ) -> None:
        self._flight = flight
        self._progress = progress
        self._remote = remote
        self._modes = modes
        self._estimate = estimate
        self._health = health
        self._mav_autopilot = mav_autopilot
        self._vtol_state = vtol_state
        self._no_mission_total = no_mission_total

    def messages(self) -> dict[int, Build]:
        return {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self._heartbeat,
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: self._sys_status,
            mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: self._system_time,
            mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: self._mission_current,
            mavlink.MAVLINK_MSG_ID_RC_CHANNELS: self._rc_channels,
            mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: self._battery,
            mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: self._estimator_status,
            mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: self._extended_state,
        }

    def _boot_ms(self) -> int:
        return int(self._flight.time_s * 1000)

    def _boot_us(self) -> int:
        return int(self._flight.time_s * 1e6)

    def _heartbeat(self) -> Any:
        if self._flight.time_s < 2.5 * self._flight.ready_after_s / 41.5:
            status = mavlink.MAV_STATE_CALIBRATING
        elif self._flight.failsafe:
            status = mavlink.MAV_STATE_CRITICAL
        else:
            status = (
                mavlink.MAV_STATE_STANDBY
                if self._flight.landed and self._modes.is_idle
                else mavlink.MAV_STATE_ACTIVE
            )
        return mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_QUADROTOR,
            self._mav_autopilot,
            self._modes.base_mode(),
            self._modes.custom_mode,
            status,
            3,
        )

    def _sys_status(self) -> Any:
        present, enabled, healthy = self._health.health()
        battery = self._flight.vehicle.battery
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

    def _system_time(self) -> Any:
        """Unix time is unknown to a vehicle in simulated time: 0, as before the first fix."""
        return mavlink.MAVLink_system_time_message(0, self._boot_ms())

    def _mission_current(self) -> Any:
        items = self._progress.items
        running = isinstance(self._flight.maneuver, MissionRun)
        if not items:
            state = mavlink.MISSION_STATE_NO_MISSION
        elif self._progress.complete:
            state = mavlink.MISSION_STATE_COMPLETE
        elif running:
            state = mavlink.MISSION_STATE_ACTIVE
        else:
            state = self._modes.mission_idle_state()
        total = self._progress.total if items else self._no_mission_total
        current = min(self._progress.next, max(0, len(items) - 1))
        return mavlink.MAVLink_mission_current_message(current, total, state, 1 if running else 0)

    def _rc_channels(self) -> Any:
        return mavlink.MAVLink_rc_channels_message(
            self._boot_ms(), 8, *self._remote.pulses_us, *[0] * 10, 255
        )

    def _battery(self) -> Any:
        battery = self._flight.vehicle.battery
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

    def _estimator_status(self) -> Any:
        ratio = 1.5 if self._estimate.lost else 0.05
        return mavlink.MAVLink_estimator_status_message(
            self._boot_us(), self._estimate.flags(), ratio, ratio, 0.05, 0.05, 0.0, 0.0, 0.3, 0.3
        )

    def _extended_state(self) -> Any:
        return mavlink.MAVLink_extended_sys_state_message(self._vtol_state, self._modes.landed_state())
