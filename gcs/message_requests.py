"""Asking each autopilot for the few messages that the ground station needs, and for no more.

An autopilot sends by itself little more than its heartbeat, and forgets what was asked when it restarts; so what
does not come is asked for again. The streams themselves are the acknowledgement.
"""

from __future__ import annotations

from typing import NamedTuple

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.fleet.vehicles import Component, Source

STREAMS: dict[int, float] = {
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 4.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 1.0,
}
"""Message id and rate in Hz."""
ONCE = mavlink.MAVLINK_MSG_ID_HOME_POSITION
"""Asked for until it is known; autopilots send it again when it changes."""

QUICK_TRIES = 4
QUICK_S = 0.5
SLOW_S = 10.0
MISSED = 4
"""Periods without a message after which a stream is taken as stopped."""


class Wish(NamedTuple):
    """One message to ask an autopilot for; `interval_s` None: once."""

    source: Source
    message_id: int
    interval_s: float | None


class _Tried(msgspec.Struct):
    count: int = 0
    last_s: float | None = None


class StreamAsker:
    def __init__(self) -> None:
        self._tried: dict[tuple[Source, int], _Tried] = {}

    def step(self, now_s: float, autopilots: list[Component]) -> list[Wish]:
        """What to ask now: at most one message of each autopilot, so that a slow radio is not flooded."""
        wishes = []
        for autopilot in autopilots:
            if autopilot.age_s(now_s) > SLOW_S:
                continue
            for message_id, rate_hz in (*STREAMS.items(), (ONCE, 0.0)):
                interval_s = 1.0 / rate_hz if rate_hz else None
                if self._is_wanting(now_s, autopilot, message_id, interval_s):
                    wishes.append(Wish(autopilot.source, message_id, interval_s))
                    break
        return wishes

    def _is_wanting(
        self, now_s: float, autopilot: Component, message_id: int, interval_s: float | None
    ) -> bool:
        heard_s = autopilot.heard_s.get(message_id)
        tried = self._tried.setdefault((autopilot.source, message_id), _Tried())
        known = autopilot.home_ned_m is not None if interval_s is None else heard_s is not None
        if known and (
            interval_s is None or (heard_s is not None and now_s - heard_s <= max(MISSED * interval_s, 2.0))
        ):
            tried.count = 0
            return False
        wait_s = QUICK_S if tried.count < QUICK_TRIES else SLOW_S
        if tried.last_s is not None and now_s - tried.last_s < wait_s:
            return False
        tried.count += 1
        tried.last_s = now_s
        return True
