"""The command `gcs`: the ground station and its operator's commands."""

from __future__ import annotations

import asyncio
import enum
import logging
import pathlib
import sys
from collections.abc import Coroutine, Sequence
from typing import Annotated, Any, TypeVar

import typer

from flightstack.swarm.wire import CommandName
from gcs.errors import GroundError
from mission.documents.yaml_file import DocumentError

app = typer.Typer(
    help="The ground station: watch the swarm, command it, prepare its vehicles.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
plan_app = typer.Typer(
    help="Missions, geofences and rally points as QGroundControl writes them.", no_args_is_help=True
)
fence_app = typer.Typer(help="Geofences in the autopilots.", no_args_is_help=True)
param_app = typer.Typer(help="Parameters of the autopilots.", no_args_is_help=True)
app.add_typer(plan_app, name="plan")
app.add_typer(fence_app, name="fence")
app.add_typer(param_app, name="param")

T = TypeVar("T")
ConfigOption = Annotated[
    pathlib.Path | None, typer.Option("--config", help="The ground station's YAML file.")
]
SwarmOption = Annotated[str | None, typer.Option("--swarm", help="Name of the swarm, without a --config.")]
ConnectOption = Annotated[
    list[str] | None,
    typer.Option("--connect", help="Endpoint of a node of the swarm: tcp/HOST:PORT. Repeatable."),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one line of JSON instead of text.")]
DroneOption = Annotated[
    int, typer.Option("--drone", min=1, max=250, help="The vehicle's number (its system id).")
]
LinkOption = Annotated[
    list[str] | None,
    typer.Option("--link", help="MAVLink link as udpin:HOST:PORT, tcp:HOST:PORT, PATH,BAUD. Repeatable."),
]


class FenceActionName(enum.StrEnum):
    RTL = "rtl"
    LAND = "land"
    HOLD = "hold"
    REPORT = "report"


@app.command()
def serve(
    config: Annotated[pathlib.Path, typer.Option("--config", help="The ground station's YAML file.")],
) -> None:
    """Run the ground station until a signal: watch, record, bring orphans home."""
    from gcs.serve import serve as run_station
    from gcs.station_config import load

    logging.basicConfig(
        stream=sys.stderr, level=logging.INFO, format="%(asctime)s %(levelname)-7s %(name)s: %(message)s"
    )
    raise typer.Exit(run_station(load(config), config))


@app.command()
def survey(
    name: Annotated[CommandName, typer.Argument(help="What the swarm shall do.")],
    config: ConfigOption = None,
    swarm: SwarmOption = None,
    connect: ConnectOption = None,
    drone: Annotated[int, typer.Option("--drone", min=0, max=250, help="One drone; 0: all members.")] = 0,
    deadline_s: Annotated[
        float,
        typer.Option("--deadline", min=0.1, help="Seconds until a drone that has not answered is given up."),
    ] = 5.0,
    json: JsonOption = False,
) -> None:
    """Command the swarm and wait for every drone's answer; exit code 0 only if all accepted."""
    from gcs.commands.send import command_swarm
    from gcs.connection import from_options
    from gcs.fleet.observe import to_json

    done = command_swarm(from_options(config, swarm, connect or ()), name, drone, deadline_s)
    if json:
        report = {"command": name, "identity": done.command.identity, "accepted": done.accepted()}
        typer.echo(to_json(report | {"drones": done.answers()}))
    else:
        for answer in done.answers():
            reason = f": {answer.reason}" if answer.reason else ""
            typer.echo(f"drone {answer.drone}: {answer.result}{reason}")
        if not done.answers():
            typer.echo("no drone is heard", err=True)
    raise typer.Exit(0 if done.accepted() else 1)


@app.command()
def status(
    config: ConfigOption = None,
    swarm: SwarmOption = None,
    connect: ConnectOption = None,
    seconds: Annotated[float, typer.Option("--seconds", min=0.1, help="How long to listen.")] = 1.5,
    json: JsonOption = False,
) -> None:
    """Listen for a moment and report every drone; exit code 1 if nobody is heard."""
    from gcs.connection import from_options
    from gcs.fleet.observe import listen, to_json

    observer, now_s = listen(from_options(config, swarm, connect or ()), seconds)
    if json:
        typer.echo(to_json(observer.snapshot(now_s)))
    else:
        from rich.console import Console

        from gcs.display.fleet_table import report

        # Piped into a file or a pager there is no width to keep to.
        console = Console() if sys.stdout.isatty() else Console(width=140)
        snapshot = observer.snapshot(now_s)
        console.print(
            report(snapshot.swarm, snapshot.drones, observer.alarms(now_s), snapshot.station, now_s)
        )
    if not observer.heard_anybody():
        typer.echo(f"gcs: no drone heard in {seconds:g} s", err=True)
        raise typer.Exit(1)


@app.command()
def watch(config: ConfigOption = None, swarm: SwarmOption = None, connect: ConnectOption = None) -> None:
    """Show the swarm live until Ctrl-C."""
    from gcs.connection import from_options
    from gcs.display.watch import watch as show

    show(from_options(config, swarm, connect or ()))


@plan_app.command("check")
def plan_check(
    file: Annotated[pathlib.Path, typer.Argument(help="A .plan file, or a waypoint file.")],
    ceiling_m: Annotated[
        float, typer.Option("--ceiling", min=1.0, help="Highest altitude above home, m.")
    ] = 120.0,
    json: JsonOption = False,
) -> None:
    """Look for mistakes in a plan: geofence, launch point, waypoints, altitudes; exit code 2 if there are any."""
    from gcs.fleet.observe import to_json
    from gcs.plans.checks import check_plan
    from mission.documents.plan_file import read_plan

    check = check_plan(read_plan(file), str(file), ceiling_m=ceiling_m)
    if json:
        typer.echo(to_json(check))
    else:
        for error in check.errors:
            typer.echo(f"{file}: {error}", err=True)
        for warning in check.warnings:
            typer.echo(f"{file}: warning: {warning}", err=True)
        if check.good:
            typer.echo(
                f"{file}: good: {check.items} items, {check.waypoints} waypoints over {check.length_m:.0f} m, "
                f"{check.fence_areas} fence areas, {check.rally_points} rally points"
            )
    raise typer.Exit(0 if check.good else 2)


@plan_app.command("upload")
def plan_upload(
    file: Annotated[pathlib.Path, typer.Argument(help="A .plan file, or a waypoint file.")],
    drone: DroneOption,
    config: ConfigOption = None,
    link: LinkOption = None,
    action: Annotated[
        FenceActionName, typer.Option("--fence-action", help="What to do at the fence.")
    ] = FenceActionName.RTL,
    force: Annotated[bool, typer.Option("--force", help="Upload in spite of what the check finds.")] = False,
    json: JsonOption = False,
) -> None:
    """Upload mission, geofence and rally points, and read them back. A plan with mistakes is refused."""
    from gcs.plans.autopilot_client import open_vehicle
    from gcs.plans.checks import check_plan
    from gcs.plans.mission_items import FENCE_ACTIONS
    from mission.documents.plan_file import read_plan

    plan = read_plan(file)
    check = check_plan(plan, str(file))
    if check.errors and not force:
        raise DocumentError(str(file), f"{check.errors[0]} (--force uploads it nevertheless)")
    links, system = _links(config, link)

    async def upload() -> dict[str, float]:
        async with open_vehicle(links, drone, system) as vehicle:
            await vehicle.upload_plan(plan)
            if plan.geofence is None:
                return {}
            return await vehicle.upload_fence(plan.geofence, FENCE_ACTIONS[action])

    parameters = _run(upload())
    facts = {
        "drone": drone,
        "items": len(plan.items),
        "rally_points": len(plan.rally),
        "parameters": parameters,
    }
    fence = f", fence with {_words(parameters)}" if parameters else ", no fence"
    _say(facts, f"drone {drone}: {len(plan.items)} items, {len(plan.rally)} rally points{fence}", json=json)


@plan_app.command("download")
def plan_download(
    file: Annotated[pathlib.Path, typer.Argument(help="The .plan file to write.")],
    drone: DroneOption,
    config: ConfigOption = None,
    link: LinkOption = None,
    json: JsonOption = False,
) -> None:
    """Write mission, geofence and rally points of a vehicle into a .plan file."""
    from gcs.plans.autopilot_client import open_vehicle
    from mission.documents.plan_file import Plan, plan_text

    _check_directory(file)
    links, system = _links(config, link)

    async def download() -> Plan:
        async with open_vehicle(links, drone, system) as vehicle:
            return await vehicle.download_plan()

    plan = _run(download())
    _write(file, plan_text(plan))
    areas = 0 if plan.geofence is None else len(plan.geofence.inclusion) + len(plan.geofence.exclusion)
    facts = {"drone": drone, "file": str(file), "items": len(plan.items), "rally_points": len(plan.rally)}
    text = f"{file}: {len(plan.items)} items, {areas} fence polygons, {len(plan.rally)} rally points"
    _say(facts | {"fence_polygons": areas}, text, json=json)


@fence_app.command("upload")
def fence_upload(
    file: Annotated[pathlib.Path, typer.Argument(help="A .plan file with a geofence.")],
    drone: DroneOption,
    config: ConfigOption = None,
    link: LinkOption = None,
    action: Annotated[
        FenceActionName, typer.Option("--action", help="What to do at the fence.")
    ] = FenceActionName.RTL,
    json: JsonOption = False,
) -> None:
    """Upload a geofence, read it back, and set and read back the parameters without which it does nothing."""
    from gcs.plans.autopilot_client import open_vehicle
    from gcs.plans.mission_items import FENCE_ACTIONS
    from mission.documents.plan_file import read_plan

    fence = read_plan(file).geofence
    if fence is None:
        raise DocumentError(str(file), "there is no geofence in this plan")
    for problem in fence.problems():
        raise DocumentError(str(file), problem, field="geoFence")
    links, system = _links(config, link)

    async def upload() -> dict[str, float]:
        async with open_vehicle(links, drone, system) as vehicle:
            return await vehicle.upload_fence(fence, FENCE_ACTIONS[action])

    parameters = _run(upload())
    _say(
        {"drone": drone, "parameters": parameters},
        f"drone {drone}: fence with {_words(parameters)}",
        json=json,
    )


NameArgument = Annotated[str, typer.Argument(help="Name of the parameter.")]


@param_app.command("get")
def param_get(
    name: NameArgument,
    drone: DroneOption,
    config: ConfigOption = None,
    link: LinkOption = None,
    json: JsonOption = False,
) -> None:
    """Read one parameter."""
    from gcs.plans.autopilot_client import check_parameter, open_vehicle

    check_parameter(name)
    links, system = _links(config, link)

    async def get() -> float:
        async with open_vehicle(links, drone, system) as vehicle:
            return await vehicle.parameter(name)

    value = _run(get())
    _say({"drone": drone, "name": name, "value": value}, f"{name} {value:.9g}", json=json)


@param_app.command("set")
def param_set(
    name: NameArgument,
    value: Annotated[float, typer.Argument(help="Its new value.")],
    drone: DroneOption,
    config: ConfigOption = None,
    link: LinkOption = None,
    json: JsonOption = False,
) -> None:
    """Set one parameter and read it back."""
    from gcs.plans.autopilot_client import check_parameter, open_vehicle

    check_parameter(name, value)
    links, system = _links(config, link)

    async def put() -> None:
        async with open_vehicle(links, drone, system) as vehicle:
            await vehicle.set_parameter(name, value)

    _run(put())
    _say({"drone": drone, "name": name, "value": value}, f"{name} {value:.9g}", json=json)


@param_app.command("list")
def param_list(
    drone: DroneOption,
    config: ConfigOption = None,
    link: LinkOption = None,
    match: Annotated[str, typer.Option("--match", help="Only names with this in them.")] = "",
    json: JsonOption = False,
) -> None:
    """Read all parameters."""
    from gcs.fleet.observe import to_json

    found = {name: v for name, v in _parameters(drone, config, link).items() if match.upper() in name}
    typer.echo(to_json(found) if json else _param_text(found), nl=json)


@param_app.command("save")
def param_save(
    file: Annotated[pathlib.Path, typer.Argument(help="The file to write, one `NAME VALUE` a line.")],
    drone: DroneOption,
    config: ConfigOption = None,
    link: LinkOption = None,
    json: JsonOption = False,
) -> None:
    """Write all parameters into a file."""
    _check_directory(file)
    found = _parameters(drone, config, link)
    _write(file, _param_text(found))
    facts = {"drone": drone, "file": str(file), "parameters": len(found)}
    _say(facts, f"{file}: {len(found)} parameters of drone {drone}", json=json)


def _parameters(drone: int, config: pathlib.Path | None, link: Sequence[str] | None) -> dict[str, float]:
    from gcs.plans.autopilot_client import open_vehicle

    links, system = _links(config, link)

    async def get() -> dict[str, float]:
        async with open_vehicle(links, drone, system) as vehicle:
            return await vehicle.parameters()

    return _run(get())


def _links(config: pathlib.Path | None, link: Sequence[str] | None) -> tuple[tuple[str, ...], int]:
    """MAVLink links and our system id, from `--link` or else from the ground station's file."""
    from gcs.station_config import MavlinkConfig, load

    mavlink = load(config).mavlink if config is not None else MavlinkConfig()
    links = tuple(link or ()) or mavlink.links
    if not links:
        raise GroundError("which link? give --link udpin:HOST:PORT, or --config with mavlink.links")
    return links, mavlink.system


def _run(call: Coroutine[Any, Any, T]) -> T:
    return asyncio.run(call)


def _words(parameters: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:g}" for name, value in parameters.items())


def _param_text(parameters: dict[str, float]) -> str:
    return "".join(f"{name} {value:.9g}\n" for name, value in parameters.items())


def _check_directory(file: pathlib.Path) -> None:
    """Before a long download: that there is somewhere to put it."""
    if not file.parent.is_dir():
        raise GroundError(f"{file}: cannot be written: there is no directory {file.parent}")


def _write(file: pathlib.Path, text: str) -> None:
    try:
        file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise GroundError(f"{file}: cannot be written: {error.strerror}") from error


def _say(facts: dict[str, Any], text: str, *, json: bool) -> None:
    from gcs.fleet.observe import to_json

    typer.echo(to_json(facts) if json else text)


def main() -> None:
    """Entry point: what a user can get wrong ends in one line and exit code 2, what a vehicle refuses in 1."""
    from flightstack.errors import FlightstackError
    from flightstack.transport import TransportError

    try:
        app(standalone_mode=True)
    except (DocumentError, GroundError, FlightstackError, TransportError) as error:
        from gcs.plans.autopilot_client import VehicleError

        typer.echo(f"gcs: {error}", err=True)
        raise SystemExit(1 if isinstance(error, VehicleError) else 2) from error


if __name__ == "__main__":
    main()
