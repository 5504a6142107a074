"""A fleet of simulated vehicles in one process, in real time or a multiple of it: sockets, faults, the truth file.

The shell around `simvehicle.vehicle`: everything that touches a socket, a file or a clock is in here.
"""

from __future__ import annotations

import math
import pathlib
import signal
import threading
import time
from collections.abc import Callable, Iterator
from types import FrameType
from typing import IO

import numpy as np

from flightstack.mavlink.link import ByteLink, LinkError, open_link
from flightstack.recording.shared_clock import Cells
from mission.documents.yaml_file import DocumentError
from sensors.instruments.sensor_error import SensorError
from simvehicle.fleet.fleet_clock import FleetClock
from simvehicle.fleet.fleet_config import (
    FARTHEST_HOME_M,
    EmulatedInstrument,
    FaultSpec,
    FleetConfig,
    VehicleSpec,
)
from simvehicle.fleet.truth import COLUMNS
from simvehicle.instruments import Emulator, make_emulator
from simvehicle.vehicle.simulated_vehicle import SimulatedVehicle
from simvehicle.world.air import Air, World
from simvehicle.world.configured import make_world

_PERIOD_S = 0.02
"""Simulated seconds between two looks at the links."""
_SHORTEST_PERIOD_S = 0.004
"""Wall seconds: faster than this other processes get no time on a small machine."""
_INSTRUMENT_PERIOD_S = 0.05
_TRUTH_PERIOD_S = 0.1
_DATAGRAM_BYTES = 1200


class FleetError(ValueError):
    """A fleet that cannot be run as configured: which field, and what is wrong with it."""

    def __init__(self, field: str, problem: str) -> None:
        super().__init__(f"{field}: {problem}")
        self.field = field
        self.problem = problem


def problems(config: FleetConfig) -> Iterator[FleetError]:
    """What cannot be flown although every value is of its type."""
    ids = [vehicle.id for vehicle in config.vehicles]
    for index, vehicle in enumerate(config.vehicles):
        if vehicle.id in ids[:index]:
            yield FleetError(f"vehicles[{index}].id", f"two vehicles have the id {vehicle.id}")
        for field in ("home_north_m", "home_east_m"):
            if not abs(getattr(vehicle, field)) <= FARTHEST_HOME_M:
                yield FleetError(
                    f"vehicles[{index}].{field}",
                    f"is more than {FARTHEST_HOME_M / 1000:g} km from the origin",
                )
        carried = [instrument.name for instrument in vehicle.instruments]
        for place, name in enumerate(carried):
            if name in carried[:place]:
                yield FleetError(
                    f"vehicles[{index}].instruments[{place}].name", f"two instruments are called {name}"
                )
    for index, fault in enumerate(config.faults):
        where = f"faults[{index}]"
        target = next((vehicle for vehicle in config.vehicles if vehicle.id == fault.drone), None)
        if target is None:
            yield FleetError(f"{where}.drone", f"no vehicle has the id {fault.drone}; there are {ids}")
        elif fault.kind == "unplug":
            names = [instrument.name for instrument in target.instruments]
            if fault.instrument not in names:
                have = ", ".join(names) or "none"
                yield FleetError(
                    f"{where}.instrument", f"vehicle {fault.drone} has no {fault.instrument!r}; it has {have}"
                )
        if fault.until_s is not None and fault.until_s <= fault.at_s:
            yield FleetError(f"{where}.until_s", f"is not after at_s ({fault.at_s:g})")


