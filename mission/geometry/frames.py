"""Positions on the earth and in the swarm's local frame.

Inside the stack every position is north-east-down in metres from one origin that all members of a swarm
share (`LocalFrame`). Latitude, longitude and altitude above mean sea level appear at the edges only.
"""

from __future__ import annotations

import math
import zlib
from typing import TypeAlias

import msgspec
import pymap3d

Vector3: TypeAlias = tuple[float, float, float]
"""Three numbers in a frame that the name of the variable tells, mostly north, east, down."""


class Geodetic(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A point on the WGS-84 ellipsoid; `amsl_m` is the altitude above mean sea level as GPS receivers give it."""

    latitude_deg: float
    longitude_deg: float
    amsl_m: float = 0.0

    def __post_init__(self) -> None:
        if not -90.0 <= self.latitude_deg <= 90.0:
            raise ValueError(f"latitude {self.latitude_deg} is not within -90 to 90 degrees")
        if not -180.0 <= self.longitude_deg <= 180.0:
            raise ValueError(f"longitude {self.longitude_deg} is not within -180 to 180 degrees")
        if not math.isfinite(self.amsl_m):
            raise ValueError("altitude is not a finite number")


class LocalFrame:
    """A north-east-down frame in metres, tangent to the earth at `origin`.

    Down is the tangent plane's down: over the few kilometres of a survey it departs from the change in
    altitude by d^2/2R (8 cm at 1 km), which `to_ned` and `to_geodetic` account for.
    """

    def __init__(self, origin: Geodetic) -> None:
        self.origin = origin
        text = f"{origin.latitude_deg:.7f},{origin.longitude_deg:.7f},{origin.amsl_m:.2f}"
        self.identity = zlib.crc32(text.encode())
        """A number equal for equal origins: peers compare it, so that two frames are never mixed."""

    def to_ned(self, point: Geodetic) -> Vector3:
        """Position of `point` in this frame, metres north, east, down."""
        o = self.origin
        north_m, east_m, down_m = pymap3d.geodetic2ned(
            point.latitude_deg, point.longitude_deg, point.amsl_m, o.latitude_deg, o.longitude_deg, o.amsl_m
        )
        return float(north_m), float(east_m), float(down_m)

    def to_geodetic(self, position_ned_m: Vector3) -> Geodetic:
        """The inverse of `to_ned`."""
        o = self.origin
        latitude_deg, longitude_deg, amsl_m = pymap3d.ned2geodetic(
            *position_ned_m, o.latitude_deg, o.longitude_deg, o.amsl_m
        )
        return Geodetic(float(latitude_deg), float(longitude_deg), float(amsl_m))


def wind_from(speed_mps: float, from_deg: float) -> Vector3:
    """The air's velocity (NED, m/s) for a wind of `speed_mps` that comes *from* `from_deg`, as forecasts say it."""
    towards_rad = math.radians(from_deg + 180.0)
    return speed_mps * math.cos(towards_rad), speed_mps * math.sin(towards_rad), 0.0
