"""A fleet's directory: what its authority needs, and for each node a bundle that is copied to it.

    crater/fleet.yaml                     who belongs to it
    crater/authority/authority.{pem,key}  stays here: whoever has the key can make members
    crater/drone-3/authority.pem, drone-3.{pem,key}, swarm.yaml
    crater/ground/authority.pem, ground.{pem,key}, swarm.yaml

`swarm.yaml` is the `swarm` section of the node's configuration file.
"""

from __future__ import annotations

import contextlib
import datetime
import os
import pathlib
from collections.abc import Iterable, Iterator
from typing import Annotated, Final

import msgspec
import yaml
from msgspec import Meta

from flightstack.config import DroneId, NodeName, Section
from flightstack.transport import TransportError
from flightstack.transport.access_rules import common_name, name_clashes
from flightstack.transport.endpoints import check_endpoint
from gcs.errors import GroundError
from gcs.keys.authority import Pair, check_library, new_authority, sign
from mission.documents.yaml_file import parse, read_text

AUTHORITY: Final = "authority"
_FLEET_FILE: Final = "fleet.yaml"


class FleetNode(Section, frozen=True, kw_only=True):
    name: NodeName
    """As in its certificate: "drone-3", or a station's name."""
    host: Annotated[str, Meta(min_length=1)]
    """Address at which the others reach it."""


class Fleet(Section, frozen=True, kw_only=True):
    """Who belongs to a fleet; drones in the order in which they take the formation's slots."""

    swarm: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]+$")]
    drones: dict[DroneId, str]
    """Id: address at which the others reach it."""
    stations: dict[NodeName, str]
    port: Annotated[int, Meta(ge=1, le=65535)] = 7447

    def nodes(self) -> list[FleetNode]:
        """Everybody, in the order in which connections are made (`swarm.connect`)."""
        named = [*self.stations.items(), *((common_name(drone), host) for drone, host in self.drones.items())]
        return [FleetNode(name=name, host=host) for name, host in named]


def create(
    directory: pathlib.Path, fleet: Fleet, valid: datetime.timedelta, *, force: bool = False
) -> list[pathlib.Path]:
    """Make an authority and everybody's bundle; returns the bundles.

    Nothing is overwritten without `force`: a new authority makes every key and certificate before it worthless.
    """
    check_library()
    _check(fleet)
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
        return _write(directory, fleet, authority, fleet.nodes(), now, valid, fresh=True)


def add(
    directory: pathlib.Path, drones: dict[int, str], stations: dict[str, str], valid: datetime.timedelta
) -> tuple[list[pathlib.Path], list[pathlib.Path]]:
    """More nodes: (their bundles, the others' `swarm.yaml`, which name the new ones now)."""
    check_library()
    fleet = read(directory)
    for known in sorted({*drones} & {*fleet.drones}):
        raise GroundError(f"{directory}: drone {known} is in this fleet already; gcs fleet renew renews it")
    for name in sorted({*stations} & {*fleet.stations}):
        raise GroundError(f"{directory}: {name} is in this fleet already; gcs fleet renew renews it")
    before = {node.name for node in fleet.nodes()}
    fleet = msgspec.structs.replace(fleet, drones=fleet.drones | drones, stations=fleet.stations | stations)
    _check(fleet)
    new = [node for node in fleet.nodes() if node.name not in before]
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
    return made, [directory / node.name / "swarm.yaml" for node in fleet.nodes() if node.name in before]


def renew(directory: pathlib.Path, names: Iterable[str], valid: datetime.timedelta) -> list[pathlib.Path]:
    """New certificates for the same keys; of everybody if no `names` are given. Returns the certificates."""
    check_library()
    fleet = read(directory)
    wanted = list(names) or [node.name for node in fleet.nodes()]
    nodes = {node.name: node for node in fleet.nodes()}
    for name in wanted:
        if name not in nodes:
            raise GroundError(f"{directory}: {name} is not in this fleet, which has {', '.join(nodes)}")
    now = datetime.datetime.now(datetime.UTC)
    with _told(directory):
        _write(
            directory, fleet, _authority(directory), [nodes[name] for name in wanted], now, valid, fresh=False
        )
    return [directory / name / f"{name}.pem" for name in wanted]


def read(directory: pathlib.Path) -> Fleet:
    """The fleet of a directory; `DocumentError` or `GroundError` where it is none."""
    file = directory / _FLEET_FILE
    if not file.is_file():
        raise GroundError(
            f"{directory} is no fleet's directory (it has no {_FLEET_FILE}); gcs fleet init makes one"
        )
    return parse(read_text(file), Fleet, str(file))


def swarm_section(fleet: Fleet, node: FleetNode) -> str:
    """The `swarm` section of a node's configuration file, YAML."""
    endpoints = {other.name: _endpoint(other.host, fleet.port) for other in fleet.nodes()}
    section = {
        "name": fleet.swarm,
        "members": list(fleet.drones),
        "listen": [endpoints[node.name]],
        "connect": list(endpoints.values()),
        "tls": {
            "authority": f"{AUTHORITY}.pem",
            "certificate": f"{node.name}.pem",
            "private_key": f"{node.name}.key",
            "stations": list(fleet.stations),
        },
    }
    return yaml.safe_dump({"swarm": section}, sort_keys=False, default_flow_style=None, width=110)


def _check(fleet: Fleet) -> None:
    for problem in name_clashes(list(fleet.stations), [AUTHORITY]):
        raise GroundError(f"stations: {problem}")
    if not fleet.drones:
        raise GroundError("a fleet has at least one drone")
    hosts: dict[str, str] = {}
    for node in fleet.nodes():
        other = hosts.setdefault(node.host, node.name)
        if other != node.name:
            raise GroundError(f"{other} and {node.name} have the same address {node.host}; give each its own")
        try:
            check_endpoint("connect", f"tcp/{_bracketed(node.host)}:{fleet.port}", None)
        except TransportError as error:
            raise GroundError(f"{node.name}: {node.host!r} is no address of a host") from error


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host


def _endpoint(host: str, port: int) -> str:
    return f"tls/{_bracketed(host)}:{port}"


def _authority(directory: pathlib.Path) -> Pair:
    kept = directory / AUTHORITY
    return Pair((kept / f"{AUTHORITY}.pem").read_bytes(), (kept / f"{AUTHORITY}.key").read_bytes())


def _write(
    directory: pathlib.Path,
    fleet: Fleet,
    authority: Pair,
    nodes: Iterable[FleetNode],
    now: datetime.datetime,
    valid: datetime.timedelta,
    *,
    fresh: bool,
) -> list[pathlib.Path]:
    """Sign for `nodes`, with new keys if `fresh`, and tell everybody who belongs to the fleet."""
    made = []
    for node in nodes:
        bundle = directory / node.name
        key = None if fresh else (bundle / f"{node.name}.key").read_bytes()
        _keep(bundle, node.name, sign(authority, node.name, now, valid, key))
        _replace(bundle / f"{AUTHORITY}.pem", authority.certificate)
        made.append(bundle)
    for node in fleet.nodes():
        _replace(directory / node.name / "swarm.yaml", swarm_section(fleet, node).encode())
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
