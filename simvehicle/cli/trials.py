"""The commands `simvehicle experiment` and `simvehicle trial`."""

from __future__ import annotations

import contextlib
import pathlib
import sys
from collections.abc import Iterator, Sequence
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from simvehicle.trials.cell import Cell

_DEFAULT_TRIALS = pathlib.Path("out") / "trials"


class RowsName(StrEnum):
    PARQUET = "parquet"
    CSV = "csv"


class FilmName(StrEnum):
    GIF = "gif"
    MP4 = "mp4"


def register(app: typer.Typer) -> None:
    """Add `experiment` and `trial` to the command line; what they need is imported when they are used."""
    app.command(name="experiment")(_experiment)
    app.command(name="trial")(_trial)


_STRATEGY_HELP = "Ours, or a reactive one of an installed package; an unknown name lists them all."
Motion = Annotated[
    str, typer.Option(help="pd: the paper authors' controller; cruise: a real drone's limits.")
]
Arena = Annotated[float, typer.Option(help="Arena radius, m (the authors ran 100, 178, 282 and 398).")]
Speed = Annotated[float, typer.Option(help="Of cruise, m/s.")]
Acceleration = Annotated[float, typer.Option(help="Of cruise, m/s2.")]
RMin = Annotated[float, typer.Option(help="Least distance of two drones, m.")]
RMax = Annotated[float, typer.Option(help="Distance between levels of the formation, m.")]
Layout = Annotated[str, typer.Option(help="rings (the paper's) or hexagonal.")]
_MOST = 2**63 - 1
"""The kernels count in 64 bits."""
Seed = Annotated[
    int, typer.Option(min=0, max=_MOST, help="The same seed gives the same trials for every strategy.")
]


def _experiment(
    name: Annotated[str, typer.Argument(help="locus-1, locus-2, locus-3 or locus-4.")],
    sizes: Annotated[str, typer.Option(help="Swarm sizes: 5,10,20.")] = "",
    rates: Annotated[str, typer.Option(help="Failure rates of locus-3 and locus-4: 1e-5,1e-4.")] = "",
    strategies: Annotated[str, typer.Option(help="Commas between. " + _STRATEGY_HELP)] = "locus,mobs",
    plumes: Annotated[
        str, typer.Option(help="Of smooth, perturbed, gaussian, gusty; instead of the experiment's.")
    ] = "",
    trials: Annotated[int | None, typer.Option(help="Trials a cell (100; 20 with --quick).")] = None,
    motion: Motion = "pd",
    arena: Arena = 100.0,
    speed: Speed = 5.0,
    acceleration: Acceleration = 2.0,
    r_min: RMin = 3.0,
    r_max: RMax = 3.0,
    layout: Layout = "rings",
    seed: Seed = 1,
    quick: Annotated[bool, typer.Option("--quick", help="A coarse look: fewer trials and rates.")] = False,
    full: Annotated[bool, typer.Option("--full", help="All sizes 2..20, or 46 failure rates.")] = False,
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Processes; default: by the amount of work.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="A dask scheduler to spread the trials over: tcp://HOST:8786.")
    ] = None,
    out: Annotated[
        pathlib.Path | None, typer.Option(help="Directory of rows, table, figure and verdicts.")
    ] = None,
    rows: Annotated[RowsName, typer.Option(help="Kind of the file with one row a trial.")] = RowsName.PARQUET,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON row a cell on standard output.")] = False,
) -> None:
    """Run one of the LoCUS paper's experiments, and say which of its claims hold.

    A run that was stopped goes on where it was when the same command is given again.
    """
    with _one_line():
        import json

        from simvehicle.experiments.locus.definitions import Options, define
        from simvehicle.experiments.locus.verdicts import Verdict
        from simvehicle.experiments.run import run_experiment, write_report
        from simvehicle.trials.cell import Cell

        base = Cell(
            motion=motion,  # type: ignore[arg-type]  # checked by Cell.problems
            arena_m=arena,
            speed_mps=speed,
            acceleration_mps2=acceleration,
            r_min_m=r_min,
            r_max_m=r_max,
            layout=layout,  # type: ignore[arg-type]
        )
        options = Options(
            sizes=_numbers(sizes, int, "--sizes"),
            rates=_numbers(rates, float, "--rates"),
            strategies=_words(strategies),
            plumes=_words(plumes),
            quick=quick,
            full=full,
            trials=trials,
            base=base,
        )
        # Wrong options are told before anything is compiled.
        _tell_compiling(define(name, options).cells)
        with _progress(name) as progress:
            report = run_experiment(
                name, options, seed=seed, out=out, jobs=jobs, scheduler=scheduler, progress=progress
            )
        page = write_report(report, _command(), rows.value)
        if as_json:
            for summary in report.summaries:
                typer.echo(json.dumps(summary))
        else:
            _show(report.summaries, report.verdicts)
        decided: list[Verdict] = [one for one in report.verdicts if one.verdict == "holds"]
        typer.echo(f"{len(decided)} of {len(report.verdicts)} claims hold; {page}", err=True)


