"""What trials cost: per second and core, per simulated drone-hour, against the step-by-step engine, and their growth.

The yardstick: the LoCUS authors' program does 2.9 trials of 20 drones in the smooth plume a second on one core of
this class of machine.
"""

from __future__ import annotations

import importlib.util
import pathlib
import statistics
import sys
import time
from typing import Any

import numpy as np

from benchmarks import Figures
from mission.strategies.registry import BUILT_IN
from simvehicle.experiments.experiment import Options
from simvehicle.experiments.locus.definitions import define
from simvehicle.experiments.run import usual_jobs
from simvehicle.trials.batch import spread
from simvehicle.trials.cell import Cell
from simvehicle.trials.motion import TICKS_PER_S
from simvehicle.trials.outcome import run_cell
from simvehicle.trials.store import Run, blocks

_AUTHORS_PER_S = 2.9
_AUTHORS_TICKS = 16_600
"""Median of the authors' trials of that kind."""
_LEAST_PER_S = 90.0
_FULL_LIMIT_S = 180.0
_SHARE = 10
"""One in so many trials of the full experiments is run, and the time multiplied."""
_GROWTH = pathlib.Path("out") / "benchmarks" / "trials-growth.png"


def _cpu_s(cell: Cell, trials: int, repeats: int = 3) -> tuple[float, float]:
    """(processor seconds a trial, simulated drone-hours a trial), the median of `repeats` runs."""
    run_cell(cell, 1, 0, 1)
    costs = []
    hours = 0.0
    for repeat in range(repeats):
        began = time.process_time()
        rows = run_cell(cell, 1, repeat * trials, trials)
        costs.append((time.process_time() - began) / trials)
        hours = float(rows["end_s"].mean()) * cell.drones / 3600.0
    return statistics.median(costs), hours


def _reference() -> Any:
    """The step-by-step engine, which stays with the tests."""
    path = (
        pathlib.Path(__file__).parents[1] / "tests" / "unit" / "simvehicle" / "trials" / "trials_reference.py"
    )
    spec = importlib.util.spec_from_file_location("trials_reference", path)
    if spec is None or spec.loader is None:
        raise FileNotFoundError(path)
    reference = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = reference
    spec.loader.exec_module(reference)
    return reference


def _reference_s(reference: Any, cell: Cell, trials: int = 3) -> tuple[float, float]:
    """(processor seconds a trial, drone-hours a trial) of the step-by-step engine."""
    began = time.process_time()
    ticks = [reference.Trial(cell, reference.SharedLuck(cell, 1, k)).run().tick for k in range(trials)]
    hours = sum(ticks) / trials / TICKS_PER_S / 3600.0 * cell.drones
    return (time.process_time() - began) / trials, hours


def _yardstick(reference: Any) -> None:
    """Print how long the trials are where the authors' program had its plumes, and anywhere."""
    theirs = [
        float(run_cell(Cell(source=place), seed, trial, 1)["source_s"].iloc[0]) * TICKS_PER_S
        for seed in range(1, 9)
        for trial, place in enumerate(reference.authors_places(100))
    ]
    anywhere = run_cell(Cell(), 1, 0, 3000)["source_s"] * TICKS_PER_S
    error = 1.2533 * anywhere.std() / 10.0
    print(
        f"   median of locus: {np.median(theirs):.0f} ticks at the plume places of the authors' seeds 0 to 99 "
        f"(their program: {_AUTHORS_TICKS}),\n"
        f"   {anywhere.median():.0f} over 3000 places, of which any hundred give +-{error:.0f} (one deviation)"
    )


