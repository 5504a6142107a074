"""`gcs signing`: the key that MAVLink is signed with."""

from __future__ import annotations

import asyncio
import pathlib
from typing import TYPE_CHECKING, Annotated

import typer

from gcs.cli.options import DroneOption, JsonOption
from gcs.cli.output import check_directory, say

if TYPE_CHECKING:
    from flightstack.mavlink.signing_store import SigningStore

app = typer.Typer(help="The key that MAVLink is signed with.", no_args_is_help=True)

KeyArgument = Annotated[pathlib.Path, typer.Argument(help="The key's file.")]
CableOption = Annotated[
    str,
    typer.Option(
        "--link",
        help="A cable to the autopilot, as PATH,BAUD: the key goes over it as it is, for all to hear.",
    ),
]
OldKeyOption = Annotated[
    pathlib.Path | None, typer.Option("--old-key", help="The key that the vehicle has, if it has one.")
]
SystemOption = Annotated[int, typer.Option("--system", min=1, max=255, help="Our own system id.")]


@app.command("make")
def signing_make(
    file: KeyArgument,
    passphrase: Annotated[
        bool,
        typer.Option(
            "--passphrase", help="Ask for a passphrase; MAVProxy and Mission Planner make the same key of it."
        ),
    ] = False,
    json: JsonOption = False,
) -> None:
    """Make a key that nobody but you can read."""
    from flightstack.mavlink.signing import key_of_passphrase
    from flightstack.mavlink.signing_store import write_key

    check_directory(file)
    key = None
    if passphrase:
        key = key_of_passphrase(
            typer.prompt("passphrase", hide_input=True, confirmation_prompt=True, err=True)
        )
    write_key(file, key)
    text = f"{file}: the fleet's key; copy it to every drone and ground station, and keep its mode (600)"
    say({"file": str(file)}, text, json=json)


@app.command("setup")
def signing_setup(
    file: KeyArgument,
    drone: DroneOption,
    link: CableOption,
    old_key: OldKeyOption = None,
    system: SystemOption = 255,
    json: JsonOption = False,
) -> None:
    """Give a vehicle's autopilot the key, and see that it signs with it. It must be disarmed."""
    from gcs.plans.signing_setup import change_signing

    asyncio.run(change_signing(link, drone, system, _store(old_key), _store(file)))
    text = f"drone {drone}: signs with {file}, and believes nothing else but at its USB port"
    say({"drone": drone, "file": str(file), "signs": True}, text, json=json)


@app.command("disable")
def signing_disable(
    drone: DroneOption,
    link: CableOption,
    old_key: OldKeyOption = None,
    system: SystemOption = 255,
    json: JsonOption = False,
) -> None:
    """Take the key away: the vehicle signs nothing and believes everybody. It must be disarmed."""
    from gcs.plans.signing_setup import change_signing

    asyncio.run(change_signing(link, drone, system, _store(old_key), None))
    say({"drone": drone, "signs": False}, f"drone {drone}: signs nothing, and believes everybody", json=json)


def _store(file: pathlib.Path | None) -> SigningStore | None:
    from flightstack.mavlink.signing_store import SigningStore

    return None if file is None else SigningStore(file)
