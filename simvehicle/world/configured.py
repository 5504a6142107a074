"""From a configuration to the world that vehicles fly in."""

from __future__ import annotations

from mission.geometry.frames import LocalFrame
from simvehicle.world.air import World
from simvehicle.world.gas import make_gas
from simvehicle.world.wind import GustyWind
from simvehicle.world.world_config import WorldConfig


def make_world(config: WorldConfig) -> World:
    """The frame and fields of a configuration; equal ones (with their seed) give equal worlds."""
    wind = GustyWind(config.wind, config.seed)
    # The plume's wind is the same wind, asked at the plume's own pace.
    gas = make_gas(config.plume, GustyWind(config.wind, config.seed), config.origin.amsl_m, config.seed)
    return World(LocalFrame(config.origin), wind, gas, config.background_co2_ppm)
