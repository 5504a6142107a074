"""From a survey to running processes: the files that they read, the ports between them, their command lines."""

from __future__ import annotations

import contextlib
import datetime
import pathlib
import socket
import sys
from collections.abc import Callable

import msgspec
import yaml

from flightstack.config import (
    AutopilotConfig,
    DroneConfig,
    FiltersConfig,
    InstrumentConfig,
    SharedClockConfig,
    SwarmConfig,
)
from flightstack.recording.shared_clock import Cells
from mission.documents.yaml_file import DocumentError
from simvehicle.drone.drone_spec import EmulatedInstrument, VehicleSpec
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.survey.ports import LOOPBACK, free_ports
from simvehicle.survey.processes import Processes
from simvehicle.survey.survey_file import Survey, SurveyDrone
from simvehicle.vehicle.dynamics import DRAG_PER_S

AGENT_START_WALL_S = 60.0
"""How long agents may take to start before the ground station wonders about them."""
VEHICLES = "vehicles"
GROUND = "ground"
LAUNCHER = "launcher"
"""Our name among the nodes of the swarm and among the followers of the clock."""
GROUND_STATION = "ground"
"""The ground station's name among the nodes of the swarm."""


class LaunchPlan(msgspec.Struct, frozen=True):
    """Everything that is written before anything is started."""

    directory: pathlib.Path
    swarm: str
    endpoints: tuple[str, ...]
    """zenoh endpoints of the ground station and of every drone; one that joins later connects to them."""
    fleet: FleetConfig
    drones: tuple[DroneConfig, ...]

    @property
    def truth(self) -> pathlib.Path:
        return self.directory / "truth.csv"

    @property
    def clock(self) -> pathlib.Path:
        return self.directory / "clock"

    def slot(self, process: str) -> int | None:
        """The place of a process among the followers of the clock; None for one that does not follow."""
        followers = (GROUND, *(agent_name(drone.drone) for drone in self.drones), LAUNCHER)
        return followers.index(process) + 1 if process in followers else None


def agent_name(drone: int) -> str:
    """Name of a drone's agent among the processes, and of its log."""
    return f"drone-{drone}"


def make_directory(out: pathlib.Path, name: str, now: datetime.datetime) -> pathlib.Path:
    """`out`/NAME-YYYYmmdd-HHMMSS, made anew."""
    stem = f"{name}-{now:%Y%m%d-%H%M%S}"
    try:
        out.mkdir(parents=True, exist_ok=True)
        for suffix in ("", *(f"-{i}" for i in range(2, 100))):
            directory = out / f"{stem}{suffix}"
            with contextlib.suppress(FileExistsError):
                directory.mkdir()
                return directory.resolve()
    except OSError as error:
        raise DocumentError(
            str(out), f"cannot be written: {error.strerror or error}; choose another --out"
        ) from error
    raise DocumentError(str(out), f"{stem} exists a hundred times; choose another --out")


