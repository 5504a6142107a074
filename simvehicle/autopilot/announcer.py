"""What an autopilot says to everybody on all its links: broadcasts, texts, and a heartbeat where the mode changed."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot.channel import Channel

_TEXT_BYTES = 50
"""Of one STATUSTEXT; a longer text goes out in numbered pieces."""
_KEPT_TEXTS = 8
_KEPT_S = 5.0
"""So many texts of so many seconds are said to a ground station that is heard only then."""


@dataclasses.dataclass(frozen=True, slots=True)
class TextStyle:
    """How an autopilot sends texts."""

    ending: str = ""
    all_numbered: bool = False
    """Also a text of one piece has a number."""
    to_ground_only: bool = False
    """Only on links on which a ground station is heard."""


class Announcer:
    """Texts and the news of a mode wait until `flush`: after the answer to a command that is being carried out."""

    def __init__(
        self,
        channels: Sequence[Channel],
        build: Callable[[int], Any | None],
        style: TextStyle = TextStyle(),
        now_s: Callable[[], float] = lambda: 0.0,
    ) -> None:
        """`build`: the message of an id as it is now, or None where there is nothing to tell."""
        self._channels = channels
        self._build = build
        self._style = style
        self._now_s = now_s
        self._posted: list[tuple[bool, list[Any]]] = []
        """What waits: whether it is a text, and its messages."""
        self._text_id = 0
        self._mode_is_news = False
        self._unheard: list[list[tuple[float, list[Any]]]] = [[] for _ in channels]
        """By link: texts for a ground station that is not there, and when they were said."""

    @property
    def pending(self) -> bool:
        return bool(self._posted) or self._mode_is_news

    def say(self, severity: int, text: str) -> None:
        """A STATUSTEXT."""
        self._posted.append((True, self._pieces(severity, (text + self._style.ending).encode())))

    def post(self, message: Any) -> None:
        """Another message, in its turn among the texts."""
        self._posted.append((False, [message]))

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
        posted, self._posted = self._posted, []
        for is_text, messages in posted:
            for channel, unheard in zip(self._channels, self._unheard, strict=True):
                if is_text and self._style.to_ground_only and not channel.hears_ground(self._now_s()):
                    unheard.append((self._now_s(), messages))
                    del unheard[:-_KEPT_TEXTS]
                    continue
                for message in messages:
                    channel.send(message)

    def ground_heard(self, link: int) -> None:
        """A ground station is there on this link: say what is fresh."""
        unheard, self._unheard[link] = self._unheard[link], []
        for said_s, messages in unheard:
            if self._now_s() - said_s < _KEPT_S:
                for message in messages:
                    self._channels[link].send(message)

    def _pieces(self, severity: int, data: bytes) -> list[Any]:
        pieces = [data[at : at + _TEXT_BYTES] for at in range(0, max(len(data), 1), _TEXT_BYTES)]
        if len(pieces) == 1 and not self._style.all_numbered:
            return [mavlink.MAVLink_statustext_message(severity, data)]
        self._text_id = self._text_id % 65535 + 1
        return [
            mavlink.MAVLink_statustext_message(severity, piece, self._text_id, place)
            for place, piece in enumerate(pieces)
        ]
