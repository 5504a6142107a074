"""What trials of traced plumes cost: robot-steps a second of processor time by strategy and by the size of the swarm.

A robot-step is one robot's step: gas and wind sampled, neighbours searched, the rule called, kept off walls,
obstacles and others. The plume is a steady one made by hand in a world of 36 obstacles, so that swarms gather at its
source as they do in the experiments, which is when they cost most.
"""

from __future__ import annotations

import math
import pathlib
import time

import msgspec
import numpy as np

from benchmarks import Figures
from mission.geometry.formation import FloatArray
from simvehicle.trials.tracing.flying import STEPS
from simvehicle.trials.tracing.swarm_flight import TracedScene, TracingVehicles, fly_trials, make_place
from simvehicle.trials.tracing.terrain import clearances_of
from simvehicle.world.obstacles import Obstacles
from simvehicle.world.recorded_air import RecordedAir
from simvehicle.world.world_config import RectangularObstacle

_PER_S = 1.5e6
"""With which the paper's 40,500 runs of 7,000 steps with four strategies take under 4 hours on two cores."""
_STRATEGIES = ("casting", "chemotaxis", "anemotaxis", "fluxotaxis")
_SIZES = (7, 28, 70)
_GROWTH = (7, 20, 70, 200, 500, 1000)
_DRAWN = pathlib.Path("out") / "benchmarks" / "tracing-growth.png"
_TICKS_US = (0.1, 0.2, 0.5, 1.0, 2.0)
_STEPS = 1.5e6
"""Robot-steps of one measurement."""
_LENGTH_M = 91.4
_NODES = 183


def place() -> TracedScene:
    """A plume to the east, around 36 obstacles."""
    source_m = np.array([45.0, 25.0])
    north, east = np.meshgrid(*[np.arange(_NODES) * 0.5] * 2, indexing="ij")
    behind = np.clip(east - source_m[1], 0.0, None)
    width_m = 1.0 + 0.08 * behind
    middle_m = source_m[0] + 6.0 * np.sin(behind / 12.0) * np.clip(behind / 60.0, 0.0, 1.0)
    gas = np.where(east > source_m[1], 0.05 * np.exp(-(((north - middle_m) / width_m) ** 2)) / width_m, 0.0)
    wind = np.zeros((1, 2, 61, 61), np.float32)
    wind[:, 1] = 0.5
    air = RecordedAir(
        gas[None].astype(np.float32),
        wind,
        np.zeros((_NODES, _NODES), np.bool_),
        np.zeros(2),
        0.5,
        np.zeros(2),
        _LENGTH_M / 60,
        6.0,
        np.full(2, _LENGTH_M),
    )
    corners = np.stack(np.meshgrid(np.linspace(8.0, 83.0, 6), np.linspace(8.0, 83.0, 6)), -1).reshape(-1, 2)
    obstacles = [
        RectangularObstacle(centre_north_m=n, centre_east_m=e, length_north_m=1.5, length_east_m=1.5)
        for n, e in corners.tolist()
    ]
    return make_place(air, source_m[None], Obstacles(obstacles))


def starts(where: TracedScene, robots: int) -> FloatArray:
    """(1, robots, 2) a lattice downwind; who would stand in an obstacle is left out, and the lattice goes on."""
    side = math.ceil(math.sqrt(1.2 * robots)) + 2
    along = 0.8 * (np.arange(side) - 0.5 * (side - 1))
    lattice = np.stack(np.meshgrid(along, along), -1).reshape(-1, 2)
    places = np.array([45.5, 60.5]) + lattice[np.argsort((lattice**2).sum(axis=1), kind="stable")]
    return places[clearances_of(where.terrain, places) > 0.2][:robots][None]


def per_s(where: TracedScene, strategy: str, robots: int, repeats: int = 2) -> float:
    """Robot-steps a second of processor time, the best of `repeats` calls."""
    begin = starts(where, robots)
    vehicles = TracingVehicles(range_m=1.0, limit_steps=max(round(_STEPS / robots), 100))
    fly_trials(where, msgspec.structs.replace(vehicles, limit_steps=1), strategy, begin, seed=1)
    rates = []
    for _ in range(repeats):
        began_s = time.process_time()
        flown = fly_trials(where, vehicles, strategy, begin, seed=1)
        rates.append(int(flown.counts[:, STEPS].sum()) * robots / (time.process_time() - began_s))
    return max(rates)


def draw_growth(where: TracedScene) -> None:
    """Processor time a robot-step by the size of the swarm, one call each."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.add_subplot()
    for name in _STRATEGIES:
        costs_us = [1e6 / per_s(where, name, size, 1) for size in _GROWTH]
        axes.loglog(_GROWTH, costs_us, "o-", label=name)
        line = ", ".join(f"{size}: {cost:.2f}" for size, cost in zip(_GROWTH, costs_us, strict=True))
        print(f"   microseconds a robot-step of {name} by robots: {line}")
    axes.set_xlabel("robots")
    axes.set_ylabel("processor time a robot-step, microseconds")
    axes.set_xticks(_GROWTH, [str(size) for size in _GROWTH])
    axes.set_yticks(_TICKS_US, [f"{tick:g}" for tick in _TICKS_US])
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    _DRAWN.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(_DRAWN, dpi=110)
    print(f"   drawn: {_DRAWN}")


def main() -> None:
    where = place()
    rates = {(name, size): per_s(where, name, size) for name in _STRATEGIES for size in _SIZES}
    for name in _STRATEGIES:
        line = ", ".join(f"{size}: {rates[name, size]:.2g}" for size in _SIZES)
        print(f"   robot-steps/s of {name} by robots: {line}")
    draw_growth(where)
    figures = Figures()
    # The experiment flies as many trials of each strategy and size; a large swarm has more robot-steps.
    whole = sum(size for _, size in rates)
    spent = sum(size / rate for (_, size), rate in rates.items())
    figures.show("robot-steps a second, the experiment's mix", whole / spent / 1e6, "M/s", least=_PER_S / 1e6)
    figures.leave()


if __name__ == "__main__":
    main()
