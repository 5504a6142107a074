"""ArduCopter, put together: its setpoints, its pilot, its words and what it does ten times a second.

The yardstick is a recorded flight of ArduCopter 4.6.3; where that is silent, https://ardupilot.org/copter/.
"""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot import ardupilot_parameters
from simvehicle.autopilot.announcer import Announcer, TextStyle
from simvehicle.autopilot.ardupilot_arming import ArduPilotArming
from simvehicle.autopilot.ardupilot_avoidance import ArduPilotAvoidance
from simvehicle.autopilot.ardupilot_commands import ArduPilotCommands
from simvehicle.autopilot.ardupilot_estimate import ArduPilotEstimate
from simvehicle.autopilot.ardupilot_failsafes import ArduPilotFailsafes
from simvehicle.autopilot.ardupilot_fence import ArduPilotFence
from simvehicle.autopilot.ardupilot_lists import ArduPilotLists
from simvehicle.autopilot.ardupilot_mishaps import ArduPilotMishaps
from simvehicle.autopilot.ardupilot_mode_control import ArduPilotModeControl
from simvehicle.autopilot.ardupilot_modes import ArduPilotMode
from simvehicle.autopilot.channel import Channel, ChannelPeer
from simvehicle.autopilot.commands import ACCEPTED, DENIED, FAILED, AnswerStyle
from simvehicle.autopilot.flight import Flight
from simvehicle.autopilot.maneuvers import Follow, HoldPosition, Sticks, TakeOff
from simvehicle.autopilot.message_streams import Build, StreamStyle
from simvehicle.autopilot.mission_progress import MissionProgress, MissionStyle
from simvehicle.autopilot.mission_run import NAMES, Told
from simvehicle.autopilot.missions import RALLY
from simvehicle.autopilot.parameters import UNASKED, Parameters, ParameterStyle
from simvehicle.autopilot.personality import FlavourRecipe, Identity, Personality, SharedParts
from simvehicle.autopilot.pilot import PilotInputs, RemoteControl, is_given
from simvehicle.autopilot.setpoints import motion_of

_INFO = mavlink.MAV_SEVERITY_INFO
_CAPABILITIES = 64495
"""As recorded."""
_VERSION = 4 << 24 | 6 << 16 | 3 << 8 | 255
_IGNORES_VELOCITY = 0x38

_DATA_STREAMS = {
    mavlink.MAV_DATA_STREAM_RAW_SENSORS: (27, 29),
    mavlink.MAV_DATA_STREAM_EXTENDED_STATUS: (1, 42, 24, 62, 162),
    mavlink.MAV_DATA_STREAM_RC_CHANNELS: (36, 65),
    mavlink.MAV_DATA_STREAM_POSITION: (33, 32),
    mavlink.MAV_DATA_STREAM_EXTRA1: (30,),
    mavlink.MAV_DATA_STREAM_EXTRA2: (74,),
    mavlink.MAV_DATA_STREAM_EXTRA3: (2, 168, 147, 193, 241),
}
"""REQUEST_DATA_STREAM's groups as ArduCopter fills them, as far as we have the messages."""


class ArduPilotPilot:
    """The remote control: a switch for the modes, and sticks that are let go after a while."""

    def __init__(
        self, flight: Flight, parameters: Parameters, remote: RemoteControl, modes: ArduPilotModeControl
    ) -> None:
        self._flight = flight
        self._parameters = parameters
        self._remote = remote
        self._modes = modes
        self._override_s: float | None = None

    def may_fly(self, system: int) -> bool:
        return system == int(self._parameters["SYSID_MYGCS"])

    def moved(self, given_us: list[int]) -> None:
        before = self._switch_position()
        self._remote.take(given_us)
        self._override_s = self._flight.now_s
        after = self._switch_position()
        if after != before:
            self._modes.set_mode(int(self._parameters[f"FLTMODE{after}"]))
        self._move_sticks(self._remote.throttle if is_given(given_us[2]) else 0.0)

    def step(self, now_s: float) -> None:
        if self._override_s is not None and now_s - self._override_s > self._parameters["RC_OVERRIDE_TIME"]:
            self._override_s = None
            self._remote.let_go()
            self._move_sticks(0.0)

    def _move_sticks(self, up: float) -> None:
        if isinstance(self._flight.maneuver, Sticks):
            self._remote.move(self._flight.maneuver, up)

    def _switch_position(self) -> int:
        pulse_us = self._remote.pulses_us[int(self._parameters["FLTMODE_CH"]) - 1]
        return 1 + sum(pulse_us > bound for bound in (1230, 1360, 1490, 1620, 1749))


