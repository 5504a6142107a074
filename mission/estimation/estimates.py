"""What a drone knows of the air, with its uncertainty: an estimated number, the wind, a reading at a waypoint."""

from __future__ import annotations

import msgspec

from mission.geometry.frames import Vector3


class Scalar(msgspec.Struct, frozen=True, array_like=True):
    """One estimated number: its mean, its variance (unit squared) and the age of the newest sample in it."""

    mean: float
    variance: float
    age_s: float


class Wind(msgspec.Struct, frozen=True, array_like=True):
    """Estimated wind: where the air goes (NED), the variance per horizontal axis, the age of the newest sample."""

    wind_ned_mps: Vector3
    variance_m2ps2: float
    age_s: float


class Reading(msgspec.Struct, frozen=True, array_like=True):
    """What one drone measured at one waypoint: filtered excess CO2 over the background."""

    drone: int
    order: int
    """Sequence number of the order in whose waypoint it was taken."""
    position_ned_m: Vector3
    excess_co2_ppm: float
    variance_ppm2: float
