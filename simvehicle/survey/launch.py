"""From a survey to running processes: ports are reserved, files written, programs started."""

from __future__ import annotations

import contextlib
import datetime
import pathlib
import socket
import sys
from collections.abc import Callable

import msgspec

from flightstack.recording.shared_clock import ClockCells
from flightstack.transport.access_rules import common_name
from flightstack.transport.node_places import NodePlaces
from flightstack.transport.shared_radio import SharedRadio
from gcs.keys.authority import new_authority
from gcs.keys.bundles import write_keys
from mission.documents.yaml_file import DocumentError
from mission.documents.yaml_values import text_of
from mission.geometry.frames import Vector3
from simvehicle.survey.draft import (
    GROUND,
    STATIONS,
    VEHICLES,
    Draft,
    agent_name,
    clock_file,
    draft,
    numbered,
    places_file,
    ports_needed,
    radio_file,
    truth_file,
)
from simvehicle.survey.ports import LOOPBACK, free_ports
from simvehicle.survey.processes import Processes
from simvehicle.survey.survey_file import GROUND_STATION, Survey

KEYS_VALID = datetime.timedelta(days=30)
"""Longer than any survey takes, and than agents warn that their certificates end."""


class Prepared(msgspec.Struct, frozen=True):
    """A survey whose files are written; nothing is started yet."""

    directory: pathlib.Path
    draft: Draft

    @property
    def truth(self) -> pathlib.Path:
        return truth_file(self.directory)

    @property
    def places(self) -> pathlib.Path:
        return places_file(self.directory)

    @property
    def clock(self) -> pathlib.Path:
        return clock_file(self.directory)

    def slot(self, process: str) -> int | None:
        """The place of a process among the followers of the clock; None for one that does not follow."""
        followers = self.draft.followers
        return followers.index(process) + 1 if process in followers else None


def make_directory(out: pathlib.Path, name: str, now: datetime.datetime) -> pathlib.Path:
    """`out`/NAME-YYYYmmdd-HHMMSS, made anew."""
    stem = f"{name}-{now:%Y%m%d-%H%M%S}"
    try:
        out.mkdir(parents=True, exist_ok=True)
        for suffix in ("", *(f"-{i}" for i in range(2, 100))):
            directory = out / f"{stem}{suffix}"
            with contextlib.suppress(FileExistsError):
                directory.mkdir()
                return directory.resolve()
    except OSError as error:
        raise DocumentError(
            str(out), f"cannot be written: {error.strerror or error}; choose another --out"
        ) from error
    raise DocumentError(str(out), f"{stem} exists a hundred times; choose another --out")


def prepare(survey: Survey, directory: pathlib.Path, *, tls: bool = False) -> Prepared:
    """Reserve ports, write every part's file into `directory`, make the clock, and with `tls` everybody's keys."""
    keys = directory / "keys" if tls else None
    if keys is not None:
        _make_keys(survey, keys)
    tcp, udp = ports_needed(survey)
    addresses = numbered(
        survey,
        LOOPBACK,
        free_ports(socket.SOCK_STREAM, tcp),
        free_ports(socket.SOCK_DGRAM, udp),
        directory,
        keys,
    )
    prepared = Prepared(directory, draft(survey, addresses))
    write_files(prepared.draft, directory)
    ClockCells.make(prepared.clock, len(prepared.draft.followers)).close()
    radio = prepared.draft.radio
    if radio is not None:
        _write(radio_file(directory), radio)
        _make_places(radio, survey.config.ground_ned_m)
    return prepared


def _make_keys(survey: Survey, directory: pathlib.Path) -> None:
    """A fleet's keys and certificates as `gcs fleet init` makes them, but for one computer and one survey.

    The authority's own key is not kept: nobody else becomes a member.
    """
    now = datetime.datetime.now(datetime.UTC)
    authority = new_authority(survey.config.name, now)
    for name in (*STATIONS, *(common_name(drone.id) for drone in survey.drones)):
        write_keys(directory / name, authority, name, now, KEYS_VALID)


def _make_places(radio: SharedRadio, ground_ned_m: Vector3 | None) -> None:
    """The vehicles' process tells where they are; the ground station stays where it is."""
    if radio.places is None:
        return
    places = NodePlaces.make(pathlib.Path(radio.places), len(radio.placed))
    if ground_ned_m is not None:
        places.tell(radio.placed.index(GROUND_STATION), ground_ned_m)
    places.close()


def write_files(drafted: Draft, directory: pathlib.Path) -> None:
    """Write fleet.yaml, drone-N.yaml and ground.yaml."""
    _write(directory / "fleet.yaml", drafted.fleet)
    for one in drafted.drones:
        _write(directory / f"{agent_name(one.drone)}.yaml", one)
    _write(directory / "ground.yaml", drafted.ground)


Commands = Callable[[str, pathlib.Path], list[str]]
"""The command line of a part ("vehicles", "ground", "agent") with its configuration file."""


def installed(part: str, config: pathlib.Path) -> list[str]:
    """The real programs, run by the interpreter that runs us."""
    module, *verb = {
        "vehicles": ("simvehicle.cli.main", "run"),
        "ground": ("gcs.cli.main", "serve"),
        "agent": ("flightstack.cli", "run"),
    }[part]
    return [sys.executable, "-m", module, *verb, "--config", str(config)]


def start(prepared: Prepared, processes: Processes, commands: Commands = installed) -> None:
    """Start the vehicles, the ground station and one agent a drone. They may come up in any order."""
    directory = prepared.directory
    processes.start(VEHICLES, commands("vehicles", directory / "fleet.yaml"))
    processes.start(GROUND, commands("ground", directory / "ground.yaml"))
    for drone in prepared.draft.drones:
        name = agent_name(drone.drone)
        processes.start(name, commands("agent", directory / f"{name}.yaml"))


def _write(path: pathlib.Path, content: object) -> None:
    text = text_of(msgspec.to_builtins(content))
    path.write_text(text, encoding="utf-8")
