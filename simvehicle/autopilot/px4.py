"""PX4 for multicopters, put together: its setpoints, its pilot, its words and what it does ten times a second.

After the PX4 user guide (https://docs.px4.io/v1.15/en/: flight modes, safety configuration, Offboard), and a recorded
PX4 1.16 whose conversation it repeats.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.dialect import AvailableModesMessage, CurrentModeMessage
from simvehicle.autopilot import px4_parameters
from simvehicle.autopilot.announcer import TextStyle
from simvehicle.autopilot.channel import Channel, ChannelPeer
from simvehicle.autopilot.commands import FAILED, REJECTED, UNSUPPORTED, AnswerStyle
from simvehicle.autopilot.flight import Flight
from simvehicle.autopilot.maneuvers import Follow, Return, Sticks
from simvehicle.autopilot.message_streams import Build, StreamStyle
from simvehicle.autopilot.mission_progress import MissionProgress, MissionStyle
from simvehicle.autopilot.mission_run import Told
from simvehicle.autopilot.parameters import Parameters, ParameterStyle
from simvehicle.autopilot.personality import FlavourRecipe, Identity, Personality, SharedParts
from simvehicle.autopilot.pilot import PilotInputs, RemoteControl
from simvehicle.autopilot.px4_arming import Px4Arming
from simvehicle.autopilot.px4_commands import Px4Commands, available_modes
from simvehicle.autopilot.px4_estimate import Px4Estimate
from simvehicle.autopilot.px4_failsafes import Px4Failsafes
from simvehicle.autopilot.px4_lists import Px4Lists
from simvehicle.autopilot.px4_mode_control import OffboardSetpoints, Px4ModeControl
from simvehicle.autopilot.px4_modes import STICKS, Px4Mode
from simvehicle.autopilot.px4_report import Px4Report
from simvehicle.autopilot.px4_voice import Px4Voice
from simvehicle.autopilot.setpoints import motion_of
from simvehicle.vehicle.dynamics import quaternion_of

_INFO, _WARNING = mavlink.MAV_SEVERITY_INFO, mavlink.MAV_SEVERITY_WARNING
_CAPABILITIES = 0xE8FF
_VERSION = 1 << 24 | 16 << 16 | 64
"""1.16.0, alpha."""
_NO_MISSION = 65535
_UNKNOWN_COVARIANCE = [math.nan] * 21
_LANDED_AFTER_S = 4.2
"""From touching the ground to being sure of it, as recorded: PX4 goes by way of "maybe landed"."""
_REACHED_AGAIN_S, _REACHED_TIMES = 1.0, 10
"""MISSION_ITEM_REACHED is repeated: it may have been lost."""
_IGNORES_ALL = 0x3F

_UNSEEN = frozenset((2, 4, 8, 83, 111, 380, 12901, 12904))
"""PING, TIMESYNC and others that the recorded one sends besides."""

_FIRST_STREAMS_S = {
    mavlink.MAVLINK_MSG_ID_ALTITUDE: 1.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 1 / 15,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 2.0,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 2.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 1.0,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 0.2,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: 1.0,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 1.0,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: 2.0,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 1.0,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: 1.0,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: 1.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 0.25,
    mavlink.MAVLINK_MSG_ID_VIBRATION: 10.0,
    mavlink.MAVLINK_MSG_ID_WIND_COV: 2.0,
}
"""PX4's "normal" profile, as far as we have the messages (mavlink_main.cpp)."""

_COMPANION_HZ = {
    mavlink.MAVLINK_MSG_ID_ALTITUDE: 10.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 100.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 50.0,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 0.5,
    CurrentModeMessage.id: 0.5,
    mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR: 10.0,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 5.0,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 50.0,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: 0.1,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 8.0,
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: 50.0,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 30.0,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: 1.0,
    mavlink.MAVLINK_MSG_ID_ODOMETRY: 30.0,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: 10.0,
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE: 1.0,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: 10.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 5.0,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 10.0,
    mavlink.MAVLINK_MSG_ID_VIBRATION: 0.5,
    mavlink.MAVLINK_MSG_ID_WIND_COV: 10.0,
}
"""The "onboard" profile as recorded, as far as we have the messages; none comes faster than our 50 Hz."""


