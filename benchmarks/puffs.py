"""What puff plumes cost on one core: puffs advanced a second, samples a second, microseconds a question.

`python -m benchmarks puffs` prints it, beside `pompy` (the same model in Python; `pip install flightstack[bench]`),
measured in the same run. `python -m benchmarks.puffs DIRECTORY` also draws how the cost grows with the puffs.
"""

from __future__ import annotations

import importlib.util
import pathlib
import sys
import time
from collections.abc import Callable

import numpy as np

from benchmarks import Figures
from simvehicle.world.filaments import Filaments
from simvehicle.world.grid_wind import GridWind
from simvehicle.world.wind import GustyWind
from simvehicle.world.world_config import (
    FilamentPlume,
    FilamentSource,
    FlatFilamentPlume,
    FlatFilamentSource,
    GridWindConfig,
    WindConfig,
)

_PUFFS_PER_S = 5e7
_SAMPLES_PER_S = 1e9
_TIMES_POMPY = 100.0
_PUFFS = 100_000
_GROWTH = (100, 1_000, 10_000, 100_000, 1_000_000)
_LIFETIME_S = 40.0
_STEP_S = 0.2
_LENGTH_M = 100.0
_POINTS = 2_000
_GRID = GridWindConfig(speed_mps=0.5, length_m=_LENGTH_M, cells=60)


def flat(puffs: int, radius_m: float = 0.3) -> Filaments:
    """So many puffs in the air of the fluxotaxis experiments; none is older than `_LIFETIME_S`."""
    config = FlatFilamentPlume(
        sources=(FlatFilamentSource(north_m=0.0, east_m=0.0),),
        puffs_per_s=puffs / _LIFETIME_S,
        initial_radius_m=radius_m,
        lifetime_s=_LIFETIME_S,
        head_start_s=_LIFETIME_S,
        step_s=_STEP_S,
    )
    return Filaments(config, GridWind(_GRID, 1), 0.0, 1)


def upright(puffs: int) -> Filaments:
    """A flight's plume over 120 s."""
    source = FilamentSource(north_m=0.0, east_m=0.0, above_home_m=5.0)
    config = FilamentPlume(sources=(source,), puffs_per_s=puffs / 120.0, lifetime_s=120.0, rise_mps=1.0)
    return Filaments(config, GustyWind(WindConfig(), 1), 2000.0, 1)


def fastest_s(call: Callable[[], object], repeats: int = 5) -> float:
    """Processor time of a call: the least of some, since whatever else runs on the processor only adds to it."""
    call()
    times = []
    for _ in range(repeats):
        began_s = time.process_time()
        call()
        times.append(time.process_time() - began_s)
    return min(times)