def plan(survey: Survey, directory: pathlib.Path) -> LaunchPlan:
    """Decide names and ports, and write fleet.yaml, drone-N.yaml and ground.yaml into `directory`."""
    config = survey.config
    count = len(survey.drones)
    instruments = sum(len(d.instruments or ()) for d in survey.drones)
    tcp = iter(free_ports(socket.SOCK_STREAM, 1 + count + instruments))
    udp = iter(free_ports(socket.SOCK_DGRAM, 1 + count))
    swarm = config.name
    members = tuple(d.id for d in survey.drones)
    ground_udp, ground_tcp = next(udp), f"tcp/{LOOPBACK}:{next(tcp)}"
    vehicles, drones, endpoints = [], [], [ground_tcp]
    for index, drone in enumerate(survey.drones):
        companion, endpoint = next(udp), f"tcp/{LOOPBACK}:{next(tcp)}"
        ports = [(i, f"{LOOPBACK}:{next(tcp)}") for i in drone.instruments or ()]
        vehicles.append(
            VehicleSpec(
                id=drone.id,
                flavour=drone.flavour,
                home_north_m=drone.home_north_m,
                home_east_m=drone.home_east_m,
                links=(f"udpout:{LOOPBACK}:{companion}", f"udpout:{LOOPBACK}:{ground_udp}"),
                instruments=tuple(EmulatedInstrument(name=i.name, type=i.type, port=p) for i, p in ports),
                parameters=drone.parameters,
            )
        )
        drones.append(
            DroneConfig(
                drone=drone.id,
                swarm=SwarmConfig(name=swarm, members=members, listen=(endpoint,), connect=tuple(endpoints)),
                origin=config.origin,
                autopilot=AutopilotConfig(
                    link=f"udpin:{LOOPBACK}:{companion}",
                    flavour=drone.flavour,
                    parameters=_failsafe_parameters(survey, drone, index),
                ),
                instruments=tuple(
                    InstrumentConfig(name=i.name, type=i.type, port=f"socket://{p}", options=i.options)
                    for i, p in ports
                ),
                filters=FiltersConfig(wind={"drag": {"linear_per_s": DRAG_PER_S}}),  # its airframe is known
                formation=config.formation,
                limits=config.limits,
                geofence=survey.geofence,
                strategy=config.strategy,
                seed=config.seed,
                record_to=str(directory / agent_name(drone.id)),
                speedup=config.speedup,
                clock=SharedClockConfig(file=str(directory / "clock"), slot=2 + index),
            )
        )
        endpoints.append(endpoint)
    fleet = FleetConfig(
        origin=config.origin,
        vehicles=tuple(vehicles),
        wind=config.wind,
        plume=config.plume,
        background_co2_ppm=config.background_co2_ppm,
        speedup=config.speedup,
        seed=config.seed,
        ready_after_s=config.ready_after_s,
        faults=config.faults,
        clock=str(directory / "clock"),
        truth=str(directory / "truth.csv"),
    )
    _write(directory / "fleet.yaml", fleet)
    for one in drones:
        _write(directory / f"{agent_name(one.drone)}.yaml", one)
    ground = {
        "station": GROUND_STATION,
        "swarm": SwarmConfig(name=swarm, members=members, listen=(ground_tcp,)),
        "origin": config.origin,
        "mavlink": {"links": [f"udpin:{LOOPBACK}:{ground_udp}"]},
        "geofence": survey.geofence,
        "alarms": {
            "ceiling_above_home_m": config.limits.ceiling_above_home_m,
            # Starting the agents takes the machine's time, which is short in simulated time.
            "absent_s": AGENT_START_WALL_S * config.speedup,
        },
        "record_to": str(directory),
        "clock": SharedClockConfig(file=str(directory / "clock"), slot=1),
        "speedup": config.speedup,
    }
    _write(directory / "ground.yaml", {key: value for key, value in ground.items() if value is not None})
    Cells.make(directory / "clock", 2 + count).close()
    return LaunchPlan(directory, swarm, tuple(endpoints), fleet, tuple(drones))


def _failsafe_parameters(survey: Survey, drone: SurveyDrone, index: int) -> dict[str, float]:
    """What the agent sets on its autopilot for the time when there is no agent any more.

    Each drone returns at an altitude of its own, that of its layer (see `flightstack.agent`), and an ArduPilot
    follows the last velocity for 1 s instead of 3.
    """
    formation = survey.config.formation
    above_home_m = formation.above_home_m + formation.layer_gap_m * (index % formation.layers + 1)
    if drone.flavour == "ardupilot":
        return {"RTL_ALT": round(above_home_m * 100.0), "GUID_TIMEOUT": 1.0}  # centimetres, seconds
    return {"RTL_RETURN_ALT": above_home_m}


Commands = Callable[[str, pathlib.Path], list[str]]
"""The command line of a part ("vehicles", "ground", "agent") with its configuration file."""


def installed(part: str, config: pathlib.Path) -> list[str]:
    """The real programs, run by the interpreter that runs us."""
    module, *verb = {
        "vehicles": ("simvehicle.cli.main", "run"),
        "ground": ("gcs.cli.main", "serve"),
        "agent": ("flightstack.cli", "run"),
    }[part]
    return [sys.executable, "-m", module, *verb, "--config", str(config)]


def start(plan: LaunchPlan, processes: Processes, commands: Commands = installed) -> None:
    """Start the vehicles, the ground station and one agent a drone. They may come up in any order."""
    processes.start(VEHICLES, commands("vehicles", plan.directory / "fleet.yaml"))
    processes.start(GROUND, commands("ground", plan.directory / "ground.yaml"))
    for drone in plan.drones:
        name = agent_name(drone.drone)
        processes.start(name, commands("agent", plan.directory / f"{name}.yaml"))


def _write(path: pathlib.Path, content: object) -> None:
    text = yaml.safe_dump(msgspec.to_builtins(content), sort_keys=False, width=110)
    path.write_text(text, encoding="utf-8")