class _Plugged:
    """An emulated instrument and the TCP port that stands for its serial line."""

    def __init__(self, spec: EmulatedInstrument, rng: np.random.Generator, field: str) -> None:
        self.spec = spec
        self._field = field
        try:
            self._emulator: Emulator = make_emulator(spec.type, rng)
        except SensorError as error:
            raise FleetError(f"{field}.type", str(error)) from error
        self._link: ByteLink | None = None
        self.plug()

    def plug(self) -> None:
        if self._link is None:
            self._link = _opened(f"tcpin:{self.spec.port}", f"{self._field}.port")

    def unplug(self) -> None:
        if self._link is not None:
            self._link.close()
            self._link = None

    def step(self, now_s: float, air: Air) -> None:
        """The instrument goes on measuring whether anybody listens or not."""
        heard = b"" if self._link is None else self._link.read()
        if heard:
            self._emulator.receive(now_s, heard)
        said = self._emulator.step(now_s, air)
        if said and self._link is not None:
            self._link.write(said)


def _opened(text: str, field: str) -> ByteLink:
    try:
        return open_link(text)
    except LinkError as error:
        raise FleetError(field, str(error)) from error


class _Member:
    """One vehicle with its links and instruments."""

    def __init__(self, spec: VehicleSpec, config: FleetConfig, world: World, field: str) -> None:
        try:
            self.vehicle = SimulatedVehicle(spec, config, world, config.seed)
        except ValueError as error:
            raise FleetError(f"{field}.parameters", str(error)) from error
        self.links: list[ByteLink] = []
        self.instruments: dict[str, _Plugged] = {}
        try:
            for index, text in enumerate(spec.links):
                self.links.append(_opened(text, f"{field}.links[{index}]"))
            for index, instrument in enumerate(spec.instruments):
                rng = np.random.default_rng([config.seed & 0xFFFFFFFF, spec.id, 0x1457, index])
                place = f"{field}.instruments[{index}]"
                self.instruments[instrument.name] = _Plugged(instrument, rng, place)
        except FleetError:
            self.close()
            raise

    def step(self, now_s: float) -> None:
        vehicle = self.vehicle
        for index, link in enumerate(self.links):
            data = link.read()
            if data:
                vehicle.receive(index, data)
        vehicle.step(now_s)
        waiting: dict[int, bytearray] = {}
        for index, frame in vehicle.drain():
            buffer = waiting.setdefault(index, bytearray())
            if len(buffer) + len(frame) > _DATAGRAM_BYTES:  # whole frames: a lost datagram damages no other
                self.links[index].write(bytes(buffer))
                buffer.clear()
            buffer += frame
        for index, buffer in waiting.items():
            self.links[index].write(bytes(buffer))

    def measure(self, now_s: float, world: World) -> None:
        if not self.instruments:
            return
        position = self.vehicle.position_ned_m
        air = world.air_at(position, now_s, self.vehicle.wind_body_mps())
        for instrument in self.instruments.values():
            instrument.step(now_s, air)

    def close(self) -> None:
        for link in self.links:
            link.close()
        for instrument in self.instruments.values():
            instrument.unplug()


