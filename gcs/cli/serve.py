"""`gcs serve`."""

from __future__ import annotations

import pathlib
from typing import Annotated

import typer


def serve(
    config: Annotated[pathlib.Path, typer.Option("--config", help="The ground station's YAML file.")],
) -> None:
    """Run the ground station until a signal: watch, record, bring orphans home."""
    from flightstack.process_log import log_to_stderr
    from gcs.serve import serve as run_station
    from gcs.station_config import load

    log_to_stderr()
    raise typer.Exit(run_station(load(config), config))
