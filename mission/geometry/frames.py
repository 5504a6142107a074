"""Positions on the earth and in the swarm's local frame.

Inside the stack every position is north-east-down in metres from one origin that all members of a swarm
share (`LocalFrame`). Latitude, longitude and altitude above mean sea level appear at the edges only.
"""

from __future__ import annotations

import math
import zlib
from typing import Final, TypeAlias

import msgspec
import pymap3d

Vector3: TypeAlias = tuple[float, float, float]
"""Three numbers in a frame that the name of the variable tells, mostly north, east, down."""

_EARTH: Final = pymap3d.Ellipsoid.from_name("wgs84")
_SEMIMAJOR_M: Final = float(_EARTH.semimajor_axis)
_SEMIMINOR_M: Final = float(_EARTH.semiminor_axis)
_E2: Final = 1.0 - (_SEMIMINOR_M / _SEMIMAJOR_M) ** 2
"""First and second eccentricity, squared."""
_E2_SECOND: Final = (_SEMIMAJOR_M / _SEMIMINOR_M) ** 2 - 1.0


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

    pymap3d's conversions are for arrays: with one point at a time, which is what telemetry brings, most of their
    time is spent around the formulas. Those stand here for plain numbers; a test holds them to pymap3d's.
    """

    def __init__(self, origin: Geodetic) -> None:
        self.origin = origin
        text = f"{origin.latitude_deg:.7f},{origin.longitude_deg:.7f},{origin.amsl_m:.2f}"
        self.identity = zlib.crc32(text.encode())
        """A number equal for equal origins: peers compare it, so that two frames are never mixed."""
        latitude_rad, longitude_rad = math.radians(origin.latitude_deg), math.radians(origin.longitude_deg)
        self._rotation = (
            math.sin(latitude_rad),
            math.cos(latitude_rad),
            math.sin(longitude_rad),
            math.cos(longitude_rad),
        )
        self._origin_ecef_m = _ecef_m(origin)

    def to_ned(self, point: Geodetic) -> Vector3:
        """Position of `point` in this frame, metres north, east, down."""
        x_m, y_m, z_m = _ecef_m(point)
        x0_m, y0_m, z0_m = self._origin_ecef_m
        x_m, y_m, z_m = x_m - x0_m, y_m - y0_m, z_m - z0_m
        sin_lat, cos_lat, sin_lon, cos_lon = self._rotation
        outward_m = cos_lon * x_m + sin_lon * y_m
        return (
            cos_lat * z_m - sin_lat * outward_m,
            cos_lon * y_m - sin_lon * x_m,
            -cos_lat * outward_m - sin_lat * z_m,
        )

    def to_geodetic(self, position_ned_m: Vector3) -> Geodetic:
        """The inverse of `to_ned`.

        In closed form, to a micrometre wherever an aircraft flies (B. R. Bowring, "Transformation from spatial to
        geographical coordinates", Survey Review 23(181), 1976; the height: "The accuracy of geodetic latitude and
        height equations", Survey Review 28(218), 1985, eq. 7).
        """
        north_m, east_m, down_m = position_ned_m
        sin_lat, cos_lat, sin_lon, cos_lon = self._rotation
        x_m, y_m, z_m = self._origin_ecef_m
        outward_m = -sin_lat * north_m - cos_lat * down_m
        x_m += cos_lon * outward_m - sin_lon * east_m
        y_m += sin_lon * outward_m + cos_lon * east_m
        z_m += cos_lat * north_m - sin_lat * down_m
        from_axis_m = math.hypot(x_m, y_m)
        reduced_rad = math.atan2(_SEMIMAJOR_M * z_m, _SEMIMINOR_M * from_axis_m)
        latitude_rad = math.atan2(
            z_m + _E2_SECOND * _SEMIMINOR_M * math.sin(reduced_rad) ** 3,
            from_axis_m - _E2 * _SEMIMAJOR_M * math.cos(reduced_rad) ** 3,
        )
        sine, cosine = math.sin(latitude_rad), math.cos(latitude_rad)
        return Geodetic(
            math.degrees(latitude_rad),
            math.degrees(math.atan2(y_m, x_m)),
            from_axis_m * cosine + z_m * sine - _SEMIMAJOR_M * math.sqrt(1.0 - _E2 * sine * sine),
        )


def _ecef_m(point: Geodetic) -> Vector3:
    """Earth-centred, earth-fixed coordinates of a point."""
    latitude_rad, longitude_rad = math.radians(point.latitude_deg), math.radians(point.longitude_deg)
    sine, cosine = math.sin(latitude_rad), math.cos(latitude_rad)
    prime_vertical_m = _SEMIMAJOR_M / math.sqrt(1.0 - _E2 * sine * sine)
    from_axis_m = (prime_vertical_m + point.amsl_m) * cosine
    return (
        from_axis_m * math.cos(longitude_rad),
        from_axis_m * math.sin(longitude_rad),
        (prime_vertical_m * (1.0 - _E2) + point.amsl_m) * sine,
    )


def wind_from(speed_mps: float, from_deg: float) -> Vector3:
    """The air's velocity (NED, m/s) for a wind of `speed_mps` that comes *from* `from_deg`, as forecasts say it."""
    towards_rad = math.radians(from_deg + 180.0)
    return speed_mps * math.cos(towards_rad), speed_mps * math.sin(towards_rad), 0.0
