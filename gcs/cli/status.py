"""`gcs status` and `gcs watch`: the fleet as it is now, once or live."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from gcs.cli.options import ConfigOption, ConnectOption, JsonOption, SwarmOption, swarm_connection


def status(
    config: ConfigOption = None,
    swarm: SwarmOption = None,
    connect: ConnectOption = None,
    seconds: Annotated[float, typer.Option("--seconds", min=0.1, help="How long to listen.")] = 1.5,
    json: JsonOption = False,
) -> None:
    """Listen for a moment and report every drone; exit code 1 if nobody is heard."""
    from gcs.fleet.observe import listen, to_json

    observer, now_s = listen(swarm_connection(config, swarm, connect), seconds)
    if json:
        typer.echo(to_json(observer.snapshot(now_s)))
    else:
        from rich.console import Console

        from gcs.display.fleet_table import report

        # Piped into a file or a pager there is no width to keep to.
        console = Console() if sys.stdout.isatty() else Console(width=140)
        snapshot = observer.snapshot(now_s)
        console.print(
            report(snapshot.swarm, snapshot.drones, observer.alarms(now_s), snapshot.station, now_s)
        )
    if not observer.heard_anybody():
        typer.echo(f"gcs: no drone heard in {seconds:g} s", err=True)
        raise typer.Exit(1)


def watch(config: ConfigOption = None, swarm: SwarmOption = None, connect: ConnectOption = None) -> None:
    """Show the swarm live until Ctrl-C."""
    from gcs.display.watch import watch as show

    show(swarm_connection(config, swarm, connect))
