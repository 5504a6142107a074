"""The command `simvehicle trial`."""

from __future__ import annotations

import pathlib
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simvehicle.cli.trial_options import (
    MOST,
    STRATEGY_HELP,
    Acceleration,
    Arena,
    CutCells,
    CutGoal,
    Layout,
    Motion,
    RMax,
    RMin,
    Seed,
    Speed,
    numbers,
    one_line,
    tell_compiling,
)

if TYPE_CHECKING:
    from simvehicle.trials.cell import Cell

_DEFAULT_OUT = pathlib.Path("out") / "trials"


class FilmName(StrEnum):
    GIF = "gif"
    MP4 = "mp4"


def trial(
    strategy: Annotated[str, typer.Option(help=STRATEGY_HELP)] = "locus",
    drones: Annotated[int, typer.Option(help="Swarm size.")] = 16,
    plume: Annotated[
        str, typer.Option(help="smooth, perturbed, gaussian or gusty; or filaments, for rules.")
    ] = "perturbed",
    plume_at: Annotated[
        str, typer.Option(help="Origin of the plume: NORTH,EAST in m; default: by the seed.")
    ] = "",
    failure: Annotated[str, typer.Option(help="none, generic or in-plume.")] = "none",
    rate: Annotated[float, typer.Option(help="Failure probability a drone and tick.")] = 0.0,
    healing: Annotated[bool, typer.Option(help="Whether LoCUS heals.")] = True,
    unhealed: Annotated[
        str,
        typer.Option(
            help="Without healing, who goes on after a loss: those whom the root reaches, or nobody."
        ),
    ] = "reached",
    motion: Motion = "pd",
    cut_cells: CutCells = False,
    cut_goal: CutGoal = False,
    arena: Arena = 100.0,
    speed: Speed = 5.0,
    acceleration: Acceleration = 2.0,
    r_min: RMin = 3.0,
    r_max: RMax = 3.0,
    layout: Layout = "rings",
    regime: Annotated[
        str, typer.Option(help="Of the filaments' wind: laminar, transitional or turbulent.")
    ] = "transitional",
    obstacles: Annotated[int, typer.Option(min=0, max=200, help="In the filaments' world, 3 m wide.")] = 0,
    steps: Annotated[int, typer.Option(min=1, max=100_000, help="In the filaments' world, at most.")] = 7000,
    seed: Seed = 1,
    index: Annotated[int, typer.Option("--trial", min=0, max=MOST, help="Which of the seed's trials.")] = 0,
    plot: Annotated[
        bool, typer.Option("--plot", help="Draw tracks, contact and heals over the plume.")
    ] = False,
    animate: Annotated[bool, typer.Option("--animate", help="Make a film of it.")] = False,
    film: Annotated[FilmName, typer.Option(help="Kind of the film; mp4 needs ffmpeg.")] = FilmName.GIF,
    out: Annotated[pathlib.Path, typer.Option(help="Directory of picture and film.")] = _DEFAULT_OUT,
    as_json: Annotated[bool, typer.Option("--json", help="The trial's row as one JSON line.")] = False,
) -> None:
    """Fly one trial, and show it."""
    with one_line():
        import json

        from simvehicle.trials.cell import Cell
        from simvehicle.trials.trials_error import TrialsError

        if plume == "filaments":
            from simvehicle.cli import traced_trial

            traced_trial.fly(
                strategy,
                drones,
                regime,
                obstacles,
                steps,
                seed,
                index,
                out,
                plot=plot,
                film=film.value if animate else None,
                as_json=as_json,
            )
            return
        place = numbers(plume_at, float, "--plume-at")
        if len(place) not in (0, 2):
            raise TrialsError(f"--plume-at {plume_at!r}: give NORTH,EAST in metres")
        cell = Cell(
            strategy=strategy,
            drones=drones,
            plume=plume,  # type: ignore[arg-type]
            source=(place[0], place[1]) if place else None,
            failure=failure,  # type: ignore[arg-type]
            failure_rate=rate,
            healing=healing,
            unhealed=unhealed,  # type: ignore[arg-type]
            cut_cells=cut_cells,
            cut_goal=cut_goal,
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
        from simvehicle.trials.outcome import kernel_of, record_trial

        tell_compiling(kernel_of(cell))
        recorded = record_trial(cell, seed, index)
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
    from simvehicle.trials.trials_error import TrialsError

    if not plot and film is None:
        return []
    stem = f"{cell.strategy}-{cell.drones}-{cell.plume}-{recorded.row['seed']}-{recorded.row['trial']}"
    files = []
    try:
        out.mkdir(parents=True, exist_ok=True)
        if plot:
            files.append(out / f"{stem}.png")
            picture.save(picture.picture(recorded, cell), files[-1])
        if film is not None:
            files.append(out / f"{stem}.{film}")
            picture.film(recorded, cell, files[-1])
    except OSError as error:
        raise TrialsError(f"{out}: {error.strerror or error}") from error
    return files


def _plain(value: Any) -> Any:
    """A NumPy scalar as Python's own."""
    return value.item() if hasattr(value, "item") else value
