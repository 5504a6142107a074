"""Real ArduCopters in the place of the simulated vehicles: python -m simvehicle.hil.sitl_fleet --config fleet.yaml

It reads the same file as `simvehicle run`, starts one ArduCopter (its own physics) for each vehicle, and gives the
vehicles what they cannot bring themselves: the instruments, fed from our world at the positions that they report,
the faults that reach them, and the record of where they were. ARDUCOPTER_SITL names the program,
ARDUCOPTER_DEFAULTS its parameter files.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import pathlib
import shutil
import signal
import socket
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping

import msgspec

from flightstack.recording.shared_clock import ClockCells
from mission.documents.yaml_file import DocumentError, parse, read_text
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.drone.drones import Drone, SimulatedDrones
from simvehicle.fleet.fleet_clock import FleetClock
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.fleet.fleet_problems import FleetError, problems
from simvehicle.fleet.process import open_places, tell_places
from simvehicle.fleet.truth import TruthWriter
from simvehicle.fleet.wires import Wires
from simvehicle.hil.arducopter_command import command_line, parameter_text
from simvehicle.hil.reported_vehicle import REACHABLE, ReportedVehicle
from simvehicle.survey.ports import LOOPBACK, free_port
from simvehicle.survey.processes import Processes
from simvehicle.world.air import World
from simvehicle.world.configured import make_world

PROGRAM, DEFAULTS = "ARDUCOPTER_SITL", "ARDUCOPTER_DEFAULTS"
"""Names in the environment."""
STEP_S = 0.02
"""Simulated seconds between looks at the vehicles and steps of the time."""
GRACE_S = 2.0
"""ArduCopter may ignore SIGTERM; the launcher gives us 5 s for all."""


class ArducopterProgram(msgspec.Struct, frozen=True):
    path: str
    parameter_files: tuple[str, ...]

    @staticmethod
    def named(environment: Mapping[str, str]) -> ArducopterProgram:
        """What the environment names; `DocumentError` where that is no program."""
        name = environment.get(PROGRAM, "")
        found = shutil.which(name)
        if found is None:
            raise DocumentError(
                PROGRAM, f"names no program ({name!r}); set it to an arducopter built for SITL"
            )
        files = environment.get(DEFAULTS, "").split(",")
        return ArducopterProgram(
            os.path.abspath(found), tuple(os.path.abspath(file) for file in files if file)
        )


def check(fleet: FleetConfig) -> None:
    """`FleetError` for a fleet that real ArduCopters cannot fly."""
    for problem in problems(fleet):
        raise problem
    for index, spec in enumerate(fleet.vehicles):
        if spec.flavour != "ardupilot":
            raise FleetError(f"vehicles[{index}].flavour", f"an ArduCopter is no {spec.flavour}")
        if spec.signing_key is not None:
            kept = "a real autopilot is given its key by gcs signing setup, and keeps it itself"
            raise FleetError(f"vehicles[{index}].signing_key", kept)
    for index, fault in enumerate(fleet.faults):
        if fault.kind not in REACHABLE:
            raise FleetError(
                f"faults[{index}].kind",
                f"{fault.kind!r} does not reach a real autopilot; what does: {', '.join(sorted(REACHABLE))}",
            )


class SitlFleet:
    """The vehicles as they report themselves, with our instruments and faults, behind their sockets."""

    def __init__(self, config: FleetConfig, world: World) -> None:
        self._vehicles = {
            spec.id: ReportedVehicle(spec.id, world.frame, spec.home_ned_m) for spec in config.vehicles
        }
        self.drones = SimulatedDrones(
            [Drone(_watched(spec), self._vehicles[spec.id], config.seed) for spec in config.vehicles],
            world,
            config.faults,
        )
        self._wires: dict[int, Wires] = {}
        try:
            for index, drone in enumerate(self.drones.by_id.values()):
                self._wires[drone.spec.id] = Wires(drone, f"vehicles[{index}]")
        except FleetError:
            self.close()
            raise

    def monitor(self, drone: int) -> str:
        """The link on which we watch a vehicle, as we opened it."""
        return self.drones.by_id[drone].spec.links[0]

    @property
    def times_s(self) -> list[float]:
        """How far every vehicle's own time has come."""
        return [vehicle.time_s for vehicle in self._vehicles.values()]

    def step(self, now_s: float) -> None:
        said = self.drones.step(now_s, {drone: wires.read() for drone, wires in self._wires.items()})
        for drone, wires in self._wires.items():
            wires.plug()
            wires.write(said[drone])

    def close(self) -> None:
        for wires in self._wires.values():
            wires.close()


