"""`gcs fleet`: keys and certificates of the drones and ground stations."""

from __future__ import annotations

import datetime
import ipaddress
import pathlib
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from gcs.cli.options import JsonOption
from gcs.cli.output import say
from gcs.errors import GroundError
from gcs.keys.roster import ROUTER_FILE

if TYPE_CHECKING:
    from gcs.keys.bundles import BundleChanges

app = typer.Typer(help="Keys and certificates of a fleet.", no_args_is_help=True)

DirectoryArgument = Annotated[
    pathlib.Path, typer.Argument(help="The fleet's directory; it stays on the ground.")
]
DronesOption = Annotated[
    str | None, typer.Option("--drones", help="Numbers as 1-5 or 1,2,7 at consecutive addresses.")
]
AddressOption = Annotated[
    str | None, typer.Option("--first-address", help="IP address of the first of --drones.")
]
StationOption = Annotated[
    list[str] | None, typer.Option("--station", help="A ground station: NAME=ADDRESS. Repeatable.")
]
SiteOption = Annotated[
    str | None, typer.Option("--site", help="Where they are, if a router joins several sites.")
]
RouterOption = Annotated[
    str | None,
    typer.Option("--router", help="Router between sites: NAME=ADDRESS, the address as this site reaches it."),
]
DroneFileOption = Annotated[
    pathlib.Path | None,
    typer.Option("--drone-file", help="Each new drone gets this file whole, with its own number and swarm."),
]
GroundFileOption = Annotated[
    pathlib.Path | None, typer.Option("--ground-file", help="The same for ground stations.")
]
DaysOption = Annotated[int, typer.Option("--days", min=1, max=7000, help="How long certificates are valid.")]


