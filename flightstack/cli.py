"""The command `flightstack`: what runs on a drone's companion computer."""

from __future__ import annotations

import pathlib
from typing import Annotated

import typer

from flightstack.command_line import run_program, versioned
from mission.documents.yaml_file import DocumentError

app = typer.Typer(
    help="The agent on a drone's companion computer.", no_args_is_help=True, pretty_exceptions_enable=False
)

app.callback()(versioned)
ConfigOption = Annotated[pathlib.Path, typer.Option("--config", help="The drone's YAML file.")]


@app.command()
def run(config: ConfigOption) -> None:
    """Fly: connect to the autopilot, the instruments and the swarm, and wait for the ground's start."""
    from flightstack.config_file import load
    from flightstack.process_log import log_to_stderr
    from flightstack.runner import run as run_agent

    log_to_stderr()
    raise typer.Exit(run_agent(load(config), file=str(config)))


@app.command()
def check(config: ConfigOption) -> None:
    """Read a drone's file and say whether it can be flown, without opening anything."""
    from flightstack.agent import Agent
    from flightstack.config_file import load

    agent = Agent(load(config), incarnation=0)
    typer.echo(f"{config}: good: drone {agent.config.drone} of {len(agent.config.swarm.members)}")


@app.command()
def replay(
    recordings: Annotated[
        list[pathlib.Path], typer.Argument(help="Files drone-*.mcap that `flightstack run` wrote.")
    ],
) -> None:
    """Fly recorded flights again and compare every tick with the recorded one; exit code 1 if any differs."""
    from flightstack.recording.replay import replay as replay_flight

    differing = 0
    for recording in recordings:
        result = replay_flight(recording)
        differing += result.differing
        if result.differing:
            typer.echo(
                f"{recording}: {result.differing} of {result.ticks} ticks differ, "
                f"the first at {result.first_difference_s:.3f} s"
            )
        else:
            typer.echo(f"{recording}: {result.ticks} ticks, all outputs the same")
    if differing:
        raise typer.Exit(1)


def _mount_sensors() -> None:
    from flightstack.sensing.bench_cli import app as sensors_app

    app.add_typer(sensors_app, name="sensors")


_mount_sensors()


def main() -> None:
    """Entry point: what a user can get wrong ends in one line and exit code 2."""
    run_program("flightstack", app, _exit_code_of)


def _exit_code_of(error: Exception) -> int | None:
    from flightstack.errors import FlightstackError
    from flightstack.transport import TransportError
    from sensors.instruments.sensor_error import SensorError

    known = (DocumentError, FlightstackError, TransportError, SensorError)
    return 2 if isinstance(error, known) else None


if __name__ == "__main__":
    main()
