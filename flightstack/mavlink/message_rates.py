"""Asks an autopilot for the messages that are needed, at the rates that are needed, and for nothing else.

An autopilot sends by itself little more than its heartbeat, requests get lost, and one that restarts has forgotten
them: what does not come, or comes far too seldom, is asked for again. The streams themselves are the answer; an
acknowledgement only tells sooner that there is none. One request is open at a time, so that a slow radio is not
flooded.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.commands import message_interval, message_once
from flightstack.mavlink.modes import Flavour
from flightstack.mavlink.vehicle_state import VehicleState

MISSED = 4
"""Periods without a message …"""
SILENCE_S = 2.0
"""… and at least this long, after which a stream is taken as stopped."""
WINDOW_S = 5.0
"""Over which a stream's rate is judged."""
ENOUGH_FRACTION = 0.4
"""Of the wanted rate: schedulers round, links lose."""
REPLY_S = 0.5
ONCE_AGAIN_S = 0.5
"""How soon a single message that has not come is asked for again."""
QUICK_TRIES = 4
SLOW_S = 10.0
"""How often it is tried after `QUICK_TRIES` in vain."""
REST_UNSUPPORTED_S = 60.0

_NO = (mavlink.MAV_RESULT_UNSUPPORTED, mavlink.MAV_RESULT_DENIED)


@dataclasses.dataclass(slots=True)
class _Wanted:
    """One message that is wanted, and what was done for it."""

    kind: int
    rate_hz: float
    """0: once."""
    asked_s: float = -math.inf
    tries: int = 0
    """In vain, in a row."""
    vain_since_s: float = math.inf
    """When the first of them was sent."""
    resting_until_s: float = -math.inf
    window_s: float = math.inf
    """When the present window of its rate began …"""
    window_count: int = 0
    """… and how many had come by then."""

    @property
    def patience_s(self) -> float:
        return ONCE_AGAIN_S if self.rate_hz == 0.0 else max(MISSED / self.rate_hz, SILENCE_S)

    def is_wanting(self, now_s: float, vehicle: VehicleState, *, asks_first: bool) -> bool:
        """Whether it is to be asked for now. Judges its rate on the way."""
        if now_s < self.resting_until_s:
            return False
        heard_s = vehicle.received_s.get(self.kind, -math.inf)
        if self.rate_hz == 0.0:
            comes = heard_s > -math.inf
        else:
            comes = now_s - max(heard_s, self.asked_s) <= self.patience_s and not self._is_rare(
                now_s, vehicle
            )
        if heard_s > self.asked_s:
            self.tries, self.vain_since_s = 0, math.inf
        if self.asked_s == -math.inf and (asks_first or not comes):
            return True
        again_s = self.patience_s if self.tries < QUICK_TRIES else SLOW_S
        return not comes and now_s - self.asked_s >= again_s

    def _is_rare(self, now_s: float, vehicle: VehicleState) -> bool:
        """Whether too few came in a window that has just ended."""
        count = vehicle.received_count.get(self.kind, 0)
        since_s = now_s - self.window_s
        if count == self.window_count:  # it is silent so far, and begins with what comes first
            self.window_s = now_s
            return False
        if since_s < max(WINDOW_S, 3.0 / self.rate_hz):
            return False
        rare = count - self.window_count < ENOUGH_FRACTION * self.rate_hz * since_s
        self.window_s, self.window_count = now_s, count
        return rare

    def is_missing(self, now_s: float, vehicle: VehicleState) -> bool:
        """Whether it was asked for and nothing came, for long enough to say so."""
        if vehicle.received_s.get(self.kind, -math.inf) >= self.vain_since_s:
            return False
        return now_s < self.resting_until_s or now_s - self.vain_since_s > WINDOW_S

    def asked(self, now_s: float, vehicle: VehicleState) -> None:
        """It has been asked for."""
        self.tries += 1
        self.vain_since_s = min(self.vain_since_s, now_s)
        self.asked_s = self.window_s = now_s
        self.window_count = vehicle.received_count.get(self.kind, 0)


class StreamRequests:
    """What one client asks of one autopilot."""

    def __init__(
        self,
        rates_hz: Mapping[Flavour, Mapping[int, float]],
        once: Iterable[int] = (),
        *,
        asks_first: bool = True,
    ) -> None:
        """`rates_hz`: by flavour and message id, in the order in which they are asked for; a flavour that is not in
        it is asked nothing. `once`: messages that are asked for until one has come. With `asks_first` also what comes
        already is asked for, once, for its rate.
        """
        self._rates_hz = rates_hz
        self._once = tuple(once)
        self._asks_first = asks_first
        self._wanted: list[_Wanted] = []
        self._open: _Wanted | None = None
        self._look_s = -math.inf
        """When it is time for the next look at what comes."""
        self._asked_of: tuple[Flavour, int] | None = None
        """The flavour and the start of the autopilot that was asked."""
        self.missing: frozenset[int] = frozenset()
        """The streams that were asked for and do not come."""

    def _restart(self, flavour: Flavour) -> None:
        """The autopilot is new, or has forgotten what was asked."""
        rates_hz = self._rates_hz.get(flavour)
        if rates_hz is None:
            self._wanted = []
        else:
            self._wanted = [_Wanted(kind, rate_hz) for kind, rate_hz in rates_hz.items()]
            self._wanted += [_Wanted(kind, 0.0) for kind in self._once]
        self._open = None
        self._look_s = -math.inf

    def acknowledge(self, now_s: float, command: int, result: int) -> None:
        """A COMMAND_ACK to us has come."""
        asked = self._open
        if asked is None or command != (
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL if asked.rate_hz else mavlink.MAV_CMD_REQUEST_MESSAGE
        ):
            return
        self._open = None
        self._look_s = -math.inf
        if result in _NO:
            asked.resting_until_s = now_s + REST_UNSUPPORTED_S

    def step(self, now_s: float, vehicle: VehicleState) -> list[Any]:
        """The next request, if one is due."""
        if not vehicle.is_connected(now_s):
            return []
        asked_of = (vehicle.flavour, vehicle.boots)
        if asked_of != self._asked_of:
            self._asked_of = asked_of
            self._restart(vehicle.flavour)
        if now_s < self._look_s:
            return []
        self._open = None
        self._look_s = now_s + REPLY_S
        self.missing = frozenset(w.kind for w in self._wanted if w.is_missing(now_s, vehicle))
        for wanted in self._wanted:
            if wanted.is_wanting(now_s, vehicle, asks_first=self._asks_first):
                wanted.asked(now_s, vehicle)
                self._open = wanted
                if wanted.rate_hz == 0.0:
                    return [message_once(vehicle, wanted.kind)]
                return [message_interval(vehicle, wanted.kind, wanted.rate_hz)]
        return []