def _strategies(reference: Any) -> float:
    """Print the cost of each strategy; the trials a second of LoCUS."""
    print("20 drones, smooth plume, arena 100 m, no failures, one core:")
    print(f"   {'motion':8} {'strategy':14} {'trials/s':>9} {'ms/trial':>9} {'us/drone-hour':>14}")
    locus_per_s = 0.0
    for motion in ("pd", "paper"):
        for strategy in [name for name, entry in BUILT_IN.items() if entry.legs]:
            cost_s, hours = _cpu_s(Cell(strategy=strategy, motion=motion), 100)  # type: ignore[arg-type]
            if (motion, strategy) == ("pd", "locus"):
                locus_per_s = 1.0 / cost_s
            per_hour_us = 1e6 * cost_s / hours
            print(f"   {motion:8} {strategy:14} {1 / cost_s:9.0f} {1e3 * cost_s:9.2f} {per_hour_us:14.0f}")
    slow_s, hours = _reference_s(reference, Cell())
    print(
        f"   pd       {'step by step':14} {1 / slow_s:9.2f} {1e3 * slow_s:9.0f} {1e6 * slow_s / hours:14.0f}  (locus)"
    )
    return locus_per_s


def _full_s() -> float:
    """Seconds that experiments 1 to 4 with --full take on this machine's cores, from a sample of their trials."""
    warm = Run("warm", 1, 1, 1, (Cell(drones=2), Cell(drones=2, strategy="mobs")) * 4)
    for _ in spread(warm, blocks(warm), jobs=usual_jobs(10**6)):
        pass  # the worker processes start and load the kernels, which a whole experiment does once
    total_s = 0.0
    for name, plume in (("locus-1", "smooth"), *((f"locus-{k}", "perturbed") for k in (2, 3, 4))):
        experiment = define(name, Options(full=True, plumes=(plume,)))  # type: ignore[arg-type]
        share = experiment.trials // _SHARE
        run = Run(name, 1, share, share, experiment.cells)
        began = time.monotonic()
        done = sum(len(rows) for _, rows in spread(run, blocks(run), jobs=usual_jobs(10**6)))
        seconds = (time.monotonic() - began) * experiment.trials / share
        print(f"   {name} --full: {done * _SHARE} trials in {seconds:.0f} s (from {done} of them)")
        total_s += seconds
    return total_s


def _growth() -> None:
    """Cost against swarm size and arena radius, drawn."""
    from matplotlib.figure import Figure

    sizes = (2, 5, 10, 20, 50, 100, 200)
    arenas = (100.0, 178.0, 282.0, 398.0, 600.0, 1000.0)
    figure = Figure(figsize=(9.6, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    for strategy, mark in (("locus", "o-"), ("mobs", "s--")):
        by_size = [_cpu_s(Cell(strategy=strategy, drones=size), 40, 1)[0] for size in sizes]
        by_arena = [_cpu_s(Cell(strategy=strategy, arena_m=arena), 40, 1)[0] for arena in arenas]
        left.loglog(sizes, [1e3 * cost for cost in by_size], mark, label=strategy)
        right.loglog(arenas, [1e3 * cost for cost in by_arena], mark, label=strategy)
        for what, values, costs in (("drones", sizes, by_size), ("arena, m", arenas, by_arena)):
            pairs = ", ".join(
                f"{value:g}: {1e3 * cost:.2g}" for value, cost in zip(values, costs, strict=True)
            )
            print(f"   {strategy}, ms a trial by {what}: {pairs}")
    left.set_xlabel("drones (arena 100 m)")
    left.set_xticks(sizes, [f"{size}" for size in sizes])
    right.set_xlabel("arena radius, m (20 drones)")
    right.set_xticks(arenas, [f"{arena:g}" for arena in arenas])
    left.set_yticks((1, 2, 5, 10, 20, 50), ("1", "2", "5", "10", "20", "50"))
    left.set_ylabel("processor time a trial, ms")
    for axes in (left, right):
        axes.minorticks_off()
        axes.grid(alpha=0.3)
        axes.legend(frameon=False)
    _GROWTH.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(_GROWTH, dpi=110)
    print(f"   drawn: {_GROWTH}")


def main() -> None:
    reference = _reference()
    locus_per_s = _strategies(reference)
    _yardstick(reference)
    print(
        f"   the authors' program: {_AUTHORS_PER_S} a second; this one {locus_per_s / _AUTHORS_PER_S:.0f} times"
    )
    full_s = _full_s()
    _growth()
    figures = Figures()
    figures.show("LoCUS trials a second and core", locus_per_s, least=_LEAST_PER_S)
    figures.show("experiments 1-4 --full", full_s, "s", most=_FULL_LIMIT_S)
    figures.leave()


if __name__ == "__main__":
    main()
