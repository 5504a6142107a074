"""The command `simvehicle scenario`."""

from __future__ import annotations

import pathlib
from typing import Annotated

import typer

app = typer.Typer(help="Whole swarms in one process while things go wrong.", no_args_is_help=True)


@app.command()
def run(
    file: Annotated[pathlib.Path, typer.Argument(help="The scenario's YAML file.")],
    transcript: Annotated[
        pathlib.Path | None, typer.Option(help="Write what happened to this file, for review.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="The result as one JSON line.")] = False,
) -> None:
    """Fly a scenario in one process on simulated time and check the invariants in every tick.

    Exit code 0: all held; 1: one was violated; 2: something is wrong with the file.
    """
    import msgspec

    from mission.documents.yaml_file import DocumentError
    from simvehicle.scenario.agent_level import fly_scenario
    from simvehicle.scenario.scenario_file import load_scenario

    result = fly_scenario(load_scenario(file))
    text = "".join(f"{line}\n" for line in result.transcript)
    typer.echo(msgspec.json.encode(result).decode() if as_json else text, nl=as_json)
    if transcript is not None:
        try:
            transcript.write_text(text, encoding="utf-8")
        except OSError as error:
            problem = f"cannot be written: {error.strerror}; name another file"
            raise DocumentError(str(transcript), problem) from error
    raise typer.Exit(1 if result.violations else 0)
