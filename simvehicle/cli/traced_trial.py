"""`simvehicle trial --plume filaments`: one trial in a traced world."""

from __future__ import annotations

import json
import pathlib

import typer

from simvehicle.cli.trial_options import tell_compiling


def fly(
    strategy: str,
    robots: int,
    regime: str,
    obstacles: int,
    steps: int,
    seed: int,
    index: int,
    out: pathlib.Path,
    *,
    plot: bool,
    film: str | None,
    as_json: bool,
) -> None:
    """Fly it, show it, tell how it went. `TrialsError` names what cannot be."""
    from simvehicle.experiments import picture, traced_picture
    from simvehicle.trials.tracing.swarm_flight import TracingVehicles
    from simvehicle.trials.tracing.traced_world import TracedWorld, kernels_of
    from simvehicle.trials.trials_error import TrialsError

    world = TracedWorld(
        number=0,
        regime=regime,  # type: ignore[arg-type]  # checked by TracedWorld.problems
        obstacles=obstacles,
        obstacle_m=3.0,
        strategies=(strategy,),
        robots=(robots,),
        vehicles=TracingVehicles(range_m=1.0, limit_steps=steps),
    )
    for problem in world.problems():
        raise TrialsError(problem)
    for kernel in kernels_of(world):
        tell_compiling(kernel)
    flown = traced_picture.record(world, strategy, robots, seed, index)
    stem = f"{strategy}-{robots}-{regime}-{seed}-{index}"
    files = []
    try:
        if plot or film is not None:
            out.mkdir(parents=True, exist_ok=True)
        if plot:
            files.append(out / f"{stem}.png")
            picture.save(traced_picture.picture(flown), files[-1])
        if film is not None:
            files.append(out / f"{stem}.{film}")
            traced_picture.film(flown, files[-1])
    except OSError as error:
        raise TrialsError(f"{out}: {error.strerror or error}") from error
    if as_json:
        row = {
            "strategy": strategy,
            "robots": robots,
            "regime": regime,
            "obstacles": obstacles,
            "seed": seed,
            "trial": index,
            "arrival_steps": flown.arrival_step,
            "contact_steps": flown.contact_step,
            **flown.air.statistics,
        }
        cells = {key: None if value != value else value for key, value in row.items()}
        typer.echo(json.dumps({**cells, "files": [str(path) for path in files]}))
        return
    typer.echo(f"{strategy}, {robots} robots, {regime}, {obstacles} obstacles: {traced_picture.words(flown)}")
    for path in files:
        typer.echo(str(path))
