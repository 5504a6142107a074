"""The world as the simulation knows it: where the air goes and what is in it."""

from __future__ import annotations

import dataclasses
from typing import Protocol

from mission.geometry.frames import LocalFrame, Vector3


class WindField(Protocol):
    def wind_ned_mps(self, position_ned_m: Vector3, time_s: float) -> Vector3:
        """Velocity of the air at a point, metres per second north, east, down (where the air goes)."""
        ...


class Plume(Protocol):
    def excess_co2_ppm(self, position_ned_m: Vector3, time_s: float) -> float:
        """CO2 over the background at a point, parts per million by volume."""
        ...

    @property
    def source_ned_m(self) -> Vector3:
        """The point of the largest concentration at the survey's altitude: what the swarm looks for."""
        ...


@dataclasses.dataclass(frozen=True)
class World:
    frame: LocalFrame
    wind: WindField
    plume: Plume
    background_co2_ppm: float = 420.0

    def co2_ppm(self, position_ned_m: Vector3, time_s: float) -> float:
        return self.background_co2_ppm + self.plume.excess_co2_ppm(position_ned_m, time_s)
