"""What commands print and write."""

from __future__ import annotations

import pathlib
from collections.abc import Sequence
from typing import Any

import typer

from gcs.errors import GroundError
from mission.documents.printable import printable


def say(facts: dict[str, Any], text: str, *, json: bool) -> None:
    """The facts as one line of JSON, or the text for a person."""
    from gcs.fleet.observe import to_json

    typer.echo(to_json(facts) if json else text)


def tell(file: pathlib.Path, errors: Sequence[str], warnings: Sequence[str]) -> None:
    """What was found in a file, on the error output."""
    for error in errors:
        typer.echo(printable(f"{file}: {error}"), err=True)
    for warning in warnings:
        typer.echo(printable(f"{file}: warning: {warning}"), err=True)


def settings(parameters: dict[str, float]) -> str:
    """Parameters in a sentence."""
    return ", ".join(f"{name} {value:g}" for name, value in parameters.items())


def check_directory(file: pathlib.Path) -> None:
    """Before a long download: that there is somewhere to put it."""
    if not file.parent.is_dir():
        raise GroundError(f"{file}: cannot be written: there is no directory {file.parent}")


def write(file: pathlib.Path, text: str) -> None:
    """Write a file; `GroundError` names it where that cannot be."""
    try:
        file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise GroundError(f"{file}: cannot be written: {error.strerror}") from error
