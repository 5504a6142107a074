"""PX4 for multicopters, put together: its setpoints, its pilot, its words and what it does ten times a second.

After the PX4 user guide v1.15 (https://docs.px4.io/v1.15/en/: flight modes, safety configuration, Offboard). There
is no recording of one to compare with: its texts are near in meaning, not in words.
"""

from __future__ import annotations

import dataclasses
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot import px4_parameters
from simvehicle.autopilot.announcer import Announcer
from simvehicle.autopilot.channel import Channel, ChannelPeer
from simvehicle.autopilot.commands import REJECTED, UNSUPPORTED
from simvehicle.autopilot.flight import Flight
from simvehicle.autopilot.maneuvers import Follow, Return, Sticks
from simvehicle.autopilot.message_streams import Build, StreamStyle
from simvehicle.autopilot.mission_progress import MissionProgress, MissionStyle
from simvehicle.autopilot.mission_run import Told
from simvehicle.autopilot.missions import StoredItem
from simvehicle.autopilot.parameters import Parameters, ParameterStyle
from simvehicle.autopilot.personality import FlavourRecipe, Identity, Personality, SharedParts
from simvehicle.autopilot.pilot import PilotInputs, RemoteControl
from simvehicle.autopilot.px4_arming import Px4Arming
from simvehicle.autopilot.px4_commands import Px4Commands
from simvehicle.autopilot.px4_estimate import Px4Estimate
from simvehicle.autopilot.px4_failsafes import Px4Failsafes
from simvehicle.autopilot.px4_mode_control import OffboardSetpoints, Px4ModeControl
from simvehicle.autopilot.px4_modes import Px4Mode
from simvehicle.autopilot.setpoints import motion_of
from simvehicle.autopilot.uploaded_lists import ListStyle

_INFO, _WARNING = mavlink.MAV_SEVERITY_INFO, mavlink.MAV_SEVERITY_WARNING
_CAPABILITIES = (
    mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
    | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
)
_VERSION = 1 << 24 | 15 << 16 | 4 << 8 | 255
_IGNORES_ALL = 0x3F

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


class Px4Events:
    """A `FlightEvents`."""

    def __init__(
        self,
        flight: Flight,
        parameters: Parameters,
        announcer: Announcer,
        estimate: Px4Estimate,
        modes: Px4ModeControl,
        offboard: OffboardSetpoints,
        failsafes: Px4Failsafes,
        arming: Px4Arming,
    ) -> None:
        self._flight = flight
        self._parameters = parameters
        self._announcer = announcer
        self._estimate = estimate
        self._modes = modes
        self._offboard = offboard
        self._failsafes = failsafes
        self._arming = arming

    def slow_step(self, now_s: float) -> None:
        self._estimate.step()
        self._arming.tell_ready()
        self._failsafes.step(now_s)
        self._arming.disarm_on_the_ground(now_s)
        self._modes.step()

    def touched(self, impact_mps: float) -> None:
        """PX4 speaks up once it is sure that it has landed."""

    def crashed(self, impact_mps: float) -> None:
        text = f"Crash: Disarming: hit the ground at {impact_mps:.1f} m/s"
        self._flight.disarm(text, mavlink.MAV_SEVERITY_CRITICAL)

    def landed(self) -> None:
        self._announcer.say(_INFO, "Landing detected")

    def mission(self, told: Told, sequence: int) -> None:  # noqa: ARG002 - ArduPilot names the items
        if told is Told.COMPLETE:
            self._announcer.say(_INFO, "Mission finished, loitering")

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

    def moved(self, given_us: list[int]) -> None:
        self._remote.take(given_us)
        self._modes.sticks_s = self._flight.now_s
        if isinstance(self._flight.maneuver, Sticks):
            self._remote.move(self._flight.maneuver, self._remote.throttle)


def _stored(_kind: int, item: StoredItem) -> StoredItem:
    return dataclasses.replace(item, frame={5: 0, 6: 3}.get(item.frame, item.frame))


