"""What a world is made of: fields, each a pure function of position and time.

Every field answers for many positions at a time: a float64 array of shape (n, 3), metres north, east, down in the
world's frame, at `time_s` seconds of simulated time. Wind and gas answer for a single point too, as plain numbers:
instruments and vehicles ask so thousands of times a second, and arrays would cost them ten times as much. Both forms
are one formula. No finite position has NaN for an answer; clearances and ranges are infinite where nothing stands.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from mission.geometry.formation import FloatArray
from mission.geometry.frames import Vector3


class WindField(Protocol):
    """Where the air goes."""

    @property
    def mean_ned_mps(self) -> Vector3:
        """The mean over time, which carries steady plumes."""
        ...

    def wind_ned_mps(self, position_ned_m: Vector3, time_s: float) -> Vector3:
        """Velocity of the air at a point, metres per second north, east, down (where the air goes)."""
        ...

    def winds_ned_mps(self, positions_ned_m: FloatArray, time_s: float) -> FloatArray:
        """(n, 3) velocities at (n, 3) positions."""
        ...


class GasField(Protocol):
    """CO2 over the background."""

    @property
    def source_ned_m(self) -> Vector3:
        """The point of the largest concentration at the height of release: what a swarm looks for. NaN without a
        source."""
        ...

    def excess_co2_ppm(self, position_ned_m: Vector3, time_s: float) -> float:
        """CO2 over the background at a point, parts per million by volume; never below 0."""
        ...

    def excesses_co2_ppm(self, positions_ned_m: FloatArray, time_s: float) -> FloatArray:
        """(n,) excesses at (n, 3) positions."""
        ...


class ObstacleField(Protocol):
    """What stands in the world."""

    def clearances_m(self, positions_ned_m: FloatArray) -> FloatArray:
        """(n,) distances from (n, 3) positions to the nearest obstacle: negative inside one, infinite without any."""
        ...

    def ranges_m(self, positions_ned_m: FloatArray, bearings_rad: FloatArray) -> FloatArray:
        """(n,) horizontal distances from (n, 3) positions along (n,) bearings, clockwise from north, to the first
        obstacle; infinite where none is met."""
        ...


class RiskField(Protocol):
    """How dangerous it is to fly somewhere."""

    def risks(self, positions_ned_m: FloatArray, time_s: float) -> FloatArray:
        """(n,) risks in [0, 1] at (n, 3) positions: 0 is none, 1 where no vehicle should go."""
        ...


class OpenGround:
    """No obstacles, and no risk from them."""

    def clearances_m(self, positions_ned_m: FloatArray) -> FloatArray:
        return np.full(len(positions_ned_m), np.inf)

    def ranges_m(self, positions_ned_m: FloatArray, bearings_rad: FloatArray) -> FloatArray:  # noqa: ARG002
        return np.full(len(positions_ned_m), np.inf)

    def risks(self, positions_ned_m: FloatArray, time_s: float) -> FloatArray:  # noqa: ARG002
        return np.zeros(len(positions_ned_m))


OPEN_GROUND = OpenGround()
"""What a world has where its configuration says nothing of obstacles and risk."""
