"""Which messages were heard before: what was recorded, or comes by two ways, counts once.

Every program counts its messages of a kind, and its starts by a number that rises from start to start (its
incarnation). A message that was heard counts no second time, and a program that was started before one that was
heard under its name is one of the past. But one that goes on counting is none, even if another has its name: two
agents with one number both fly, and must both be seen.
"""

from __future__ import annotations

import enum
from typing import Final

from flightstack.swarm.topics import Delivery, Received
from flightstack.swarm.wire import (
    Command,
    DroneState,
    Event,
    GroundBeat,
    OrderState,
    ReadingsState,
    TableState,
    Traffic,
)

Counted = DroneState | TableState | OrderState | ReadingsState | Command | Event | Traffic | GroundBeat
"""The messages that have a number."""

_WINDOWS: Final = {Delivery.BEST_EFFORT: 64, Delivery.RELIABLE: 1024}
"""A number so far behind the newest is too late to be told from one that was heard."""
SENDERS_AT_MOST: Final = 1024
"""Commands have a name of their own each; the longest silent is forgotten."""
INCARNATIONS_AT_MOST: Final = 8
"""Of one sender at once."""


class Freshness(enum.Enum):
    NEW = "new"
    REPEATED = "repeated"
    """It was heard before, or is too late to know."""
    PAST = "past"
    """Its sender was started before one that was heard."""


class _Window:
    """Numbers of one kind of message of one start."""

    def __init__(self, width: int) -> None:
        self._width = width
        self._all = (1 << width) - 1
        self._newest = -1
        self._seen = 0
        """Bit n: the number that is n below the newest."""

    def is_new(self, number: int) -> bool:
        ahead = number - self._newest
        if ahead > 0:
            self._seen = (self._seen << min(ahead, self._width) | 1) & self._all
            self._newest = number
            return True
        if -ahead >= self._width or self._seen >> -ahead & 1:
            return False
        self._seen |= 1 << -ahead
        return True


class _Starts:
    """One sender's incarnations, that was heard last at the end, and the windows of each by topic."""

    def __init__(self) -> None:
        self.newest = -1
        self.last: int | None = None
        """Who was heard last."""
        self.windows: dict[str, _Window] = {}
        """Of that one."""
        self.known: dict[int, dict[str, _Window]] = {}

    def turn_to(self, incarnation: int) -> bool:
        """Another one than the last is heard; False for one of the past."""
        windows = self.known.pop(incarnation, None)
        if windows is None:
            if incarnation < self.newest:
                return False
            windows = {}
        self.newest = max(self.newest, incarnation)
        self.known[incarnation] = windows
        while len(self.known) > INCARNATIONS_AT_MOST:
            del self.known[next(iter(self.known))]
        self.last, self.windows = incarnation, windows
        return True


class MessageMemory:
    """What one node has heard. It begins empty: who is heard first is believed."""

    def __init__(self) -> None:
        self._senders: dict[str, _Starts] = {}

    def judge(self, received: Received, message: Counted) -> Freshness:
        """Whether a message counts, that is believed otherwise; it is remembered. One without numbers is new."""
        incarnation = message.incarnation
        if incarnation == 0:
            return Freshness.NEW
        senders, sender = self._senders, received.sender
        starts = senders.pop(sender, None)
        if starts is None:
            starts = _Starts()
        senders[sender] = starts
        if len(senders) > SENDERS_AT_MOST:
            del senders[next(iter(senders))]
        if incarnation != starts.last and not starts.turn_to(incarnation):
            return Freshness.PAST
        topic = received.topic
        window = starts.windows.get(topic.name)
        if window is None:
            window = starts.windows[topic.name] = _Window(_WINDOWS[topic.delivery])
        return Freshness.NEW if window.is_new(message.sequence) else Freshness.REPEATED
