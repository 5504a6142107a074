"""What brings a PX4 vehicle home or down by itself: position, Offboard, link, battery, fence.

After the PX4 user guide v1.15, safety configuration: https://docs.px4.io/v1.15/en/config/safety.html. A failsafe
first holds for COM_FAIL_ACT_T seconds, so that a person can react, and then acts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot.announcer import Announcer
from simvehicle.autopilot.fences import outside
from simvehicle.autopilot.flight import Flight
from simvehicle.autopilot.maneuvers import Land
from simvehicle.autopilot.parameters import Parameters
from simvehicle.autopilot.px4_estimate import Px4Estimate
from simvehicle.autopilot.px4_mode_control import OffboardSetpoints, Px4ModeControl
from simvehicle.autopilot.px4_modes import Px4Mode
from simvehicle.autopilot.uploaded_lists import FenceAreas

_INFO, _WARNING, _CRITICAL = (
    mavlink.MAV_SEVERITY_INFO,
    mavlink.MAV_SEVERITY_WARNING,
    mavlink.MAV_SEVERITY_CRITICAL,
)
_OFFBOARD_ACTIONS = {3: Px4Mode.RETURN, 4: Px4Mode.LAND, 5: Px4Mode.HOLD}
"""COM_OBL_RC_ACT. 0 to 2 are a pilot's modes: without sticks PX4 falls through them to Hold."""
_LINK_ACTIONS = {1: Px4Mode.HOLD, 2: Px4Mode.RETURN, 3: Px4Mode.LAND}
"""NAV_DLL_ACT."""
_FENCE_ACTIONS = {2: Px4Mode.HOLD, 3: Px4Mode.RETURN, 5: Px4Mode.LAND}
"""GF_ACTION."""


