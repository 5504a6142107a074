"""The command `simvehicle run`."""

from __future__ import annotations

import json
import pathlib
import sys
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from simvehicle.fleet.fleet_config import FleetConfig

_HOST = "127.0.0.1"


class FlavourName(StrEnum):
    ARDUPILOT = "ardupilot"
    PX4 = "px4"


def run(
    config: Annotated[
        pathlib.Path | None, typer.Option("--config", help="A fleet's YAML file; instead of the rest.")
    ] = None,
    count: Annotated[int, typer.Option(min=1, max=250, help="Vehicles, with system ids 1, 2, …")] = 1,
    flavour: Annotated[
        FlavourName, typer.Option(help="What the autopilots are like.")
    ] = FlavourName.ARDUPILOT,
    speedup: Annotated[
        float | None, typer.Option(min=0.1, max=100.0, help="Times real time; also instead of the file's.")
    ] = None,
    companion_port: Annotated[
        int, typer.Option(min=1, max=65000, help="UDP port that the first vehicle sends to; the next: + 1.")
    ] = 14540,
    ground_port: Annotated[
        int, typer.Option(min=0, max=65535, help="UDP port that all vehicles send to; 0: no ground link.")
    ] = 14550,
    latitude_deg: Annotated[float, typer.Option(min=-90, max=90, help="Of the first vehicle.")] = -5.06,
    longitude_deg: Annotated[float, typer.Option(min=-180, max=180, help="Of the first vehicle.")] = 151.3,
    amsl_m: Annotated[float, typer.Option(help="Altitude of the ground.")] = 500.0,
    spacing_m: Annotated[float, typer.Option(min=0.5, help="Between vehicles, eastwards.")] = 5.0,
    wind_mps: Annotated[float, typer.Option(min=0.0, max=30.0, help="Mean wind speed.")] = 3.0,
    wind_from_deg: Annotated[float, typer.Option(min=0.0, max=360.0, help="Where it comes from.")] = 90.0,
    ready_after_s: Annotated[
        float, typer.Option(min=0.0, help="Simulated seconds from power-up to being ready to arm.")
    ] = 41.0,
    seed: Annotated[int, typer.Option(min=0, help="Of wind and noise.")] = 0,
    truth: Annotated[pathlib.Path | None, typer.Option(help="CSV file for the true states.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Say what listens where as one JSON line.")] = False,
) -> None:
    """Run simulated vehicles until Ctrl-C or SIGTERM."""
    import msgspec

    from mission.documents.yaml_file import DocumentError, line_of
    from mission.geometry.frames import Geodetic
    from simvehicle.drone.drone_spec import VehicleSpec
    from simvehicle.fleet.fleet_config import FleetConfig
    from simvehicle.world.world_config import WindConfig

    if config is not None:
        fleet_config = _read(config)
    else:
        ground = (f"udpout:{_HOST}:{ground_port}",) if ground_port else ()
        fleet_config = FleetConfig(
            origin=Geodetic(latitude_deg, longitude_deg, amsl_m),
            vehicles=tuple(
                VehicleSpec(
                    id=index + 1,
                    flavour=flavour.value,
                    home_east_m=index * spacing_m,
                    links=(f"udpout:{_HOST}:{companion_port + index}", *ground),
                )
                for index in range(count)
            ),
            wind=WindConfig(speed_mps=wind_mps, from_deg=wind_from_deg),
            ready_after_s=ready_after_s,
            seed=seed,
        )
    if speedup is not None:
        fleet_config = msgspec.structs.replace(fleet_config, speedup=speedup)
    if truth is not None:
        fleet_config = msgspec.structs.replace(fleet_config, truth=str(truth))

    from simvehicle.fleet.fleet_problems import FleetError
    from simvehicle.fleet.process import Fleet, run_until_signalled

    try:
        fleet = Fleet(fleet_config)
        _announce(fleet_config, as_json=as_json)
        run_until_signalled(fleet)
    except FleetError as error:
        if config is None:
            raise DocumentError("simvehicle run", error.problem) from error
        line = line_of(config.read_text(encoding="utf-8"), error.field)
        raise DocumentError(str(config), error.problem, line=line, field=error.field) from error


def _read(path: pathlib.Path) -> FleetConfig:
    import msgspec

    from mission.documents.yaml_file import parse, read_text
    from simvehicle.fleet.fleet_config import FleetConfig

    config = parse(read_text(path), FleetConfig, str(path))
    vehicles = tuple(
        vehicle
        if vehicle.signing_key is None
        else msgspec.structs.replace(vehicle, signing_key=str(path.parent / vehicle.signing_key))
        for vehicle in config.vehicles
    )
    return msgspec.structs.replace(config, vehicles=vehicles)


def _announce(config: FleetConfig, *, as_json: bool) -> None:
    if as_json:
        vehicles = [
            {
                "id": vehicle.id,
                "flavour": vehicle.flavour,
                "links": list(vehicle.links),
                "instruments": {i.name: f"socket://{i.port}" for i in vehicle.instruments},
            }
            for vehicle in config.vehicles
        ]
        typer.echo(json.dumps({"vehicles": vehicles, "speedup": config.speedup}))
    else:
        for vehicle in config.vehicles:
            ports = [f"{i.name} ({i.type}) socket://{i.port}" for i in vehicle.instruments]
            typer.echo(f"vehicle {vehicle.id} ({vehicle.flavour}): {', '.join((*vehicle.links, *ports))}")
        typer.echo(f"speed-up {config.speedup:g}; Ctrl-C ends it")
    sys.stdout.flush()
