"""What brings a PX4 vehicle home or down by itself: position, Offboard, link, battery, fence.

After the PX4 user guide, safety configuration (https://docs.px4.io/v1.15/en/config/safety.html), and a recorded one.
A failsafe first holds for COM_FAIL_ACT_T seconds, so that a person can react, and then acts; but at once where the
setpoints or the position are lost.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot.fences import outside
from simvehicle.autopilot.flight import Flight
from simvehicle.autopilot.maneuvers import Land
from simvehicle.autopilot.parameters import Parameters
from simvehicle.autopilot.px4_estimate import Px4Estimate
from simvehicle.autopilot.px4_mode_control import OffboardSetpoints, Px4ModeControl
from simvehicle.autopilot.px4_modes import Px4Mode
from simvehicle.autopilot.px4_voice import Px4Voice
from simvehicle.autopilot.uploaded_lists import FenceAreas

_INFO, _WARNING, _CRITICAL = (
    mavlink.MAV_SEVERITY_INFO,
    mavlink.MAV_SEVERITY_WARNING,
    mavlink.MAV_SEVERITY_CRITICAL,
)
_OFFBOARD_ACTIONS = {
    1: Px4Mode.ALTITUDE,
    2: Px4Mode.MANUAL,
    3: Px4Mode.RETURN,
    4: Px4Mode.LAND,
    5: Px4Mode.HOLD,
}
"""COM_OBL_RC_ACT. 0, and whatever else it is set to, is Position: a pilot's mode also where there is no pilot."""
_TERMINATES, _DISARMS = 6, 7
_LINK_ACTIONS = {1: Px4Mode.HOLD, 2: Px4Mode.RETURN, 3: Px4Mode.LAND}
"""NAV_DLL_ACT and NAV_RCL_ACT."""
_FLIES_ON_OFFBOARD = 4
"""Bit of COM_RCL_EXCEPT: the loss of the remote control does not end Offboard."""
_FENCE_ACTIONS = {2: Px4Mode.HOLD, 3: Px4Mode.RETURN, 5: Px4Mode.LAND}
"""GF_ACTION."""
_ACTION_NUMBERS = {
    Px4Mode.POSITION: 2,
    Px4Mode.ALTITUDE: 3,
    Px4Mode.MANUAL: 4,
    Px4Mode.HOLD: 5,
    Px4Mode.RETURN: 6,
    Px4Mode.LAND: 7,
}
_DESCEND = 8
_BATTERY_WARNINGS = (
    ("commander_failsafe_enter_low_bat", "Low battery level, return advised"),
    ("commander_failsafe_enter_crit_bat_warn", "Critical battery level, land now"),
    ("commander_failsafe_enter_crit_low_bat_warn", "Emergency battery level, land immediately"),
)
_BY_FAILSAFE = 14
"""Reason for disarming."""
_REMOTE_LOST, _LINK_LOST, _BATTERY_CRITICAL, _BATTERY_EMERGENCY = 1, 2, 4, 5
"""Causes that events tell."""