class Px4FlightEvents:
    """A `FlightEvents`."""

    def __init__(
        self,
        flight: Flight,
        parameters: Parameters,
        progress: MissionProgress,
        voice: Px4Voice,
        estimate: Px4Estimate,
        modes: Px4ModeControl,
        offboard: OffboardSetpoints,
        failsafes: Px4Failsafes,
        arming: Px4Arming,
        lists: Px4Lists,
        report: Px4Report,
        broadcast: Callable[[Any], None],
    ) -> None:
        self._flight = flight
        self._parameters = parameters
        self._progress = progress
        self._voice = voice
        self._estimate = estimate
        self._modes = modes
        self._offboard = offboard
        self._failsafes = failsafes
        self._arming = arming
        self._lists = lists
        self._report = report
        self._broadcast = broadcast
        self._reached: tuple[int, int, float] | None = None
        """The item that was reached last, how often it is still told, and when next."""

    def slow_step(self, now_s: float) -> None:
        self._estimate.step()
        self._failsafes.step(now_s)
        self._arming.disarm_on_the_ground(now_s)
        self._modes.step()
        self._lists.step(now_s)
        self._report.step(now_s)
        self._voice.step(now_s)
        self._tell_reached(now_s)

    def _tell_reached(self, now_s: float) -> None:
        if self._reached is None or now_s < self._reached[2]:
            return
        sequence, left, _ = self._reached
        self._reached = (sequence, left - 1, now_s + _REACHED_AGAIN_S) if left > 1 else None
        if sequence < len(self._progress.items):
            self._broadcast(mavlink.MAVLink_mission_item_reached_message(sequence))

    def touched(self, impact_mps: float) -> None:
        """PX4 speaks up once it is sure that it has landed."""

    def crashed(self, impact_mps: float) -> None:
        text = f"Crash: Disarming: hit the ground at {impact_mps:.1f} m/s"
        self._flight.disarm(text, mavlink.MAV_SEVERITY_CRITICAL)

    def landed(self) -> None:
        self._voice.tell("commander_landing_detected", _INFO, text="Landing detected")

    def mission(self, told: Told, sequence: int) -> None:
        if told is Told.COMPLETE:
            self._voice.tell("mission_finished_loiter", _INFO, text="Mission finished, loitering")
            self._modes.step()
        elif told is Told.REACHED:
            self._reached = (sequence, _REACHED_TIMES, self._flight.now_s + _REACHED_AGAIN_S)
        elif self._progress.items[sequence].command == mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
            self._voice.tell("commander_rtl", _INFO, text="Returning to launch")
            self._modes.fall_back(Px4Mode.RETURN)

    def parameter_changed(self, name: str) -> None:  # noqa: ARG002 - the others are read where they are used
        self._modes.renew_limits()

    def setpoint(self, message: Any) -> None:
        flight = self._flight
        motion = motion_of(message, flight.nav, flight.vehicle.estimator, per_axis=True)
        if motion is None or message.type_mask & _IGNORES_ALL == _IGNORES_ALL:
            return
        self._offboard.take(motion, flight.now_s)
        motion.speed_mps = self._parameters["MPC_XY_VEL_MAX"]
        if self._modes.mode is Px4Mode.OFFBOARD and flight.armed:
            if isinstance(flight.maneuver, Follow):
                flight.maneuver.renewed(motion, flight.now_s, face_travel=False)
            else:
                self._modes.begin()


class Px4Pilot:
    def __init__(self, flight: Flight, remote: RemoteControl, modes: Px4ModeControl) -> None:
        self._flight = flight
        self._remote = remote
        self._modes = modes

    def take(self) -> None:
        """A person holds the remote control from now on, its sticks centred."""
        self._modes.sticks_s = math.inf

    def moved(self, given_us: list[int]) -> None:
        self._remote.take(given_us)
        self._modes.sticks_s = self._flight.now_s
        if isinstance(self._flight.maneuver, Sticks):
            self._remote.move(self._flight.maneuver, self._remote.throttle)


def _list_requested() -> None:
    """Nothing but the list."""


def _unknown_parameter(channel: Channel, peer: ChannelPeer, name: str) -> None:
    if not name.startswith("#"):
        channel.send(
            mavlink.MAVLink_param_error_message(
                peer.system, peer.component, name.encode(), -1, mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST
            )
        )


def _messages(
    system: int,
    flight: Flight,
    parameters: Parameters,
    estimate: Px4Estimate,
    modes: Px4ModeControl,
    arming: Px4Arming,
) -> dict[int, Build]:
    def version() -> Any:
        board = list(b"simvehic")
        uid2 = [system] + [0] * 17
        return mavlink.MAVLink_autopilot_version_message(
            _CAPABILITIES, _VERSION, _VERSION, 0, 1, board, [0] * 8, [0] * 8, 0, 0, system, uid2
        )

    def heartbeat() -> Any:
        """Once a second and not when the mode changes; what cannot be armed in its mode is not on standby."""
        if flight.armed:
            status = mavlink.MAV_STATE_CRITICAL if flight.failsafe else mavlink.MAV_STATE_ACTIVE
        else:
            status = mavlink.MAV_STATE_STANDBY if arming.can_arm() else mavlink.MAV_STATE_UNINIT
        return mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_QUADROTOR,
            mavlink.MAV_AUTOPILOT_PX4,
            modes.base_mode(),
            modes.custom_mode,
            status,
            3,
        )

    def current_mode() -> Any:
        custom = modes.custom_mode
        return CurrentModeMessage(standard_mode=0, custom_mode=custom, intended_custom_mode=custom)

    def odometry() -> Any | None:
        """Pose and velocity in one, both in the local frame; how sure it is it does not say."""
        if not estimate.ready:
            return None
        frame = mavlink.MAV_FRAME_LOCAL_NED
        return mavlink.MAVLink_odometry_message(
            int(flight.time_s * 1e6),
            frame,
            frame,
            *flight.nav.position_m,
            list(quaternion_of(flight.vehicle.body.attitude_rad)),
            *flight.nav.velocity_mps,
            *flight.vehicle.body.rates_radps,
            _UNKNOWN_COVARIANCE,
            _UNKNOWN_COVARIANCE,
        )

    def wind() -> Any | None:
        """The vector, NED; only with drag fusion on."""
        if not parameters["EKF2_DRAG_CTRL"] or flight.landed:
            return None
        north, east, _ = flight.wind_estimate
        return mavlink.MAVLink_wind_cov_message(
            int(flight.time_s * 1e6), north, east, 0.0, 0.25, 0.0, flight.above_home_m, 0.5, 0.0
        )

    return {
        mavlink.MAVLINK_MSG_ID_HEARTBEAT: heartbeat,
        mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: version,
        mavlink.MAVLINK_MSG_ID_ODOMETRY: odometry,
        CurrentModeMessage.id: current_mode,
        mavlink.MAVLINK_MSG_ID_WIND: lambda: None,
        mavlink.MAVLINK_MSG_ID_WIND_COV: wind,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: lambda: None,
        mavlink.MAVLINK_MSG_ID_FENCE_STATUS: lambda: None,
    }


