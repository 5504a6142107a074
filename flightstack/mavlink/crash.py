"""Whether a vehicle has crashed, from what it says of its motion: a fall and its end, an attitude, a text.

Autopilots do not always notice. An ArduCopter disarms after a crash only where it leans far; one that fell flat stays
armed in its mode and says that it flies. What tells a fall from a descent is its end: no motors take several metres a
second away at once, the ground does. What goes on to climb, sink or travel, armed and level, was no wreck.

Times are the vehicle's own (`time_boot_ms`): messages that a link held up come all at once, and a simulation may run
faster than we do; by our clock a gentle braking would look like an impact then.
"""

from __future__ import annotations

import math
import re

import msgspec

FALL_MPS = 4.0
"""Nothing that flies as it is told sinks so fast and is at rest a moment later."""
FALL_M = FALL_MPS**2 / (2.0 * 9.81)
"""So deep falls at least what falls that fast: one wrong velocity between two right ones is no fall."""
IMPACT_MPS2 = 10.0
"""Only the ground brakes a fall like that; a multirotor that catches itself has about half as much to spare."""
ONSET_MPS2 = 15.0
ONSET_SLACK_MPS = 1.0
"""Nothing begins to fall faster than that: a velocity that does is another opinion of the estimator's …"""
GROWS_MPS = 3.0
"""… unless it grows by so much from there, as that of a fall does."""
SETTLES_WITHIN_S = 5.0
"""A wreck bounces and slides, and an estimator takes its time to believe in the end of the fall."""
AT_REST_MPS = 0.5
AT_REST_S = 1.5
STILL_M = 0.7
ON_THE_GROUND_M = 1.5
"""Over home: where a vehicle is at rest that fell and whose impact was not seen."""
TURNED_OVER_RAD = math.radians(70.0)
TURNED_OVER_S = 2.0
TURNED_OVER_MPS = 3.0
"""On its side or back, and this slow: nothing hovers like that."""
LEVEL_RAD = math.radians(45.0)
FLIES_S = 3.0
FLIES_LEVEL_MPS = 1.0
FLIES_VERTICAL_MPS = 0.2
"""Slower than any landing; an estimator on the ground drifts more slowly still."""
FLIES_VERTICAL_M = 2.0
"""No wreck rises or sinks as far in one go …"""
FLIES_LEVEL_M = 8.0
"""… or travels so far."""

_TEXT = re.compile(r"^crash: disarming|^crash detected", re.IGNORECASE)
_THRUST_LOSS = re.compile(r"thrust loss|motor failure", re.IGNORECASE)


class _Fall(msgspec.Struct):
    fastest_mps: float
    last_mps: float
    seen_s: float
    """When it was last seen to fall."""
    from_amsl_m: float | None
    """Where it was before, if that is known."""
    jumped_to_mps: float | None
    """It began at once, as only an estimate can."""
    impact: bool = False
    rest_since_s: float | None = None
    rest_amsl_m: float = 0.0


class _Flight(msgspec.Struct):
    """What a vehicle that is taken for a wreck does without a pause."""

    since_s: float
    newest_s: float
    from_amsl_m: float
    sign: float
    """Of its vertical velocity; 0: it travels."""
    north_m: float = 0.0
    east_m: float = 0.0


