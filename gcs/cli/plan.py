"""`gcs plan`: missions, geofences and rally points as QGroundControl writes them."""

from __future__ import annotations

import asyncio
import pathlib
from typing import Annotated

import typer

from gcs.cli.options import ConfigOption, DroneOption, FenceActionName, JsonOption, LinkOption, mavlink_links
from gcs.cli.output import check_directory, say, settings, write
from mission.documents.yaml_file import DocumentError

app = typer.Typer(
    help="Missions, geofences and rally points as QGroundControl writes them.", no_args_is_help=True
)


@app.command("check")
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


@app.command("upload")
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
    links, system = mavlink_links(config, link)

    async def upload() -> dict[str, float]:
        async with open_vehicle(links, drone, system) as vehicle:
            await vehicle.upload_plan(plan)
            if plan.geofence is None:
                return {}
            return await vehicle.upload_fence(plan.geofence, FENCE_ACTIONS[action])

    parameters = asyncio.run(upload())
    facts = {
        "drone": drone,
        "items": len(plan.items),
        "rally_points": len(plan.rally),
        "parameters": parameters,
    }
    fence = f", fence with {settings(parameters)}" if parameters else ", no fence"
    say(facts, f"drone {drone}: {len(plan.items)} items, {len(plan.rally)} rally points{fence}", json=json)


@app.command("download")
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

    check_directory(file)
    links, system = mavlink_links(config, link)

    async def download() -> Plan:
        async with open_vehicle(links, drone, system) as vehicle:
            return await vehicle.download_plan()

    plan = asyncio.run(download())
    write(file, plan_text(plan))
    areas = 0 if plan.geofence is None else len(plan.geofence.inclusion) + len(plan.geofence.exclusion)
    facts = {"drone": drone, "file": str(file), "items": len(plan.items), "rally_points": len(plan.rally)}
    text = f"{file}: {len(plan.items)} items, {areas} fence polygons, {len(plan.rally)} rally points"
    say(facts | {"fence_polygons": areas}, text, json=json)
