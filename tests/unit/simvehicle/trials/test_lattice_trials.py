"""A lattice in recorded air: it traces, keeps its limits, and gives the same rows however trials are batched."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from mission.strategies.lattice.lattice_rule import CHEMOTAXIS, FLUXOTAXIS
from simvehicle.trials.tracing.flying import NEVER
from simvehicle.trials.tracing.lattice_flying import (
    CLOSEST_M,
    CONTACT,
    CONTAINED,
    END_M,
    INSIDE,
    Tracing,
    fly_lattice_trials,
)
from simvehicle.trials.tracing.swarm_flight import TracedScene, TracingVehicles, make_place
from simvehicle.trials.trials_error import TrialsError
from simvehicle.world.obstacles import Obstacles
from simvehicle.world.recorded_air import RecordedAir
from simvehicle.world.world_config import RectangularObstacle

LENGTH_M, SOURCE_M = 20.0, (14.0, 10.0)
VEHICLES = TracingVehicles(limit_steps=1500)
ROCK = RectangularObstacle(centre_north_m=9.0, centre_east_m=10.0, length_north_m=1.5, length_east_m=1.5)


def place(*, rock: bool = False) -> TracedScene:
    """A steady plume with the wind from the north."""
    nodes = np.linspace(0.0, LENGTH_M, 81)
    north, east = np.meshgrid(nodes, nodes, indexing="ij")
    width_m = 1.0 + 0.2 * np.maximum(SOURCE_M[0] - north, 0.0)
    upwind_m = np.maximum(north - SOURCE_M[0], 0.0)
    gas = np.exp(-0.5 * ((east - SOURCE_M[1]) / width_m) ** 2 - upwind_m**2) / width_m**2
    gas[gas < 1e-4] = 0.0
    wind = np.zeros((1, 2, 3, 3), np.float32)
    wind[:, 0] = -0.5
    air = RecordedAir(
        gas[None].astype(np.float32),
        wind,
        np.zeros((81, 81), bool),
        np.zeros(2),
        0.25,
        np.zeros(2),
        10.0,
        1.0,
        np.array([LENGTH_M, LENGTH_M]),
    )
    return make_place(air, np.array([SOURCE_M]), Obstacles([ROCK] if rock else []))


def centres(count: int) -> np.ndarray:
    return np.random.default_rng(4).uniform(1.0, 6.0, (count, 2))


def test_a_lattice_comes_to_the_source_and_stays_about_it() -> None:
    found = fly_lattice_trials(place(), VEHICLES, Tracing(tracer=CHEMOTAXIS), centres(12), seed=1)
    assert (found.counts[:, CONTACT] < NEVER).all()
    assert (found.counts[:, INSIDE] == 1).mean() > 0.9
    assert (found.distances_m[:, END_M] < 1.5).mean() > 0.9
    assert (found.distances_m[:, CLOSEST_M] <= found.distances_m[:, END_M]).all()
    assert (found.counts[:, CONTAINED] < VEHICLES.limit_steps).all()


def test_equal_seeds_give_equal_rows_however_trials_are_batched() -> None:
    noisy, tracing = msgspec.structs.replace(VEHICLES, noise=0.01), Tracing(tracer=FLUXOTAXIS)
    whole = fly_lattice_trials(place(), noisy, tracing, centres(6), seed=1, first=3)
    part = fly_lattice_trials(place(), noisy, tracing, centres(6)[4:], seed=1, first=7)
    np.testing.assert_array_equal(whole.counts[4:], part.counts)
    np.testing.assert_array_equal(whole.distances_m[4:], part.distances_m)
    other = fly_lattice_trials(place(), noisy, tracing, centres(6)[4:], seed=2, first=7)
    assert (whole.distances_m[4:] != other.distances_m).any()


@pytest.mark.parametrize("tracer", [CHEMOTAXIS, FLUXOTAXIS])
def test_no_vehicle_is_too_fast_touches_another_an_obstacle_or_a_wall(tracer: int) -> None:
    tracks = fly_lattice_trials(
        place(rock=True), VEHICLES, Tracing(tracer=tracer), np.array([[3.0, 9.0]]), seed=1, every=1
    ).tracks_m
    way_m = np.hypot(*np.diff(tracks, axis=0).transpose(2, 0, 1))
    assert way_m.max() <= VEHICLES.step_s * VEHICLES.speed_mps + 1e-9
    apart_m = np.hypot(*(tracks[:, :, None] - tracks[:, None]).transpose(3, 0, 1, 2))
    assert apart_m[:, *np.triu_indices(7, 1)].min() >= 2.0 * VEHICLES.radius_m - 1e-9
    assert tracks.min() >= VEHICLES.radius_m - 1e-9
    assert tracks.max() <= LENGTH_M - VEHICLES.radius_m + 1e-9
    beside_m = np.maximum(np.abs(tracks - (9.0, 10.0)) - 0.75, 0.0)
    assert np.hypot(beside_m[:, :, 0], beside_m[:, :, 1]).min() >= VEHICLES.radius_m - 1e-6
    # It gets past the rock that stands in its way.
    assert math.dist(tracks[-1, 0], SOURCE_M) < math.dist(tracks[0, 0], SOURCE_M)


def test_a_start_that_cannot_be_is_told() -> None:
    with pytest.raises(TrialsError, match="start in an obstacle"):
        fly_lattice_trials(
            place(rock=True), VEHICLES, Tracing(tracer=FLUXOTAXIS), np.array([[9.0, 10.9]]), seed=1
        )
