"""The file that `simvehicle run` takes: the world, and the vehicles with their links and instruments."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.faults.fault_table import FaultSpec
from simvehicle.world.world_config import WorldConfig

FARTHEST_HOME_M = 50_000.0
"""A home farther from the origin than this is a slip of the pen, and too far for one tangent plane."""


class FleetConfig(WorldConfig, frozen=True, kw_only=True):
    vehicles: Annotated[tuple[VehicleSpec, ...], Meta(min_length=1)]
    speedup: Annotated[float, Meta(gt=0.0, le=100.0)] = 1.0
    ready_after_s: Annotated[float, Meta(ge=0.0)] = 41.0
    """How long the autopilots need from power-up until they let themselves be armed."""
    faults: tuple[FaultSpec, ...] = ()
    clock: str | None = None
    """A file made by the launcher (`flightstack.recording.shared_clock`): the time of this fleet, for agents and
    ground station to follow and to hold back. None: the wall clock times `speedup`."""
    places: str | None = None
    """A file made by the launcher (`flightstack.transport.node_places`) that is told where the vehicles are, in their
    order, for the nodes' simulated radio. None: nobody needs to know."""
    truth: str | None = None
    """A CSV file that gets every vehicle's true state ten times a (simulated) second: columns time_s, drone,
    north_m, east_m, down_m, airborne (0/1), armed (0/1), mode, co2_ppm, battery_fraction. Flushed once a second."""
