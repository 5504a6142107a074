"""All drones of a simulation on one clock: the core that every shell (process, scenario, real autopilots) wraps.

Sans-IO and deterministic: `step(now_s, bytes in) -> bytes out`. Everything happens on one grid of 50 Hz that begins
with the first step, whatever the steps are: the vehicles fly, faults strike when they are due after the first
take-off, and every other tick the instruments measure the world's air where their vehicle really is.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.drone.flown_vehicle import FlownVehicle
from simvehicle.drone.instrument_lines import InstrumentLines, felt_wind_mps
from simvehicle.faults.fault_table import FaultSpec, Unheard
from simvehicle.faults.schedule import FaultSchedule
from simvehicle.world.air import World

TICK_S = 0.02
_MEASURE_TICKS = 2
"""Ticks between two measurements: what an instrument is asked it answers within 0.04 s."""


class DroneBytes(NamedTuple):
    """What goes over the wires of one drone in one direction."""

    links: tuple[tuple[int, bytes], ...] = ()
    """(index of a MAVLink link, bytes); outwards each is one whole frame."""
    instruments: tuple[tuple[str, bytes], ...] = ()
    """(name of an instrument, bytes)"""


NOTHING = DroneBytes()


class Drone:
    """A vehicle and its instruments, and what faults can do to them."""

    def __init__(self, spec: VehicleSpec, vehicle: FlownVehicle, seed: int) -> None:
        """`SensorError` for an instrument that cannot be emulated."""
        self.spec = spec
        self.vehicle = vehicle
        self.lines = InstrumentLines(spec.instruments, spec.id, seed)

    def set_plugged(self, instrument: str, plugged: bool) -> None:
        self.lines.set_plugged(instrument, plugged)

    def set_stuck(self, instrument: str, stuck: bool) -> None:
        self.lines.set_stuck(instrument, stuck)

    def set_lying(self, instrument: str, by_ppm: float) -> None:
        self.lines.set_lying(instrument, by_ppm)

    def set_gps(self, working: bool) -> None:
        self.vehicle.set_gps(working)

    def set_gps_error(self, north_m: float) -> None:
        self.vehicle.set_gps_error(north_m)

    def set_heard(self, what: Unheard, heard: bool) -> None:
        self.vehicle.set_heard(what, heard)

    def set_motors(self, working: bool) -> None:
        self.vehicle.set_motors(working)

    def set_turned_over(self, turned_over: bool) -> None:
        self.vehicle.set_turned_over(turned_over)

    def set_range_finder(self, *, silent: bool, lies_m: float) -> None:
        self.vehicle.set_range_finder(silent=silent, lies_m=lies_m)

    def set_silent(self, silent: bool) -> None:
        self.vehicle.set_silent(silent)

    def weaken_battery(self) -> None:
        self.vehicle.weaken_battery()

    def receive(self, now_s: float, arrived: DroneBytes) -> None:
        for link_index, data in arrived.links:
            self.vehicle.receive(link_index, data)
        for name, data in arrived.instruments:
            self.lines.receive(name, now_s, data)

    def measure(self, now_s: float, world: World) -> None:
        if not len(self.lines):
            return
        vehicle = self.vehicle
        position = vehicle.position_ned_m
        felt = (0.0, 0.0, 0.0)
        if self.lines.feel_wind:
            wind = world.wind.wind_ned_mps(position, now_s)
            felt = felt_wind_mps(wind, vehicle.velocity_ned_mps, vehicle.attitude_rad)
        self.lines.step(now_s, world.air_at(position, now_s, felt))

    def drain(self) -> DroneBytes:
        return DroneBytes(tuple(self.vehicle.drain()), tuple(self.lines.drain().items()))


class SimulatedDrones:
    """`step` powers all drones up when called first and then advances them together, by id."""

    def __init__(self, drones: Iterable[Drone], world: World, faults: Iterable[FaultSpec] = ()) -> None:
        self.world = world
        self.by_id = {drone.spec.id: drone for drone in drones}
        self.first_takeoff_s: float | None = None
        """When the first vehicle left the ground."""
        self._schedule = FaultSchedule(faults)
        self._begin_s: float | None = None
        self._now_s = 0.0
        self._ticks = 0

    def step(self, now_s: float, arrived: Mapping[int, DroneBytes] | None = None) -> dict[int, DroneBytes]:
        """Everything up to `now_s`: what arrived since the last step goes in first, what was said comes out."""
        for drone_id, data in (arrived or {}).items():
            self.by_id[drone_id].receive(self._now_s, data)
        if self._begin_s is None:
            self._begin_s = now_s
            self._advance(now_s)
        last = int((now_s - self._begin_s) / TICK_S + 1e-6)
        while self._ticks < last:
            self._ticks += 1
            self._advance(self._begin_s + self._ticks * TICK_S)
        return {drone_id: drone.drain() for drone_id, drone in self.by_id.items()}

    def _advance(self, now_s: float) -> None:
        self._now_s = now_s
        for drone in self.by_id.values():
            drone.vehicle.step(now_s)
        if self.first_takeoff_s is None and any(drone.vehicle.airborne for drone in self.by_id.values()):
            self.first_takeoff_s = now_s
        if self.first_takeoff_s is not None:
            self._schedule.strike(now_s - self.first_takeoff_s, self.by_id)
        if self._ticks % _MEASURE_TICKS == 0:
            for drone in self.by_id.values():
                drone.measure(now_s, self.world)
