"""Which messages go out on which link and how often, and messages that are asked for once."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot.channel import Channel, ChannelPeer, Handler
from simvehicle.autopilot.commands import ACCEPTED, UNSUPPORTED, CommandAnswer, Execute, ReceivedCommand

_MINIMUM_INTERVAL_S = 0.02

Build = Callable[[], Any | None]
"""Makes a message as it is now; None where there is nothing to tell."""


@dataclasses.dataclass(frozen=True, slots=True)
class StreamStyle:
    """How an autopilot deals with requests for messages."""

    first_s: Mapping[int, float]
    """Message id -> interval of what is sent without being asked for."""
    groups: Mapping[int, Sequence[int]]
    """REQUEST_DATA_STREAM's groups; empty where only SET_MESSAGE_INTERVAL is known."""
    unknown_interval: int
    """MAV_RESULT for the interval of a message that does not exist."""
    unknown_request: int
    nothing_yet: int
    """MAV_RESULT for the request of a message of which there is nothing to tell yet."""
    series: Mapping[int, Callable[[int], Sequence[Any]]] = dataclasses.field(default_factory=dict)
    """Messages that are many: by id what comes of the request for one of them, or (0) for all."""


class MessageStreams:
    def __init__(
        self,
        messages: Mapping[int, Build],
        style: StreamStyle,
        channels: Sequence[Channel],
        now_s: Callable[[], float],
    ) -> None:
        self.messages = messages
        self._style = style
        self._channels = channels
        self._now_s = now_s

    def start(self, now_s: float) -> None:
        """Power-up."""
        for channel in self._channels:
            for message_id, interval_s in self._style.first_s.items():
                channel.set_stream(message_id, interval_s, now_s)

    def send_due(self, now_s: float) -> None:
        for channel in self._channels:
            if now_s < channel.next_due_s:
                continue
            for message_id in channel.take_due(now_s):
                message = self.messages[message_id]()
                if message is not None:
                    channel.send(message)

    def handlers(self) -> dict[str, Handler]:
        return {"REQUEST_DATA_STREAM": self._data_stream}

    def table(self) -> dict[int, Execute]:
        return {
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: self._set_interval,
            mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: self._get_interval,
            mavlink.MAV_CMD_REQUEST_MESSAGE: self._request,
            mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: lambda _: self._send_once(
                mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION
            ),
            mavlink.MAV_CMD_GET_HOME_POSITION: lambda _: self._send_once(
                mavlink.MAVLINK_MSG_ID_HOME_POSITION
            ),
        }

    def _set_interval(self, command: ReceivedCommand) -> int:
        message_id, interval_us = command.whole(0), command.params[1]
        if message_id not in self.messages:
            return self._style.unknown_interval
        interval_s: float | None
        if interval_us < 0:
            interval_s = None
        elif interval_us == 0:
            interval_s = self._style.first_s.get(message_id)
        else:
            interval_s = max(_MINIMUM_INTERVAL_S, interval_us / 1e6)
        self._channels[command.peer.link].set_stream(message_id, interval_s, self._now_s())
        return ACCEPTED

    def _get_interval(self, command: ReceivedCommand) -> int | CommandAnswer:
        message_id = command.whole(0)
        if message_id not in self.messages:
            return UNSUPPORTED
        stream = self._channels[command.peer.link].streams.get(message_id)
        interval_us = -1 if stream is None else round(stream.interval_s * 1e6)
        return CommandAnswer(ACCEPTED, mavlink.MAVLink_message_interval_message(message_id, interval_us))

    def _request(self, command: ReceivedCommand) -> int | CommandAnswer:
        series = self._style.series.get(command.whole(0))
        if series is None:
            return self._send_once(command.whole(0))
        found = series(command.whole(1))
        return CommandAnswer(ACCEPTED, found[0], tuple(found[1:])) if found else self._style.nothing_yet

    def _send_once(self, message_id: int) -> int | CommandAnswer:
        if message_id not in self.messages:
            return self._style.unknown_request
        message = self.messages[message_id]()
        return self._style.nothing_yet if message is None else CommandAnswer(ACCEPTED, message)

    def _data_stream(self, channel: Channel, _peer: ChannelPeer, message: Any) -> None:
        everything = message.req_stream_id == mavlink.MAV_DATA_STREAM_ALL
        for group, ids in self._style.groups.items():
            if everything or group == message.req_stream_id:
                on = message.start_stop and message.req_message_rate > 0
                for message_id in ids:
                    interval_s = 1.0 / message.req_message_rate if on else None
                    channel.set_stream(message_id, interval_s, self._now_s())
