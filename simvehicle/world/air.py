"""The world as the simulation knows it: where the air goes, what is in it, and what stands in it."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

from mission.geometry.frames import LocalFrame, Vector3
from simvehicle.world.atmosphere import air_pressure_pa, air_temperature_c
from simvehicle.world.fields import OPEN_GROUND, GasField, ObstacleField, RiskField, WindField


class Air(NamedTuple):
    """The air at an instrument's inlet, and at an anemometer's mast."""

    co2_ppm: float = 420.0
    wind_body_mps: Vector3 = (0.0, 0.0, 0.0)
    """Where the air goes relative to the airframe: forward, right, down; the vehicle's motion is in it."""
    temperature_c: float = 12.0
    pressure_pa: float = 83_000.0


@dataclasses.dataclass(frozen=True)
class World:
    """The fields in which everything flies, in one frame."""

    frame: LocalFrame
    wind: WindField
    gas: GasField
    background_co2_ppm: float = 420.0
    obstacles: ObstacleField = OPEN_GROUND
    risk: RiskField = OPEN_GROUND

    def co2_ppm(self, position_ned_m: Vector3, time_s: float) -> float:
        return self.background_co2_ppm + self.gas.excess_co2_ppm(position_ned_m, time_s)

    def air_at(self, position_ned_m: Vector3, time_s: float, wind_body_mps: Vector3) -> Air:
        """The air that the instruments of a vehicle at this point are in: background and gas, standard
        atmosphere by altitude. `wind_body_mps`: the wind as the moving, tilted airframe feels it, which is the
        vehicle's to know."""
        amsl_m = self.frame.origin.amsl_m - position_ned_m[2]
        return Air(
            co2_ppm=self.co2_ppm(position_ned_m, time_s),
            wind_body_mps=wind_body_mps,
            temperature_c=air_temperature_c(amsl_m),
            pressure_pa=air_pressure_pa(amsl_m),
        )
