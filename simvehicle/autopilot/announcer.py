"""What an autopilot says to everybody on all its links: broadcasts, texts, and a heartbeat where the mode changed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot.channel import Channel

_TEXT_BYTES = 50
"""Of one STATUSTEXT; a longer text goes out in numbered pieces."""


class Announcer:
    """Texts and the news of a mode wait until `flush`: after the answer to a command that is being carried out."""

    def __init__(self, channels: Sequence[Channel], build: Callable[[int], Any | None]) -> None:
        """`build`: the message of an id as it is now, or None where there is nothing to tell."""
        self._channels = channels
        self._build = build
        self._texts: list[tuple[int, str]] = []
        self._text_id = 0
        self._mode_is_news = False

    @property
    def pending(self) -> bool:
        return bool(self._texts) or self._mode_is_news

    def say(self, severity: int, text: str) -> None:
        """A STATUSTEXT."""
        self._texts.append((severity, text))

    def mode_changed(self) -> None:
        self._mode_is_news = True

    def broadcast(self, message: Any) -> None:
        for channel in self._channels:
            channel.send(message)

    def tell(self, message_id: int) -> None:
        """Broadcast a message as it is now, if there is something to tell."""
        message = self._build(message_id)
        if message is not None:
            self.broadcast(message)

    def announce_mode(self) -> None:
        """A HEARTBEAT out of turn where the mode has just changed."""
        if self._mode_is_news:
            self._mode_is_news = False
            self.tell(mavlink.MAVLINK_MSG_ID_HEARTBEAT)

    def flush(self) -> None:
        self.announce_mode()
        texts, self._texts = self._texts, []
        for severity, text in texts:
            data = text.encode()
            if len(data) <= _TEXT_BYTES:
                self.broadcast(mavlink.MAVLink_statustext_message(severity, data))
                continue
            self._text_id = self._text_id % 65535 + 1
            for part in range(0, len(data), _TEXT_BYTES):
                piece = data[part : part + _TEXT_BYTES]
                self.broadcast(
                    mavlink.MAVLink_statustext_message(severity, piece, self._text_id, part // _TEXT_BYTES)
                )
