"""Positions that cannot follow on the one before: such a one counts when the next one agrees with it.

A check sum of 16 bits lets one damaged frame in 65536 pass, and one that puts the vehicle elsewhere, or its clock
ahead so that the right ones after it look late, would have the swarm count its drone out. A leap that is one (another
estimate after a GPS glitch, a link that was held up) is taken over with the next message.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

from mission.geometry.frames import Geodetic

AHEAD_S: Final = 1.0
"""The vehicle's clock runs as ours does; a message that was held up on the way is behind, not ahead."""
LEAP_M: Final = 100.0
FASTEST_MPS: Final = 60.0
"""No multicopter or helicopter flies faster."""
FORGOTTEN_S: Final = 3.0
"""What was known longer ago says nothing about now."""
_M_PER_1E7: Final = 0.0111319
"""Of latitude."""


def apart_m(a: Geodetic, b: Geodetic) -> float:
    """Distance of two places, roughly."""
    return _distance_m(
        (a.latitude_deg - b.latitude_deg) * 1e7,
        (a.longitude_deg - b.longitude_deg) * 1e7,
        a.latitude_deg,
        a.amsl_m - b.amsl_m,
    )


def _distance_m(north_1e7: float, east_1e7: float, latitude_deg: float, up_m: float) -> float:
    east_m = east_1e7 * _M_PER_1E7 * math.cos(math.radians(latitude_deg))
    return math.hypot(north_1e7 * _M_PER_1E7, east_m, up_m)


class _Report(NamedTuple):
    now_s: float
    boot_ms: int
    latitude_1e7: int
    longitude_1e7: int
    amsl_mm: int

    def follows(self, before: _Report) -> bool:
        """Whether a vehicle that was as `before` says can be as this says."""
        elapsed_s = max(self.now_s - before.now_s, 0.0)
        boot_s = (self.boot_ms - before.boot_ms) / 1000.0
        distance_m = _distance_m(
            self.latitude_1e7 - before.latitude_1e7,
            self.longitude_1e7 - before.longitude_1e7,
            self.latitude_1e7 * 1e-7,
            (self.amsl_mm - before.amsl_mm) / 1000.0,
        )
        return boot_s <= elapsed_s + AHEAD_S and distance_m <= LEAP_M + FASTEST_MPS * elapsed_s


class LeapFilter:
    """Of one vehicle, between its start and the next."""

    def __init__(self) -> None:
        self._before: _Report | None = None
        self._leap: _Report | None = None

    def believes(self, now_s: float, fields: Any) -> bool:
        """Whether this GLOBAL_POSITION_INT counts."""
        report = _Report(now_s, fields.time_boot_ms, fields.lat, fields.lon, fields.alt)
        fast = math.hypot(fields.vx, fields.vy, fields.vz) * 0.01 > FASTEST_MPS
        before, leap = self._before, self._leap
        known = before is not None and now_s - before.now_s <= FORGOTTEN_S
        leaps = fast or (known and before is not None and not report.follows(before))
        if leaps and (leap is None or not report.follows(leap)):
            self._leap = report
            return False
        self._leap = None
        self._before = report
        return True


class HomeFilter:
    """A home far from the one before has moved when it is told a second time."""

    def __init__(self) -> None:
        self._other: Geodetic | None = None

    def believes(self, before: Geodetic | None, home: Geodetic) -> bool:
        """Whether `home` counts. `before`: the one that counts now."""
        if before is not None and home != self._other and apart_m(home, before) > LEAP_M:
            self._other = home
            return False
        self._other = None
        return True