def _build(parts: SharedParts) -> Personality:
    flight, parameters, announcer = parts.flight, parts.parameters, parts.announcer

    def back() -> Return:
        return px4_parameters.return_to_launch(parameters, flight)

    flight.landed_after_s = _LANDED_AFTER_S
    missions = MissionStyle(first=0, arrival_m=lambda: parameters["NAV_ACC_RAD"], back=back)
    progress = MissionProgress(flight, parts.lists, missions)
    voice = Px4Voice(flight, announcer)
    estimate = Px4Estimate(flight)
    offboard = OffboardSetpoints(parameters)
    modes = Px4ModeControl(flight, parameters, voice, estimate, progress, offboard, back)
    failsafes = Px4Failsafes(
        flight, parameters, voice, estimate, modes, offboard, parts.fence, parts.ground_heard_s
    )
    report = Px4Report(
        flight,
        estimate,
        progress,
        offboard,
        voice,
        modes,
        lambda: not failsafes.link_lost,
        lambda: failsafes.breached,
        failsafes.faults,
    )
    failsafes.report_by(report.now)
    lists = Px4Lists(flight, parts.fence, voice)
    lists.check_by(progress)
    arming = Px4Arming(flight, parameters, estimate, modes, failsafes, report, voice)
    commands = Px4Commands(flight, parameters, voice, progress, modes, failsafes, arming, report)
    pilot = Px4Pilot(flight, parts.remote, modes)

    def switch_mode(custom_mode: int) -> int:
        mode = Px4Mode(custom_mode)
        if mode in STICKS:
            pilot.take()
        return commands.enter(mode)

    return Personality(
        identity=Identity(
            mavlink.MAV_AUTOPILOT_PX4,
            gps_fix_type=mavlink.GPS_FIX_TYPE_3D_FIX,
            vtol_state=mavlink.MAV_VTOL_STATE_UNDEFINED,
            no_mission_total=_NO_MISSION,
        ),
        modes=modes,
        estimate=estimate,
        health=arming,
        progress=progress,
        lists=lists.style(),
        parameters=ParameterStyle(
            None,
            unknown=_unknown_parameter,
            list_requested=_list_requested,
            corrects_types=False,
            has_hash=True,
        ),
        streams=StreamStyle(
            first_s=_FIRST_STREAMS_S,
            groups={},
            unknown_interval=FAILED,
            unknown_request=UNSUPPORTED,
            nothing_yet=REJECTED,
            companion_first_s=None if parts.quiet else {k: 1.0 / hz for k, hz in _COMPANION_HZ.items()},
            unseen=_UNSEEN,
            series={AvailableModesMessage.id: available_modes},
        ),
        messages=_messages(parts.system, flight, parameters, estimate, modes, arming),
        commands=commands.table(),
        handlers=voice.handlers(),
        split_mode=lambda custom_mode: (custom_mode >> 16 & 0xFF, custom_mode >> 24),
        answers=AnswerStyle(set_mode=mavlink.MAV_CMD_DO_SET_MODE, message_first=True),
        pilot=PilotInputs(lambda system: system != parts.system, pilot.moved),
        events=Px4FlightEvents(
            flight,
            parameters,
            progress,
            voice,
            estimate,
            modes,
            offboard,
            failsafes,
            arming,
            lists,
            report,
            announcer.broadcast,
        ),
        switch_mode=switch_mode,
        unheard=failsafes.unheard,
    )


PX4 = FlavourRecipe(
    system_parameter="MAV_SYS_ID",
    limits=px4_parameters.limits,
    battery=px4_parameters.battery,
    texts=TextStyle(all_numbered=True, to_ground_only=True),
    weak_battery_fraction=0.06,
    build=_build,
)
