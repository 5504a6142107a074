"""`gcs serve`."""

from __future__ import annotations

import logging
import pathlib
import sys
from typing import Annotated

import typer


def serve(
    config: Annotated[pathlib.Path, typer.Option("--config", help="The ground station's YAML file.")],
) -> None:
    """Run the ground station until a signal: watch, record, bring orphans home."""
    from gcs.serve import serve as run_station
    from gcs.station_config import load

    logging.basicConfig(
        stream=sys.stderr, level=logging.INFO, format="%(asctime)s %(levelname)-7s %(name)s: %(message)s"
    )
    raise typer.Exit(run_station(load(config), config))
