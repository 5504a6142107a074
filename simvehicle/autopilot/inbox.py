"""What a simulated autopilot does with the messages that reach it, and what it passes on to its other links."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot.channel import Channel, ChannelPeer
from simvehicle.autopilot.commands import ReceivedCommand

if TYPE_CHECKING:
    from simvehicle.autopilot.core import Autopilot

_FORWARDED_TO_ALL = ("HEARTBEAT", "STATUSTEXT", "NAMED_VALUE_FLOAT")
"""Broadcasts that are handed to the other links. (Real autopilots hand on all of them; the rest is not needed.)"""

_FTP_NAK, _FTP_ACK = 129, 128
_FTP_TERMINATE, _FTP_RESET = 1, 2
_FTP_OPENS = (3, 4, 13)
_FTP_FILE_NOT_FOUND, _FTP_UNKNOWN_COMMAND = 10, 7

DATA_STREAMS = {
    mavlink.MAV_DATA_STREAM_RAW_SENSORS: (27, 29),
    mavlink.MAV_DATA_STREAM_EXTENDED_STATUS: (1, 42, 24, 62, 162),
    mavlink.MAV_DATA_STREAM_RC_CHANNELS: (36, 65),
    mavlink.MAV_DATA_STREAM_POSITION: (33, 32),
    mavlink.MAV_DATA_STREAM_EXTRA1: (30,),
    mavlink.MAV_DATA_STREAM_EXTRA2: (74,),
    mavlink.MAV_DATA_STREAM_EXTRA3: (2, 168, 147, 193, 241),
}
"""REQUEST_DATA_STREAM's groups as ArduCopter fills them, as far as we have the messages."""


