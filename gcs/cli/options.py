"""Options that several commands have."""

from __future__ import annotations

import enum
import pathlib
from collections.abc import Sequence
from typing import Annotated

import typer

from gcs.errors import GroundError

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


def mavlink_links(config: pathlib.Path | None, link: Sequence[str] | None) -> tuple[tuple[str, ...], int]:
    """MAVLink links and our system id, from `--link` or else from the ground station's file."""
    from gcs.station_config import MavlinkConfig, load

    mavlink = load(config).mavlink if config is not None else MavlinkConfig()
    links = tuple(link or ()) or mavlink.links
    if not links:
        raise GroundError("which link? give --link udpin:HOST:PORT, or --config with mavlink.links")
    return links, mavlink.system
