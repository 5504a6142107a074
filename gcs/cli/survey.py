"""`gcs survey`: the operator's commands to the swarm."""

from __future__ import annotations

from typing import Annotated

import typer

from flightstack.swarm.wire import CommandName
from gcs.cli.options import ConfigOption, ConnectOption, JsonOption, SwarmOption, swarm_connection
from gcs.errors import GroundError


def survey(
    name: Annotated[CommandName, typer.Argument(help="What the swarm shall do.")],
    config: ConfigOption = None,
    swarm: SwarmOption = None,
    connect: ConnectOption = None,
    drone: Annotated[int, typer.Option("--drone", min=0, max=250, help="One drone; 0: all members.")] = 0,
    deadline_s: Annotated[
        float,
        typer.Option("--deadline", min=0.1, help="Seconds until a drone that has not answered is given up."),
    ] = 5.0,
    without_recording: Annotated[
        bool,
        typer.Option("--without-recording", help="Start also drones whose flights cannot be recorded."),
    ] = False,
    json: JsonOption = False,
) -> None:
    """Command the swarm and wait for every drone's answer; exit code 0 only if all accepted."""
    from gcs.commands.send import command_swarm
    from gcs.fleet.observe import to_json

    if without_recording and name is not CommandName.START:
        raise GroundError(f"--without-recording is for start, not for {name}")
    connection = swarm_connection(config, swarm, connect)
    done = command_swarm(connection, name, drone, deadline_s, without_recording=without_recording)
    if json:
        report = {"command": name, "identity": done.command.identity, "accepted": done.accepted()}
        typer.echo(to_json(report | {"drones": done.answers()}))
    else:
        for answer in done.answers():
            reason = f": {answer.reason}" if answer.reason else ""
            typer.echo(f"drone {answer.drone}: {answer.result}{reason}")
        if not done.answers():
            typer.echo("no drone is heard", err=True)
    raise typer.Exit(0 if done.accepted() else 1)