class ArduPilotFlightEvents:
    """A `FlightEvents`."""

    def __init__(
        self,
        flight: Flight,
        parameters: Parameters,
        announcer: Announcer,
        progress: MissionProgress,
        estimate: ArduPilotEstimate,
        modes: ArduPilotModeControl,
        failsafes: ArduPilotFailsafes,
        arming: ArduPilotArming,
        fence: ArduPilotFence,
        avoidance: ArduPilotAvoidance,
        pilot: ArduPilotPilot,
    ) -> None:
        self._flight = flight
        self._parameters = parameters
        self._announcer = announcer
        self._progress = progress
        self._estimate = estimate
        self._modes = modes
        self._failsafes = failsafes
        self._mishaps = ArduPilotMishaps(flight, parameters, announcer)
        self._arming = arming
        self._fence = fence
        self._avoidance = avoidance
        self._pilot = pilot

    def slow_step(self, now_s: float) -> None:
        self._estimate.step()
        self._arming.prearm_texts()
        self._failsafes.step(now_s)
        self._mishaps.step(now_s)
        self._arming.disarm_on_the_ground(now_s)
        self._flight.failsafe = self._failsafes.active
        self._pilot.step(now_s)
        self._end_maneuver(now_s)

    def _end_maneuver(self, now_s: float) -> None:
        """What is done, or no longer asked for, ends in a hover."""
        flight, maneuver = self._flight, self._flight.maneuver
        if isinstance(maneuver, TakeOff) and maneuver.finished:
            north, east, _ = flight.nav.position_m
            flight.maneuver = HoldPosition((north, east, flight.nav.home_m[2] - maneuver.above_home_m))
        elif isinstance(maneuver, Follow) and maneuver.motion.horizontal_m is None:
            late = now_s - maneuver.given_s > self._parameters["GUID_TIMEOUT"]
            flight.maneuver = HoldPosition() if late else maneuver

    def touched(self, impact_mps: float) -> None:
        self._announcer.say(_INFO, f"SIM Hit ground at {impact_mps:.6f} m/s")

    def crashed(self, impact_mps: float) -> None:
        """ArduCopter looks at its attitude alone: one that fell flat stays armed and believes that it flies."""

    def landed(self) -> None:
        self._modes.after_landing()

    def mission(self, told: Told, sequence: int) -> None:
        if told is Told.COMPLETE:
            return  # a mission that was cleared in flight is complete too, and has no last item
        command = self._progress.items[sequence].command
        if told is Told.STARTED:
            self._announcer.say(_INFO, f"Mission: {sequence} {NAMES.get(command, str(command))}")
        elif command != mavlink.MAV_CMD_NAV_TAKEOFF:
            self._announcer.say(_INFO, f"Reached command #{sequence}")

    def parameter_changed(self, name: str) -> None:
        self._modes.renew_limits()
        if name == "SIM_BATT_VOLTAGE":
            self._flight.vehicle.battery.full_volts = self._parameters[name]
        elif name == "SIM_GPS_DISABLE":
            self._flight.vehicle.estimator.gps = not self._parameters[name]

    def setpoint(self, message: Any) -> None:
        flight = self._flight
        if self._modes.mode is not ArduPilotMode.GUIDED or not flight.armed:
            return
        motion = motion_of(message, flight.nav, flight.vehicle.estimator, per_axis=False)
        if motion is None:
            return
        no_yaw = motion.yaw_rad is None and motion.yaw_rate_radps is None
        if motion.horizontal_m is not None:
            if not self._fence.allows(*motion.horizontal_m):
                return  # a destination outside the fence is refused, without a word on the link
        elif message.type_mask & _IGNORES_VELOCITY:
            flight.maneuver = HoldPosition()
            return
        elif motion.horizontal_mps is not None and motion.down_mps is not None:
            adjusted = self._avoidance.adjusted(motion.horizontal_mps, motion.down_mps)
            motion.horizontal_mps, motion.down_mps = adjusted
        if isinstance(flight.maneuver, Follow):
            flight.maneuver.renewed(motion, flight.now_s, face_travel=no_yaw)
        else:
            flight.maneuver = Follow(motion, flight.now_s, face_travel=no_yaw, lifts_off=False)


