"""Real ArduCopters in the place of the simulated vehicles: python ardupilot_sitl_fleet.py --config fleet.yaml

It reads the same file as `simvehicle run`, starts one ArduCopter (its own physics) for each vehicle, and gives the
vehicles what they cannot bring themselves: the instruments, fed from our world at the positions that they report,
and the record of where they were. ARDUCOPTER_SITL names the program, ARDUCOPTER_DEFAULTS its parameter file.
"""

from __future__ import annotations

import contextlib
import os
import pathlib
import shutil
import signal
import socket
import sys
import tempfile
import time
from collections.abc import Iterator
from typing import Any, TextIO

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.autopilot.modes import Flavour, mode_name
from flightstack.autopilot.session import EVENTS, STATES
from flightstack.mavlink.framing import FrameReader
from flightstack.mavlink.link import ByteLink, open_link
from flightstack.mavlink.message_rates import StreamRequests
from flightstack.mavlink.telemetry import Telemetry
from flightstack.recording.shared_clock import Cells
from mission.documents.yaml_file import parse
from mission.geometry.frames import Vector3
from simvehicle.fleet.fleet_clock import FleetClock
from simvehicle.fleet.fleet_config import FleetConfig, VehicleSpec
from simvehicle.fleet.truth import COLUMNS
from simvehicle.instruments import make_emulator
from simvehicle.survey.ports import free_port
from simvehicle.survey.processes import Processes
from simvehicle.vehicle.dynamics import in_body
from simvehicle.world.air import World
from simvehicle.world.configured import make_world

HOST = "127.0.0.1"
PERIOD_S = 0.1
"""Simulated seconds between measurements, and entries of the record."""
STEP_S = 0.02
"""Simulated seconds between looks at the vehicles and steps of the time."""
GRACE_S = 2.0
"""ArduCopter may ignore SIGTERM; the launcher gives us 5 s for all."""
BATTERY_MAH = 20_000.0
"""Three quarters of an hour of hovering. The stock 3300 mAh are three quarters used after five minutes, and the
agents come home with the last quarter."""
MONITOR = 250
"""Our MAVLink system id on the third serial port of every vehicle."""


class Monitor:
    """Watches one vehicle over a MAVLink port of its own, as the agent does, but asks it for nothing else."""

    def __init__(self, spec: VehicleSpec, world: World) -> None:
        self.vehicle = Telemetry(spec.id, world.frame, Flavour.ARDUPILOT)
        self.link: ByteLink = open_link(f"udpin:{HOST}:{free_port(socket.SOCK_DGRAM)}")
        self._reader = FrameReader(spec.id, STATES, EVENTS)
        self._streams = StreamRequests()
        self._boot_s: float | None = None
        self._encoder = mavlink.MAVLink(
            None, srcSystem=MONITOR, srcComponent=mavlink.MAV_COMP_ID_MISSIONPLANNER
        )

    def step(self, now_s: float) -> None:
        for message in self._reader.read(now_s, self.link.read()):
            if self.vehicle.accept(now_s, message):
                self._streams.received(now_s, message.get_msgId())
                if message.get_type() == "COMMAND_ACK" and message.target_system == MONITOR:
                    self._streams.acknowledge(now_s, message.command, message.result)
        self.vehicle.clear_news()
        if self._boot_s is None and self.vehicle.boot_ms is not None:
            self._boot_s = now_s - self.vehicle.boot_ms * 1e-3
        for message in self._streams.step(now_s, self.vehicle):
            self._send(message)

    @property
    def time_s(self) -> float:
        """How far the vehicle's own time has come, from the first look at it on; 0 before that."""
        boot_ms = self.vehicle.boot_ms
        return 0.0 if self._boot_s is None or boot_ms is None else self._boot_s + boot_ms * 1e-3

    def _send(self, message: Any) -> None:
        self.link.write(message.pack(self._encoder))
        self._encoder.seq = (self._encoder.seq + 1) % 256


class Member:
    """One vehicle: its monitor and its instruments."""

    def __init__(self, spec: VehicleSpec, fleet: FleetConfig, world: World) -> None:
        self.spec = spec
        self.monitor = Monitor(spec, world)
        self._world = world
        self._home: Vector3 = (spec.home_north_m, spec.home_east_m, 0.0)
        self._instruments = [
            (
                make_emulator(item.type, np.random.default_rng([fleet.seed, spec.id, index])),
                open_link(f"tcpin:{item.port}"),
            )
            for index, item in enumerate(spec.instruments)
        ]

    @property
    def position_ned_m(self) -> Vector3:
        return self.monitor.vehicle.position_ned_m() or self._home

    def measure(self, now_s: float) -> None:
        vehicle = self.monitor.vehicle
        wind = self._world.wind.wind_ned_mps(self.position_ned_m, now_s)
        own = vehicle.velocity_ned_mps or (0.0, 0.0, 0.0)
        relative = (wind[0] - own[0], wind[1] - own[1], wind[2] - own[2])
        felt = in_body(relative, vehicle.attitude_rad or (0.0, 0.0, 0.0))
        air = self._world.air_at(self.position_ned_m, now_s, felt)
        for emulator, link in self._instruments:
            emulator.receive(now_s, link.read())
            link.write(emulator.step(now_s, air))

    def row(self, now_s: float) -> str:
        vehicle = self.monitor.vehicle
        mode = "" if vehicle.custom_mode is None else mode_name(Flavour.ARDUPILOT, vehicle.custom_mode)
        position = self.position_ned_m
        numbers = ",".join(f"{value:.3f}" for value in position)
        state = f"{vehicle.is_airborne(now_s):d},{vehicle.armed:d},{mode}"
        battery = 1.0 if vehicle.battery_fraction is None else vehicle.battery_fraction
        co2_ppm = self._world.co2_ppm(position, now_s)
        return f"{now_s:.2f},{self.spec.id},{numbers},{state},{co2_ppm:.2f},{battery:.3f}\n"

    def close(self) -> None:
        self.monitor.link.close()
        for _, link in self._instruments:
            link.close()


