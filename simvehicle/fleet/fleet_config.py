"""The file that `simvehicle run` takes: the world, and the vehicles with their links and instruments."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from flightstack.config import Section
from mission.geometry.frames import Vector3
from simvehicle.world.world_config import WorldConfig

FARTHEST_HOME_M = 50_000.0
"""A home farther from the origin than this is a slip of the pen, and too far for one tangent plane."""


class EmulatedInstrument(Section, frozen=True, kw_only=True):
    name: str
    type: str
    port: str
    """"HOST:PORT" of the TCP socket that the instrument's bytes come out of (agents open socket://HOST:PORT)."""


class VehicleSpec(Section, frozen=True, kw_only=True):
    id: Annotated[int, Meta(ge=1, le=250)]
    flavour: Literal["ardupilot", "px4"] = "ardupilot"
    home_north_m: float = 0.0
    home_east_m: float = 0.0
    links: Annotated[tuple[str, ...], Meta(min_length=1)]
    """Each as pymavlink writes it, seen from the vehicle: "udpout:127.0.0.1:14541", "udpin:…", "tcpin:…"."""
    instruments: tuple[EmulatedInstrument, ...] = ()
    parameters: dict[str, float] = msgspec.field(default_factory=dict)
    """Parameters that differ from the flavour's defaults."""


class FaultSpec(Section, frozen=True, kw_only=True):
    """Something that goes wrong, `at_s` seconds of simulated time after the first take-off."""

    drone: int
    at_s: Annotated[float, Meta(ge=0.0)]
    kind: Literal["unplug", "gps_loss", "battery_low", "motor", "silence"]
    """"unplug" needs `instrument`; "silence" stops the vehicle's MAVLink; "motor" makes it fall."""
    instrument: str = ""
    until_s: float | None = None
    """When it mends itself; None: never."""


class FleetConfig(WorldConfig, frozen=True, kw_only=True):
    vehicles: Annotated[tuple[VehicleSpec, ...], Meta(min_length=1)]
    speedup: Annotated[float, Meta(gt=0.0, le=100.0)] = 1.0
    ready_after_s: Annotated[float, Meta(ge=0.0)] = 41.0
    """How long the autopilots need from power-up until they let themselves be armed."""
    faults: tuple[FaultSpec, ...] = ()
    clock: str | None = None
    """A file made by the launcher (`flightstack.recording.shared_clock`): the time of this fleet, for agents and
    ground station to follow and to hold back. None: the wall clock times `speedup`."""
    truth: str | None = None
    """A CSV file that gets every vehicle's true state ten times a (simulated) second: columns time_s, drone,
    north_m, east_m, down_m, airborne (0/1), armed (0/1), mode, co2_ppm, battery_fraction. Flushed once a second."""


def position_ned_m(vehicle: VehicleSpec) -> Vector3:
    return vehicle.home_north_m, vehicle.home_east_m, 0.0