class Fleet:
    """All vehicles of a configuration. `step` advances them; who calls it keeps the time.

    Opens every link and the truth file at once: `FleetError` where that cannot be, with nothing left open.
    """

    def __init__(self, config: FleetConfig) -> None:
        for problem in problems(config):
            raise problem
        self.config = config
        self.world = make_world(config)
        self.members: dict[int, _Member] = {}
        self._truth: IO[str] | None = None
        self._instruments_due_s = 0.0
        self._truth_due_s = 0.0
        self._flush_due_s = 1.0
        self.first_takeoff_s: float | None = None
        self._faults = [(fault.at_s, True, fault) for fault in config.faults]
        self._faults += [(f.until_s, False, f) for f in config.faults if f.until_s is not None]
        self._faults.sort(key=lambda entry: entry[0])
        try:
            for index, spec in enumerate(config.vehicles):
                self.members[spec.id] = _Member(spec, config, self.world, f"vehicles[{index}]")
            if config.truth is not None:
                self._truth = _open_truth(config.truth)
        except FleetError:
            self.close()
            raise

    def step(self, now_s: float) -> None:
        """Everything up to `now_s`, simulated seconds since the fleet was powered up."""
        for member in self.members.values():
            member.step(now_s)
        if self.first_takeoff_s is None and any(m.vehicle.airborne for m in self.members.values()):
            self.first_takeoff_s = now_s
        if self._faults and self.first_takeoff_s is not None:
            self._fail(now_s - self.first_takeoff_s)
        if now_s >= self._instruments_due_s:
            self._instruments_due_s = now_s + _INSTRUMENT_PERIOD_S
            for member in self.members.values():
                member.measure(now_s, self.world)
        if self._truth is not None and now_s >= self._truth_due_s:
            self._truth_due_s = max(self._truth_due_s + _TRUTH_PERIOD_S, now_s)
            self._write_truth(self._truth, now_s)

    def _fail(self, since_takeoff_s: float) -> None:
        while self._faults and self._faults[0][0] <= since_takeoff_s:
            _, begins, fault = self._faults.pop(0)
            self._apply(fault, begins=begins)

    def _apply(self, fault: FaultSpec, *, begins: bool) -> None:
        member = self.members[fault.drone]
        vehicle = member.vehicle
        actions: dict[str, Callable[[], None]] = {
            "gps_loss": lambda: vehicle.set_gps(not begins),
            "silence": lambda: vehicle.set_silent(begins),
            "motor": lambda: vehicle.set_motors(not begins),
        }
        if fault.kind == "unplug":
            instrument = member.instruments[fault.instrument]
            instrument.unplug() if begins else instrument.plug()
        elif fault.kind == "battery_low":
            if begins:  # a cell does not mend itself
                vehicle.weaken_battery()
        else:
            actions[fault.kind]()

    def _write_truth(self, file: IO[str], now_s: float) -> None:
        for drone, member in self.members.items():
            v = member.vehicle
            north, east, down = v.position_ned_m
            file.write(
                f"{now_s:.2f},{drone},{north:.3f},{east:.3f},{down:.3f},{v.airborne:d},{v.armed:d},{v.mode},"
                f"{self.world.co2_ppm((north, east, down), now_s):.2f},{v.battery_fraction:.4f}\n"
            )
        if now_s >= self._flush_due_s:
            self._flush_due_s = now_s + 1.0
            file.flush()

    def close(self) -> None:
        for member in self.members.values():
            member.close()
        if self._truth is not None:
            self._truth.close()
            self._truth = None


def _open_truth(path: str) -> IO[str]:
    try:
        file = pathlib.Path(path).open("w", encoding="utf-8")  # noqa: SIM115 - the fleet closes it
    except OSError as error:
        raise FleetError("truth", f"{path} cannot be written: {error.strerror}") from error
    file.write(",".join(COLUMNS) + "\n")
    return file


def _shared_clock(config: FleetConfig) -> Cells | None:
    try:
        return Cells(config.clock) if config.clock is not None else None
    except DocumentError as error:
        raise FleetError("clock", str(error)) from error


def run(fleet: Fleet, stop: threading.Event) -> None:
    """Step the fleet at its configuration's speed-up until `stop` is set, then close it.

    Late steps are made up for at once, unless there is a shared clock: then the other processes wait.
    """
    speedup = fleet.config.speedup
    period_s = max(_PERIOD_S / speedup, _SHORTEST_PERIOD_S)
    due_s = time.monotonic()
    try:
        fleet_clock = FleetClock(speedup, _shared_clock(fleet.config))
        while not stop.is_set():
            fleet.step(fleet_clock.advance())
            fleet_clock.publish()
            due_s += period_s
            left_s = due_s - time.monotonic()
            if left_s > 0.0:
                stop.wait(left_s)
            else:
                due_s -= period_s * math.floor(left_s / period_s)
    finally:
        fleet.close()


def run_until_signalled(fleet: Fleet) -> None:
    """`run` in the main thread until SIGINT or SIGTERM."""
    stop = threading.Event()

    def end(_number: int, _frame: FrameType | None) -> None:
        stop.set()

    before = {number: signal.signal(number, end) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        run(fleet, stop)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
