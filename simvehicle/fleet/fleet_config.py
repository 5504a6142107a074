"""The file that `simvehicle run` takes: the world, and the vehicles with their links and instruments."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from flightstack.config import Section
from mission.geometry.frames import Geodetic
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.faults.fault_table import FaultSpec

FARTHEST_HOME_M = 50_000.0
"""A home farther from the origin than this is a slip of the pen, and too far for one tangent plane."""


class WindConfig(Section, frozen=True, kw_only=True):
    speed_mps: Annotated[float, Meta(ge=0.0, le=30.0)] = 3.0
    from_deg: Annotated[float, Meta(ge=0.0, le=360.0)] = 90.0
    """Where the mean wind comes from, degrees clockwise from north."""
    gust_sd_mps: Annotated[float, Meta(ge=0.0)] = 0.3
    gust_time_s: Annotated[float, Meta(ge=0.1)] = 5.0


class GaussianPlume(Section, frozen=True, kw_only=True, tag="gaussian", tag_field="type"):
    """The physical plume: stack height, reflection at the ground, spread growing downwind from a vent."""

    source_north_m: float
    source_east_m: float
    source_above_home_m: Annotated[float, Meta(ge=0.0)] = 10.0
    """Effective release height: the vent's height plus the plume's rise."""
    emission_kgps: Annotated[float, Meta(gt=0.0)] = 1.0
    vent_sd_m: Annotated[float, Meta(gt=0.0, le=1000.0)] = 4.0
    """Standard deviation of the plume's cross-section at the vent."""


class LocusGridPlume(Section, frozen=True, kw_only=True, tag="locus-grid", tag_field="type"):
    """The plume of the LoCUS paper's experiments: a 200 m by 40 m grid of values in [0, 1], downwind to the north."""

    source_north_m: float
    source_east_m: float
    perturbed: bool = False
    peak_ppm: Annotated[float, Meta(gt=0.0)] = 1000.0
    """What a value of 1 stands for."""


class FleetConfig(Section, frozen=True, kw_only=True):
    origin: Geodetic
    vehicles: Annotated[tuple[VehicleSpec, ...], Meta(min_length=1)]
    wind: WindConfig = WindConfig()
    plume: GaussianPlume | LocusGridPlume | None = None
    background_co2_ppm: Annotated[float, Meta(ge=0.0)] = 420.0
    speedup: Annotated[float, Meta(gt=0.0, le=100.0)] = 1.0
    seed: int = 0
    ready_after_s: Annotated[float, Meta(ge=0.0)] = 41.0
    """How long the autopilots need from power-up until they let themselves be armed."""
    faults: tuple[FaultSpec, ...] = ()
    clock: str | None = None
    """A file made by the launcher (`flightstack.recording.shared_clock`): the time of this fleet, for agents and
    ground station to follow and to hold back. None: the wall clock times `speedup`."""
    truth: str | None = None
    """A CSV file that gets every vehicle's true state ten times a (simulated) second: columns time_s, drone,
    north_m, east_m, down_m, airborne (0/1), armed (0/1), mode, co2_ppm, battery_fraction. Flushed once a second."""
