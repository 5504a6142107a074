"""The winds: what a vehicle pays for a question, what a map of many points costs, and how fast the solver steps.

A flight asks a thousand times a second for a point: no wind may cost much more than the uniform one.
"""

from __future__ import annotations

import math
import statistics
import time

import numpy as np

from benchmarks import Figures
from simvehicle.world.configured import make_wind
from simvehicle.world.fields import WindField
from simvehicle.world.grid_wind import GridWind
from simvehicle.world.obstacles import Obstacles
from simvehicle.world.world_config import (
    AnyWindConfig,
    BoundaryLayerWindConfig,
    GridWindConfig,
    RectangularObstacle,
    ThermalsConfig,
    WindConfig,
)

QUESTIONS = 2000
ROUNDS = 9
POINTS = 100_000
STEPS = 2000
TIMES_UNIFORM = 10.0
"""More than so many uniform winds no grid wind may cost."""


def main() -> None:
    figures = Figures()
    blocks = Obstacles(
        [
            RectangularObstacle(
                centre_north_m=17.0 * row - 42.0,
                centre_east_m=23.0 * column - 57.0,
                length_north_m=5.0,
                length_east_m=6.0,
            )
            for row in range(6)
            for column in range(6)
        ]
    )
    open_ground = Obstacles(())
    gusts, grid = WindConfig(), GridWindConfig(roughness_m=0.05)
    warm = BoundaryLayerWindConfig(thermals=ThermalsConfig())
    rows: list[tuple[str, AnyWindConfig, Obstacles]] = [
        ("uniform", gusts, open_ground),
        ("grid, 61^2 nodes", grid, open_ground),
        ("grid among 36 obstacles", grid, blocks),
        ("boundary-layer", BoundaryLayerWindConfig(), open_ground),
        ("boundary-layer with thermals", warm, open_ground),
    ]
    uniform_us = 0.0
    for name, config, standing in rows:
        wind = make_wind(config, 1, standing)
        us = question_us(wind)
        uniform_us = uniform_us or us
        most = TIMES_UNIFORM if isinstance(config, GridWindConfig) else math.inf
        figures.show(f"{name}: a question at 1000 a second", us, "us")
        figures.show(f"{name}: the same, uniform winds", us / uniform_us, "x", most=most)
        figures.show(f"{name}: points of a map a second", points_per_s(wind) / 1e6, "million")
    wind = make_wind(GridWindConfig(), 1, open_ground)
    assert isinstance(wind, GridWind)
    wind.grid_mps(0.0)
    began = time.thread_time()
    wind.grid_mps(STEPS * wind.step_s)
    spent_s = time.thread_time() - began
    figures.show("grid: nodes the solver updates a second", STEPS * wind.nodes**2 / spent_s / 1e6, "million")
    figures.show("grid: of a core for a flight in real time", 100.0 * spent_s / (STEPS * wind.step_s), "%")
    figures.leave()


def question_us(wind: WindField) -> float:
    """Processor time of `wind_ned_mps`, the median of some rounds, time going on."""
    rng = np.random.default_rng(1)
    places = [
        (float(n), float(e), -float(up))
        for n, e, up in rng.uniform((-80, -80, 2), (80, 80, 40), (QUESTIONS, 3))
    ]
    times_us = []
    for turn in range(ROUNDS):
        wind.wind_ned_mps(places[0], 2.0 * turn)
        began = time.thread_time()
        for index, place in enumerate(places):
            wind.wind_ned_mps(place, 2.0 * turn + 0.001 * index)
        times_us.append(1e6 * (time.thread_time() - began) / QUESTIONS)
    return statistics.median(times_us)


def points_per_s(wind: WindField) -> float:
    places = np.random.default_rng(2).uniform((-80, -80, -40), (80, 80, -2), (POINTS, 3))
    wind.winds_ned_mps(places, 30.0)
    began = time.thread_time()
    wind.winds_ned_mps(places, 30.0)
    return POINTS / max(time.thread_time() - began, 1e-9)


if __name__ == "__main__":
    main()