def _watched(spec: VehicleSpec) -> VehicleSpec:
    """The vehicle's own links go from the program straight to its agent and ground; ours is one more."""
    return msgspec.structs.replace(spec, links=(f"udpin:{LOOPBACK}:{free_port(socket.SOCK_DGRAM)}",))


@contextlib.contextmanager
def running(
    program: ArducopterProgram, config: FleetConfig, fleet: SitlFleet, logs: pathlib.Path
) -> Iterator[Processes]:
    """All ArduCopters, up to the end of the block."""
    with contextlib.ExitStack() as open_ends:
        processes = open_ends.enter_context(Processes(logs))
        for spec in config.vehicles:
            directory = pathlib.Path(
                open_ends.enter_context(tempfile.TemporaryDirectory(prefix="arducopter-"))
            )
            own = directory / "own.parm"
            own.write_text(parameter_text(spec, config.wind), encoding="utf-8")
            command = command_line(
                program.path,
                (*program.parameter_files, str(own)),
                spec,
                speedup=config.speedup,
                home=fleet.drones.world.frame.to_geodetic(spec.home_ned_m),
                monitor=fleet.monitor(spec.id),
                remote_control_port=free_port(socket.SOCK_DGRAM),
                directory=directory,
            )
            processes.start(f"arducopter-{spec.id}", command)
        open_ends.callback(processes.stop, GRACE_S)  # before the directories go
        yield processes


def fly(program: ArducopterProgram, config: FleetConfig, truth: pathlib.Path) -> str:
    """Fly until a signal ends it; what went wrong, for a person, or nothing.

    The vehicles make the time that the others follow: a machine that cannot keep up makes them all slower.
    The other way round nobody waits: an ArduCopter flies on while its agent misses ticks, as a real one does.
    """
    stopped: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _frame: stopped.append(number))
    with contextlib.ExitStack() as open_ends:
        writer = TruthWriter(truth)
        open_ends.callback(writer.close)
        own = pathlib.Path(open_ends.enter_context(tempfile.TemporaryDirectory(prefix="clock-"))) / "clock"
        times = ClockCells.make(own, len(config.vehicles))
        open_ends.callback(times.close)
        told = (
            ClockCells(config.clock)
            if config.clock is not None
            else ClockCells.make(own.with_name("unheard"), 0)
        )
        open_ends.callback(told.close)
        places = open_places(config)
        if places is not None:
            open_ends.callback(places.close)
        clock = FleetClock(config.speedup, times)
        fleet = SitlFleet(config, make_world(config))
        open_ends.callback(fleet.close)
        processes = open_ends.enter_context(running(program, config, fleet, truth.parent))
        while not stopped:
            now_s = clock.advance()
            fleet.step(now_s)
            for slot, time_s in enumerate(fleet.times_s, 1):
                times.values[slot] = time_s
            writer.step(now_s, fleet.drones)
            if places is not None:
                tell_places(places, fleet.drones)
            told.values[0] = now_s
            for ended in processes.ended():
                return str(ended)
            time.sleep(STEP_S / config.speedup)
    return ""


def fleet_command(part: str, config: pathlib.Path) -> list[str]:
    """As `simvehicle.survey.launch.installed`, with this program in the place of the vehicles."""
    from simvehicle.survey.launch import installed

    if part == "vehicles":
        return [sys.executable, "-m", "simvehicle.hil.sitl_fleet", "--config", str(config)]
    return installed(part, config)


def main() -> None:
    parser = argparse.ArgumentParser(description="Fly real ArduCopters in the place of simulated vehicles.")
    parser.add_argument("--config", type=pathlib.Path, required=True, help="the fleet's file")
    path: pathlib.Path = parser.parse_args().config
    try:
        program = ArducopterProgram.named(os.environ)
        config = parse(read_text(path), FleetConfig, str(path))
        check(config)
        if config.truth is None:
            raise FleetError("truth", "must name the file for the record of the flight")
        problem = fly(program, config, pathlib.Path(config.truth))
    except (DocumentError, FleetError) as error:
        problem = str(error)
    if problem:
        raise SystemExit(problem)


if __name__ == "__main__":
    main()