class Px4Failsafes:
    """One per vehicle; `step` is called ten times a second."""

    def __init__(
        self,
        flight: Flight,
        parameters: Parameters,
        voice: Px4Voice,
        estimate: Px4Estimate,
        modes: Px4ModeControl,
        offboard: OffboardSetpoints,
        fence: FenceAreas,
        ground_heard_s: Mapping[int, float],
    ) -> None:
        self._flight = flight
        self._parameters = parameters
        self._voice = voice
        self._report_now: Callable[[float], None] = lambda _now_s: None
        self._estimate = estimate
        self._modes = modes
        self._offboard_setpoints = offboard
        self._areas = fence
        self._ground_heard_s = ground_heard_s
        self._offboard_lost = False
        self._link_lost = False
        self.unheard: set[str] = set()
        """What is missed on purpose."""
        self._remote_lost = False
        self.breached = False
        self.battery_level = 0
        """0 in order, 1 low, 2 critical, 3 emergency: only grows."""
        self._pending: tuple[float, Px4Mode] | None = None
        """When to do what, after the holding time."""
        self._back_to: Px4Mode | None = None
        """The mode to go back to when the cause goes away by itself."""

    def report_by(self, report_now: Callable[[float], None]) -> None:
        """What fails is reported before the failsafe that it causes."""
        self._report_now = report_now

    @property
    def link_lost(self) -> bool:
        """No ground station is heard, or none yet."""
        return self._link_lost or not self._ground_heard_s

    def faults(self) -> list[str]:
        """The checks that fail in every mode."""
        found = ["check_battery_critical"] if self.battery_level >= 2 else []
        if self._flight.vehicle.body.failed or self._flight.crashed:
            found.append("check_failure_detector_motor")
        return found

    def user_chose(self) -> None:
        """A person's or companion's mode ends what a failsafe had in mind."""
        self._pending = None
        self._back_to = None
        self._flight.failsafe = False

    def step(self, now_s: float) -> None:
        self._position(now_s)
        self._offboard(now_s)
        self._link(now_s)
        self._remote_control(now_s)
        self._battery(now_s)
        self._fence(now_s)
        if self._pending is not None and now_s >= self._pending[0]:
            mode = self._pending[1]
            self._pending = self._back_to = None
            self._enter(mode)

    def _activate(self, now_s: float, mode: Px4Mode, cause: int = 0) -> None:
        """Hold first, then `mode`. `cause`: as an event tells it; 0: what the report says."""
        flight, now = self._flight, self._modes.mode
        if flight.landed and now is not Px4Mode.OFFBOARD:
            return
        if now is Px4Mode.LAND or (now is Px4Mode.RETURN and mode is not Px4Mode.LAND):
            return
        flight.failsafe = True
        self._back_to = None
        delay_s = self._parameters["COM_FAIL_ACT_T"]
        if mode is Px4Mode.HOLD or delay_s <= 0.0:
            self._pending = None
            self._enter(mode, cause)
            return
        self._pending = (now_s + delay_s, mode)
        told = struct.pack("<IBH", int(now), _ACTION_NUMBERS[mode], round(delay_s))
        name = "commander_failsafe_enter_hold" if cause else "commander_failsafe_enter_generic_hold"
        text = f"Failsafe activated: entering Hold for {round(delay_s)} seconds"
        self._voice.tell(name, _CRITICAL, told + bytes([cause] if cause else []), text=text)
        self._modes.fall_back(self._possible(Px4Mode.HOLD))

    def _enter(self, mode: Px4Mode, cause: int = 0, *, action: int | None = None) -> None:
        """A failsafe's mode, now."""
        action = _ACTION_NUMBERS[mode] if action is None else action
        told = struct.pack("<IB", int(self._modes.mode), action) + bytes([cause] if cause else [])
        name = "commander_failsafe_enter" if cause else "commander_failsafe_enter_generic"
        self._voice.tell(name, _CRITICAL, told, text="Failsafe activated")
        self._modes.fall_back(self._possible(mode))

    def _possible(self, mode: Px4Mode) -> Px4Mode:
        """A mode, or a landing where there is no position for it."""
        return mode if mode is Px4Mode.LAND or self._estimate.position_ok else Px4Mode.LAND

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
            self._report_now(now_s)
            self._enter(Px4Mode.LAND, action=_DESCEND)
            flight.maneuver = Land(with_position=False)

    def _offboard(self, now_s: float) -> None:
        flight, modes = self._flight, self._modes
        flies = flight.armed and modes.mode is Px4Mode.OFFBOARD
        if flies and self._offboard_setpoints.are_lost(now_s) and not self._offboard_lost:
            self._offboard_lost = True
            self._report_now(now_s)
            self._act_on_lost_offboard(int(self._parameters["COM_OBL_RC_ACT"]))
        elif self._offboard_lost and self._offboard_setpoints.are_alive(now_s):
            self._offboard_lost = False
            if self._back_to is Px4Mode.OFFBOARD and flight.armed:
                self.user_chose()
                modes.enter(Px4Mode.OFFBOARD)

    def _act_on_lost_offboard(self, action: int) -> None:
        """At once, and only until the setpoints are back."""
        flight = self._flight
        if action in (_TERMINATES, _DISARMS):
            flight.disarm(
                "Flight terminated" if action == _TERMINATES else "Disarmed by failsafe\t", _CRITICAL
            )
            self._voice.tell("commander_disarmed_by", _INFO, bytes([_BY_FAILSAFE]))
            return
        flight.failsafe = True
        mode = Px4Mode.HOLD if flight.landed else _OFFBOARD_ACTIONS.get(action, Px4Mode.POSITION)
        self._enter(mode)
        self._back_to = Px4Mode.OFFBOARD

    def _link(self, now_s: float) -> None:
        heard_s = max(self._ground_heard_s.values(), default=None)
        unheard = "ground_link" in self.unheard
        if heard_s is None and not (unheard or self._link_lost):
            return
        lost = unheard or (heard_s is not None and now_s - heard_s > self._parameters["COM_DL_LOSS_T"])
        if lost and not self._link_lost:
            text = "Connection to ground control station lost"
            self._voice.tell("commander_gcs_lost", _WARNING, text=text)
            action = _LINK_ACTIONS.get(int(self._parameters["NAV_DLL_ACT"]))
            if action is not None and self._flight.armed:
                self._activate(now_s, action, _LINK_LOST)
        elif self._link_lost and not lost:
            self._voice.tell("commander_dl_regained", _INFO, text="GCS connection regained")
        self._link_lost = lost

    def _remote_control(self, now_s: float) -> None:
        """It was heard until it is lost: the vehicles that we simulate have one without needing it."""
        p, modes = self._parameters, self._modes
        lost = "remote_control" in self.unheard
        if lost:
            modes.sticks_s = -math.inf
        if lost and not self._remote_lost:
            self._voice.tell("commander_rc_lost", _CRITICAL, text="Manual control lost")
            action = _LINK_ACTIONS.get(int(p["NAV_RCL_ACT"]))
            flies_on = modes.mode is Px4Mode.OFFBOARD and int(p["COM_RCL_EXCEPT"]) & _FLIES_ON_OFFBOARD
            if action is not None and self._flight.armed and not flies_on:
                self._activate(now_s, action, _REMOTE_LOST)
        self._remote_lost = lost

    def _battery(self, now_s: float) -> None:
        p = self._parameters
        fraction = self._flight.vehicle.battery.fraction
        level = sum(fraction < p[name] for name in ("BAT_LOW_THR", "BAT_CRIT_THR", "BAT_EMERGEN_THR"))
        if level <= self.battery_level:
            return
        self.battery_level = level
        name, text = _BATTERY_WARNINGS[level - 1]
        self._voice.tell(name, _WARNING if level == 1 else _CRITICAL, text=text)
        action = int(p["COM_LOW_BAT_ACT"])
        cause = _BATTERY_EMERGENCY if level == 3 else _BATTERY_CRITICAL
        if not self._flight.armed or level < 2:
            return
        if action == 2 or (action == 3 and level == 3):
            self._activate(now_s, Px4Mode.LAND, cause)
        elif action == 3:
            self._activate(now_s, Px4Mode.RETURN, cause)

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
            self._voice.say(_CRITICAL, "Geofence violation: approaching or outside geofence")
            self.breached = True
            self._report_now(now_s)
            action = int(p["GF_ACTION"])
            if action == 4:
                flight.disarm("Flight terminated", _CRITICAL)
            elif action in _FENCE_ACTIONS:
                self._activate(now_s, _FENCE_ACTIONS[action])
        self.breached = breached