@app.command("init")
def fleet_init(
    directory: DirectoryArgument,
    swarm: Annotated[str, typer.Option("--swarm", help="Name of the swarm.")],
    drones: DronesOption = None,
    first_address: AddressOption = None,
    station: StationOption = None,
    port: Annotated[int, typer.Option("--port", min=1, max=65535, help="Where everybody listens.")] = 7447,
    site: SiteOption = None,
    router: RouterOption = None,
    router_port: Annotated[
        int, typer.Option("--router-port", min=1, max=65535, help="Where the router listens.")
    ] = 7448,
    drone_file: DroneFileOption = None,
    ground_file: GroundFileOption = None,
    days: DaysOption = 365,
    force: Annotated[
        bool, typer.Option("--force", help="Make all keys anew: what was made before is worthless then.")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Make an authority of this fleet, and for every drone and station a key, a certificate and its swarm section."""
    from gcs.keys.bundles import create
    from gcs.keys.roster import FleetRoster
    from gcs.keys.whole_files import Templates

    stations = _stations(station)
    if not stations and site is None:
        raise GroundError("--station: name at least one ground station, as ground=192.168.2.1")
    if (site is None) != (router is None):
        raise GroundError("--site and --router: a router joins sites; give both or neither")
    if re.fullmatch(r"[A-Za-z0-9_-]+", swarm) is None:
        raise GroundError(f"--swarm {swarm!r}: use letters, digits, - and _ only")
    named = None if router is None else _router(router)
    fleet = FleetRoster(
        swarm=swarm,
        drones={},
        stations={},
        port=port,
        router=None if named is None else named[0],
        router_port=router_port,
    ).with_nodes(_drones(drones, first_address), stations, _site(site), None if named is None else named[1])
    valid = datetime.timedelta(days=days)
    changes = create(directory, fleet, valid, Templates(drone_file, ground_file), force=force)
    _tell(directory, changes, valid, json=json)


@app.command("add")
def fleet_add(
    directory: DirectoryArgument,
    drones: DronesOption = None,
    first_address: AddressOption = None,
    station: StationOption = None,
    site: SiteOption = None,
    router: RouterOption = None,
    drone_file: DroneFileOption = None,
    ground_file: GroundFileOption = None,
    days: DaysOption = 365,
    json: JsonOption = False,
) -> None:
    """Add drones or ground stations to a fleet. The others' keys stay; their swarm sections name the new ones."""
    from gcs.keys.bundles import add
    from gcs.keys.whole_files import Templates

    if drones is None and first_address is not None:
        raise GroundError("--first-address: of which --drones?")
    more = {} if drones is None else _drones(drones, first_address)
    stations = _stations(station)
    if not more and not stations:
        raise GroundError("whom? give --drones with --first-address, or --station NAME=ADDRESS")
    valid = datetime.timedelta(days=days)
    named = None if router is None else _router(router)
    changes = add(directory, more, stations, valid, _site(site), named, Templates(drone_file, ground_file))
    _tell(directory, changes, valid, json=json)


@app.command("renew")
def fleet_renew(
    directory: DirectoryArgument,
    names: Annotated[
        list[str] | None, typer.Argument(help="drone-3, ground, …; all if none is given.")
    ] = None,
    days: DaysOption = 365,
    json: JsonOption = False,
) -> None:
    """New certificates for the same keys, before or after the old ones expire."""
    from gcs.keys.bundles import renew

    valid = datetime.timedelta(days=days)
    _tell(directory, renew(directory, names or (), valid), valid, json=json)


def _drones(text: str | None, first: str | None) -> dict[int, str]:
    """Numbers and their addresses, counted up from the first."""
    if text is None or first is None:
        raise GroundError("which drones, and where? give --drones 1-5 --first-address 192.168.2.11")
    numbers: list[int] = []
    for part in text.split(","):
        match = re.fullmatch(r"(\d{1,3})(?:-(\d{1,3}))?", part.strip())
        if match is None:
            raise GroundError(f"--drones {text}: write numbers as 1-5 or 1,2,7")
        begin, end = int(match[1]), int(match[2] or match[1])
        if not 1 <= begin <= end <= 250:
            raise GroundError(f"--drones {text}: {part} is not within 1 to 250, lowest first")
        numbers += range(begin, end + 1)
    if len(set(numbers)) != len(numbers):
        raise GroundError(f"--drones {text}: a number stands twice")
    try:
        address = ipaddress.ip_address(first)
        return {number: str(address + index) for index, number in enumerate(numbers)}
    except ValueError as error:
        raise GroundError(f"--first-address {first}: {error}") from error


def _stations(texts: Sequence[str] | None) -> dict[str, str]:
    stations: dict[str, str] = {}
    for text in texts or ():
        name, _, host = text.partition("=")
        if re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", name) is None or not host:
            raise GroundError(f"--station {text}: write NAME=ADDRESS, as ground=192.168.2.1")
        if name in stations:
            raise GroundError(f"--station {text}: {name} stands twice")
        stations[name] = host
    return stations


def _site(name: str | None) -> str | None:
    if name is not None and re.fullmatch(r"[A-Za-z0-9_-]{1,32}", name) is None:
        raise GroundError(f"--site {name!r}: use letters, digits, - and _ only, 32 at most")
    return name


def _router(text: str) -> tuple[str, str]:
    """Name and address."""
    name, _, host = text.partition("=")
    if re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", name) is None or not host:
        raise GroundError(f"--router {text}: write NAME=ADDRESS, as relay=203.0.113.7")
    return name, host


def _tell(
    directory: pathlib.Path,
    changes: BundleChanges,
    valid: datetime.timedelta,
    *,
    json: bool,
) -> None:
    until = f"{datetime.datetime.now(datetime.UTC) + valid:%Y-%m-%d}"
    lines = [
        f"{bundle}: copy the directory to {bundle.name}; its key is nobody else's"
        + (f"; there: gcs router --config {ROUTER_FILE}" if (bundle / ROUTER_FILE).is_file() else "")
        for bundle in changes.made
    ]
    lines += [
        f"{file}: changed; copy it to {file.parent.name} and start it again" for file in changes.changed
    ]
    lines.append(
        f"valid until {until}; {directory / 'authority'} stays here: who has its key can make members"
    )
    facts = {
        "bundles": [str(bundle) for bundle in changes.made],
        "changed": [str(file) for file in changes.changed],
        "valid_until": until,
    }
    say(facts, "\n".join(lines), json=json)