class CrashWatch:
    """One vehicle between its arming and the next. `reason` says how it crashed, "" as long as it has not."""

    def __init__(self) -> None:
        self.reason = ""
        self._final = False
        """The autopilot says so itself."""
        self._fall: _Fall | None = None
        self._flight: _Flight | None = None
        self._turned_since_s: float | None = None
        self._is_level = True
        self._speed_mps = 0.0
        self._before: tuple[float, float] | None = None
        """Time and speed downwards of the position before."""
        self._amsl_m: float | None = None
        self._thrust_lost = ""

    def moved(
        self,
        boot_s: float,
        velocity_ned_mps: tuple[float, float, float],
        amsl_m: float,
        above_home_m: float,
        *,
        landing: bool,
        armed: bool = True,
    ) -> None:
        """A position of a vehicle came that is armed or was a moment ago. `landing`: its mode ends on the ground by
        itself."""
        down_mps = velocity_ned_mps[2]
        self._speed_mps = math.hypot(*velocity_ned_mps)
        before, self._before = self._before, (boot_s, down_mps)
        if self.reason:
            self._look_whether_it_flies(boot_s, velocity_ned_mps, amsl_m, armed=armed)
            self._amsl_m = amsl_m
            return
        fall = self._fall
        if down_mps >= FALL_MPS:
            if fall is None:
                jumped = before is not None and down_mps - before[1] > ONSET_SLACK_MPS + ONSET_MPS2 * (
                    boot_s - before[0]
                )
                self._fall = _Fall(down_mps, down_mps, boot_s, self._amsl_m, down_mps if jumped else None)
            else:
                fall.fastest_mps, fall.last_mps = max(down_mps, fall.fastest_mps), down_mps
                fall.seen_s, fall.impact, fall.rest_since_s = boot_s, False, None
            return
        if fall is None:
            self._amsl_m = amsl_m
            return
        hit = down_mps < 1.0 and fall.last_mps - down_mps > IMPACT_MPS2 * (boot_s - fall.seen_s)
        is_real = fall.jumped_to_mps is None or fall.fastest_mps - fall.jumped_to_mps >= GROWS_MPS
        fall.impact |= hit and is_real
        if boot_s - fall.seen_s > SETTLES_WITHIN_S and fall.rest_since_s is None:
            self._fall = None
            return
        still = fall.rest_since_s is not None and abs(amsl_m - fall.rest_amsl_m) < STILL_M
        if self._speed_mps > AT_REST_MPS or not still:
            at_rest = self._speed_mps <= AT_REST_MPS
            fall.rest_since_s, fall.rest_amsl_m = (boot_s, amsl_m) if at_rest else (None, amsl_m)
            return
        if fall.from_amsl_m is not None and fall.from_amsl_m - amsl_m < FALL_M:
            self._fall = None
            return
        low = above_home_m < ON_THE_GROUND_M and not landing
        at_rest_s = boot_s - (fall.rest_since_s or boot_s)
        if at_rest_s >= (AT_REST_S if fall.impact else 2.0 * AT_REST_S) and (fall.impact or low):
            lost = f' after "{self._thrust_lost}"' if self._thrust_lost else ""
            self.reason = f"fell and hit the ground at {fall.fastest_mps:.1f} m/s{lost}"

    def _look_whether_it_flies(
        self, boot_s: float, velocity_ned_mps: tuple[float, float, float], amsl_m: float, *, armed: bool
    ) -> None:
        """Take the crash back if the vehicle goes on to fly."""
        north_mps, east_mps, down_mps = velocity_ned_mps
        sign = math.copysign(1.0, down_mps) if abs(down_mps) >= FLIES_VERTICAL_MPS else 0.0
        travels = math.hypot(north_mps, east_mps) >= FLIES_LEVEL_MPS
        if self._final or not armed or not self._is_level or not (sign or travels):
            self._flight = None
            return
        flight = self._flight
        if flight is None or (flight.sign != sign and not travels):
            self._flight = _Flight(boot_s, boot_s, amsl_m, sign)
            return
        step_s = min(max(boot_s - flight.newest_s, 0.0), 1.0)
        flight.newest_s = boot_s
        flight.north_m += north_mps * step_s if travels else 0.0
        flight.east_m += east_mps * step_s if travels else 0.0
        far = math.hypot(flight.north_m, flight.east_m) >= FLIES_LEVEL_M
        climbs = flight.sign == sign and abs(amsl_m - flight.from_amsl_m) >= FLIES_VERTICAL_M
        if boot_s - flight.since_s >= FLIES_S and (far or climbs):
            self.reason, self._fall, self._flight = "", None, None

    def leaned(self, boot_s: float, roll_rad: float, pitch_rad: float) -> None:
        """An attitude of an armed vehicle came."""
        cosine = math.cos(roll_rad) * math.cos(pitch_rad)
        self._is_level = cosine > math.cos(LEVEL_RAD)
        if cosine > math.cos(TURNED_OVER_RAD) or self._speed_mps > TURNED_OVER_MPS:
            self._turned_since_s = None
        elif self._turned_since_s is None:
            self._turned_since_s = boot_s
        elif boot_s - self._turned_since_s >= TURNED_OVER_S and not self.reason:
            tilt_deg = math.degrees(math.acos(max(-1.0, min(1.0, cosine))))
            self.reason = f"lies turned over by {tilt_deg:.0f} degrees"

    def told(self, text: str) -> None:
        """The autopilot said something, armed or a moment after."""
        if _THRUST_LOSS.search(text):
            self._thrust_lost = text
        if _TEXT.search(text):
            self._final = True
            self.reason = self.reason or f'the autopilot says "{text}"'
