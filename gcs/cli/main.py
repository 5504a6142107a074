"""The command `gcs`: the ground station and its operator's commands, put together."""

from __future__ import annotations

import typer

from gcs.cli import fence, param, plan, serve, status, survey
from gcs.errors import GroundError
from mission.documents.printable import printable
from mission.documents.yaml_file import DocumentError

app = typer.Typer(
    help="The ground station: watch the swarm, command it, prepare its vehicles.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
for command in (serve.serve, survey.survey, status.status, status.watch):
    app.command()(command)
for name, nouns in (("plan", plan.app), ("fence", fence.app), ("param", param.app)):
    app.add_typer(nouns, name=name)


def main() -> None:
    """Entry point: what a user can get wrong ends in one line and exit code 2, what a vehicle refuses in 1."""
    from flightstack.errors import FlightstackError
    from flightstack.transport import TransportError

    try:
        app(standalone_mode=True)
    except (DocumentError, GroundError, FlightstackError, TransportError) as error:
        from gcs.plans.autopilot_client import VehicleError

        typer.echo(printable(f"gcs: {error}"), err=True)
        raise SystemExit(1 if isinstance(error, VehicleError) else 2) from error


if __name__ == "__main__":
    main()