class Inbox:
    """One per vehicle; a handler per message type."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._handlers = {
            "HEARTBEAT": self._heartbeat,
            "COMMAND_LONG": self._command_long,
            "COMMAND_INT": self._command_int,
            "SET_MODE": self._set_mode,
            "PARAM_REQUEST_LIST": self._parameter_list,
            "PARAM_REQUEST_READ": self._parameter_read,
            "PARAM_SET": self._parameter_set,
            "SET_POSITION_TARGET_LOCAL_NED": self._setpoint,
            "SET_POSITION_TARGET_GLOBAL_INT": self._setpoint,
            "REQUEST_DATA_STREAM": self._data_stream,
            "RC_CHANNELS_OVERRIDE": self._rc_override,
            "MANUAL_CONTROL": self._manual_control,
            "TIMESYNC": self._timesync,
            "PING": self._ping,
            "LOG_REQUEST_LIST": self._log_list,
            "FILE_TRANSFER_PROTOCOL": self._ftp,
        }

    def receive(self, channel: Channel, data: bytes) -> None:
        for message in channel.parse(data):
            peer = ChannelPeer(channel.link, message.get_srcSystem(), message.get_srcComponent())
            if (peer.system, peer.component) == (self._autopilot.system, 1):
                continue  # our own words, looped back by a link
            channel.peers.add((peer.system, peer.component))
            self._route(channel, peer, message)

    def _route(self, channel: Channel, peer: ChannelPeer, message: Any) -> None:
        target = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        own = target == self._autopilot.system
        if target == 0 or (own and component in (0, 1)):
            self._handle(channel, peer, message)
        if target != 0 and not (own and component == 1):
            for other in self._autopilot.channels:
                if other is not channel and any(
                    system == target and component in (0, each) for system, each in other.peers
                ):
                    other.forward(message)
        elif target == 0 and message.get_type() in _FORWARDED_TO_ALL:
            for other in self._autopilot.channels:
                if other is not channel and other.peers:
                    other.forward(message)

    def _handle(self, channel: Channel, peer: ChannelPeer, message: Any) -> None:
        handler = self._handlers.get(message.get_type())
        if handler is not None:
            handler(channel, peer, message)
        else:
            self._autopilot.missions.receive(self._autopilot.now_s or 0.0, peer, message)
            self._autopilot.flush_texts()

    def _heartbeat(self, _channel: Channel, peer: ChannelPeer, message: Any) -> None:
        if message.type == mavlink.MAV_TYPE_GCS:
            self._autopilot.gcs_heard_s[peer.system] = self._autopilot.now_s or 0.0

    def _command_long(self, _channel: Channel, peer: ChannelPeer, m: Any) -> None:
        params = (m.param1, m.param2, m.param3, m.param4)
        self._autopilot.commands.run(
            ReceivedCommand(peer, m.command, params, m.param5, m.param6, m.param7, None)
        )

    def _command_int(self, _channel: Channel, peer: ChannelPeer, m: Any) -> None:
        params = (m.param1, m.param2, m.param3, m.param4)
        self._autopilot.commands.run(
            ReceivedCommand(peer, m.command, params, m.x / 1e7, m.y / 1e7, m.z, m.frame)
        )

    def _set_mode(self, _channel: Channel, peer: ChannelPeer, m: Any) -> None:
        if self._autopilot.flavour == "px4":
            main, sub = m.custom_mode >> 16 & 0xFF, m.custom_mode >> 24
        else:
            main, sub = m.custom_mode, 0
        params = (float(m.base_mode), float(main), float(sub), 0.0)
        command = ReceivedCommand(peer, mavlink.MAV_CMD_DO_SET_MODE, params, 0.0, 0.0, 0.0, None)
        self._autopilot.commands.run(command, answers=mavlink.MAVLINK_MSG_ID_SET_MODE)

    def _parameter_list(self, channel: Channel, _peer: ChannelPeer, _message: Any) -> None:
        self._autopilot.parameter_server.request_list(channel)
        self._autopilot.on_parameter_list()

    def _parameter_read(self, channel: Channel, peer: ChannelPeer, message: Any) -> None:
        unknown = self._autopilot.parameter_server.request_read(channel, message)
        if unknown is not None:
            self._autopilot.unknown_parameter(channel, peer, unknown)

    def _parameter_set(self, channel: Channel, peer: ChannelPeer, message: Any) -> None:
        autopilot, name = self._autopilot, str(message.param_id)
        if name not in autopilot.parameters:
            autopilot.unknown_parameter(channel, peer, name)
            return
        value = autopilot.parameters.decoded(name, message.param_value, message.param_type)
        if value is not None:
            autopilot.set_parameter(name, value)
        index = None if autopilot.flavour == "px4" else 65535
        autopilot.broadcast(autopilot.parameters.message(name, index))

    def _setpoint(self, _channel: Channel, _peer: ChannelPeer, message: Any) -> None:
        self._autopilot.setpoint(message)

    def _data_stream(self, channel: Channel, _peer: ChannelPeer, message: Any) -> None:
        if self._autopilot.flavour == "px4":
            return  # PX4 knows SET_MESSAGE_INTERVAL only
        everything = message.req_stream_id == mavlink.MAV_DATA_STREAM_ALL
        for group, ids in DATA_STREAMS.items():
            if everything or group == message.req_stream_id:
                on = message.start_stop and message.req_message_rate > 0
                for message_id in ids:
                    interval_s = 1.0 / message.req_message_rate if on else None
                    channel.set_stream(message_id, interval_s, self._autopilot.now_s or 0.0)

    def _rc_override(self, _channel: Channel, peer: ChannelPeer, m: Any) -> None:
        if self._autopilot.takes_pilot(peer.system):
            given = (m.chan1_raw, m.chan2_raw, m.chan3_raw, m.chan4_raw)
            more = (m.chan5_raw, m.chan6_raw, m.chan7_raw, m.chan8_raw)
            self._autopilot.pilot([*given, *more])

    def _manual_control(self, _channel: Channel, peer: ChannelPeer, m: Any) -> None:
        if not self._autopilot.takes_pilot(peer.system):
            return
        # x forward, y right, r clockwise: -1000 to 1000; z up: 0 to 1000 with 500 as the middle
        sticks = [m.y, -m.x, (m.z - 500) * 2, m.r]
        self._autopilot.pilot([1500 + round(max(-1000, min(1000, stick)) / 2) for stick in sticks] + [0] * 4)

    def _timesync(self, channel: Channel, _peer: ChannelPeer, message: Any) -> None:
        if message.tc1 == 0:
            channel.send(mavlink.MAVLink_timesync_message(int(self._autopilot.time_s * 1e9), message.ts1))

    def _ping(self, channel: Channel, peer: ChannelPeer, message: Any) -> None:
        if message.target_system == 0:
            channel.send(
                mavlink.MAVLink_ping_message(message.time_usec, message.seq, peer.system, peer.component)
            )

    def _log_list(self, channel: Channel, _peer: ChannelPeer, _message: Any) -> None:
        """No logs are kept; a real autopilot says nothing at all about them while it flies."""
        if self._autopilot.landed:
            channel.send(mavlink.MAVLink_log_entry_message(0, 0, 0, 0, 0))

    def _ftp(self, channel: Channel, peer: ChannelPeer, message: Any) -> None:
        """There are no files: https://mavlink.io/en/services/ftp.html."""
        request = bytes(message.payload)
        sequence = (int.from_bytes(request[0:2], "little") + 1) & 0xFFFF
        opcode = request[3]
        reply = bytearray(251)
        reply[0:2] = sequence.to_bytes(2, "little")
        reply[2] = request[2]
        reply[5] = opcode
        if opcode in (_FTP_TERMINATE, _FTP_RESET):
            reply[3] = _FTP_ACK
        else:
            reply[3], reply[4] = _FTP_NAK, 1
            reply[12] = _FTP_FILE_NOT_FOUND if opcode in _FTP_OPENS else _FTP_UNKNOWN_COMMAND
        channel.send(
            mavlink.MAVLink_file_transfer_protocol_message(0, peer.system, peer.component, list(reply))
        )
