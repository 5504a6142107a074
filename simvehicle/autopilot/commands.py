"""COMMAND_LONG and COMMAND_INT: they are carried out by whoever knows them, and acknowledged here.

https://mavlink.io/en/services/command.html. The answer goes out before anything that the command causes, as on the
recorded vehicle.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot.channel import Channel, ChannelPeer, Handler

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


class CommandAnswer(NamedTuple):
    """A MAV_RESULT and what was asked for, which goes out beside the acknowledgement."""

    result: int
    message: Any
    more: tuple[Any, ...] = ()


class AnswerStyle(NamedTuple):
    """How an autopilot acknowledges."""

    set_mode: int = mavlink.MAVLINK_MSG_ID_SET_MODE
    """The number of the command in the answer to the old message SET_MODE."""
    message_first: bool = False
    """What a command asks for goes out before the acknowledgement."""


Execute = Callable[[ReceivedCommand], "int | CommandAnswer"]
"""Carries a command out: MAV_RESULT, or that and a message."""


class CommandServer:
    """Runs commands by a table and acknowledges them."""

    def __init__(
        self,
        table: Mapping[int, Execute],
        channels: Sequence[Channel],
        flush: Callable[[], None],
        split_mode: Callable[[int], tuple[int, int]],
        style: AnswerStyle = AnswerStyle(),  # noqa: B008 (it cannot change)
    ) -> None:
        """`flush`: say now what the command caused. `split_mode`: SET_MODE's custom mode as main and sub mode."""
        self._table = table
        self._channels = channels
        self._flush = flush
        self._split_mode = split_mode
        self._style = style

    def handlers(self) -> dict[str, Handler]:
        return {"COMMAND_LONG": self._long, "COMMAND_INT": self._int, "SET_MODE": self._set_mode}

    def _long(self, _channel: Channel, peer: ChannelPeer, m: Any) -> None:
        params = (m.param1, m.param2, m.param3, m.param4)
        self._run(ReceivedCommand(peer, m.command, params, m.param5, m.param6, m.param7, None), m.command)

    def _int(self, _channel: Channel, peer: ChannelPeer, m: Any) -> None:
        params = (m.param1, m.param2, m.param3, m.param4)
        self._run(ReceivedCommand(peer, m.command, params, m.x / 1e7, m.y / 1e7, m.z, m.frame), m.command)

    def _set_mode(self, _channel: Channel, peer: ChannelPeer, m: Any) -> None:
        main, sub = self._split_mode(m.custom_mode)
        params = (float(m.base_mode), float(main), float(sub), 0.0)
        command = ReceivedCommand(peer, mavlink.MAV_CMD_DO_SET_MODE, params, 0.0, 0.0, 0.0, None)
        self._run(command, self._style.set_mode)

    def _run(self, command: ReceivedCommand, acknowledged: int) -> None:
        execute = self._table.get(command.number)
        if execute is not None:
            answer = execute(command)
        else:
            answer = ACCEPTED if command.number in _NOTHING_TO_DO else UNSUPPORTED
        asked_for: tuple[Any, ...] = ()
        if isinstance(answer, CommandAnswer):
            result, asked_for = answer.result, (answer.message, *answer.more)
        else:
            result = answer
        peer = command.peer
        told = mavlink.MAVLink_command_ack_message(acknowledged, result, 0, 0, peer.system, peer.component)
        channel = self._channels[peer.link]
        for message in (*asked_for, told) if self._style.message_first else (told, *asked_for):
            channel.send(message)
        self._flush()