def command_line(
    program: str,
    defaults: str,
    spec: VehicleSpec,
    fleet: FleetConfig,
    world: World,
    monitor: str,
    directory: pathlib.Path,
) -> list[str]:
    """How to start the ArduCopter of one vehicle: all its MAVLink ports are UDP clients of 127.0.0.1."""
    own = directory / "own.parm"
    parameters = {
        "SIM_WIND_SPD": fleet.wind.speed_mps,
        "SIM_WIND_DIR": fleet.wind.from_deg,
        "SIM_WIND_T": 1.0,  # the same wind at all heights: stock is 40 % of it 10 m up
        "BATT_CAPACITY": BATTERY_MAH,
        **spec.parameters,
    }
    own.write_text("".join(f"{name} {value:g}\n" for name, value in parameters.items()), encoding="utf-8")
    home = world.frame.to_geodetic((spec.home_north_m, spec.home_east_m, 0.0))
    ports = [link.replace("udpout:", "udpclient:") for link in spec.links] + [
        monitor.replace("udpin:", "udpclient:")
    ]
    serials = [part for number, port in enumerate(ports) for part in (f"--serial{number}", port)]
    return [
        # It keeps its parameters in the directory that it is started in.
        "/bin/sh", "-c", 'cd "$1" && shift && exec "$@"', "sh", str(directory), program,
        "--model", "+",
        "--speedup", f"{fleet.speedup:g}",
        "--home", f"{home.latitude_deg:.7f},{home.longitude_deg:.7f},{home.amsl_m:.2f},0",
        "--defaults", f"{defaults},{own}" if defaults else str(own),
        "--sysid", str(spec.id),
        "--instance", str(spec.id),
        "--rc-in-port", str(free_port(socket.SOCK_DGRAM)),
        *serials,
    ]  # fmt: skip


@contextlib.contextmanager
def running(fleet: FleetConfig, world: World, logs: pathlib.Path) -> Iterator[tuple[list[Member], Processes]]:
    """All vehicles and their processes, up to the end of the block."""
    program = shutil.which(os.environ["ARDUCOPTER_SITL"])
    if program is None:
        raise SystemExit(f"ARDUCOPTER_SITL: {os.environ['ARDUCOPTER_SITL']} is not a program")
    named = os.environ.get("ARDUCOPTER_DEFAULTS", "")
    defaults = ",".join(os.path.abspath(file) for file in named.split(",") if file)
    with contextlib.ExitStack() as open_ends:
        members = []
        processes = open_ends.enter_context(Processes(logs))
        for spec in fleet.vehicles:
            member = Member(spec, fleet, world)
            open_ends.callback(member.close)
            directory = pathlib.Path(
                open_ends.enter_context(tempfile.TemporaryDirectory(prefix="arducopter-"))
            )
            command = command_line(
                os.path.abspath(program),
                defaults,
                spec,
                fleet,
                world,
                member.monitor.link.describe,
                directory,
            )
            processes.start(f"arducopter-{spec.id}", command)
            members.append(member)
        open_ends.callback(processes.stop, GRACE_S)  # before the directories go
        yield members, processes


def fly(fleet: FleetConfig, truth: TextIO) -> None:
    """The vehicles make the time that the others follow: a machine that cannot keep up makes them all slower.

    The other way round nobody waits: an ArduCopter flies on while its agent misses ticks, as a real one does.
    """
    world = make_world(fleet)
    stopped: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _frame: stopped.append(number))
    truth.write(",".join(COLUMNS) + "\n")
    with contextlib.ExitStack() as open_ends:
        own = pathlib.Path(open_ends.enter_context(tempfile.TemporaryDirectory(prefix="clock-"))) / "clock"
        times = Cells.make(own, len(fleet.vehicles))
        open_ends.callback(times.close)
        told = Cells(fleet.clock) if fleet.clock is not None else Cells.make(own.with_name("unheard"), 0)
        open_ends.callback(told.close)
        pace = FleetClock(fleet.speedup, times)
        members, processes = open_ends.enter_context(running(fleet, world, pathlib.Path(truth.name).parent))
        due_s = 0.0
        while not stopped:
            now_s = pace.advance()
            for slot, member in enumerate(members, 1):
                member.monitor.step(now_s)
                times.values[slot] = member.monitor.time_s
            if now_s >= due_s:
                due_s = now_s + PERIOD_S
                for member in members:
                    member.measure(now_s)
                    truth.write(member.row(now_s))
                truth.flush()
            told.values[0] = now_s
            for ended in processes.ended():
                raise SystemExit(str(ended))
            time.sleep(STEP_S / fleet.speedup)


def fleet_command(part: str, config: pathlib.Path) -> list[str]:
    """As `simvehicle.survey.launch.installed`, with this file in the place of the vehicles."""
    from simvehicle.survey.launch import installed

    return (
        [sys.executable, __file__, "--config", str(config)] if part == "vehicles" else installed(part, config)
    )


def main() -> None:
    path = pathlib.Path(sys.argv[sys.argv.index("--config") + 1])
    fleet = parse(path.read_text(encoding="utf-8"), FleetConfig, str(path))
    assert fleet.truth is not None
    with pathlib.Path(fleet.truth).open("w", encoding="utf-8") as truth:
        fly(fleet, truth)


if __name__ == "__main__":
    main()
