"""What each experiment flies (fluxotaxis paper, its second study): its worlds, and the cells of its table."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import msgspec

from mission.strategies.registry import names
from simvehicle.experiments.experiment import Experiment, Options
from simvehicle.trials.cell import Cell
from simvehicle.trials.tracing.swarm_flight import TracingVehicles
from simvehicle.trials.tracing.traced_world import REGIMES, Regime, TracedWorld
from simvehicle.trials.trials_error import TrialsError

STRATEGIES = ("casting", "chemotaxis", "anemotaxis", "fluxotaxis")
"""The paper's."""
RANKED = (
    *STRATEGIES,
    "virtual-forces",
    "upwind",
    "surge-cast",
    "spiral-surge",
    "infotaxis",
    "cooperative-infotaxis",
)
"""Of `tracing`: those of them that the registry knows."""
_SMALL = (
    ("speed_mps", 0.1),
    ("upwind", 4.0),
    ("repulsion_m3ps", 0.15),
    ("obstacle_m3ps", 0.003),
    ("near_m", 0.5),
    ("sight_m", 0.5),
    ("least_m", 0.03),
)
_PARAMETERS: dict[str, tuple[tuple[str, float], ...]] = {
    "upwind": _SMALL,
    "virtual-forces": (
        *_SMALL,
        ("gradient_m2ps", 2.3),
        ("attraction_m3ps", 0.01),
        ("far_m", 0.8),
        ("range_m", 1.0),
    ),
}
"""Of strategies whose defaults are for drones: their paper's large arena with lengths times 5/22 (R1 is 0.5 m) and
speeds times 1/5, which are those of the robots here."""
_TITLES = {
    "fluxo-3": "Arrival and localisation among obstacles",
    "fluxo-4": "Arrival and localisation of large swarms",
    "tracing": "All strategies ranked",
}
NAMES = tuple(_TITLES)

_COURSES: tuple[tuple[int, float, float], ...] = (
    (0, 1.5, 0.0),
    (9, 1.5, 0.0025),
    (18, 1.5, 0.005),
    (27, 1.5, 0.0075),
    (36, 1.5, 0.01),
    (2, 3.0, 0.0025),
    (4, 3.0, 0.005),
    (7, 3.0, 0.0075),
    (9, 3.0, 0.01),
)
"""Obstacles, their sides in metres, and the share of the ground that the paper gives for them."""
_TEN = (10, 1.5, 0.0025)
"""Experiment 4's obstacles; their share is nearest to this."""
_OF_LOCUS = msgspec.structs.replace(Cell(), motion="paper")


class Size(msgspec.Struct, frozen=True):
    """How much is flown."""

    worlds: int
    starts: int
    robots: tuple[int, ...]


_SIZES: dict[str, tuple[Size, Size, Size]] = {
    "fluxo-3": (
        Size(9, 2, (7, 28, 70)),
        Size(27, 4, (7, 28, 70)),
        Size(81, 50, tuple(range(7, 71, 7))),
    ),
    "fluxo-4": (
        Size(3, 2, (10, 50, 150)),
        Size(9, 4, (10, 50, 100, 150)),
        Size(10, 30, tuple(range(10, 151, 10))),
    ),
    "tracing": (Size(3, 2, (20,)), Size(6, 4, (20,)), Size(30, 10, (7, 20, 50))),
}
"""Quick, usual, full: of the paper's experiments the last is the paper's."""
_SOURCE_MPS = 0.003
_CONDITIONS: dict[str, dict[str, Any]] = {
    "plain": {},
    "slow, noisy sensors": {"vehicles": TracingVehicles(range_m=1.0, lag_s=6.0, noise=1e-4, detection=3e-4)},
    "two sources": {"sources": 2},
    "a moving source": {"source_mps": _SOURCE_MPS},
    "half of the members lost": {"vehicles": TracingVehicles(range_m=1.0, loss_rate=1e-4)},
}
"""What `tracing` changes of its worlds. A member of two is lost by the end of 7,000 steps; the source moves 25 m."""


