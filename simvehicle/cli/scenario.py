"""The command `simvehicle scenario`."""

from __future__ import annotations

import pathlib
import re
from enum import StrEnum
from typing import Annotated

import typer

app = typer.Typer(help="Whole swarms in one process while things go wrong.", no_args_is_help=True)


LEVEL_HELP = (
    "agent: whole agents with simulated autopilots; protocol: the swarm's protocol with points that fly."
)


class LevelName(StrEnum):
    AGENT = "agent"
    PROTOCOL = "protocol"


@app.command()
def run(
    file: Annotated[pathlib.Path, typer.Argument(help="The scenario's YAML file.")],
    transcript: Annotated[
        pathlib.Path | None, typer.Option(help="Write what happened to this file, for review.")
    ] = None,
    level: Annotated[LevelName, typer.Option(help=LEVEL_HELP)] = LevelName.AGENT,
    as_json: Annotated[bool, typer.Option("--json", help="The result as one JSON line.")] = False,
) -> None:
    """Fly a scenario in one process on simulated time and check the invariants in every tick.

    The file of a scenario of the protocol level is smaller: docs/simulate.md tells what is in it.

    Exit code 0: all held; 1: one was violated; 2: something is wrong with the file.
    """
    import msgspec

    from mission.documents.yaml_file import DocumentError, read_text
    from simvehicle.scenario.level import LEVELS

    result = LEVELS[level.value]().run_text(read_text(file), str(file))
    text = "".join(f"{line}\n" for line in result.transcript)
    typer.echo(msgspec.json.encode(result).decode() if as_json else text, nl=as_json)
    if transcript is not None:
        try:
            transcript.write_text(text, encoding="utf-8")
        except OSError as error:
            problem = f"cannot be written: {error.strerror}; name another file"
            raise DocumentError(str(transcript), problem) from error
    raise typer.Exit(1 if result.violations else 0)


@app.command()
def search(
    seeds: Annotated[str, typer.Option(help="FIRST:END, END not included: 0:40 are 40 scenarios.")],
    level: Annotated[LevelName, typer.Option(help=LEVEL_HELP)] = LevelName.AGENT,
    out: Annotated[
        pathlib.Path, typer.Option(help="Results are kept here, and a search goes on from them.")
    ] = pathlib.Path("out/scenarios"),
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes; else one a core.")] = None,
    shrink: Annotated[
        bool,
        typer.Option(
            help="Reduce the first failing scenario of each kind, which is written to --out, before."
        ),
    ] = True,
    as_json: Annotated[bool, typer.Option("--json", help="End with the summary as one JSON line.")] = False,
) -> None:
    """Fly scenarios drawn by chance, each seed another, and look for what violates an invariant.

    Exit code 0: none did; 1: some did; 2: wrong use.
    """
    import os
    import time

    import msgspec

    from mission.documents.yaml_file import DocumentError
    from simvehicle.scenario import search as searching

    bounds = re.fullmatch(r"(\d{1,9}):(\d{1,9})", seeds)
    if bounds is None or int(bounds[1]) >= int(bounds[2]):
        raise DocumentError(f"--seeds {seeds}", "write FIRST:END with END above FIRST, such as 0:40")
    wanted = range(int(bounds[1]), int(bounds[2]))
    code = searching.sources_identity()
    began_s = time.monotonic()
    store = searching.ResultStore(out, level.value, code)
    try:
        known = len(store.known.keys() & set(wanted))
        for number, result in enumerate(
            searching.search(level.value, code, wanted, store, jobs=jobs or os.cpu_count() or 1), known + 1
        ):
            typer.echo(f"{number} of {len(wanted)}: seed {result.seed}, {result.core_s:.1f} core-s", err=True)
            for violation in result.violations:
                typer.echo(f"  {violation.kind} at {violation.at_s:g} s: {violation.text}", err=True)
    finally:
        store.close()
    results = [store.known[seed] for seed in wanted]
    summary = searching.summarized(level.value, results, time.monotonic() - began_s)
    for kind in summary.violations:
        seed = next(r.seed for r in results if kind in {v.kind for v in r.violations})
        file = out / f"{level.value}-{kind}-{seed}.yaml"
        text = searching.failing(level.value, seed, kind, smallest=shrink)
        file.write_text(text, encoding="utf-8")
        typer.echo(f"{text}\nreplay it: simvehicle scenario run {file} --level {level.value}", err=True)
    if as_json:
        typer.echo(msgspec.json.encode(summary).decode())
    else:
        told = (
            ", ".join(f"{kind} in {count}" for kind, count in summary.violations.items()) or "no violations"
        )
        seeds_told = ", ".join(map(str, summary.failing_seeds))
        told += f" (seeds {seeds_told})" if seeds_told else ""
        typer.echo(f"{summary.seeds} scenarios: {told}; {summary.wall_s:g} s, {summary.core_s:g} core-s")
    raise typer.Exit(1 if summary.failing_seeds else 0)
