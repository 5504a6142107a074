"""Options that several commands have."""

from __future__ import annotations

import enum
import pathlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer

from gcs.errors import GroundError

if TYPE_CHECKING:
    from gcs.connection import Connection
    from gcs.station_config import MavlinkConfig

ConfigOption = Annotated[
    pathlib.Path | None, typer.Option("--config", help="The ground station's YAML file.")
]
SwarmOption = Annotated[str | None, typer.Option("--swarm", help="Name of the swarm, without a --config.")]
ConnectOption = Annotated[
    list[str] | None,
    typer.Option("--connect", help="Endpoint of a node of the swarm: tcp/HOST:PORT. Repeatable."),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one line of JSON instead of text.")]
DroneOption = Annotated[
    int, typer.Option("--drone", min=1, max=250, help="The vehicle's number (its system id).")
]
LinkOption = Annotated[
    list[str] | None,
    typer.Option("--link", help="MAVLink link as udpin:HOST:PORT, tcp:HOST:PORT, PATH,BAUD. Repeatable."),
]


class FenceActionName(enum.StrEnum):
    RTL = "rtl"
    LAND = "land"
    HOLD = "hold"
    REPORT = "report"


def swarm_connection(
    config: pathlib.Path | None, swarm: str | None, connect: Sequence[str] | None
) -> Connection:
    """How to join the swarm, by --config, or by --swarm and --connect; says which hosts of a file do not exist."""
    from gcs.connection import from_options

    connection = from_options(config, swarm, connect or ())
    for problem in connection.unresolved:
        typer.echo(f"gcs: warning: {problem}", err=True)
    return connection


def mavlink_access(config: pathlib.Path | None, link: Sequence[str] | None) -> MavlinkConfig:
    """How to speak to vehicles: by the ground station's file, with the links of `--link` if they are given."""
    from gcs.station_config import MavlinkConfig, load

    mavlink = load(config).mavlink if config is not None else MavlinkConfig()
    links = tuple(link or ()) or mavlink.links
    if not links:
        raise GroundError("which link? give --link udpin:HOST:PORT, or --config with mavlink.links")
    return msgspec.structs.replace(mavlink, links=links)
