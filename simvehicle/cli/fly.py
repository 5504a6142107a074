"""The command `simvehicle fly`."""

from __future__ import annotations

import pathlib
from typing import Annotated

import typer


def fly(
    survey: Annotated[
        pathlib.Path, typer.Argument(help="The survey's YAML file, such as examples/survey.yaml.")
    ],
    as_json: Annotated[
        bool, typer.Option("--json", help="End standard output with the summary as one JSON line.")
    ] = False,
    kill: Annotated[
        list[str] | None,
        typer.Option(
            help="DRONE@SECONDS: kill -9 of a drone's agent, simulated seconds after the first take-off."
        ),
    ] = None,
    freeze: Annotated[
        list[str] | None,
        typer.Option(help="DRONE@SECONDS: stop a drone's agent (SIGSTOP), until its --unfreeze or the end."),
    ] = None,
    unfreeze: Annotated[
        list[str] | None, typer.Option(help="DRONE@SECONDS: let a frozen agent go on (SIGCONT).")
    ] = None,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            help="INSTRUMENT-unplug:DRONE@SECONDS, or gps-loss, battery-low, motor, tumble or silence instead; "
            "with -SECONDS behind it mends itself."
        ),
    ] = None,
    drones: Annotated[
        int | None,
        typer.Option(min=1, max=250, help="How many stand on the launch line; instead of the file's."),
    ] = None,
    speedup: Annotated[
        float | None, typer.Option(min=0.1, max=20.0, help="Times real time; instead of the file's.")
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Of wind, noise and strategy; instead of the file's.")
    ] = None,
    radio_loss: Annotated[
        float | None,
        typer.Option(min=0.0, max=90.0, help="Per cent of the swarm's messages lost; instead of the file's."),
    ] = None,
    tls: Annotated[
        bool, typer.Option("--tls", help="Encrypt the swarm's messages, with keys made for this survey.")
    ] = False,
    out: Annotated[
        pathlib.Path, typer.Option(help="Where the survey's own directory is made.")
    ] = pathlib.Path("out"),
    report: Annotated[bool, typer.Option(help="Draw report.html at the end.")] = True,
) -> None:
    """Fly a whole simulated survey: vehicles, agents and ground station as processes on this machine.

    Ends when the source is found and everybody has landed at home. Exit code 0: source found; 1: anything else that
    happened in flight; 2: something is wrong with the file or the machine. Ctrl-C lands everybody first.
    """
    import msgspec

    from flightstack.transport import TransportError
    from gcs.errors import GroundError
    from mission.documents.yaml_file import DocumentError
    from simvehicle.survey import conduct
    from simvehicle.survey.agent_faults import parse_freezes, parse_kill
    from simvehicle.survey.fault_options import parse_fault
    from simvehicle.survey.survey_file import load

    try:
        faults = tuple(parse_fault(text) for text in fault or ())
        kills = tuple(parse_kill(text) for text in kill or ())
        freezes = parse_freezes(freeze or (), unfreeze or ())
        loaded = load(
            survey,
            speedup=speedup,
            seed=seed,
            drones=drones,
            radio_loss=None if radio_loss is None else radio_loss / 100.0,
            extra_faults=faults,
        )
        for warning in loaded.warnings:
            typer.echo(f"warning: {warning}", err=True)
        flown = conduct.fly(loaded, out=out, kills=kills, freezes=freezes, tls=tls)
    except (DocumentError, TransportError, GroundError) as error:
        typer.echo(f"simvehicle: {error}", err=True)
        raise typer.Exit(2) from error
    except KeyboardInterrupt:
        typer.echo("simvehicle: ended at once; nothing was written about the flight", err=True)
        raise typer.Exit(1) from None
    if report:
        typer.echo(f"report: {conduct.write_report(loaded, flown)}", err=True)
    if as_json:
        typer.echo(msgspec.json.encode(flown.summary).decode())
    else:
        typer.echo(conduct.words(flown.summary))
    if flown.bad_input:
        raise typer.Exit(2)
    raise typer.Exit(0 if flown.summary.outcome == "source_found" else 1)