def _messages(
    system: int, flight: Flight, parameters: Parameters, estimate: ArduPilotEstimate, fence: ArduPilotFence
) -> dict[int, Build]:
    def version() -> Any:
        board = list(b"simvehic")
        uid2 = [system] + [0] * 17
        return mavlink.MAVLink_autopilot_version_message(
            _CAPABILITIES, _VERSION, 0, 0, 0, board, [0] * 8, [0] * 8, 0, 0, 0, uid2
        )

    def wind() -> Any | None:
        """Where it comes from, degrees."""
        if not estimate.ready:
            return None
        told = ardupilot_parameters.estimates_wind(parameters) and not flight.landed
        north, east, _ = flight.wind_estimate if told else (0.0, 0.0, 0.0)
        from_deg = math.degrees(math.atan2(-east, -north))
        return mavlink.MAVLink_wind_message(from_deg, math.hypot(north, east), 0.0)

    def estimator() -> Any:
        variance = 0.9 if estimate.lost else 0.02
        return mavlink.MAVLink_ekf_status_report_message(
            estimate.flags(), variance, variance, 0.01, 0.02, 0.0
        )

    return {
        mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: version,
        mavlink.MAVLINK_MSG_ID_WIND: wind,
        mavlink.MAVLINK_MSG_ID_WIND_COV: lambda: None,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: estimator,
        mavlink.MAVLINK_MSG_ID_FENCE_STATUS: fence.status,
    }


def _unknown_parameter(_channel: Channel, _peer: ChannelPeer, _name: str) -> None:
    """ArduPilot 4.6 says nothing, as recorded."""


def _build(parts: SharedParts) -> Personality:
    flight, parameters, announcer = parts.flight, parts.parameters, parts.announcer

    def back() -> Any:
        return ardupilot_parameters.return_to_launch(parameters, flight, parts.lists[RALLY])

    def list_requested() -> None:
        for text in ("ArduCopter V4.6.3 (simvehicle)", "Frame: QUAD/PLUS"):
            announcer.say(_INFO, text)

    missions = MissionStyle(
        first=1, arrival_m=lambda: max(0.5, parameters["WPNAV_RADIUS"] / 100.0), back=back
    )
    progress = MissionProgress(flight, parts.lists, missions)
    estimate = ArduPilotEstimate(flight, announcer)
    modes = ArduPilotModeControl(flight, parameters, announcer, estimate, progress, back)
    fence = ArduPilotFence(flight, parameters, parts.fence, announcer)
    failsafes = ArduPilotFailsafes(
        flight, parameters, announcer, estimate, modes, fence, parts.ground_heard_s
    )
    arming = ArduPilotArming(flight, parameters, announcer, estimate, modes, failsafes, fence)
    commands = ArduPilotCommands(flight, estimate, modes, arming, fence, parts.set_parameter)
    pilot = ArduPilotPilot(flight, parameters, parts.remote, modes)
    return Personality(
        identity=Identity(
            mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
            gps_fix_type=mavlink.GPS_FIX_TYPE_RTK_FIXED,
            vtol_state=mavlink.MAV_VTOL_STATE_MC,
            no_mission_total=0,
        ),
        modes=modes,
        estimate=estimate,
        health=arming,
        progress=progress,
        lists=ArduPilotLists(flight, parameters, announcer).style(),
        parameters=ParameterStyle(UNASKED, unknown=_unknown_parameter, list_requested=list_requested),
        streams=StreamStyle(
            first_s={},
            groups=_DATA_STREAMS,
            unknown_interval=DENIED,
            unknown_request=FAILED,
            nothing_yet=ACCEPTED,
        ),
        messages=_messages(parts.system, flight, parameters, estimate, fence),
        commands=commands.table(),
        handlers={},
        split_mode=lambda custom_mode: (custom_mode, 0),
        answers=AnswerStyle(),
        pilot=PilotInputs(pilot.may_fly, pilot.moved),
        events=ArduPilotFlightEvents(
            flight,
            parameters,
            announcer,
            progress,
            estimate,
            modes,
            failsafes,
            arming,
            fence,
            ArduPilotAvoidance(flight, parameters, parts.fence),
            pilot,
        ),
        switch_mode=modes.set_mode,
        unheard=failsafes.unheard,
    )


ARDUPILOT = FlavourRecipe(
    system_parameter="SYSID_THISMAV",
    limits=ardupilot_parameters.limits,
    battery=ardupilot_parameters.battery,
    texts=TextStyle(),
    weak_battery_fraction=0.10,
    build=_build,
)
