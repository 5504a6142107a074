"""The command `simvehicle`: simulated vehicles, whole simulated surveys, trials and experiments, put together."""

from __future__ import annotations

import typer

from flightstack.command_line import run_program, versioned
from simvehicle.cli import experiment, fly, run, scenario, trial

app = typer.Typer(
    help="The simulated world: vehicles with their autopilots and instruments, surveys, trials.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
app.callback()(versioned)
for command in (run.run, fly.fly, experiment.experiment, trial.trial):
    app.command()(command)
app.add_typer(scenario.app, name="scenario")


def main() -> None:
    """Entry point: what a person can mend is one line and exit code 2."""
    run_program("simvehicle", app, _exit_code_of)


def _exit_code_of(error: Exception) -> int | None:
    from mission.documents.yaml_file import DocumentError

    return 2 if isinstance(error, DocumentError) else None


if __name__ == "__main__":
    main()
