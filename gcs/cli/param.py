"""`gcs param`: parameters of the autopilots."""

from __future__ import annotations

import asyncio
import pathlib
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from gcs.cli.options import ConfigOption, DroneOption, JsonOption, LinkOption, mavlink_access
from gcs.cli.output import check_directory, say, write

if TYPE_CHECKING:
    from flightstack.mavlink.parameter_values import ParameterValue
    from gcs.plans.parameter_load import LoadPlan

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
    from flightstack.mavlink.parameter_values import number_text
    from gcs.plans.autopilot_client import check_parameter, open_vehicle

    known = check_parameter(name)
    access = mavlink_access(config, link)

    async def get() -> float:
        async with open_vehicle(access, drone) as vehicle:
            return (await vehicle.parameter(known)).value

    value = asyncio.run(get())
    say({"drone": drone, "name": known, "value": value}, f"{known} {number_text(value)}", json=json)


# A negative number is a value and no option.
@app.command("set", context_settings={"ignore_unknown_options": True})
def param_set(
    name: NameArgument,
    value: Annotated[float, typer.Argument(help="Its new value.")],
    drone: DroneOption,
    config: ConfigOption = None,
    link: LinkOption = None,
    json: JsonOption = False,
) -> None:
    """Set one parameter and read it back. What the vehicle holds already is not written."""
    from flightstack.mavlink.parameter_values import number_text
    from gcs.plans.autopilot_client import check_parameter, open_vehicle

    known = check_parameter(name, value)
    access = mavlink_access(config, link)

    async def put() -> bool:
        async with open_vehicle(access, drone) as vehicle:
            return await vehicle.set_parameter(known, value)

    written = asyncio.run(put())
    facts = {"drone": drone, "name": known, "value": value, "written": written}
    say(facts, f"{known} {number_text(value)}", json=json)


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
    if json:
        typer.echo(to_json({name: value.value for name, value in found.items()}))
    else:
        typer.echo(_lines(found), nl=False)
    if not found:
        typer.echo(f"drone {drone}: no parameter has {match!r} in its name", err=True)
        raise typer.Exit(1)


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


@app.command("load")
def param_load(
    file: Annotated[
        pathlib.Path,
        typer.Argument(
            help="Parameters as MAVProxy, Mission Planner, QGroundControl or `param save` write them."
        ),
    ],
    drone: DroneOption,
    config: ConfigOption = None,
    link: LinkOption = None,
    yes: Annotated[bool, typer.Option("--yes", help="Write without asking.")] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only show what would change.")] = False,
    json: JsonOption = False,
) -> None:
    """Show what a file would change, ask, write that and read it back; exit code 1 if the vehicle lacks any of it."""
    from gcs.plans.autopilot_client import open_vehicle
    from gcs.plans.parameter_load import plan_load
    from gcs.plans.vehicle_link import VehicleError
    from mission.documents.parameter_file import read_parameters
    from mission.documents.yaml_file import DocumentError

    wanted = read_parameters(file)
    access = mavlink_access(config, link)

    async def load() -> tuple[LoadPlan, int]:
        async with open_vehicle(access, drone) as vehicle:
            plan = plan_load(wanted, await vehicle.parameters(), vehicle.flavour, drone)
            _show(plan, file, quiet=json)
            if plan.impossible:
                raise DocumentError(str(file), "; ".join(plan.impossible) + "; nothing was written")
            if not plan.changes or dry_run or not _agreed(file, len(plan.changes), yes=yes):
                return plan, 0
            for done, change in enumerate(plan.changes):
                try:
                    await vehicle.set_parameter(change.name, change.new)
                except asyncio.CancelledError as error:
                    left = len(plan.changes) - done
                    raise VehicleError(
                        f"drone {drone}: interrupted at {change.name}; {done} were written before, {left} may not be"
                    ) from error
                except VehicleError as error:
                    left = len(plan.changes) - done
                    raise VehicleError(f"{error}; {done} were written before it, {left} were not") from error
            return plan, len(plan.changes)

    plan, written = asyncio.run(load())
    facts = {
        "drone": drone,
        "file": str(file),
        "changes": {change.name: [change.old, change.new] for change in plan.changes},
        "written": written,
        "same": plan.same,
        "unknown": plan.unknown,
        "read_only": plan.read_only,
        "identity": plan.identity,
        "other_components": plan.other_components,
        "other_vehicles": plan.other_vehicles,
    }
    text = f"drone {drone}: {written} of {len(wanted)} written and read back, {plan.same} were so already"
    say(facts, text, json=json)
    if plan.unknown or written < len(plan.changes):
        raise typer.Exit(0 if dry_run else 1)


def _show(plan: LoadPlan, file: pathlib.Path, *, quiet: bool) -> None:
    """The differences, and by name what is left out of them."""
    if not quiet:
        for change in plan.changes:
            typer.echo(str(change))
    for names, why in (
        (plan.unknown, "unknown to this vehicle, not written (some appear once their group is enabled)"),
        (plan.read_only, "read-only, not written"),
        (plan.other_components, "of other components than the autopilot, not written"),
    ):
        if names:
            typer.echo(f"{file}: {why}: {', '.join(names)}", err=True)
    if plan.other_vehicles:
        numbers = ", ".join(map(str, plan.other_vehicles))
        typer.echo(f"{file}: warning: it was saved from drone {numbers}", err=True)
    for sentence in plan.identity:
        typer.echo(f"{file}: not written: {sentence}", err=True)


def _agreed(file: pathlib.Path, count: int, *, yes: bool) -> bool:
    if yes:
        return True
    try:
        what = f"these {count} parameters" if count > 1 else "this parameter"
        return typer.confirm(f"write {what}?", err=True)
    except typer.Abort:  # nobody is there to be asked
        typer.echo(f"\n{file}: nothing was written; --yes writes what is listed", err=True)
        raise typer.Exit(2) from None


def _parameters(
    drone: int, config: pathlib.Path | None, link: Sequence[str] | None
) -> Mapping[str, ParameterValue]:
    from gcs.plans.autopilot_client import open_vehicle

    access = mavlink_access(config, link)

    async def get() -> Mapping[str, ParameterValue]:
        async with open_vehicle(access, drone) as vehicle:
            return await vehicle.parameters()

    return asyncio.run(get())


def _lines(parameters: Mapping[str, ParameterValue]) -> str:
    from flightstack.mavlink.parameter_values import number_text

    return "".join(f"{name} {number_text(value.value)}\n" for name, value in parameters.items())