def _as_stored(_kind: int, _sequence: int, item: StoredItem) -> StoredItem:
    return item


def _accepted(_kind: int, _items: list[StoredItem]) -> None:
    """PX4 says nothing about a list that is in order."""


def _progress(_kind: int, _count: int) -> None:
    """PX4 keeps no totals as parameters."""


def _list_requested() -> None:
    """Nothing but the list."""


def _unknown_parameter(channel: Channel, peer: ChannelPeer, name: str) -> None:
    text = f"[pm] unknown param: {name}".encode()[:50]
    channel.send(mavlink.MAVLink_statustext_message(_WARNING, text))
    if not name.startswith("#"):
        channel.send(
            mavlink.MAVLink_param_error_message(
                peer.system, peer.component, name.encode(), -1, mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST
            )
        )


def _messages(system: int, flight: Flight, parameters: Parameters) -> dict[int, Build]:
    def version() -> Any:
        board = list(b"simvehic")
        uid2 = [system] + [0] * 17
        return mavlink.MAVLink_autopilot_version_message(
            int(_CAPABILITIES), _VERSION, _VERSION, 0, 0, board, [0] * 8, [0] * 8, 0, 0, system, uid2
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
        mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: version,
        mavlink.MAVLINK_MSG_ID_WIND: lambda: None,
        mavlink.MAVLINK_MSG_ID_WIND_COV: wind,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: lambda: None,
        mavlink.MAVLINK_MSG_ID_FENCE_STATUS: lambda: None,
    }


def _build(parts: SharedParts) -> Personality:
    flight, parameters, announcer = parts.flight, parts.parameters, parts.announcer

    def back() -> Return:
        return px4_parameters.return_to_launch(parameters, flight)

    missions = MissionStyle(first=0, arrival_m=lambda: parameters["NAV_ACC_RAD"], back=back)
    progress = MissionProgress(flight, parts.lists, missions)
    estimate = Px4Estimate(flight)
    offboard = OffboardSetpoints(parameters)
    modes = Px4ModeControl(flight, parameters, announcer, estimate, progress, offboard, back)
    failsafes = Px4Failsafes(
        flight, parameters, announcer, estimate, modes, offboard, parts.fence, parts.ground_heard_s
    )
    arming = Px4Arming(flight, parameters, announcer, estimate, modes, failsafes)
    commands = Px4Commands(flight, parameters, announcer, progress, modes, failsafes, arming)
    pilot = Px4Pilot(flight, parts.remote, modes)
    return Personality(
        identity=Identity(
            mavlink.MAV_AUTOPILOT_PX4,
            gps_fix_type=mavlink.GPS_FIX_TYPE_3D_FIX,
            vtol_state=mavlink.MAV_VTOL_STATE_UNDEFINED,
        ),
        modes=modes,
        estimate=estimate,
        health=arming,
        progress=progress,
        lists=ListStyle(
            legacy_requests=False,
            atomic=True,
            stored=_stored,
            read=_as_stored,
            accepted=_accepted,
            progress=_progress,
        ),
        parameters=ParameterStyle(None, unknown=_unknown_parameter, list_requested=_list_requested),
        streams=StreamStyle(
            first_s=_FIRST_STREAMS_S,
            groups={},
            unknown_interval=UNSUPPORTED,
            unknown_request=UNSUPPORTED,
            nothing_yet=REJECTED,
        ),
        messages=_messages(parts.system, flight, parameters),
        commands=commands.table(),
        split_mode=lambda custom_mode: (custom_mode >> 16 & 0xFF, custom_mode >> 24),
        pilot=PilotInputs(lambda system: system != parts.system, pilot.moved),
        events=Px4Events(flight, parameters, announcer, estimate, modes, offboard, failsafes, arming),
        switch_mode=lambda mode: commands.enter(Px4Mode(mode)),
    )


PX4 = FlavourRecipe(
    system_parameter="MAV_SYS_ID",
    limits=px4_parameters.limits,
    battery=px4_parameters.battery,
    weak_battery_fraction=0.06,
    build=_build,
)
