"""Asks the autopilot for the messages that the agent needs, at the rates it needs, and for nothing else.

A stream that does not come, or comes far too seldom, is asked for again: requests get lost, and an autopilot that
restarts has forgotten them. One request is open at a time.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.autopilot.modes import Flavour
from flightstack.mavlink.exchanges import command_long
from flightstack.mavlink.telemetry import Telemetry

_NEEDED_HZ = {
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 10.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 10.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 2.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
}
RATES_HZ: dict[Flavour, dict[int, float]] = {
    Flavour.ARDUPILOT: {
        **_NEEDED_HZ,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: 2.0,
        mavlink.MAVLINK_MSG_ID_WIND: 1.0,
    },
    Flavour.PX4: {
        **_NEEDED_HZ,
        mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 2.0,
        mavlink.MAVLINK_MSG_ID_WIND_COV: 1.0,
    },
}
"""What the agent needs of each autopilot, in the order in which it is asked for."""

OPTIONAL = frozenset(
    (
        mavlink.MAVLINK_MSG_ID_WIND,
        mavlink.MAVLINK_MSG_ID_WIND_COV,
        mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS,
        mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
        mavlink.MAVLINK_MSG_ID_HOME_POSITION,
    )
)
"""Silence in these is no fault: not estimated, not known yet, or there is another way to tell."""

WINDOW_S = 5.0
"""Over which a stream's rate is judged."""
ENOUGH_FRACTION = 0.4
"""Of the wanted rate: schedulers round, links lose."""
REPLY_S = 0.5
REST_UNSUPPORTED_S = 60.0


class StreamRequests:
    """The open request, and when each stream is to be looked at again."""

    def __init__(self) -> None:
        self._due_s: dict[int, float] = {}
        self._times_s: dict[int, deque[float]] = {}
        self._open: tuple[int, float] | None = None
        self._flavour = Flavour.UNKNOWN
        self._missing: set[int] = set()

    def restart(self) -> None:
        """The autopilot is new, or has forgotten what was asked."""
        self._due_s.clear()
        self._times_s.clear()
        self._missing.clear()
        self._open = None

    def received(self, now_s: float, kind: int) -> None:
        times_s = self._times_s.get(kind)
        if times_s is not None:
            times_s.append(now_s)
            self._missing.discard(kind)

    def acknowledge(self, now_s: float, command: int, result: int) -> None:
        if command != mavlink.MAV_CMD_SET_MESSAGE_INTERVAL or self._open is None:
            return
        kind, _ = self._open
        self._open = None
        if result in (mavlink.MAV_RESULT_UNSUPPORTED, mavlink.MAV_RESULT_DENIED):
            self._due_s[kind] = now_s + REST_UNSUPPORTED_S
            self._missing.add(kind)

    def notes(self) -> tuple[str, ...]:
        """Needed streams that were asked for and do not come."""
        names = [mavlink.mavlink_map[kind].msgname for kind in sorted(self._missing - OPTIONAL)]
        return tuple(f"autopilot does not send {name}" for name in names)

    def step(self, now_s: float, vehicle: Telemetry) -> list[Any]:
        """The next request, if one is due."""
        if vehicle.flavour is Flavour.UNKNOWN or not vehicle.is_connected(now_s):
            return []
        if vehicle.flavour is not self._flavour:
            self.restart()
            self._flavour = vehicle.flavour
        if self._open is not None and now_s - self._open[1] < REPLY_S:
            return []
        for kind, rate_hz in RATES_HZ[self._flavour].items():
            window_s = max(WINDOW_S, 3.0 / rate_hz)
            due_s = self._due_s.setdefault(kind, -math.inf)
            times_s = self._times_s.setdefault(kind, deque(maxlen=int(2.0 * rate_hz * window_s) + 1))
            if now_s < due_s:
                continue
            while times_s and now_s - times_s[0] > window_s:
                times_s.popleft()
            enough = due_s > -math.inf and len(times_s) >= ENOUGH_FRACTION * rate_hz * window_s
            self._due_s[kind] = now_s + window_s
            if enough:
                continue
            if due_s > -math.inf and not times_s:
                self._missing.add(kind)
            self._open = (kind, now_s)
            interval_us = 1e6 / rate_hz
            return [command_long(vehicle, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, (float(kind), interval_us))]
        return []
