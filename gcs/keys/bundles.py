"""A fleet's directory: what its authority needs, and for each node a bundle that is copied to it.

    crater/fleet.yaml                     who belongs to it
    crater/authority/authority.{pem,key}  stays here: whoever has the key can make members
    crater/drone-3/authority.pem, drone-3.{pem,key}, swarm.yaml
    crater/ground/authority.pem, ground.{pem,key}, swarm.yaml
    crater/relay/authority.pem, relay.{pem,key}, zenohd.json5

`swarm.yaml` is the `swarm` section of the node's configuration file, `zenohd.json5` the whole of the router's, if one
joins several sites.
"""

from __future__ import annotations

import contextlib
import datetime
import os
import pathlib
from collections.abc import Iterable, Iterator
from typing import Final

import msgspec
import yaml

from gcs.errors import GroundError
from gcs.keys.authority import Pair, check_library, new_authority, sign
from gcs.keys.node_files import router_file, swarm_section
from gcs.keys.roster import AUTHORITY, ROUTER_FILE, Fleet, check_fleet
from mission.documents.yaml_file import parse, read_text

_FLEET_FILE: Final = "fleet.yaml"


def create(
    directory: pathlib.Path, fleet: Fleet, valid: datetime.timedelta, *, force: bool = False
) -> list[pathlib.Path]:
    """Make an authority and everybody's bundle; returns the bundles.

    Nothing is overwritten without `force`: a new authority makes every key and certificate before it worthless.
    """
    check_library()
    check_fleet(fleet)
    if not force and directory.is_dir() and any(directory.iterdir()):
        raise GroundError(
            f"{directory} is not empty; gcs fleet add and renew change a fleet, and --force makes a new one, whose "
            "nodes do not hear those of the old one any more"
        )
    if directory.exists() and not directory.is_dir():
        raise GroundError(f"{directory} is no directory")
    if directory.exists() and any(directory.iterdir()):
        read(directory)  # only a fleet's own directory is ever overwritten
    now = datetime.datetime.now(datetime.UTC)
    authority = new_authority(fleet.swarm, now)
    with _told(directory):
        _keep(directory / AUTHORITY, AUTHORITY, authority)
        return _write(directory, fleet, authority, fleet.everybody(), now, valid, fresh=True)


def add(
    directory: pathlib.Path,
    drones: dict[int, str],
    stations: dict[str, str],
    valid: datetime.timedelta,
    site: str | None = None,
    router: tuple[str, str] | None = None,
) -> tuple[list[pathlib.Path], list[pathlib.Path]]:
    """More nodes: (their bundles, the others' files, which name the new ones now).

    In a fleet of several sites they are all at `site`, which may be new; `router` is the router's name and the
    address at which that site reaches it.
    """
    check_library()
    fleet = read(directory)
    for known in sorted({*drones} & {*fleet.drones}):
        raise GroundError(f"{directory}: drone {known} is in this fleet already; gcs fleet renew renews it")
    for name in sorted({*stations} & {*fleet.stations}):
        raise GroundError(f"{directory}: {name} is in this fleet already; gcs fleet renew renews it")
    if site is not None and fleet.router is None:
        raise GroundError(f"--site {site}: this fleet has no router; docs/sites.md says how it gets one")
    if router is not None and router[0] != fleet.router:
        raise GroundError(f"--router {router[0]}: this fleet's router is {fleet.router or 'none'}")
    before = fleet.everybody()
    fleet = fleet.with_nodes(drones, stations, site, None if router is None else router[1])
    check_fleet(fleet)
    new = [name for name in fleet.everybody() if name not in before]
    with _told(directory):
        made = _write(
            directory,
            fleet,
            _authority(directory),
            new,
            datetime.datetime.now(datetime.UTC),
            valid,
            fresh=True,
        )
    return made, [_section_file(directory, fleet, name) for name in before]


