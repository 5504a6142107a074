"""ArduCopter's avoidance (AC_Avoid): velocity targets that lead over its own fence are slowed and turned along it.

Stock it is on (AVOID_ENABLE 3), it brakes gently, 1 m/s^2, and it says nothing.
"""

from __future__ import annotations

import math

from simvehicle.autopilot.fences import Area
from simvehicle.autopilot.flight import Flight
from simvehicle.autopilot.parameters import Parameters
from simvehicle.autopilot.uploaded_lists import FenceAreas

_BRAKE_MPS2 = 1.0
"""AC_AVOID_ACCEL_CMSS_MAX."""
_GAIN_PER_S = 1.0
_MAX_ALT, _CIRCLE, _POLYGON = 1, 2, 4
"""Bits of FENCE_TYPE."""
_AT_FENCE = 1
"""Bit of AVOID_ENABLE."""

Plane = tuple[float, float]


class ArduPilotAvoidance:
    def __init__(self, flight: Flight, parameters: Parameters, fence: FenceAreas) -> None:
        self._flight = flight
        self._parameters = parameters
        self._fence = fence

    def adjusted(self, velocity_mps: Plane, down_mps: float) -> tuple[Plane, float]:
        """What becomes of a velocity target, north, east and down."""
        p = self._parameters
        if not p["FENCE_ENABLE"] or not int(p["AVOID_ENABLE"]) & _AT_FENCE:
            return velocity_mps, down_mps
        kinds = int(p["FENCE_TYPE"])
        if kinds & _MAX_ALT:
            room_m = p["FENCE_ALT_MAX"] - p["FENCE_MARGIN"] - self._flight.above_home_m
            down_mps = max(down_mps, -self._allowed_mps(room_m))
        here = self._flight.nav.position_m[:2]
        for outward, clearance_m in self._limits(kinds, here):
            velocity_mps = self._limited(velocity_mps, outward, clearance_m - p["FENCE_MARGIN"])
        return velocity_mps, down_mps

    def _limits(self, kinds: int, here: Plane) -> list[tuple[Plane, float]]:
        """Of every fence that it is inside of: the direction to its line (a unit vector), and how far that is."""
        limits = []
        if kinds & _CIRCLE:
            home = self._flight.nav.home_m
            limits.append(_to_circle(here, (home[0], home[1]), self._parameters["FENCE_RADIUS"], inside=True))
        if kinds & _POLYGON:
            for area in self._fence.areas:
                if area.contains(*here) is not area.inclusion:
                    continue  # breached: no more avoidance there
                if area.vertices_m:
                    limits.append(_to_edge(here, area))
                else:
                    limits.append(_to_circle(here, area.center_m, area.radius_m, inside=area.inclusion))
        return [limit for limit in limits if limit[1] >= 0.0]

    def _limited(self, velocity_mps: Plane, outward: Plane, room_m: float) -> Plane:
        towards_mps = velocity_mps[0] * outward[0] + velocity_mps[1] * outward[1]
        allowed_mps = self._allowed_mps(room_m)
        if towards_mps <= allowed_mps:
            return velocity_mps
        if self._parameters["AVOID_BEHAVE"]:  # stop
            share = max(allowed_mps, 0.0) / towards_mps
            return velocity_mps[0] * share, velocity_mps[1] * share
        excess_mps = towards_mps - allowed_mps  # slide
        return velocity_mps[0] - outward[0] * excess_mps, velocity_mps[1] - outward[1] * excess_mps

    def _allowed_mps(self, room_m: float) -> float:
        """ArduPilot's square root controller; inside of the margin it backs away."""
        if room_m <= 0.0:
            return max(_GAIN_PER_S * room_m, -self._parameters["AVOID_BACKUP_SPD"])
        linear_m = _BRAKE_MPS2 / _GAIN_PER_S**2
        if room_m <= linear_m:
            return _GAIN_PER_S * room_m
        return math.sqrt(2.0 * _BRAKE_MPS2 * (room_m - linear_m / 2.0))


def _to_circle(here: Plane, center: Plane, radius_m: float, *, inside: bool) -> tuple[Plane, float]:
    north_m, east_m = here[0] - center[0], here[1] - center[1]
    away_m = math.hypot(north_m, east_m)
    outward = (north_m / away_m, east_m / away_m) if away_m > 1e-6 else (1.0, 0.0)
    if inside:
        return outward, radius_m - away_m
    return (-outward[0], -outward[1]), away_m - radius_m


def _to_edge(here: Plane, area: Area) -> tuple[Plane, float]:
    """To the nearest edge of a polygon."""
    best: tuple[Plane, float] = (1.0, 0.0), math.inf
    north_1, east_1 = area.vertices_m[-1]
    for north_2, east_2 in area.vertices_m:
        along_n, along_e = north_2 - north_1, east_2 - east_1
        length2 = along_n**2 + along_e**2
        part = ((here[0] - north_1) * along_n + (here[1] - east_1) * along_e) / length2 if length2 else 0.0
        part = min(max(part, 0.0), 1.0)
        to_n, to_e = north_1 + part * along_n - here[0], east_1 + part * along_e - here[1]
        away_m = math.hypot(to_n, to_e)
        if 1e-6 < away_m < best[1]:
            best = (to_n / away_m, to_e / away_m), away_m
        north_1, east_1 = north_2, east_2
    return best
