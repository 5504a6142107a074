"""What keeps a PX4 vehicle on the ground and what brings it down: preflight checks, failsafes, fence.

After the PX4 user guide v1.15, safety configuration: https://docs.px4.io/v1.15/en/config/safety.html. A failsafe
first holds for COM_FAIL_ACT_T seconds, so that a person can react, and then acts.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot.fences import outside
from simvehicle.autopilot.px4_modes import Px4Mode

if TYPE_CHECKING:
    from simvehicle.autopilot.px4 import Px4

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

_GYRO_ACC_MAG_BARO = 0x1 | 0x2 | 0x4 | 0x8
_GPS, _MOTORS, _FENCE, _AHRS, _BATTERY, _PREARM = 0x20, 0x8000, 0x100000, 0x200000, 0x2000000, 0x10000000
_ALL = _GYRO_ACC_MAG_BARO | _GPS | _MOTORS | _FENCE | _AHRS | _BATTERY | _PREARM


class Px4Safety:
    """One per vehicle; `step` is called ten times a second."""

    def __init__(self, autopilot: Px4) -> None:
        self._a = autopilot
        self.position_lost = False
        self._told_ready = False
        self._offboard_lost = False
        self._link_lost = False
        self._breached = False
        self._battery_level = 0
        """0 in order, 1 low, 2 critical, 3 emergency: only grows."""
        self._pending: tuple[float, Px4Mode] | None = None
        """When to do what, after the holding time."""
        self._back_to: Px4Mode | None = None
        """The mode to go back to when the cause goes away by itself."""
        self._landed_since_s = 0.0

    def user_chose(self) -> None:
        """A person's or companion's mode ends what a failsafe had in mind."""
        self._pending = None
        self._back_to = None
        self._a.failsafe = False

    def step(self, now_s: float) -> None:
        a = self._a
        if not a.origin_is_set and a.gps_detected and a.time_s >= 0.5 * a.ready_after_s:
            a.set_origin()
        elif a.origin_is_set and not a.armed:
            a.home_m = a.nav.home_m = a.nav.position_m
        if a.ready and not self._told_ready:
            self._told_ready = True
            a.say(_INFO, "Ready for takeoff!")
        self._position(now_s)
        self._offboard(now_s)
        self._link(now_s)
        self._battery(now_s)
        self._fence(now_s)
        if self._pending is not None and now_s >= self._pending[0]:
            mode = self._pending[1]
            self._pending = self._back_to = None
            a.say(_CRITICAL, f"Failsafe activated: {mode.name.title()}")
            self._enter(mode)
        self._disarm_on_the_ground(now_s)

    def failures(self) -> list[str]:
        a = self._a
        texts: list[str] = []
        if not a.gps_detected or not a.estimator.gps:
            texts.append("GPS fix too low")
        if not a.position_ok:
            texts.append("No valid global position estimate")
        if not a.origin_is_set:
            texts.append("Home position not set")
        if self._battery_level >= 2:
            texts.append("Critical battery")
        if a.body.failed or a.crashed:
            texts.append("Motor failure")
        if a.ready and (reason := a.why_not(a.mode)) is not None:
            texts.append(reason)
        return texts

    def health(self) -> tuple[int, int, int]:
        a = self._a
        enabled = _ALL if a.parameters["GF_ACTION"] else _ALL & ~_FENCE
        healthy = _GYRO_ACC_MAG_BARO | _MOTORS | _FENCE
        if a.estimator.gps and a.gps_detected:
            healthy |= _GPS
        if a.position_ok:
            healthy |= _AHRS
        if self._battery_level < 2:
            healthy |= _BATTERY
        if self._breached:
            healthy &= ~_FENCE
        if a.armed or not self.failures():
            healthy |= _PREARM
        return _ALL, enabled, healthy

    # -- failsafes ------------------------------------------------------------------------------------------

    def _activate(self, now_s: float, mode: Px4Mode, *, returns_to: Px4Mode | None = None) -> None:
        """Hold first, then `mode`; with `returns_to` the mode to take up again when the cause goes away."""
        a = self._a
        if a.landed and a.mode is not Px4Mode.OFFBOARD:
            return
        if a.mode is Px4Mode.LAND or (a.mode is Px4Mode.RETURN and mode is not Px4Mode.LAND):
            return
        a.failsafe = True
        delay_s = a.parameters["COM_FAIL_ACT_T"]
        self._back_to = returns_to
        a.say(_CRITICAL, "Failsafe activated")
        if mode is Px4Mode.HOLD or delay_s <= 0.0:
            self._pending = None
            self._enter(mode)
        else:
            self._pending = (now_s + delay_s, mode)
            self._enter(Px4Mode.HOLD)

    def _enter(self, mode: Px4Mode) -> None:
        """A failsafe's mode, or a landing where there is no position for it."""
        a = self._a
        a.enter(mode if mode is Px4Mode.LAND or a.position_ok else Px4Mode.LAND)

    def _position(self, now_s: float) -> None:
        a = self._a
        if a.estimator.gps:
            self.position_lost = False
            return
        if self.position_lost or a.estimator.lost_for_s(now_s) < a.parameters["EKF2_NOAID_TOUT"] / 1e6:
            return
        self.position_lost = True
        if (a.armed and a.why_not(a.mode) is not None) or (a.armed and a.mode is Px4Mode.LAND):
            a.failsafe = True
            self._pending = self._back_to = None
            a.say(_CRITICAL, "Failsafe activated: Descend")
            a.enter(Px4Mode.LAND)
            a.maneuver = a.land_without_position()

    def _offboard(self, now_s: float) -> None:
        a = self._a
        lost = a.armed and a.mode is Px4Mode.OFFBOARD and now_s - a.offboard_s > a.parameters["COM_OF_LOSS_T"]
        if lost and not self._offboard_lost:
            self._offboard_lost = True
            action = int(a.parameters["COM_OBL_RC_ACT"])
            a.say(_CRITICAL, "Offboard control lost")
            if action in (6, 7):
                a.disarm("Flight terminated" if action == 6 else "Disarmed by failsafe", _CRITICAL)
            elif a.landed:
                a.failsafe = True
                a.enter(Px4Mode.HOLD)
            else:
                self._activate(
                    now_s, _OFFBOARD_ACTIONS.get(action, Px4Mode.HOLD), returns_to=Px4Mode.OFFBOARD
                )
                if action in _OFFBOARD_ACTIONS and self._pending is None:
                    self._back_to = None
        elif self._offboard_lost and a.offboard_alive:
            self._offboard_lost = False
            if self._back_to is Px4Mode.OFFBOARD and a.armed and a.mode is Px4Mode.HOLD:
                self.user_chose()
                a.enter(Px4Mode.OFFBOARD)
                a.say(_INFO, "Offboard control regained")

    def _link(self, now_s: float) -> None:
        a = self._a
        heard_s = max(a.gcs_heard_s.values(), default=None)
        if heard_s is None:
            return
        lost = now_s - heard_s > a.parameters["COM_DL_LOSS_T"]
        if lost and not self._link_lost:
            a.say(_CRITICAL, "Connection to ground control station lost")
            action = _LINK_ACTIONS.get(int(a.parameters["NAV_DLL_ACT"]))
            if action is not None and a.armed:
                self._activate(now_s, action)
        elif self._link_lost and not lost:
            a.say(_INFO, "Connection to ground control established")
        self._link_lost = lost

    def _battery(self, now_s: float) -> None:
        a, p = self._a, self._a.parameters
        fraction = a.battery.fraction
        level = sum(fraction < p[name] for name in ("BAT_LOW_THR", "BAT_CRIT_THR", "BAT_EMERGEN_THR"))
        if level <= self._battery_level:
            return
        self._battery_level = level
        a.say(
            _WARNING if level == 1 else _CRITICAL,
            ("Low", "Critical", "Dangerously low")[level - 1] + " battery",
        )
        action = int(p["COM_LOW_BAT_ACT"])
        if not a.armed or level < 2:
            return
        if action == 2 or (action == 3 and level == 3):
            self._activate(now_s, Px4Mode.LAND)
        elif action == 3:
            self._activate(now_s, Px4Mode.RETURN)

    def _fence(self, now_s: float) -> None:
        a, p = self._a, self._a.parameters
        if not p["GF_ACTION"] or not a.armed or not a.position_ok:
            self._breached = False
            return
        north, east, _ = a.nav.position_m
        far_m, high_m = p["GF_MAX_HOR_DIST"], p["GF_MAX_VER_DIST"]
        breached = (
            outside(a.fence, north, east, any_inclusion=True)
            or 0.0 < far_m < math.dist((north, east), a.nav.home_m[:2])
            or 0.0 < high_m < a.above_home_m
        )
        if breached and not self._breached:
            a.say(_CRITICAL, "Geofence violation")
            action = int(p["GF_ACTION"])
            if action == 4:
                a.disarm("Flight terminated", _CRITICAL)
            elif action in _FENCE_ACTIONS:
                self._activate(now_s, _FENCE_ACTIONS[action])
        self._breached = breached

    def _disarm_on_the_ground(self, now_s: float) -> None:
        a, p = self._a, self._a.parameters
        flew = a.has_flown
        if not a.landed or not a.armed or (a.motion_wants_to_fly and not flew):
            self._landed_since_s = now_s
        waits_s = p["COM_DISARM_LAND" if flew else "COM_DISARM_PRFLT"]
        if a.armed and waits_s > 0.0 and now_s - self._landed_since_s > waits_s:
            a.disarm("Disarmed by landing" if flew else "Disarmed by auto preflight disarming")
            a.failsafe = False
