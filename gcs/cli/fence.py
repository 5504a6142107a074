"""`gcs fence`: geofences in the autopilots."""

from __future__ import annotations

import asyncio
import pathlib
from typing import Annotated

import typer

from gcs.cli.options import ConfigOption, DroneOption, FenceActionName, JsonOption, LinkOption, mavlink_links
from gcs.cli.output import say, settings
from mission.documents.yaml_file import DocumentError

app = typer.Typer(help="Geofences in the autopilots.", no_args_is_help=True)


@app.command("upload")
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
    links, system = mavlink_links(config, link)

    async def upload() -> dict[str, float]:
        async with open_vehicle(links, drone, system) as vehicle:
            return await vehicle.upload_fence(fence, FENCE_ACTIONS[action])

    parameters = asyncio.run(upload())
    say(
        {"drone": drone, "parameters": parameters},
        f"drone {drone}: fence with {settings(parameters)}",
        json=json,
    )
