"""Answers that need little of the vehicle: time, echo, logs and files that there are none of, who was heard."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot.channel import Channel, ChannelPeer, Handler
from simvehicle.autopilot.flight import Flight

_FTP_NAK, _FTP_ACK = 129, 128
_FTP_TERMINATE, _FTP_RESET = 1, 2
_FTP_OPENS = (3, 4, 13)
_FTP_FILE_NOT_FOUND, _FTP_UNKNOWN_COMMAND = 10, 7


class LinkServices:
    def __init__(
        self,
        flight: Flight,
        ground_heard_s: dict[int, float],
        ground_heard: Callable[[int], None] = lambda _link: None,
    ) -> None:
        """`ground_heard_s` gets the time of every ground station's last heartbeat, by system; `ground_heard` is told
        the link."""
        self._flight = flight
        self._ground_heard_s = ground_heard_s
        self._ground_heard = ground_heard

    def handlers(self) -> dict[str, Handler]:
        return {
            "HEARTBEAT": self._heartbeat,
            "TIMESYNC": self._timesync,
            "PING": self._ping,
            "LOG_REQUEST_LIST": self._log_list,
            "FILE_TRANSFER_PROTOCOL": self._ftp,
        }

    def _heartbeat(self, channel: Channel, peer: ChannelPeer, message: Any) -> None:
        if message.type == mavlink.MAV_TYPE_GCS:
            self._ground_heard_s[peer.system] = channel.ground_heard_s = self._flight.now_s
            self._ground_heard(channel.link)

    def _timesync(self, channel: Channel, _peer: ChannelPeer, message: Any) -> None:
        if message.tc1 == 0:
            channel.send(mavlink.MAVLink_timesync_message(int(self._flight.time_s * 1e9), message.ts1))

    def _ping(self, channel: Channel, peer: ChannelPeer, message: Any) -> None:
        if message.target_system == 0:
            channel.send(
                mavlink.MAVLink_ping_message(message.time_usec, message.seq, peer.system, peer.component)
            )

    def _log_list(self, channel: Channel, _peer: ChannelPeer, _message: Any) -> None:
        """No logs are kept; a real autopilot says nothing at all about them while it flies."""
        if self._flight.landed:
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