def renew(directory: pathlib.Path, names: Iterable[str], valid: datetime.timedelta) -> list[pathlib.Path]:
    """New certificates for the same keys; of everybody if no `names` are given. Returns the certificates."""
    check_library()
    fleet = read(directory)
    check_fleet(fleet)
    everybody = fleet.everybody()
    wanted = list(names) or everybody
    for name in wanted:
        if name not in everybody:
            raise GroundError(f"{directory}: {name} is not in this fleet, which has {', '.join(everybody)}")
    now = datetime.datetime.now(datetime.UTC)
    with _told(directory):
        _write(directory, fleet, _authority(directory), wanted, now, valid, fresh=False)
    return [directory / name / f"{name}.pem" for name in wanted]


def read(directory: pathlib.Path) -> Fleet:
    """The fleet of a directory; `DocumentError` or `GroundError` where it is none."""
    file = directory / _FLEET_FILE
    if not file.is_file():
        raise GroundError(
            f"{directory} is no fleet's directory (it has no {_FLEET_FILE}); gcs fleet init makes one"
        )
    return parse(read_text(file), Fleet, str(file))


def _section_file(directory: pathlib.Path, fleet: Fleet, name: str) -> pathlib.Path:
    return directory / name / (ROUTER_FILE if name == fleet.router else "swarm.yaml")


def write_keys(
    bundle: pathlib.Path,
    authority: Pair,
    name: str,
    now: datetime.datetime,
    valid: datetime.timedelta,
    private_key: bytes | None = None,
) -> None:
    """The key and certificate of the node `name` and the authority's certificate; the arguments are `sign`'s."""
    _keep(bundle, name, sign(authority, name, now, valid, private_key))
    _replace(bundle / f"{AUTHORITY}.pem", authority.certificate)


def _authority(directory: pathlib.Path) -> Pair:
    kept = directory / AUTHORITY
    return Pair((kept / f"{AUTHORITY}.pem").read_bytes(), (kept / f"{AUTHORITY}.key").read_bytes())


def _write(
    directory: pathlib.Path,
    fleet: Fleet,
    authority: Pair,
    names: Iterable[str],
    now: datetime.datetime,
    valid: datetime.timedelta,
    *,
    fresh: bool,
) -> list[pathlib.Path]:
    """Sign for `names`, with new keys if `fresh`, and tell everybody who belongs to the fleet."""
    made = []
    for name in names:
        file = directory / name / f"{name}.key"
        # A router that was written into the fleet's file by hand has no key yet.
        new = fresh or (name == fleet.router and not file.exists())
        write_keys(file.parent, authority, name, now, valid, None if new else file.read_bytes())
        made.append(file.parent)
    for node in fleet.nodes():
        _replace(_section_file(directory, fleet, node.name), swarm_section(fleet, node).encode())
    if fleet.router is not None:
        file = _section_file(directory, fleet, fleet.router)
        file.parent.mkdir(exist_ok=True)
        _replace(file, router_file(fleet, fleet.router).encode())
    written = yaml.safe_dump(msgspec.to_builtins(fleet, str_keys=False), sort_keys=False)
    _replace(directory / _FLEET_FILE, written.encode())
    return made


def _keep(bundle: pathlib.Path, name: str, pair: Pair) -> None:
    bundle.mkdir(parents=True, exist_ok=True)
    bundle.chmod(0o700)
    _replace(bundle / f"{name}.pem", pair.certificate)
    _replace(bundle / f"{name}.key", pair.private_key, mode=0o600)


def _replace(file: pathlib.Path, data: bytes, mode: int = 0o644) -> None:
    """Write whole or not at all: half a key is worse than an old one. Nobody else can read a key even meanwhile."""
    fresh = file.with_name(f".{file.name}.new")
    fresh.unlink(missing_ok=True)
    with open(os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as output:
        output.write(data)
        output.flush()
        os.fsync(output.fileno())
    fresh.replace(file)


@contextlib.contextmanager
def _told(directory: pathlib.Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise GroundError(f"{error.filename or directory}: {error.strerror}") from error