def advanced_per_s(puffs: int) -> float:
    """Puff-steps a second: the wind's solver, the releases and those that are gone are all in it."""
    model = flat(puffs)
    steps = int(np.clip(2_000_000 // puffs, 5, 500))
    place = 0

    def go() -> None:
        nonlocal place
        place += steps
        model.excess_co2_ppm((0.0, 5.0, -10.0), place * _STEP_S)

    taken_s = fastest_s(go, 3)
    return steps * len(model.puffs(place * _STEP_S).radii_m) / taken_s


def samples_per_s(model: Filaments, spread_m: float) -> float:
    """Puffs times points a second, of points in a square in order of their place."""
    rng = np.random.default_rng(1)
    points = rng.uniform(-0.5 * spread_m, 0.5 * spread_m, (_POINTS, 3))
    points = points[np.lexsort((points[:, 0], points[:, 1] // 2.0))]
    points[:, 2] = -8.0
    puffs = len(model.puffs(0.0).radii_m)
    return puffs * _POINTS / fastest_s(lambda: model.excesses_co2_ppm(points, 0.0))


def grid_samples_per_s(model: Filaments, nodes: int = 256) -> float:
    along_m, values = (
        np.linspace(-0.5 * _LENGTH_M, 0.5 * _LENGTH_M, nodes),
        np.empty((nodes, nodes), np.float32),
    )
    puffs = len(model.puffs(0.0).radii_m)
    taken_s = fastest_s(lambda: model.grid_excesses_co2_ppm(along_m, along_m, -8.0, 0.0, values), 3)
    return puffs * nodes * nodes / taken_s


def question_us(puffs: int) -> float:
    """Of an instrument: ten drones ask 25 times a second in the midst of the plume, whose steps are in it."""
    model = upright(puffs)
    rng = np.random.default_rng(1)
    live = model.puffs(0.0).positions_ned_m
    drones = [tuple(place) for place in (live[rng.integers(len(live), size=10)] + (0.0, 0.0, -5.0)).tolist()]
    now_s = 0.0

    def ask() -> None:
        nonlocal now_s
        for _ in range(100):
            now_s += 0.04
            for drone in drones:
                model.excess_co2_ppm(drone, now_s)

    return fastest_s(ask) / 1000.0 * 1e6


def pompy_per_s() -> float:
    """Puff-steps a second of `pompy`, its wind already there."""
    from pompy import models

    class Wind(models.WindModel):  # type: ignore[misc]
        """As it is, but for the conversion of arrays of one number to numbers, which numpy refuses since 2.4."""

        def velocity_at_pos(self, x: float, y: float) -> np.ndarray:
            return np.array([self._interp_u(x, y).item(), self._interp_v(x, y).item()])

    region = models.Rectangle(0.0, 1000.0, -500.0, 500.0)
    wind = Wind(region, 21, 21, rng=np.random.RandomState(1))
    wind.update(_STEP_S)
    wind._set_interpolators()  # noqa: SLF001
    plume = models.PlumeModel(
        region,
        (500.0, 0.0, 0.0),
        wind,
        puff_release_rate=0,
        init_num_puffs=1000,
        rng=np.random.RandomState(1),
    )

    def go() -> None:
        for _ in range(5):
            plume.update(_STEP_S)

    return 5 * 1000 / fastest_s(go, 3)


def draw(growth: dict[int, tuple[float, float]], directory: pathlib.Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 3.6), layout="constrained")
    axes = figure.add_subplot()
    numbers = list(growth)
    axes.loglog(numbers, [1e6 * step_s for step_s, _ in growth.values()], "o-", label="a step of all puffs")
    axes.loglog(numbers, [us for _, us in growth.values()], "s-", label="a question at a point")
    axes.set_xlabel("puffs in the air")
    axes.set_ylabel("processor time, µs")
    axes.grid(which="major", linewidth=0.4)
    axes.legend(frameon=False)
    directory.mkdir(parents=True, exist_ok=True)
    figure.savefig(directory / "puffs.png", dpi=110)


def growth() -> dict[int, tuple[float, float]]:
    """By puffs: seconds a step of the flat plume, µs a question of the upright one."""
    return {puffs: (puffs / advanced_per_s(puffs), question_us(puffs)) for puffs in _GROWTH}


def main() -> None:
    figures = Figures()
    rate = advanced_per_s(_PUFFS)
    figures.show(
        "puffs advanced a second, all that is in a step", rate / 1e6, "M/s", least=_PUFFS_PER_S / 1e6
    )
    every = samples_per_s(flat(10_000, radius_m=200.0), _LENGTH_M)
    figures.show(
        "samples a second, all puffs reach all points", every / 1e9, "G/s", least=_SAMPLES_PER_S / 1e9
    )
    near = samples_per_s(flat(10_000), _LENGTH_M)
    figures.show("samples a second, with the cut-off", near / 1e9, "G/s", least=_SAMPLES_PER_S / 1e9)
    grid = grid_samples_per_s(flat(10_000, radius_m=200.0))
    figures.show("samples a second, nodes of a grid", grid / 1e9, "G/s", least=_SAMPLES_PER_S / 1e9)
    for puffs in (2_000, 10_000):
        figures.show(f"a question of an instrument, {puffs} puffs", question_us(puffs), "us", most=50.0)
    if importlib.util.find_spec("pompy") is None:
        print("  beside pompy: it is not installed (pip install flightstack[bench])")
    else:
        slow = pompy_per_s()
        figures.show("puffs advanced a second by pompy", slow / 1e6, "M/s")
        figures.show("times the rate of pompy", rate / slow, least=_TIMES_POMPY)
    print("   us a step, us a question, by puffs: ", end="")
    grown = growth()
    print(", ".join(f"{puffs}: {1e6 * step_s:.3g}, {us:.3g}" for puffs, (step_s, us) in grown.items()))
    if len(sys.argv) > 1:
        draw(grown, pathlib.Path(sys.argv[1]))
    figures.leave()


if __name__ == "__main__":
    main()
