"""A fleet's directory: what its authority needs, and for each node a bundle that is copied to it.

    crater/fleet.yaml                     who belongs to it
    crater/authority/authority.{pem,key}  stays here: whoever has the key can make members
    crater/drone-3/authority.pem, drone-3.{pem,key}, swarm.yaml
    crater/ground/authority.pem, ground.{pem,key}, swarm.yaml
    crater/relay/authority.pem, relay.{pem,key}, zenohd.json5

`swarm.yaml` is the `swarm` section of the node's configuration file. Where a template was given, a whole
`drone.yaml` or `ground.yaml` stands beside it, and keeps what a person wrote into it. `zenohd.json5` is the router's
file, if one joins several sites.
"""

from __future__ import annotations

import contextlib
import datetime
import os
import pathlib
from collections.abc import Collection, Iterable, Iterator
from typing import Final, NamedTuple

import msgspec
import yaml

from gcs.errors import GroundError
from gcs.keys.authority import Pair, check_library, new_authority, sign
from gcs.keys.node_files import router_file, swarm_section
from gcs.keys.roster import AUTHORITY, ROUTER_FILE, FleetRoster, check_fleet
from gcs.keys.whole_files import NO_TEMPLATES, Templates, beside, whole_file
from mission.documents.yaml_file import parse, read_text

_FLEET_FILE: Final = "fleet.yaml"
_SECTION_FILE: Final = "swarm.yaml"


_SET_CLOCKS: Final = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)
"""Before this no fleet was made: a clock that says so is not set, and its certificates would have expired."""


class BundleChanges(NamedTuple):
    """What is to be copied to the nodes."""

    made: list[pathlib.Path]
    """Bundles that are new, with a new key each."""
    changed: list[pathlib.Path]
    """Files of the others."""


def create(
    directory: pathlib.Path,
    fleet: FleetRoster,
    valid: datetime.timedelta,
    templates: Templates = NO_TEMPLATES,
    *,
    force: bool = False,
) -> BundleChanges:
    """Make an authority and everybody's bundle, with whole configuration files where there are `templates`.

    Nothing is overwritten without `force`: a new authority makes every key and certificate before it worthless.
    """
    check_library()
    check_fleet(fleet)
    if directory.exists() and not directory.is_dir():
        raise GroundError(f"{directory} is no directory")
    former: list[str] = []
    if directory.is_dir() and any(directory.iterdir()):
        if not force:
            raise GroundError(
                f"{directory} is not empty; gcs fleet add and renew change a fleet, and --force makes a new one, "
                "whose nodes do not hear those of the old one any more"
            )
        former = read(directory).everybody()  # only a fleet's own directory is ever overwritten
    now = _now()
    authority = new_authority(fleet.swarm, now)
    with _told(directory):
        files = _configurations(directory, fleet, fleet.everybody(), templates)
        directory.mkdir(parents=True, exist_ok=True)
        # First, so that what is only half made, on a disk that is full, is a fleet's directory and can be made again.
        _write_roster(directory, fleet)
        for name in {*former} - {*fleet.everybody()}:
            _remove_keys(directory / name, name)
        _keep(directory / AUTHORITY, AUTHORITY, authority)
        return _write(directory, fleet, authority, fleet.everybody(), now, valid, files, fresh=True)