class TracedCell(msgspec.Struct, frozen=True):
    """The trials that a row of the table is about."""

    strategy: str
    robots: int
    regime: Regime
    obstacle_share: float
    condition: str = "plain"


def define(name: str, options: Options) -> Experiment:
    """The experiment called `name`, one of NAMES. `TrialsError` names what is impossible."""
    refuse_others(name, options)
    quick, usual, full = _SIZES[name]
    size = full if options.full else quick if options.quick else usual
    worlds = options.worlds if options.worlds is not None else size.worlds
    starts = options.trials if options.trials is not None else size.starts
    if worlds < 1:
        raise TrialsError(f"--worlds must be at least 1, not {worlds}")
    if starts < 1:
        raise TrialsError(f"--trials must be at least 1, not {starts}")
    strategies = tuple(dict.fromkeys(options.strategies)) or (
        tuple(one for one in RANKED if one in names()) if name == "tracing" else STRATEGIES
    )
    robots = tuple(sorted(set(options.sizes))) or size.robots
    parameters = tuple(
        (strategy, *changed) for strategy in strategies for changed in _PARAMETERS.get(strategy, ())
    )
    flown = tuple(
        TracedWorld(
            number=number,
            regime=regime,
            obstacles=obstacles,
            obstacle_m=obstacle_m,
            obstacle_share=share,
            strategies=strategies,
            parameters=parameters,
            robots=robots,
            condition=condition,
            **changes,
        )
        for condition, changes in (_CONDITIONS if name == "tracing" else {"plain": {}}).items()
        for number, regime, (obstacles, obstacle_m, share) in itertools.islice(
            _plan(name, _regimes(options)), worlds
        )
    )
    for problem in flown[0].problems():
        raise TrialsError(problem)
    return Experiment(name, _TITLES[name], cells_of(flown), (), starts, flown)


def cells_of(worlds: Sequence[TracedWorld]) -> tuple[TracedCell, ...]:
    """One for each strategy and swarm size in each kind of world."""
    kinds = sorted(
        {(REGIMES.index(world.regime), world.obstacle_share, world.condition) for world in worlds},
        key=lambda kind: (list(_CONDITIONS).index(kind[2]), kind[0], kind[1]),
    )
    return tuple(
        TracedCell(strategy, robots, REGIMES[regime], share, condition)
        for regime, share, condition in kinds
        for strategy in worlds[0].strategies
        for robots in worlds[0].robots
    )


def _plan(name: str, regimes: tuple[Regime, ...]) -> Iterator[tuple[int, Regime, tuple[int, float, float]]]:
    """(number, regime, obstacles) of one world after the other, the kinds evenly mixed however many are taken."""
    for number in itertools.count():
        block, place = divmod(number, len(_COURSES))
        if name == "fluxo-3":
            yield number, regimes[(place + place // len(regimes) + block) % len(regimes)], _COURSES[place]
        else:
            yield number, regimes[number % len(regimes)], _TEN


def _regimes(options: Options) -> tuple[Regime, ...]:
    for regime in options.regimes:
        if regime not in REGIMES:
            raise TrialsError(f"no regime is called {regime!r}; there are {', '.join(REGIMES)}")
    return tuple(regime for regime in REGIMES if not options.regimes or regime in options.regimes)


def refuse_others(name: str, options: Options) -> None:
    """What belongs to the LoCUS paper's trials would be taken for granted and have no effect."""
    motion = (
        "--motion, --arena, --speed, --acceleration, --r-min, --r-max, --layout, --cut-cells and --cut-goal"
    )
    given = {
        "--rates": bool(options.rates),
        "--plumes": bool(options.plumes),
        "--unhealed": options.unhealed != ("reached",),
        motion: options.base != _OF_LOCUS,
    }
    for option, is_given in given.items():
        if is_given:
            raise TrialsError(f"{name} has no use for {option}, which belong to the LoCUS experiments")
