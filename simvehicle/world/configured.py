"""From a configuration to the world that vehicles fly in."""

from __future__ import annotations

from mission.geometry.frames import LocalFrame
from simvehicle.world.air import World
from simvehicle.world.boundary_layer import BoundaryLayerWind
from simvehicle.world.fields import OPEN_GROUND, WindField
from simvehicle.world.gas import make_gas
from simvehicle.world.obstacles import Obstacles
from simvehicle.world.wind import GustyWind
from simvehicle.world.world_config import AnyWindConfig, BoundaryLayerWindConfig, WindConfig, WorldConfig


def make_world(config: WorldConfig) -> World:
    """The frame and fields of a configuration; equal ones (with their seed) give equal worlds.

    `ValueError` for one that `world_problems.problems` finds something wrong with.
    """
    obstacles = Obstacles(config.obstacles)
    wind = make_wind(config.wind, config.seed, obstacles)
    # Puffs look half their step ahead: the wind still knows what it was now.
    gas = make_gas(config.plume, wind, config.origin.amsl_m, config.seed, obstacles)
    # What is to be compiled for a question is compiled now, and not in flight.
    gas.excess_co2_ppm((0.0, 0.0, 0.0), 0.0)
    standing = obstacles if obstacles.count else OPEN_GROUND
    return World(LocalFrame(config.origin), wind, gas, config.background_co2_ppm, standing)


def make_wind(config: AnyWindConfig, seed: int, obstacles: Obstacles) -> WindField:
    """The wind that a configuration describes, around what stands in it."""
    if isinstance(config, WindConfig):
        return GustyWind(config, seed)
    if isinstance(config, BoundaryLayerWindConfig):
        return BoundaryLayerWind(config, seed)
    # Loaded where it is asked for: who flies in a uniform wind starts without a solver.
    from simvehicle.world.grid_wind import GridWind

    return GridWind(config, seed, obstacles)
