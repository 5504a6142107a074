"""Spreading trials over cores (joblib) and machines (dask): blocks of a run in any order, rows always the same."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable, Generator, Hashable, Iterator, Sequence
from typing import Any, NamedTuple

import pandas as pd

from simvehicle.trials.outcome import code_of, engine_of, kernels_of, run_cell
from simvehicle.trials.store import Block, Run, Store
from simvehicle.trials.trials_error import TrialsError

Progress = Callable[[int, int], None]
"""Called with (trials done, trials in all)."""
Finished = Generator[tuple[Block, pd.DataFrame], None, None]


class Trials(NamedTuple):
    """How the trials of one kind of cells are flown; plain functions of modules, which other processes find too."""

    fly: Callable[[Any, int, int, int], pd.DataFrame]
    """(cell, seed, first, count) -> one tidy row a trial, the same however they are split. With a count of 0 it only
    compiles."""
    engine: Callable[[Sequence[Any]], str]
    """Equal where the rows of cells are computed by equal code."""
    code: Callable[[Any], Hashable]
    """Equal for cells that need the same machine code."""
    kernels: Callable[[Any], Sequence[Callable[..., Any]]]
    """The compiled entries that fly trials of a cell."""


CELLS = Trials(run_cell, engine_of, code_of, kernels_of)
"""Those of `simvehicle.trials.cell.Cell`."""


def complete(
    run: Run,
    store: Store,
    trials: Trials = CELLS,
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> pd.DataFrame:
    """Do what is missing of `run`, on `jobs` cores here or on the dask cluster at `scheduler`; all rows."""
    total = run.trials * len(run.cells)
    missing = store.missing()
    done = total - sum(block.count for block in missing)
    report = progress or _silent
    report(done, total)
    if missing:
        with contextlib.closing(spread(run, missing, trials, jobs=jobs, scheduler=scheduler)) as finished:
            for block, rows in finished:
                store.add(block, rows)
                done += block.count
                report(done, total)
    return store.rows()


def spread(
    run: Run, missing: Sequence[Block], trials: Trials = CELLS, *, jobs: int = 1, scheduler: str | None = None
) -> Finished:
    """Do these blocks of `run`; each comes with its rows as it is finished."""
    return (
        _on_cluster(run, missing, trials, scheduler) if scheduler else _on_cores(run, missing, trials, jobs)
    )


def _silent(done: int, total: int) -> None:
    del done, total


def warm_up(run: Run, trials: Trials = CELLS) -> None:
    """Compile (or load) what `run` needs, once, before workers all do it at the same time."""
    for cell in {trials.code(cell): cell for cell in run.cells}.values():
        trials.fly(cell, run.seed, 0, 0)


def _work(trials: Trials, cell: Any, seed: int, block: Block, engine: str) -> tuple[Block, pd.DataFrame]:
    if engine != trials.engine((cell,)):
        raise TrialsError("a worker runs another version of the software; install the same one everywhere")
    return block, trials.fly(cell, seed, block.first, block.count)


def _tasks(
    run: Run, missing: Sequence[Block], trials: Trials
) -> Iterator[tuple[Trials, Any, int, Block, str]]:
    """The arguments of `_work`, one tuple a block."""
    engines = {trials.code(cell): trials.engine((cell,)) for cell in run.cells}
    for block in missing:
        cell = run.cells[block.cell]
        yield trials, cell, run.seed, block, engines[trials.code(cell)]


def _on_cores(run: Run, missing: Sequence[Block], trials: Trials, jobs: int) -> Finished:
    warm_up(run, trials)
    if jobs == 1:
        for task in _tasks(run, missing, trials):
            yield _work(*task)
        return
    import joblib

    parallel: Any = joblib.Parallel(n_jobs=jobs, return_as="generator_unordered", batch_size=1)
    calls = (joblib.delayed(_work)(*task) for task in _tasks(run, missing, trials))
    results = parallel(calls)
    try:
        for result in results:  # noqa: UP028 (`yield from` would close `results` before `finally` is reached)
            yield result
    finally:
        with warnings.catch_warnings():
            # joblib warns that an interrupted run leaves work undone, which is what was asked for.
            warnings.simplefilter("ignore")
            results.close()


def _on_cluster(run: Run, missing: Sequence[Block], trials: Trials, scheduler: str) -> Finished:
    try:
        import distributed as dask_cluster
    except ImportError as error:
        raise TrialsError("--scheduler needs dask: pip install 'flightstack[cluster]'") from error
    distributed: Any = dask_cluster
    try:
        client = distributed.Client(scheduler, timeout="10s")
    except (OSError, ValueError, TimeoutError) as error:
        raise TrialsError(f"no dask scheduler answers at {scheduler}: {error}") from error
    with client:
        futures = [client.submit(_work, *task, pure=False) for task in _tasks(run, missing, trials)]
        for _, result in distributed.as_completed(futures, with_results=True):
            yield result
