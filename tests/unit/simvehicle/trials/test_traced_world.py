"""Worlds of traced plumes: made of their seed alone, shared by all that is flown in them, and what they refuse."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import pandas as pd
import pytest

from simvehicle import code_identity
from simvehicle.compiled import called_by_leaves
from simvehicle.trials.tracing.air_statistics import plume_statistics
from simvehicle.trials.tracing.swarm_flight import TracingVehicles
from simvehicle.trials.tracing.traced_world import (
    TracedWorld,
    engine_of,
    fly_world,
    make_air,
    start_places,
)
from simvehicle.trials.trials_error import TrialsError
from simvehicle.world.recorded_air import RecordedAir

SMALL = TracedWorld(
    number=3,
    length_m=20.0,
    strategies=("casting",),
    robots=(2, 5),
    obstacles=4,
    start_m=8.0,
    head_start_s=6.0,
    spacing_m=1.0,
    vehicles=TracingVehicles(limit_steps=20, range_m=1.0),
)


def changed(**changes: Any) -> TracedWorld:
    return msgspec.structs.replace(SMALL, **changes)


def test_rows_are_the_same_however_they_are_split_and_small_swarms_are_the_first_of_large_ones() -> None:
    whole = fly_world(SMALL, 7, 0, 3)
    parts = pd.concat([fly_world(SMALL, 7, 0, 1), fly_world(SMALL, 7, 1, 2)])
    order = ["strategy", "robots", "trial"]
    pd.testing.assert_frame_equal(
        whole.sort_values(order).reset_index(drop=True), parts.sort_values(order).reset_index(drop=True)
    )
    assert len(whole) == 2 * 3
    assert whole.groupby("trial")["start_m"].nunique().max() == 1
    assert {"arrival_steps", "localisation", "intermittency", "peak_to_mean", "world"} <= set(whole.columns)
    assert fly_world(SMALL, 7, 0, 0).empty


def test_a_world_is_made_of_its_number_and_seed_alone() -> None:
    one, same, other = make_air(SMALL, 7), make_air(SMALL, 7), make_air(changed(number=4), 7)
    assert np.array_equal(one.place.air.gas, same.place.air.gas)
    assert np.array_equal(one.obstacles.corners_m, same.obstacles.corners_m)
    assert not np.array_equal(one.obstacles.corners_m, other.obstacles.corners_m)
    assert one.place.air.gas.max() > 0.0  # the sources were at work before
    # What is flown does not change the air.
    assert np.array_equal(make_air(changed(robots=(9,)), 7).place.air.gas, one.place.air.gas)


def test_everybody_starts_free_and_apart_within_the_distance() -> None:
    air = make_air(SMALL, 7)
    for trial in range(20):
        places = start_places(SMALL, air.place, 7, trial, 12)
        apart = np.linalg.norm(places[:, None] - places, axis=2)[np.triu_indices(12, 1)]
        assert apart.min() > 0.79
        assert places.min() > 0.15
        assert places.max() < 20.0 - 0.15
        flat = np.column_stack([places, np.zeros(12)])
        assert air.obstacles.clearances_m(flat).min() > 0.15
        assert np.array_equal(places[:5], start_places(SMALL, air.place, 7, trial, 5))


def test_a_source_that_moves_is_where_its_gas_comes_from() -> None:
    moving = changed(source_mps=0.05, sources=2, obstacles=0)
    air = make_air(moving, 7)
    places = air.place.sources.places_m
    still = make_air(changed(sources=2, obstacles=0), 7).place.sources.places_m
    assert places[0] == pytest.approx(still[0])
    assert np.linalg.norm(np.diff(places, axis=0), axis=2) == pytest.approx(0.05 * 5 * 1.2)
    assert air.place.sources.every_s == 6.0


def test_the_statistics_of_a_plume_that_is_there_half_the_time() -> None:
    gas = np.zeros((400, 40, 40), np.float32)
    gas[::2, 8:20, 8:20] = 2.0
    gas[1::10, 8:20, 8:20] = 0.0
    air = RecordedAir(
        gas,
        np.zeros((1, 2, 2, 2), np.float32),
        np.zeros((40, 40), np.bool_),
        np.zeros(2),
        0.5,
        np.zeros(2),
        20.0,
        6.0,
        np.full(2, 20.0),
    )
    found = plume_statistics(air, 1e-5)
    assert found["intermittency"] == pytest.approx(0.5)
    assert found["peak_to_mean"] == pytest.approx(2.0)
    assert found["plume_share"] == pytest.approx(0.09)
    assert found["meander"] == 0.0
    assert plume_statistics(air._replace(gas=0.0 * gas), 1e-5)["intermittency"] == 1.0


def test_engines_differ_by_strategy_only() -> None:
    assert engine_of((SMALL,)) == engine_of((changed(number=9, robots=(3,)),))
    assert engine_of((SMALL,)) != engine_of((changed(strategies=("chemotaxis",)),))


def test_an_engine_is_the_same_whatever_else_a_process_has_compiled() -> None:
    before = engine_of((SMALL,))

    def another(north_m: float) -> float:
        return north_m + 1.0

    called_by_leaves(another)
    code_identity._own.cache_clear()
    assert engine_of((SMALL,)) == before


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"strategies": ("locus",)}, "strategy locus is no rule of ticks"),
        ({"strategies": ("no-such",)}, "no strategy is called 'no-such'"),
        ({"regime": "calm"}, "no regime is called 'calm'; there are laminar, transitional, turbulent"),
        ({"robots": (0,)}, "a swarm has 1 to 1000 robots, not 0"),
        ({"vehicles": TracingVehicles(step_s=9.0)}, "longer than a vehicle"),
        ({"obstacles": 400}, "no room for 400 obstacles of 1.5 m"),
        ({"robots": (900,)}, "no room for 900 robots"),
    ],
)
def test_what_cannot_be_is_one_line(changes: Any, words: str) -> None:
    with pytest.raises(TrialsError, match=words):
        fly_world(changed(**changes), 1, 0, 1)
