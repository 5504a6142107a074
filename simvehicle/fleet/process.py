"""A fleet of simulated vehicles in one process, in real time or a multiple of it: sockets, the truth file, the clock.

The shell around `simvehicle.drone`: everything that touches a socket, a file or a clock is in here.
"""

from __future__ import annotations

import math
import pathlib
import signal
import threading
import time
from types import FrameType

from flightstack.mavlink.signing import Signing, stamp_at
from flightstack.mavlink.signing_store import SigningKeyError, read_key
from flightstack.recording.shared_clock import ClockCells
from flightstack.transport.node_places import NodePlaces
from mission.documents.yaml_file import DocumentError
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.drone.drones import Drone, SimulatedDrones
from simvehicle.drone.simulated_vehicle import SimulatedVehicle
from simvehicle.fleet.fleet_clock import FleetClock
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.fleet.fleet_problems import FleetError, problems
from simvehicle.fleet.truth import TruthWriter
from simvehicle.fleet.wires import Wires
from simvehicle.world.configured import make_world

_PERIOD_S = 0.02
"""Simulated seconds between two looks at the links."""
_SHORTEST_PERIOD_S = 0.004
"""Wall seconds: faster than this other processes get no time on a small machine."""
_DATAGRAM_BYTES = 1200


class Fleet:
    """All vehicles of a configuration behind their sockets. `step` advances them; who calls it keeps the time.

    Opens every link and the truth file at once: `FleetError` where that cannot be, with nothing left open.
    """

    def __init__(self, config: FleetConfig) -> None:
        for problem in problems(config):
            raise problem
        self.config = config
        self.world = make_world(config)
        self.drones = SimulatedDrones(
            [self._drone(spec, f"vehicles[{index}]") for index, spec in enumerate(config.vehicles)],
            self.world,
            config.faults,
        )
        self._wires: dict[int, Wires] = {}
        self._truth: TruthWriter | None = None
        self._places: NodePlaces | None = None
        try:
            for index, drone in enumerate(self.drones.by_id.values()):
                self._wires[drone.spec.id] = Wires(drone, f"vehicles[{index}]")
            if config.truth is not None:
                self._truth = _truth_writer(config.truth)
            self._places = open_places(config)
        except FleetError:
            self.close()
            raise

    def _drone(self, spec: VehicleSpec, field: str) -> Drone:
        config = self.config
        try:
            vehicle = SimulatedVehicle(
                spec,
                self.world,
                seed=config.seed,
                ready_after_s=config.ready_after_s,
                signing=_signing(spec),
            )
        except SigningKeyError as error:
            raise FleetError(f"{field}.signing_key", str(error)) from error
        except ValueError as error:
            raise FleetError(f"{field}.parameters", str(error)) from error
        return Drone(spec, vehicle, config.seed)

    def step(self, now_s: float) -> None:
        """Everything up to `now_s`, simulated seconds since the fleet was powered up."""
        said = self.drones.step(now_s, {drone: wires.read() for drone, wires in self._wires.items()})
        for drone, wires in self._wires.items():
            wires.plug()
            wires.write(said[drone])
        if self._truth is not None:
            self._truth.step(now_s, self.drones)
        if self._places is not None:
            tell_places(self._places, self.drones)

    def close(self) -> None:
        for wires in self._wires.values():
            wires.close()
        if self._truth is not None:
            self._truth.close()
            self._truth = None
        if self._places is not None:
            self._places.close()
            self._places = None


def open_places(config: FleetConfig) -> NodePlaces | None:
    """Where to tell the vehicles' places; `FleetError` where that cannot be."""
    if config.places is None:
        return None
    try:
        places = NodePlaces(config.places)
    except DocumentError as error:
        raise FleetError("places", str(error)) from error
    if len(places) < len(config.vehicles):
        places.close()
        raise FleetError("places", f"{config.places} has room for fewer nodes than there are vehicles")
    return places


def tell_places(places: NodePlaces, drones: SimulatedDrones) -> None:
    """Where the vehicles are now, in their order."""
    for index, drone in enumerate(drones.by_id.values()):
        places.tell(index, drone.vehicle.position_ned_m)


def _signing(spec: VehicleSpec) -> Signing | None:
    """The key that a vehicle was given; how late it is its GPS tells."""
    if spec.signing_key is None:
        return None
    return Signing(read_key(pathlib.Path(spec.signing_key)), stamp_at(time.time()))


def _truth_writer(path: str) -> TruthWriter:
    try:
        return TruthWriter(pathlib.Path(path))
    except OSError as error:
        raise FleetError("truth", f"{path} cannot be written: {error.strerror}") from error


def _shared_clock(config: FleetConfig) -> ClockCells | None:
    try:
        return ClockCells(config.clock) if config.clock is not None else None
    except DocumentError as error:
        raise FleetError("clock", str(error)) from error


def run(fleet: Fleet, stop: threading.Event) -> None:
    """Step the fleet at its configuration's speed-up until `stop` is set, then close it.

    Late steps are made up for at once, but what a process slept through does not pass in the world; with a shared
    clock the other processes wait.
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
