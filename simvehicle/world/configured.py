"""From a fleet's configuration to the world that its vehicles fly in."""

from __future__ import annotations

from mission.geometry.frames import LocalFrame
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.world.air import World
from simvehicle.world.gas import make_plume
from simvehicle.world.wind import GustyWind


def make_world(fleet: FleetConfig) -> World:
    """The frame, wind and plume of a fleet; equal configurations (with their seed) give equal worlds."""
    wind = GustyWind(fleet.wind, fleet.seed)
    plume = make_plume(fleet.plume, wind.mean_ned_mps, fleet.origin.amsl_m)
    return World(LocalFrame(fleet.origin), wind, plume, fleet.background_co2_ppm)
