"""The command `simvehicle`: simulated vehicles, whole simulated surveys, trials and experiments, put together."""

from __future__ import annotations

import typer

from simvehicle.cli import experiment, fly, run, trial

app = typer.Typer(
    help="The simulated world: vehicles with their autopilots and instruments, surveys, trials.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
for command in (run.run, fly.fly, experiment.experiment, trial.trial):
    app.command()(command)


def main() -> None:
    """Entry point: what a person can mend is one line and exit code 2."""
    from mission.documents.yaml_file import DocumentError

    try:
        app()
    except DocumentError as error:
        typer.echo(f"simvehicle: {error}", err=True)
        raise SystemExit(2) from None


if __name__ == "__main__":
    main()
