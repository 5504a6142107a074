"""`gcs fence`: geofences in the autopilots."""

from __future__ import annotations

import asyncio
import pathlib
from typing import TYPE_CHECKING, Annotated

import typer

from gcs.cli.options import ConfigOption, DroneOption, FenceActionName, JsonOption, LinkOption, mavlink_access
from gcs.cli.output import check_directory, say, settings, tell, write
from mission.documents.yaml_file import DocumentError

if TYPE_CHECKING:
    from gcs.plans.autopilot_client import Uploaded
    from mission.geometry.geofence import Geofence

app = typer.Typer(help="Geofences in the autopilots.", no_args_is_help=True)


@app.command("upload")
def fence_upload(
    file: Annotated[pathlib.Path, typer.Argument(help="A file with a geofence.")],
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
    from mission.documents.plan_file import Plan, read_plan

    plan = read_plan(file)
    fence = plan.geofence
    if fence is None:
        raise DocumentError(str(file), "there is no geofence in this plan")
    for problem in fence.problems():
        raise DocumentError(str(file), problem, field="geoFence")
    tell(file, (), plan.warnings)
    access = mavlink_access(config, link)

    async def upload() -> Uploaded:
        async with open_vehicle(access, drone) as vehicle:
            places = await vehicle.place_warnings(Plan(geofence=fence))
            tell(file, (), places)
            warnings.extend(places)
            return await vehicle.upload_fence(fence, FENCE_ACTIONS[action])

    warnings = list(plan.warnings)
    done = asyncio.run(upload())
    tell(file, (), done.warnings)
    say(
        {"drone": drone, "parameters": done.parameters, "warnings": (*warnings, *done.warnings)},
        f"drone {drone}: fence with {settings(done.parameters)}",
        json=json,
    )


@app.command("download")
def fence_download(
    file: Annotated[pathlib.Path, typer.Argument(help="The .plan file to write.")],
    drone: DroneOption,
    config: ConfigOption = None,
    link: LinkOption = None,
    json: JsonOption = False,
) -> None:
    """Write a vehicle's geofence into a .plan file that holds nothing else."""
    from gcs.plans.autopilot_client import open_vehicle
    from gcs.plans.vehicle_link import VehicleError
    from mission.documents.plan_file import Plan, plan_text

    check_directory(file)
    access = mavlink_access(config, link)

    async def download() -> Geofence | None:
        async with open_vehicle(access, drone) as vehicle:
            return await vehicle.download_fence()

    fence = asyncio.run(download())
    if fence is None:
        raise VehicleError(f"drone {drone}: it holds no fence; {file} was not written")
    write(file, plan_text(Plan(geofence=fence)))
    polygons = len(fence.inclusion) + len(fence.exclusion)
    circles = len(fence.inclusion_circles) + len(fence.exclusion_circles)
    facts = {"drone": drone, "file": str(file), "fence_polygons": polygons, "fence_circles": circles}
    say(facts, f"{file}: {polygons} fence polygons, {circles} fence circles of drone {drone}", json=json)


@app.command("clear")
def fence_clear(
    drone: DroneOption,
    config: ConfigOption = None,
    link: LinkOption = None,
    force: Annotated[bool, typer.Option("--force", help="Also while the vehicle is armed.")] = False,
    json: JsonOption = False,
) -> None:
    """Remove a vehicle's uploaded geofence, and read that it is gone; says which of its other fences still act."""
    from gcs.plans.autopilot_client import FENCE as GEOFENCE
    from gcs.plans.autopilot_client import open_vehicle

    access = mavlink_access(config, link)

    async def clear() -> tuple[str, ...]:
        async with open_vehicle(access, drone) as vehicle:
            vehicle.expect_disarmed(force=force)
            return (await vehicle.clear(GEOFENCE)).notes

    notes = asyncio.run(clear())
    text = "; ".join(notes) or "it held no fence"
    say({"drone": drone, "notes": notes}, f"drone {drone}: {text}", json=json)
