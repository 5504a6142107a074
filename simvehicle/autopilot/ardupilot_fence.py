"""ArduCopter's fence: destinations that it refuses, and what it does about a breach."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot.announcer import Announcer
from simvehicle.autopilot.ardupilot_modes import ArduPilotMode
from simvehicle.autopilot.fences import outside
from simvehicle.autopilot.flight import Flight
from simvehicle.autopilot.parameters import Parameters
from simvehicle.autopilot.uploaded_lists import FenceAreas

_ACTIONS = {
    1: ArduPilotMode.RTL,
    2: ArduPilotMode.LAND,
    3: ArduPilotMode.SMART_RTL,
    4: ArduPilotMode.BRAKE,
    5: ArduPilotMode.SMART_RTL,
}
"""FENCE_ACTION"""


class ArduPilotFence:
    def __init__(
        self, flight: Flight, parameters: Parameters, fence: FenceAreas, announcer: Announcer
    ) -> None:
        self._flight = flight
        self._parameters = parameters
        self._fence = fence
        self._announcer = announcer
        self.breached = 0
        """FENCE_BREACH_NONE, or what was breached."""
        self._breaches = 0
        self._breach_time_ms = 0

    def allows(self, north_m: float, east_m: float) -> bool:
        """Whether the enabled fence contains a destination."""
        p = self._parameters
        if not p["FENCE_ENABLE"]:
            return True
        kinds = int(p["FENCE_TYPE"])
        if kinds & 2 and math.dist((north_m, east_m), self._flight.nav.home_m[:2]) > p["FENCE_RADIUS"]:
            return False
        return not (kinds & 4 and self._is_outside(north_m, east_m))

    def _is_outside(self, north_m: float, east_m: float) -> bool:
        union = bool(int(self._parameters["FENCE_OPTIONS"]) & 2)
        return outside(self._fence.areas, north_m, east_m, any_inclusion=union)

    def step(self, act: Callable[[ArduPilotMode | None], None]) -> None:
        """`act`: enter a failsafe's mode."""
        flight, p = self._flight, self._parameters
        if not p["FENCE_ENABLE"] or not flight.armed:
            return
        now, name = self._breach()
        before, self.breached = self.breached, int(now)
        if now and not before:
            self._breaches += 1
            self._breach_time_ms = int(flight.time_s * 1000)
            self._announcer.say(mavlink.MAV_SEVERITY_NOTICE, f"{name} fence breached")
            self._announcer.say(mavlink.MAV_SEVERITY_INFO, "Manual recovery started")
            act(_ACTIONS.get(int(p["FENCE_ACTION"])))
            self._announcer.announce_mode()
            self._announcer.broadcast(self.status())
        elif before and not now:
            self._announcer.say(mavlink.MAV_SEVERITY_NOTICE, "Fence breach cleared")

    def _breach(self) -> tuple[int, str]:
        flight, p = self._flight, self._parameters
        north, east, _ = flight.nav.position_m
        kinds = int(p["FENCE_TYPE"])
        if kinds & 1 and flight.above_home_m > p["FENCE_ALT_MAX"]:
            return mavlink.FENCE_BREACH_MAXALT, "Max Alt"
        if kinds & 2 and math.dist((north, east), flight.nav.home_m[:2]) > p["FENCE_RADIUS"]:
            return mavlink.FENCE_BREACH_BOUNDARY, "Circle"
        if kinds & 4 and self._is_outside(north, east):
            return mavlink.FENCE_BREACH_BOUNDARY, "Polygon"
        if kinds & 8 and not flight.landed and flight.above_home_m < p["FENCE_ALT_MIN"]:
            return mavlink.FENCE_BREACH_MINALT, "Min Alt"
        return 0, ""

    def status(self) -> Any:
        """FENCE_STATUS"""
        breached = self.breached
        return mavlink.MAVLink_fence_status_message(
            1 if breached else 0, self._breaches, breached, self._breach_time_ms, 0
        )
