"""Whether a vehicle has crashed, from what it says of its motion: a fall and its end, an attitude, a text.

Autopilots do not always notice. An ArduCopter disarms after a crash only where it leans far; one that fell flat stays
armed in its mode and says that it flies. What tells a fall from a descent is its end: no motors take several metres a
second away at once, the ground does.
"""

from __future__ import annotations

import math
import re

import msgspec

FALL_MPS = 4.0
"""Nothing that flies as it is told sinks so fast and is at rest a moment later."""
IMPACT_MPS2 = 10.0
"""Only the ground brakes a fall like that; a multirotor that catches itself has about half as much to spare."""
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

_TEXT = re.compile(r"^crash: disarming|^crash detected", re.IGNORECASE)
_THRUST_LOSS = re.compile(r"thrust loss|motor failure", re.IGNORECASE)


class _Fall(msgspec.Struct):
    fastest_mps: float
    last_mps: float
    seen_s: float
    """When it was last seen to fall."""
    impact: bool = False
    rest_since_s: float | None = None
    rest_amsl_m: float = 0.0


class CrashWatch:
    """One vehicle between its arming and the next. `reason` says how it crashed, "" as long as it has not."""

    def __init__(self) -> None:
        self.reason = ""
        self._fall: _Fall | None = None
        self._turned_since_s: float | None = None
        self._speed_mps = 0.0
        self._thrust_lost = ""

    def moved(
        self,
        now_s: float,
        velocity_ned_mps: tuple[float, float, float],
        amsl_m: float,
        above_home_m: float,
        *,
        landing: bool,
    ) -> None:
        """A position of an armed vehicle came. `landing`: its mode ends on the ground by itself."""
        north_mps, east_mps, down_mps = velocity_ned_mps
        self._speed_mps = math.hypot(north_mps, east_mps, down_mps)
        fall = self._fall
        if down_mps >= FALL_MPS:
            fastest_mps = down_mps if fall is None else max(down_mps, fall.fastest_mps)
            self._fall = _Fall(fastest_mps, down_mps, now_s)
            return
        if fall is None or self.reason:
            return
        fall.impact |= down_mps < 1.0 and fall.last_mps - down_mps > IMPACT_MPS2 * (now_s - fall.seen_s)
        if now_s - fall.seen_s > SETTLES_WITHIN_S and fall.rest_since_s is None:
            self._fall = None
            return
        still = fall.rest_since_s is not None and abs(amsl_m - fall.rest_amsl_m) < STILL_M
        if self._speed_mps > AT_REST_MPS or not still:
            at_rest = self._speed_mps <= AT_REST_MPS
            fall.rest_since_s, fall.rest_amsl_m = (now_s, amsl_m) if at_rest else (None, amsl_m)
            return
        low = above_home_m < ON_THE_GROUND_M and not landing
        at_rest_s = now_s - (fall.rest_since_s or now_s)
        if at_rest_s >= (AT_REST_S if fall.impact else 2.0 * AT_REST_S) and (fall.impact or low):
            lost = f' after "{self._thrust_lost}"' if self._thrust_lost else ""
            self.reason = f"fell and hit the ground at {fall.fastest_mps:.1f} m/s{lost}"

    def leaned(self, now_s: float, roll_rad: float, pitch_rad: float) -> None:
        """An attitude of an armed vehicle came."""
        cosine = math.cos(roll_rad) * math.cos(pitch_rad)
        if cosine > math.cos(TURNED_OVER_RAD) or self._speed_mps > TURNED_OVER_MPS:
            self._turned_since_s = None
        elif self._turned_since_s is None:
            self._turned_since_s = now_s
        elif now_s - self._turned_since_s >= TURNED_OVER_S and not self.reason:
            tilt_deg = math.degrees(math.acos(max(-1.0, min(1.0, cosine))))
            self.reason = f"lies turned over by {tilt_deg:.0f} degrees"

    def told(self, text: str) -> None:
        """The autopilot said something, armed or a moment after."""
        if _THRUST_LOSS.search(text):
            self._thrust_lost = text
        if not self.reason and _TEXT.search(text):
            self.reason = f'the autopilot says "{text}"'
