"""What autopilots say in words, each time told once, whoever heard it: the drone's own agent, or our links.

An agent tells its autopilot's texts itself, so the same text comes twice, and by several links more often. But not
every autopilot tells its companion what it tells a ground station, so what we hear alone is told as well, after the
agent had time to.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

from flightstack.mavlink.statustext import StatusText

AGENT_FIRST_S: Final = 1.0
"""How long a text of a drone whose agent lives waits for the agent's own telling."""
SAME_S: Final = 5.0
"""The same words within this time, by another way, are the same text."""
_WAITING_AT_MOST: Final = 200

_AGENT: Final = -1
"""In the place of a link's index."""


class VehicleText(NamedTuple):
    drone: int
    text: StatusText


class _WaitingText(NamedTuple):
    since_s: float
    way: int
    told: VehicleText


class VehicleTexts:
    """Takes texts by all ways; `due` gives those to be told now."""

    def __init__(self) -> None:
        self._waiting: deque[_WaitingText] = deque(maxlen=_WAITING_AT_MOST)
        self._told: dict[tuple[int, str], tuple[float, int]] = {}
        """When these words of a drone came last, and by which way."""

    def agent_told(self, now_s: float, drone: int, words: str) -> None:
        """The agent of `drone` has told a text of its autopilot."""
        self._told[drone, words] = (now_s, _AGENT)

    def hear(self, now_s: float, link: int, drone: int, text: StatusText) -> None:
        """A text has come over our own link."""
        self._waiting.append(_WaitingText(now_s, link, VehicleText(drone, text)))

    def due(self, now_s: float, agent_live: Callable[[int], bool]) -> list[VehicleText]:
        """The texts to tell now, oldest first."""
        self._told = {words: at for words, at in self._told.items() if now_s - at[0] <= SAME_S}
        found: list[VehicleText] = []
        kept: deque[_WaitingText] = deque(maxlen=_WAITING_AT_MOST)
        for waiting in self._waiting:
            drone, text = waiting.told
            _, way = self._told.get((drone, text.text), (0.0, waiting.way))
            if way != waiting.way:
                continue
            if agent_live(drone) and now_s - waiting.since_s < AGENT_FIRST_S:
                kept.append(waiting)
                continue
            self._told[drone, text.text] = (now_s, waiting.way)
            found.append(waiting.told)
        self._waiting = kept
        return found