class Px4Failsafes:
    """One per vehicle; `step` is called ten times a second."""

    def __init__(
        self,
        flight: Flight,
        parameters: Parameters,
        announcer: Announcer,
        estimate: Px4Estimate,
        modes: Px4ModeControl,
        offboard: OffboardSetpoints,
        fence: FenceAreas,
        ground_heard_s: Mapping[int, float],
    ) -> None:
        self._flight = flight
        self._parameters = parameters
        self._announcer = announcer
        self._estimate = estimate
        self._modes = modes
        self._offboard_setpoints = offboard
        self._areas = fence
        self._ground_heard_s = ground_heard_s
        self._offboard_lost = False
        self._link_lost = False
        self.breached = False
        self.battery_level = 0
        """0 in order, 1 low, 2 critical, 3 emergency: only grows."""
        self._pending: tuple[float, Px4Mode] | None = None
        """When to do what, after the holding time."""
        self._back_to: Px4Mode | None = None
        """The mode to go back to when the cause goes away by itself."""

    def user_chose(self) -> None:
        """A person's or companion's mode ends what a failsafe had in mind."""
        self._pending = None
        self._back_to = None
        self._flight.failsafe = False

    def step(self, now_s: float) -> None:
        self._position(now_s)
        self._offboard(now_s)
        self._link(now_s)
        self._battery(now_s)
        self._fence(now_s)
        if self._pending is not None and now_s >= self._pending[0]:
            mode = self._pending[1]
            self._pending = self._back_to = None
            self._announcer.say(_CRITICAL, f"Failsafe activated: {mode.name.title()}")
            self._enter(mode)

    def _activate(self, now_s: float, mode: Px4Mode, *, returns_to: Px4Mode | None = None) -> None:
        """Hold first, then `mode`; with `returns_to` the mode to take up again when the cause goes away."""
        flight, now = self._flight, self._modes.mode
        if flight.landed and now is not Px4Mode.OFFBOARD:
            return
        if now is Px4Mode.LAND or (now is Px4Mode.RETURN and mode is not Px4Mode.LAND):
            return
        flight.failsafe = True
        delay_s = self._parameters["COM_FAIL_ACT_T"]
        self._back_to = returns_to
        self._announcer.say(_CRITICAL, "Failsafe activated")
        if mode is Px4Mode.HOLD or delay_s <= 0.0:
            self._pending = None
            self._enter(mode)
        else:
            self._pending = (now_s + delay_s, mode)
            self._enter(Px4Mode.HOLD)

    def _enter(self, mode: Px4Mode) -> None:
        """A failsafe's mode, or a landing where there is no position for it."""
        self._modes.enter(mode if mode is Px4Mode.LAND or self._estimate.position_ok else Px4Mode.LAND)

    def _position(self, now_s: float) -> None:
        flight, modes, estimate = self._flight, self._modes, self._estimate
        estimator = flight.vehicle.estimator
        if estimator.gps:
            estimate.lost = False
            return
        if estimate.lost or estimator.lost_for_s(now_s) < self._parameters["EKF2_NOAID_TOUT"] / 1e6:
            return
        estimate.lost = True
        if flight.armed and (modes.why_not(modes.mode) is not None or modes.mode is Px4Mode.LAND):
            flight.failsafe = True
            self._pending = self._back_to = None
            self._announcer.say(_CRITICAL, "Failsafe activated: Descend")
            modes.enter(Px4Mode.LAND)
            flight.maneuver = Land(with_position=False)

    def _offboard(self, now_s: float) -> None:
        flight, modes, say = self._flight, self._modes, self._announcer.say
        flies = flight.armed and modes.mode is Px4Mode.OFFBOARD
        if flies and self._offboard_setpoints.are_lost(now_s) and not self._offboard_lost:
            self._offboard_lost = True
            say(_CRITICAL, "Offboard control lost")
            self._act_on_lost_offboard(now_s, int(self._parameters["COM_OBL_RC_ACT"]))
        elif self._offboard_lost and self._offboard_setpoints.are_alive(now_s):
            self._offboard_lost = False
            if self._back_to is Px4Mode.OFFBOARD and flight.armed and modes.mode is Px4Mode.HOLD:
                self.user_chose()
                modes.enter(Px4Mode.OFFBOARD)
                say(_INFO, "Offboard control regained")

    def _act_on_lost_offboard(self, now_s: float, action: int) -> None:
        flight = self._flight
        if action in (6, 7):
            flight.disarm("Flight terminated" if action == 6 else "Disarmed by failsafe", _CRITICAL)
        elif flight.landed:
            flight.failsafe = True
            self._modes.enter(Px4Mode.HOLD)
        else:
            self._activate(now_s, _OFFBOARD_ACTIONS.get(action, Px4Mode.HOLD), returns_to=Px4Mode.OFFBOARD)
            if action in _OFFBOARD_ACTIONS and self._pending is None:
                self._back_to = None

    def _link(self, now_s: float) -> None:
        heard_s = max(self._ground_heard_s.values(), default=None)
        if heard_s is None:
            return
        lost = now_s - heard_s > self._parameters["COM_DL_LOSS_T"]
        if lost and not self._link_lost:
            self._announcer.say(_CRITICAL, "Connection to ground control station lost")
            action = _LINK_ACTIONS.get(int(self._parameters["NAV_DLL_ACT"]))
            if action is not None and self._flight.armed:
                self._activate(now_s, action)
        elif self._link_lost and not lost:
            self._announcer.say(_INFO, "Connection to ground control established")
        self._link_lost = lost

    def _battery(self, now_s: float) -> None:
        p = self._parameters
        fraction = self._flight.vehicle.battery.fraction
        level = sum(fraction < p[name] for name in ("BAT_LOW_THR", "BAT_CRIT_THR", "BAT_EMERGEN_THR"))
        if level <= self.battery_level:
            return
        self.battery_level = level
        self._announcer.say(
            _WARNING if level == 1 else _CRITICAL,
            ("Low", "Critical", "Dangerously low")[level - 1] + " battery",
        )
        action = int(p["COM_LOW_BAT_ACT"])
        if not self._flight.armed or level < 2:
            return
        if action == 2 or (action == 3 and level == 3):
            self._activate(now_s, Px4Mode.LAND)
        elif action == 3:
            self._activate(now_s, Px4Mode.RETURN)

    def _fence(self, now_s: float) -> None:
        flight, p = self._flight, self._parameters
        if not p["GF_ACTION"] or not flight.armed or not self._estimate.position_ok:
            self.breached = False
            return
        north, east, _ = flight.nav.position_m
        far_m, high_m = p["GF_MAX_HOR_DIST"], p["GF_MAX_VER_DIST"]
        breached = (
            outside(self._areas.areas, north, east, any_inclusion=True)
            or 0.0 < far_m < math.dist((north, east), flight.nav.home_m[:2])
            or 0.0 < high_m < flight.above_home_m
        )
        if breached and not self.breached:
            self._announcer.say(_CRITICAL, "Geofence violation")
            action = int(p["GF_ACTION"])
            if action == 4:
                flight.disarm("Flight terminated", _CRITICAL)
            elif action in _FENCE_ACTIONS:
                self._activate(now_s, _FENCE_ACTIONS[action])
        self.breached = breached
