"""What each experiment runs (LoCUS paper, section V-B): its cells, from a few options."""

from __future__ import annotations

import msgspec

from simvehicle.experiments.experiment import Experiment, Options
from simvehicle.trials.cell import GRIDS, Cell, FailureKind, PlumeKind
from simvehicle.trials.trials_error import TrialsError

ALONE = ("mobs", "mobs-authors")
"""Strategies without a formation that could be healed."""
_TITLES = {
    "locus-1": "Time to contact and to max flux",
    "locus-2": "Time to contact and to max flux",
    "locus-3": "Generic failures",
    "locus-4": "Failures in the plume",
}
NAMES = tuple(_TITLES)
_FAILURE: dict[str, FailureKind] = {
    "locus-1": "none",
    "locus-2": "none",
    "locus-3": "generic",
    "locus-4": "in-plume",
}
_PLUMES: dict[str, tuple[PlumeKind, ...]] = {
    "locus-1": ("smooth",),
    "locus-2": ("perturbed",),
    # The authors ran the perturbed plume, the paper says smooth: both.
    "locus-3": ("perturbed", "smooth"),
    "locus-4": ("perturbed", "smooth"),
}


def _rates(digits: tuple[int, ...]) -> tuple[float, ...]:
    """1e-6 to 1e-1 with these leading digits in each decade; written out, so that 3e-5 is exactly 3e-5."""
    return (*(float(f"{digit}e-{decade}") for decade in range(6, 1, -1) for digit in digits), 0.1)


_DEFAULT_RATES = _rates((1, 3))
_QUICK_RATES = _rates((1,))
FULL_RATES = _rates((1, 2, 3, 4, 5, 6, 7, 8, 9))
"""46 rates: nine a decade."""


def define(name: str, options: Options) -> Experiment:
    """The experiment called `name`, one of NAMES. `TrialsError` names what is impossible."""
    failure = _FAILURE[name]
    if options.rates and failure == "none":
        raise TrialsError(f"{name} has no failures; --rates belongs to locus-3 and locus-4")
    if options.regimes or options.worlds is not None:
        raise TrialsError(f"{name} has one world a trial; --regimes and --worlds belong to the traced plumes")
    strategies = options.strategies or ("locus", "mobs")
    trials = options.trials if options.trials is not None else (20 if options.quick else 100)
    if trials < 1:
        raise TrialsError(f"--trials must be at least 1, not {trials}")
    plumes = options.plumes or _PLUMES[name]
    base = msgspec.structs.replace(options.base, failure=failure)
    cells: list[Cell] = []
    compared: list[Cell] = []
    if failure == "none":
        sizes = options.sizes or (tuple(range(2, 21)) if options.full else (5, 10, 20))
        for plume in plumes:
            cells += [
                msgspec.structs.replace(_flown(base, strategy, plume), drones=size)
                for strategy in strategies
                for size in sizes
            ]
        if name == "locus-2" and plumes == ("perturbed",):
            compared = [
                msgspec.structs.replace(cell, plume="smooth") for cell in cells if cell.strategy == "locus"
            ]
    else:
        rates = options.rates or (
            FULL_RATES if options.full else _QUICK_RATES if options.quick else _DEFAULT_RATES
        )
        for plume in plumes:
            for size in options.sizes or (20,):
                for strategy in strategies:
                    flown = msgspec.structs.replace(_flown(base, strategy, plume), drones=size)
                    lines = [flown] if strategy not in ALONE else []
                    lines += [
                        msgspec.structs.replace(flown, healing=False, unhealed=unhealed)
                        for unhealed in (options.unhealed if strategy not in ALONE else ("reached",))
                    ]
                    cells += [
                        msgspec.structs.replace(line, failure_rate=rate) for line in lines for rate in rates
                    ]
    for cell in cells:
        problems = cell.problems()
        if problems:
            raise TrialsError(problems[0])
    if not cells:
        raise TrialsError(f"{name}: nothing to run")
    return Experiment(name, _TITLES[name], _once(cells), _once(compared), trials)


def by_rate(experiment: Experiment) -> bool:
    """Whether its cells differ in their failure rate."""
    return any(cell.failure != "none" for cell in experiment.cells)


def _flown(base: Cell, strategy: str, plume: PlumeKind) -> Cell:
    """`mobs-authors` is flown with its program's cells and goal, the others with exact ones."""
    cut = strategy == "mobs-authors"
    return msgspec.structs.replace(
        base,
        strategy=strategy,
        plume=plume,
        cut_cells=base.cut_cells or (cut and plume in GRIDS),
        cut_goal=base.cut_goal or cut,
    )


def _once(cells: list[Cell]) -> tuple[Cell, ...]:
    """What a person named twice is run once: two cells of one kind would be reported with both's trials."""
    return tuple(dict.fromkeys(cells))
