"""What each experiment runs (LoCUS paper, section V-B): its cells, from a few options."""

from __future__ import annotations

import msgspec

from simvehicle.trials.cell import Cell, FailureKind, PlumeKind
from simvehicle.trials.trials_error import TrialsError

NAMES = ("locus-1", "locus-2", "locus-3", "locus-4")
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


class Options(msgspec.Struct, frozen=True, kw_only=True):
    """What a person may choose; None or empty: the experiment's own."""

    sizes: tuple[int, ...] = ()
    rates: tuple[float, ...] = ()
    strategies: tuple[str, ...] = ("locus", "mobs")
    plumes: tuple[PlumeKind, ...] = ()
    quick: bool = False
    full: bool = False
    trials: int | None = None
    base: Cell = Cell()
    """Arena, motion and formation of all cells."""


class Experiment(msgspec.Struct, frozen=True):
    name: str
    cells: tuple[Cell, ...]
    """The cells whose rows are reported."""
    compared: tuple[Cell, ...]
    """Further cells that a verdict needs."""
    trials: int

    @property
    def by_rate(self) -> bool:
        return _FAILURE[self.name] != "none"


def define(name: str, options: Options) -> Experiment:
    """The experiment called `name`. `TrialsError` names what is impossible."""
    if name not in NAMES:
        raise TrialsError(f"no experiment is called {name!r}; there are {', '.join(NAMES)}")
    failure = _FAILURE[name]
    if options.rates and failure == "none":
        raise TrialsError(f"{name} has no failures; --rates belongs to locus-3 and locus-4")
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
                msgspec.structs.replace(base, strategy=strategy, drones=size, plume=plume)
                for strategy in options.strategies
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
                for strategy in options.strategies:
                    for healing in (False,) if strategy == "mobs" else (True, False):
                        cells += [
                            msgspec.structs.replace(
                                base,
                                strategy=strategy,
                                drones=size,
                                plume=plume,
                                healing=healing,
                                failure_rate=rate,
                            )
                            for rate in rates
                        ]
    for cell in cells:
        problems = cell.problems()
        if problems:
            raise TrialsError(problems[0])
    if not cells:
        raise TrialsError(f"{name}: nothing to run")
    return Experiment(name, _once(cells), _once(compared), trials)


def _once(cells: list[Cell]) -> tuple[Cell, ...]:
    """What a person named twice is run once: two cells of one kind would be reported with both's trials."""
    return tuple(dict.fromkeys(cells))
