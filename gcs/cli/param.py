"""`gcs param`: parameters of the autopilots."""

from __future__ import annotations

import asyncio
import pathlib
from collections.abc import Sequence
from typing import Annotated

import typer

from gcs.cli.options import ConfigOption, DroneOption, JsonOption, LinkOption, mavlink_links
from gcs.cli.output import check_directory, say, write

app = typer.Typer(help="Parameters of the autopilots.", no_args_is_help=True)
NameArgument = Annotated[str, typer.Argument(help="Name of the parameter.")]


@app.command("get")
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
    links, system = mavlink_links(config, link)

    async def get() -> float:
        async with open_vehicle(links, drone, system) as vehicle:
            return await vehicle.parameter(name)

    value = asyncio.run(get())
    say({"drone": drone, "name": name, "value": value}, f"{name} {value:.9g}", json=json)


@app.command("set")
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
    links, system = mavlink_links(config, link)

    async def put() -> None:
        async with open_vehicle(links, drone, system) as vehicle:
            await vehicle.set_parameter(name, value)

    asyncio.run(put())
    say({"drone": drone, "name": name, "value": value}, f"{name} {value:.9g}", json=json)


@app.command("list")
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
    typer.echo(to_json(found) if json else _lines(found), nl=json)


@app.command("save")
def param_save(
    file: Annotated[pathlib.Path, typer.Argument(help="The file to write, one `NAME VALUE` a line.")],
    drone: DroneOption,
    config: ConfigOption = None,
    link: LinkOption = None,
    json: JsonOption = False,
) -> None:
    """Write all parameters into a file."""
    check_directory(file)
    found = _parameters(drone, config, link)
    write(file, _lines(found))
    facts = {"drone": drone, "file": str(file), "parameters": len(found)}
    say(facts, f"{file}: {len(found)} parameters of drone {drone}", json=json)


def _parameters(drone: int, config: pathlib.Path | None, link: Sequence[str] | None) -> dict[str, float]:
    from gcs.plans.autopilot_client import open_vehicle

    links, system = mavlink_links(config, link)

    async def get() -> dict[str, float]:
        async with open_vehicle(links, drone, system) as vehicle:
            return await vehicle.parameters()

    return asyncio.run(get())


def _lines(parameters: dict[str, float]) -> str:
    return "".join(f"{name} {value:.9g}\n" for name, value in parameters.items())