def add(
    directory: pathlib.Path,
    drones: dict[int, str],
    stations: dict[str, str],
    valid: datetime.timedelta,
    site: str | None = None,
    router: tuple[str, str] | None = None,
    templates: Templates = NO_TEMPLATES,
) -> BundleChanges:
    """More nodes, whom the others' files name then.

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
        files = _configurations(directory, fleet, new, templates)
        return _write(directory, fleet, _authority(directory), new, _now(), valid, files, fresh=True)


def renew(directory: pathlib.Path, names: Iterable[str], valid: datetime.timedelta) -> BundleChanges:
    """New certificates for the same keys; of everybody if no `names` are given."""
    check_library()
    fleet = read(directory)
    check_fleet(fleet)
    everybody = fleet.everybody()
    wanted = list(dict.fromkeys(names)) or everybody
    for name in wanted:
        if name not in everybody:
            raise GroundError(f"{directory}: {name} is not in this fleet, which has {', '.join(everybody)}")
    with _told(directory):
        files = _configurations(directory, fleet, (), NO_TEMPLATES)
        return _write(directory, fleet, _authority(directory), wanted, _now(), valid, files, fresh=False)


def read(directory: pathlib.Path) -> FleetRoster:
    """The fleet of a directory; `DocumentError` or `GroundError` where it is none."""
    file = directory / _FLEET_FILE
    if not file.is_file():
        raise GroundError(
            f"{directory} is no fleet's directory (it has no {_FLEET_FILE}); gcs fleet init makes one"
        )
    return parse(read_text(file), FleetRoster, str(file))


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


def _now() -> datetime.datetime:
    now = datetime.datetime.now(datetime.UTC)
    if now < _SET_CLOCKS:
        raise GroundError(f"this computer's clock says {now:%Y-%m-%d}; set it, certificates are valid by it")
    return now


def _write(
    directory: pathlib.Path,
    fleet: FleetRoster,
    authority: Pair,
    names: Iterable[str],
    now: datetime.datetime,
    valid: datetime.timedelta,
    files: dict[pathlib.Path, bytes],
    *,
    fresh: bool,
) -> BundleChanges:
    """Sign for `names`, with new keys if `fresh`, and tell everybody who belongs to the fleet with `files`."""
    made, changed = [], []
    for name in names:
        file = directory / name / f"{name}.key"
        # A router that was written into the fleet's file by hand has no key yet.
        new = fresh or (name == fleet.router and not file.exists())
        write_keys(file.parent, authority, name, now, valid, None if new else file.read_bytes())
        if new:
            made.append(file.parent)
        else:
            changed.append(file.parent / f"{name}.pem")
    for file, data in files.items():
        file.parent.mkdir(parents=True, exist_ok=True)
        same = file.exists() and file.read_bytes() == data
        if not same and file.parent not in made and not _is_in_whole_file(file, files):
            changed.append(file)
        _replace(file, data)
    _write_roster(directory, fleet)
    return BundleChanges(made, changed)


def _configurations(
    directory: pathlib.Path, fleet: FleetRoster, new: Collection[str], templates: Templates
) -> dict[pathlib.Path, bytes]:
    """What tells everybody how to join, by file; of those in `new` from `templates`.

    Made before anything is written: a template that cannot be used changes nothing.
    """
    files: dict[pathlib.Path, bytes] = {}
    for node in fleet.nodes():
        bundle, section = directory / node.name, swarm_section(fleet, node)
        station = node.name in fleet.stations
        whole = bundle / ("ground.yaml" if station else "drone.yaml")
        template = (templates.station if station else templates.drone) if node.name in new else None
        if template is None and whole.is_file():
            template = whole
        if template is not None:
            text = read_text(template)
            name = node.name if station else int(node.name.removeprefix("drone-"))
            key = "station" if station else "drone"
            files[whole] = whole_file(text, str(template), section, key, name).encode()
            if template != whole:
                for file in beside(text, str(template)):
                    files[bundle / file] = (template.parent / file).read_bytes()
        files[bundle / _SECTION_FILE] = section.encode()
    if fleet.router is not None:
        files[directory / fleet.router / ROUTER_FILE] = router_file(fleet, fleet.router).encode()
    return files


def _is_in_whole_file(file: pathlib.Path, files: dict[pathlib.Path, bytes]) -> bool:
    return file.name == _SECTION_FILE and any(
        file.with_name(whole) in files for whole in ("drone.yaml", "ground.yaml")
    )


def _write_roster(directory: pathlib.Path, fleet: FleetRoster) -> None:
    written = yaml.safe_dump(msgspec.to_builtins(fleet, str_keys=False), sort_keys=False)
    _replace(directory / _FLEET_FILE, written.encode())


def _remove_keys(bundle: pathlib.Path, name: str) -> None:
    """Of a node that is in no fleet any more: worthless, and not to be taken for another's. Other files stay."""
    for file in (f"{AUTHORITY}.pem", f"{name}.pem", f"{name}.key", _SECTION_FILE, ROUTER_FILE):
        (bundle / file).unlink(missing_ok=True)
    if bundle.is_dir() and not any(bundle.iterdir()):
        bundle.rmdir()


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
