"""The command `gcs`: the ground station and its operator's commands, put together."""

from __future__ import annotations

import typer

from flightstack.command_line import run_program, versioned
from gcs.cli import fence, fleet, param, plan, router, serve, signing, status, survey
from gcs.errors import GroundError
from mission.documents.yaml_file import DocumentError

app = typer.Typer(
    help="The ground station: watch the swarm, command it, prepare its vehicles.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
app.callback()(versioned)
for command in (serve.serve, router.router, survey.survey, status.status, status.watch):
    app.command()(command)
for name, nouns in (
    ("plan", plan.app),
    ("fence", fence.app),
    ("param", param.app),
    ("fleet", fleet.app),
    ("signing", signing.app),
):
    app.add_typer(nouns, name=name)


def main() -> None:
    """Entry point: what a user can get wrong ends in one line and exit code 2, what a vehicle refuses in 1."""
    run_program("gcs", app, _exit_code_of)


def _exit_code_of(error: Exception) -> int | None:
    from flightstack.errors import FlightstackError
    from flightstack.transport import TransportError
    from gcs.plans.vehicle_link import VehicleError

    if isinstance(error, VehicleError):
        return 1
    known = (DocumentError, GroundError, FlightstackError, TransportError)
    return 2 if isinstance(error, known) else None


if __name__ == "__main__":
    main()