def _trial(
    strategy: Annotated[str, typer.Option(help=_STRATEGY_HELP)] = "locus",
    drones: Annotated[int, typer.Option(help="Swarm size.")] = 16,
    plume: Annotated[str, typer.Option(help="smooth, perturbed, gaussian or gusty.")] = "perturbed",
    plume_at: Annotated[
        str, typer.Option(help="Origin of the plume: NORTH,EAST in m; default: by the seed.")
    ] = "",
    failure: Annotated[str, typer.Option(help="none, generic or in-plume.")] = "none",
    rate: Annotated[float, typer.Option(help="Failure probability a drone and tick.")] = 0.0,
    healing: Annotated[bool, typer.Option(help="Whether LoCUS heals.")] = True,
    motion: Motion = "pd",
    arena: Arena = 100.0,
    speed: Speed = 5.0,
    acceleration: Acceleration = 2.0,
    r_min: RMin = 3.0,
    r_max: RMax = 3.0,
    layout: Layout = "rings",
    seed: Seed = 1,
    trial: Annotated[int, typer.Option(min=0, max=_MOST, help="Which of the seed's trials.")] = 0,
    plot: Annotated[
        bool, typer.Option("--plot", help="Draw tracks, contact and heals over the plume.")
    ] = False,
    animate: Annotated[bool, typer.Option("--animate", help="Make a film of it.")] = False,
    film: Annotated[FilmName, typer.Option(help="Kind of the film; mp4 needs ffmpeg.")] = FilmName.GIF,
    out: Annotated[pathlib.Path, typer.Option(help="Directory of picture and film.")] = _DEFAULT_TRIALS,
    as_json: Annotated[bool, typer.Option("--json", help="The trial's row as one JSON line.")] = False,
) -> None:
    """Fly one trial, and show it."""
    with _one_line():
        import json

        from simvehicle.trials.cell import Cell
        from simvehicle.trials.trials_error import TrialsError

        place = _numbers(plume_at, float, "--plume-at")
        if len(place) not in (0, 2):
            raise TrialsError(f"--plume-at {plume_at!r}: give NORTH,EAST in metres")
        cell = Cell(
            strategy=strategy,
            drones=drones,
            plume=plume,  # type: ignore[arg-type]  # checked by Cell.problems
            source=(place[0], place[1]) if place else None,
            failure=failure,  # type: ignore[arg-type]
            failure_rate=rate,
            healing=healing,
            motion=motion,  # type: ignore[arg-type]
            arena_m=arena,
            speed_mps=speed,
            acceleration_mps2=acceleration,
            r_min_m=r_min,
            r_max_m=r_max,
            layout=layout,  # type: ignore[arg-type]
        )
        problems = cell.problems()
        if problems:
            raise TrialsError(problems[0])
        _tell_compiling((cell,))
        from simvehicle.trials.outcome import record_trial

        recorded = record_trial(cell, seed, trial)
        files = _draw(recorded, cell, out, plot=plot, film=film.value if animate else None)
        if as_json:
            row = {key: None if value != value else _plain(value) for key, value in recorded.row.items()}
            typer.echo(json.dumps({**row, "files": [str(path) for path in files]}))
            return
        from simvehicle.experiments.picture import outcome_words

        typer.echo(f"{cell.label()}: {outcome_words(recorded)}")
        for path in files:
            typer.echo(str(path))


