"""`gcs plan`: missions, geofences and rally points of a vehicle, as files of ground stations hold them."""

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

app = typer.Typer(
    help="Missions, geofences and rally points as QGroundControl writes them.", no_args_is_help=True
)
CeilingOption = Annotated[float, typer.Option("--ceiling", min=1.0, help="Highest altitude above home, m.")]


@app.command("check")
def plan_check(
    file: Annotated[pathlib.Path, typer.Argument(help="A .plan file, or a waypoint file.")],
    ceiling_m: CeilingOption = 120.0,
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
        tell(file, check.errors, check.warnings)
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
    clear_fence: Annotated[
        bool, typer.Option("--clear-fence", help="Where the plan has no fence, remove the vehicle's.")
    ] = False,
    ceiling_m: CeilingOption = 120.0,
    force: Annotated[bool, typer.Option("--force", help="Upload in spite of what the check finds.")] = False,
    json: JsonOption = False,
) -> None:
    """Upload mission, geofence and rally points, and read them back. A plan with mistakes is refused.

    A plan is all three together: a mission and rally points that it has not are cleared in the vehicle. The vehicle's
    fence stays unless the plan has one, or --clear-fence is given.
    """
    from gcs.plans.autopilot_client import open_vehicle
    from gcs.plans.checks import check_plan
    from gcs.plans.mission_items import FENCE_ACTIONS
    from mission.documents.plan_file import read_plan

    plan = read_plan(file)
    check = check_plan(plan, str(file), ceiling_m=ceiling_m)
    tell(file, check.errors[1:], check.warnings)
    if check.errors and not force:
        raise DocumentError(str(file), f"{check.errors[0]} (--force uploads it nevertheless)")
    tell(file, check.errors[:1], ())
    if clear_fence and plan.geofence is not None:
        raise DocumentError(
            str(file), "it has a fence, which takes the place of the vehicle's: no --clear-fence"
        )
    access = mavlink_access(config, link)

    async def upload() -> Uploaded:
        async with open_vehicle(access, drone) as vehicle:
            places = await vehicle.place_warnings(plan)
            tell(file, (), places)
            warnings.extend(places)
            return await vehicle.upload_plan(plan, FENCE_ACTIONS[action], clear_fence=clear_fence)

    warnings = list(check.warnings)
    done = asyncio.run(upload())
    tell(file, (), done.warnings)
    facts = {
        "drone": drone,
        "items": len(plan.items),
        "rally_points": len(plan.rally),
        "parameters": done.parameters,
        "notes": done.notes,
        "warnings": (*warnings, *done.warnings),
    }
    fence = f", fence with {settings(done.parameters)}" if done.parameters else ", no fence"
    lines = [f"drone {drone}: {len(plan.items)} items, {len(plan.rally)} rally points{fence}"]
    say(facts, "\n".join([*lines, *(f"drone {drone}: {note}" for note in done.notes)]), json=json)


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
    access = mavlink_access(config, link)

    async def download() -> Plan:
        async with open_vehicle(access, drone) as vehicle:
            return await vehicle.download_plan()

    plan = asyncio.run(download())
    write(file, plan_text(plan))
    areas = 0 if plan.geofence is None else len(plan.geofence.inclusion) + len(plan.geofence.exclusion)
    facts = {"drone": drone, "file": str(file), "items": len(plan.items), "rally_points": len(plan.rally)}
    text = f"{file}: {len(plan.items)} items, {areas} fence polygons, {len(plan.rally)} rally points"
    say(facts | {"fence_polygons": areas}, text, json=json)


@app.command("clear")
def plan_clear(
    drone: DroneOption,
    config: ConfigOption = None,
    link: LinkOption = None,
    clear_fence: Annotated[bool, typer.Option("--clear-fence", help="Remove the fence, too.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Also while the vehicle is armed.")] = False,
    json: JsonOption = False,
) -> None:
    """Remove a vehicle's mission and rally points, and read that they are gone. The fence stays unless asked for."""
    from gcs.plans.autopilot_client import FENCE as GEOFENCE
    from gcs.plans.autopilot_client import MISSION, RALLY, open_vehicle

    access = mavlink_access(config, link)

    async def clear() -> tuple[str, ...]:
        async with open_vehicle(access, drone) as vehicle:
            vehicle.expect_disarmed(force=force)
            done = [await vehicle.clear(MISSION), await vehicle.clear(RALLY)]
            done.append(await (vehicle.clear(GEOFENCE) if clear_fence else vehicle.kept(GEOFENCE)))
            return tuple(note for each in done for note in each.notes)

    notes = asyncio.run(clear())
    text = "; ".join(notes) or "it held nothing"
    say({"drone": drone, "notes": notes}, f"drone {drone}: {text}", json=json)
