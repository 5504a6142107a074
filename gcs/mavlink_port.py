"""The ground station's end of one MAVLink link, without the link: bytes to messages and requests to bytes."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.autopilot.modes import mode_of, set_mode_parameters
from gcs.fleet.orphans import ModeChange
from gcs.fleet.vehicles import Source

COMPONENT = mavlink.MAV_COMP_ID_MISSIONPLANNER
"""190: what ground stations use."""


class MavlinkPort:
    """Decoder and encoder of one link. Every frame gets this link's own sequence number."""

    def __init__(self, system: int) -> None:
        self._encoder = mavlink.MAVLink(None, srcSystem=system, srcComponent=COMPONENT)
        self._decoder = mavlink.MAVLink(None)
        self._decoder.robust_parsing = True  # or one bad checksum from anybody raises
        self.bad_bytes = 0

    def decode(self, data: bytes) -> list[Any]:
        """All messages completed by `data`, in any chunking; garbage is counted and stepped over."""
        if not data:
            return []
        messages = []
        for message in self._decoder.parse_buffer(data) or ():
            if message.get_type() == "BAD_DATA":
                self.bad_bytes += len(message.data)
            else:
                messages.append(message)
        return messages

    def heartbeat(self) -> bytes:
        return self._encode(
            mavlink.MAVLink_heartbeat_message(
                mavlink.MAV_TYPE_GCS,
                mavlink.MAV_AUTOPILOT_INVALID,
                0,
                0,
                mavlink.MAV_STATE_ACTIVE,
                3,
            )
        )

    def set_mode(self, request: ModeChange) -> bytes:
        parameters = set_mode_parameters(request.flavour, mode_of(request.flavour, request.duty))
        return self._command(
            request.source, mavlink.MAV_CMD_DO_SET_MODE, parameters, confirmation=request.confirmation
        )

    def set_interval(self, source: Source, message_id: int, interval_s: float) -> bytes:
        parameters = (float(message_id), round(interval_s * 1e6))
        return self._command(source, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, parameters)

    def request_message(self, source: Source, message_id: int) -> bytes:
        return self._command(source, mavlink.MAV_CMD_REQUEST_MESSAGE, (float(message_id),))

    def _command(
        self, target: Source, command: int, parameters: tuple[float, ...], confirmation: int = 0
    ) -> bytes:
        # None of the commands sent here has a parameter that must be NaN when unused.
        padded = parameters + (0.0,) * (7 - len(parameters))
        return self._encode(
            mavlink.MAVLink_command_long_message(
                target.system, target.component, command, confirmation, *padded
            )
        )

    def _encode(self, message: Any) -> bytes:
        frame = bytes(message.pack(self._encoder))
        self._encoder.seq = (self._encoder.seq + 1) % 256
        return frame