def _draw(
    recorded: Any, cell: Cell, out: pathlib.Path, *, plot: bool, film: str | None
) -> list[pathlib.Path]:
    from simvehicle.experiments import picture
    from simvehicle.experiments.locus import figures
    from simvehicle.trials.trials_error import TrialsError

    if not plot and film is None:
        return []
    stem = f"{cell.strategy}-{cell.drones}-{cell.plume}-{recorded.row['seed']}-{recorded.row['trial']}"
    files = []
    try:
        out.mkdir(parents=True, exist_ok=True)
        if plot:
            files.append(out / f"{stem}.png")
            figures.save(picture.picture(recorded, cell), files[-1])
        if film is not None:
            files.append(out / f"{stem}.{film}")
            picture.film(recorded, cell, files[-1])
    except OSError as error:
        raise TrialsError(f"{out}: {error.strerror or error}") from error
    return files


def _plain(value: Any) -> Any:
    """A NumPy scalar as Python's own."""
    return value.item() if hasattr(value, "item") else value


def _words(text: str) -> tuple[Any, ...]:
    return tuple(word.strip() for word in text.split(",") if word.strip())


def _numbers(text: str, kind: type, option: str) -> tuple[Any, ...]:
    from simvehicle.trials.trials_error import TrialsError

    try:
        return tuple(kind(word) for word in _words(text))
    except ValueError:
        raise TrialsError(f"{option} {text!r}: give numbers with commas between") from None


def _command() -> str:
    """The command as it was given, for the page that shows its results."""
    return " ".join(["simvehicle", *sys.argv[1:]])


def _tell_compiling(cells: Sequence[Cell]) -> None:
    from simvehicle.compiled import needs_compiling
    from simvehicle.trials.outcome import kernel_of

    if any(needs_compiling(kernel_of(cell)) for cell in {cell.strategy: cell for cell in cells}.values()):
        typer.echo("compiling the trials for this machine (once a version, about half a minute) …", err=True)


@contextlib.contextmanager
def _progress(name: str) -> Iterator[Any]:
    """A bar on the terminal's error output; nothing where nobody looks."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn(name),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("trials"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(name)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def _show(summaries: list[dict[str, Any]], verdicts: list[Any]) -> None:
    """Table and verdicts for a person."""
    from rich.console import Console
    from rich.table import Table

    from simvehicle.experiments.table import percent

    by_rate = any("failure_rate" in one for one in summaries)
    table = Table(title="times in minutes, mean ± standard deviation")
    for column in ("strategy", "drones", "plume", *(("healing", "rate") if by_rate else ())):
        table.add_column(column)
    for column in ("success", "contact", "max flux", "median", "longest"):
        table.add_column(column, justify="right")

    def minutes(one: dict[str, Any], *names: str) -> str:
        values = [one[name] for name in names]
        return " ± ".join("-" if value is None else f"{value / 60.0:.1f}" for value in values)

    for one in summaries:
        row = [one["strategy"], str(one["drones"]), one["plume"]]
        row += ["on" if one["healing"] else "off", f"{one['failure_rate']:.0e}"] if by_rate else []
        row += [percent(one, "success_rate"), minutes(one, "contact_s_mean", "contact_s_sd")]
        row += [minutes(one, "source_s_mean", "source_s_sd"), minutes(one, "source_s_median")]
        table.add_row(*row, minutes(one, "source_s_max"))
    console = Console()
    console.print(table)
    for one in verdicts:
        console.print(f"{one.verdict.upper()}: {one.claim}\n    {one.statistic}", highlight=False)


@contextlib.contextmanager
def _one_line() -> Iterator[None]:
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
