"""What the three commands share at their edge: their version, numbers, and an output that may be broken.

A pipe that was closed, a full disk and an output that was never open end a command in one line and exit code 1, and
whatever it does is undone on the way as by any other error. An error output that is broken stops nothing: a flight
does not end because nobody can be told of it.
"""

from __future__ import annotations

import contextlib
import importlib.metadata
import io
import math
import os
import sys
from collections.abc import Callable
from typing import Annotated, Any, NoReturn

import typer

from mission.documents.printable import printable


class BrokenOutputError(Exception):
    """What was to be printed cannot be; not an OSError, which others take for their own."""


class _Output(io.RawIOBase):
    """A descriptor of our own process. `report`: errors are told, otherwise what cannot be written is dropped."""

    def __init__(self, descriptor: int, problem: str, *, report: bool) -> None:
        self._descriptor = descriptor
        self._problem = problem
        """Why nothing can be written; empty where it can."""
        self._report = report

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._descriptor

    def isatty(self) -> bool:
        return not self._problem and os.isatty(self._descriptor)

    def write(self, data: Any, /) -> int | None:
        if not self._problem:
            try:
                return os.write(self._descriptor, data)
            except BlockingIOError:
                return None  # the buffer tells
            except OSError as error:
                self._problem = error.strerror or str(error)
        if self._report:
            raise BrokenOutputError(f"standard output cannot be written: {self._problem}")
        return len(data)

    def drop(self) -> None:
        """From now on nothing is told of what cannot be written."""
        self._report = False


def run_program(name: str, app: typer.Typer, exit_code_of: Callable[[Exception], int | None]) -> NoReturn:
    """Run the command line and end the process with its exit code.

    `exit_code_of` says with which code an error ends that a person can cause, in one line; None: it is a defect, and
    shows where it is.
    """
    sys.stdout = _opened(sys.stdout, 1, report=True)
    sys.stderr = _opened(sys.stderr, 2, report=False)
    code: int | str | None
    try:
        try:
            command = typer.main.get_command(app)
            _expect_numbers(command)
            command()
            code = 0
        except SystemExit as ended:
            code = ended.code
        sys.stdout.flush()
    except BrokenOutputError as error:
        code = 1
        typer.echo(printable(f"{name}: {error}"), err=True)
    except Exception as error:
        told = exit_code_of(error)
        if told is None:
            raise
        code = told
        typer.echo(printable(f"{name}: {error}"), err=True)
        with contextlib.suppress(BrokenOutputError):
            sys.stdout.flush()
    finally:
        _let_go()
    raise SystemExit(code)


def _opened(stream: Any, descriptor: int, *, report: bool) -> io.TextIOWrapper:
    """The process's output in the place of Python's own, which may be None."""
    problem = ""
    if stream is None:
        problem = "it is closed"
        # Whatever is opened next would get its number, and what C code prints would go there.
        with contextlib.suppress(OSError):
            while os.open(os.devnull, os.O_WRONLY) < descriptor:
                pass
    else:
        stream.flush()
    raw = _Output(descriptor, problem, report=report)
    return io.TextIOWrapper(
        io.BufferedWriter(raw),
        encoding=getattr(stream, "encoding", "utf-8"),
        errors=getattr(stream, "errors", "backslashreplace"),
        line_buffering=not report or raw.isatty(),
    )


def _let_go() -> None:
    """What is still in the buffer of an output that is broken must not be tried again at the interpreter's end."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except BrokenOutputError:
            raw = getattr(getattr(stream, "buffer", None), "raw", None)
            if isinstance(raw, _Output):
                raw.drop()


def _expect_numbers(command: Any) -> None:
    """Numbers of the command line are numbers: "nan" passes every limit, and nothing can be done with "inf"."""
    for parameter in command.params:
        if "float" in getattr(parameter.type, "name", ""):
            parameter.type = _finite(parameter.type)
    for each in getattr(command, "commands", {}).values():
        _expect_numbers(each)


def _finite(kind: Any) -> Any:
    """The same type of option without infinities and NaN."""

    class Finite(type(kind)):  # type: ignore[misc]  # a range or a plain float, of the click that typer brings
        def convert(self, value: Any, param: Any, ctx: Any) -> Any:
            number = super().convert(value, param, ctx)
            if isinstance(number, float) and not math.isfinite(number):
                self.fail(f"{value!r} is no number to work with.", param, ctx)
            return number

    made = Finite.__new__(Finite)
    made.__dict__.update(kind.__dict__)
    return made


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"flightstack {importlib.metadata.version('flightstack')}")
        raise typer.Exit


def versioned(
    version: Annotated[
        bool,
        typer.Option("--version", help="Print the version and exit.", callback=_show_version, is_eager=True),
    ] = False,
) -> None:
    """What stands before a command's verb: `app.callback()(versioned)`."""
