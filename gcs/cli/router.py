"""`gcs router`."""

from __future__ import annotations

import pathlib
from typing import Annotated

import typer


def router(
    config: Annotated[
        pathlib.Path, typer.Option("--config", help="The router's zenohd.json5, of gcs fleet init --router.")
    ],
) -> None:
    """Join a swarm's sites until a signal: zenoh's router, as zenohd would run it from the same file."""
    from flightstack.process_log import log_to_stderr
    from gcs.router import run_router

    log_to_stderr()
    raise typer.Exit(run_router(config))
