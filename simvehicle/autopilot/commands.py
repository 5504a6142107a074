"""COMMAND_LONG and COMMAND_INT: the commands that both flavours carry out alike, and the acknowledgements.

https://mavlink.io/en/services/command.html. The answer goes out before anything that the command causes, as on the
recorded vehicle.
"""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mission.geometry.frames import Geodetic, Vector3
from simvehicle.autopilot import telemetry_messages as streams
from simvehicle.autopilot.channel import ChannelPeer
from simvehicle.autopilot.setpoints import global_position

if TYPE_CHECKING:
    from simvehicle.autopilot.core import Autopilot

ACCEPTED = int(mavlink.MAV_RESULT_ACCEPTED)
REJECTED = int(mavlink.MAV_RESULT_TEMPORARILY_REJECTED)
DENIED = int(mavlink.MAV_RESULT_DENIED)
UNSUPPORTED = int(mavlink.MAV_RESULT_UNSUPPORTED)
FAILED = int(mavlink.MAV_RESULT_FAILED)

_NOTHING_TO_DO = frozenset(
    (
        mavlink.MAV_CMD_DO_SET_SERVO,
        mavlink.MAV_CMD_DO_SET_RELAY,
        mavlink.MAV_CMD_DO_SET_ROI,
        mavlink.MAV_CMD_DO_SET_ROI_NONE,
        mavlink.MAV_CMD_DO_SET_ROI_LOCATION,
    )
)
"""Accepted without effect: our vehicles have no servos and no gimbal."""
_MINIMUM_INTERVAL_S = 0.02


@dataclasses.dataclass(frozen=True, slots=True)
class ReceivedCommand:
    peer: ChannelPeer
    number: int
    params: tuple[float, float, float, float]
    """Parameters 1 to 4."""
    x: float
    """Parameter 5: mostly a latitude in degrees."""
    y: float
    z: float
    frame: int | None
    """MAV_FRAME of a COMMAND_INT; None for a COMMAND_LONG."""

    def whole(self, place: int) -> int:
        """One of `params` as an integer; -1 where it is none (NaN stands for "not given")."""
        value = self.params[place]
        return int(value) if abs(value) < 2**31 else -1


class CommandServer:
    """Runs commands and acknowledges them."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._after: list[Any] = []
        self._table = {
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: self._set_interval,
            mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: self._get_interval,
            mavlink.MAV_CMD_REQUEST_MESSAGE: self._request_message,
            mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: self._capabilities,
            mavlink.MAV_CMD_GET_HOME_POSITION: self._get_home,
            mavlink.MAV_CMD_DO_SET_HOME: self._set_home,
            mavlink.MAV_CMD_DO_SET_MISSION_CURRENT: self._set_mission_current,
            mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: self._grounded_only,
            mavlink.MAV_CMD_PREFLIGHT_CALIBRATION: self._grounded_only,
            mavlink.MAV_CMD_PREFLIGHT_STORAGE: self._grounded_only,
        }

    def run(self, command: ReceivedCommand, answers: int | None = None) -> None:
        """Carry out and acknowledge; `answers` is the id to acknowledge where it is not the command's own."""
        handler = self._table.get(command.number)
        if handler is not None:
            result = handler(command)
        elif command.number in _NOTHING_TO_DO:
            result = ACCEPTED
        else:
            flavoured = self._autopilot.command(command)
            result = UNSUPPORTED if flavoured is None else flavoured
        channel = self._autopilot.channels[command.peer.link]
        acknowledged = command.number if answers is None else answers
        channel.send(
            mavlink.MAVLink_command_ack_message(
                acknowledged, result, 0, 0, command.peer.system, command.peer.component
            )
        )
        after, self._after = self._after, []
        for message in after:
            channel.send(message)
        self._autopilot.flush_texts()

    def _set_interval(self, command: ReceivedCommand) -> int:
        message_id, interval_us = command.whole(0), command.params[1]
        if message_id not in streams.BUILDERS:
            return DENIED if self._autopilot.flavour == "ardupilot" else UNSUPPORTED
        interval_s: float | None
        if interval_us < 0:
            interval_s = None
        elif interval_us == 0:
            interval_s = self._autopilot.first_streams().get(message_id)
        else:
            interval_s = max(_MINIMUM_INTERVAL_S, interval_us / 1e6)
        channel = self._autopilot.channels[command.peer.link]
        channel.set_stream(message_id, interval_s, self._autopilot.now_s or 0.0)
        return ACCEPTED

    def _get_interval(self, command: ReceivedCommand) -> int:
        message_id = command.whole(0)
        if message_id not in streams.BUILDERS:
            return UNSUPPORTED
        stream = self._autopilot.channels[command.peer.link].streams.get(message_id)
        interval_us = -1 if stream is None else round(stream.interval_s * 1e6)
        self._after.append(mavlink.MAVLink_message_interval_message(message_id, interval_us))
        return ACCEPTED

    def _request_message(self, command: ReceivedCommand) -> int:
        return self._send_once(command.whole(0))

    def _capabilities(self, _command: ReceivedCommand) -> int:
        return self._send_once(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)

    def _get_home(self, _command: ReceivedCommand) -> int:
        return self._send_once(mavlink.MAVLINK_MSG_ID_HOME_POSITION)

    def _send_once(self, message_id: int) -> int:
        ardupilot = self._autopilot.flavour == "ardupilot"
        if message_id not in streams.BUILDERS:
            return FAILED if ardupilot else UNSUPPORTED
        message = streams.build(self._autopilot, message_id)
        if message is None:  # nothing to tell yet: ArduPilot accepts all the same
            return ACCEPTED if ardupilot else REJECTED
        self._after.append(message)
        return ACCEPTED

    def _set_home(self, command: ReceivedCommand) -> int:
        autopilot = self._autopilot
        if not autopilot.origin_is_set:
            return FAILED
        if command.params[0] == 1.0:
            autopilot.home_m = autopilot.nav.home_m = autopilot.nav.position_m
            return ACCEPTED
        if not (abs(command.x) <= 90.0 and abs(command.y) <= 180.0 and math.isfinite(command.z)):
            return DENIED
        autopilot.home_m = autopilot.nav.home_m = autopilot.estimator.local(
            Geodetic(command.x, command.y, command.z)
        )
        return ACCEPTED

    def _set_mission_current(self, command: ReceivedCommand) -> int:
        return ACCEPTED if self._autopilot.set_mission_current(command.whole(0)) else DENIED

    def _grounded_only(self, _command: ReceivedCommand) -> int:
        """Reboot, calibration, storage: nothing to do in a simulation, but never in flight."""
        return REJECTED if self._autopilot.armed else ACCEPTED

    def target(self, command: ReceivedCommand) -> Vector3 | None:
        """The place that a DO_REPOSITION means, in the local frame; NaN or 0, 0 keep what is."""
        autopilot = self._autopilot
        nav = autopilot.nav
        here = autopilot.estimator.geodetic(nav.position_m)
        frame = mavlink.MAV_FRAME_GLOBAL if command.frame is None else command.frame
        keeps = command.x == 0.0 and command.y == 0.0
        latitude_deg = here.latitude_deg if keeps or math.isnan(command.x) else command.x
        longitude_deg = here.longitude_deg if keeps or math.isnan(command.y) else command.y
        if math.isnan(command.z):
            frame, altitude_m = mavlink.MAV_FRAME_GLOBAL, here.amsl_m
        else:
            altitude_m = command.z
        return global_position(frame, latitude_deg, longitude_deg, altitude_m, nav, autopilot.estimator)
