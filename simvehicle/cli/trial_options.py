"""What `simvehicle experiment` and `simvehicle trial` share: the cell's options, lists of words, errors."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Annotated, Any

import typer

STRATEGY_HELP = "Ours, or a reactive one of an installed package; an unknown name lists them all."

Motion = Annotated[
    str,
    typer.Option(
        help="paper: the LoCUS authors' controller as in their paper; pd: as their program has it now, a tenth as "
        "fast; cruise: a real drone's limits."
    ),
]
CutCells = Annotated[
    bool, typer.Option("--cut-cells", help="Readings are rounded as in the LoCUS authors' program.")
]
CutGoal = Annotated[
    bool,
    typer.Option("--cut-goal", help="The place that counts as the maximum is cut to whole metres, as there."),
]
Arena = Annotated[float, typer.Option(help="Arena radius, m (the authors ran 100, 178, 282 and 398).")]
Speed = Annotated[float, typer.Option(help="Of cruise, m/s.")]
Acceleration = Annotated[float, typer.Option(help="Of cruise, m/s2.")]
RMin = Annotated[float, typer.Option(help="Least distance of two drones, m.")]
RMax = Annotated[float, typer.Option(help="Distance between levels of the formation, m.")]
Layout = Annotated[str, typer.Option(help="rings (the paper's) or hexagonal.")]
MOST = 2**63 - 1
"""The kernels count in 64 bits."""
Seed = Annotated[
    int, typer.Option(min=0, max=MOST, help="The same seed gives the same trials for every strategy.")
]


def words(text: str) -> tuple[Any, ...]:
    """The words between commas: ("a", "b") of "a, b"."""
    return tuple(word.strip() for word in text.split(",") if word.strip())


def numbers(text: str, kind: type, option: str) -> tuple[Any, ...]:
    """The numbers between commas; `TrialsError` with the option's name for what is no number."""
    from simvehicle.trials.trials_error import TrialsError

    try:
        return tuple(kind(word) for word in words(text))
    except ValueError:
        raise TrialsError(f"{option} {text!r}: give numbers with commas between") from None


def tell_compiling(*kernels: Callable[..., Any]) -> None:
    """Say so before a first run, which is silent for long."""
    from simvehicle.compiled import needs_compiling

    if any(map(needs_compiling, kernels)):
        typer.echo("compiling the trials for this machine (once a version, about half a minute) …", err=True)


@contextlib.contextmanager
def one_line() -> Iterator[None]:
    """What a person can mend is one line and exit code 2; Ctrl-C says that nothing is lost."""
    try:
        yield
    except ValueError as error:
        from simvehicle.trials.trials_error import TrialsError

        if not isinstance(error, TrialsError):
            raise
        typer.echo(f"simvehicle: {error}", err=True)
        raise typer.Exit(2) from error
    except OSError as error:
        # Rows, pages and pictures have errors of their own; what is left is the compiler's directory.
        from simvehicle.compiled import cache_directory

        typer.echo(
            f"simvehicle: {error.strerror or error}; machine code is kept in {cache_directory()}: make room there, "
            "or set XDG_CACHE_HOME; finished trials are kept",
            err=True,
        )
        raise typer.Exit(2) from error
    except ImportError as error:
        typer.echo(
            f"simvehicle: {error.name} is not installed; trials need: pip install 'flightstack[sim]'",
            err=True,
        )
        raise typer.Exit(2) from error
    except KeyboardInterrupt:
        typer.echo("simvehicle: stopped; finished trials are kept, the same command goes on", err=True)
        raise typer.Exit(1) from None
