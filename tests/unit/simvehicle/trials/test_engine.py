"""The fast engine against the slow one: the same trial from the same luck, the same distribution from other luck."""

from __future__ import annotations

import importlib.util
import pathlib
import sys
from typing import Any

import numpy as np
import pytest

from simvehicle.trials.cell import Cell
from simvehicle.trials.outcome import run_cell

TICKS_PER_S = 16


def load_reference() -> Any:
    path = pathlib.Path(__file__).with_name("trials_reference.py")
    spec = importlib.util.spec_from_file_location("trials_reference", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


reference = load_reference()


def cell(**changes: Any) -> Cell:
    return Cell(**({"drones": 4, "arena_m": 30.0, "limit_ticks": 60_000} | changes))


SAME = [
    cell(),
    cell(plume="perturbed", drones=7),
    cell(drones=1),
    cell(drones=3, layout="hexagonal"),
    cell(failure="generic", failure_rate=1e-4, drones=9),
    cell(failure="generic", failure_rate=2e-4, drones=6, healing=False),
    cell(failure="in-plume", failure_rate=1e-3, drones=8),
    cell(failure="in-plume", failure_rate=5e-3, drones=6, plume="perturbed", healing=False),
    cell(strategy="mobs"),
    cell(strategy="mobs", plume="perturbed", drones=2),
    cell(strategy="mobs", failure="generic", failure_rate=1e-4),
    cell(strategy="mobs", failure="in-plume", failure_rate=1e-2),
    cell(motion="paper"),
    cell(motion="paper", plume="perturbed", drones=7, arena_m=90.0),
    cell(motion="paper", failure="generic", failure_rate=1e-3, drones=9),
    cell(motion="paper", failure="in-plume", failure_rate=5e-3, drones=8, healing=False, unhealed="nobody"),
    cell(failure="generic", failure_rate=5e-5, drones=6, healing=False, unhealed="nobody"),
    cell(motion="paper", strategy="mobs", failure="in-plume", failure_rate=1e-2),
    cell(strategy="mobs-authors"),
    cell(strategy="mobs-authors", motion="paper", plume="perturbed", drones=2),
    cell(strategy="mobs-authors", motion="paper", cut_cells=True, cut_goal=True, plume="perturbed"),
    cell(strategy="mobs-authors", cut_cells=True, failure="in-plume", failure_rate=1e-2),
    cell(strategy="mobs-authors", cut_goal=True, failure="generic", failure_rate=1e-4),
    cell(motion="paper", cut_cells=True, cut_goal=True),
]


@pytest.mark.parametrize("which", range(len(SAME)), ids=[f"{one.motion} {one.label()}" for one in SAME])
def test_the_same_luck_gives_the_same_trial(which: int) -> None:
    one = SAME[which]
    rows = run_cell(one, seed=5, first=0, count=4)
    for number, row in rows.iterrows():
        trial = reference.Trial(one, reference.SharedLuck(one, 5, number)).run()
        assert (row.plume_north_m, row.plume_east_m) == pytest.approx(trial.origin)
        assert row.success == (trial.success is not None)
        if trial.success is not None:
            assert row.source_s * TICKS_PER_S == trial.success
        if trial.contact is None:
            assert np.isnan(row.contact_s)
        else:
            assert row.contact_s * TICKS_PER_S == trial.contact
        if one.strategy == "locus" and one.healing and row.ended != "limit":
            assert (row.heals, row.moves) == (trial.heals, trial.moves)
        if row.success:
            assert row.survivors == sum(trial.alive)


def test_at_the_authors_places_the_median_is_their_programs() -> None:
    """About 16,600 ticks with 20 drones. Over thousands of places it is 21,400; a hundred give +-1,300."""
    places = reference.authors_places(100)
    assert (places[0], places[99]) == ((-38.3, 11.4), (-57.2, -52.4))
    ticks = [
        run_cell(Cell(source=place), seed, trial, 1).source_s.iloc[0] * TICKS_PER_S
        for seed in (1, 2, 3)
        for trial, place in enumerate(places)
    ]
    assert np.median(ticks) == pytest.approx(16_600, rel=0.1)


def ks_distance(a: np.ndarray, b: np.ndarray) -> float:
    """Largest distance of two empirical distribution functions."""
    places = np.concatenate([a, b])
    below_a = np.searchsorted(np.sort(a), places, side="right") / len(a)
    below_b = np.searchsorted(np.sort(b), places, side="right") / len(b)
    return float(np.abs(below_a - below_b).max())


@pytest.mark.parametrize(
    "one",
    [
        cell(drones=3, arena_m=20.0),
        cell(drones=3, arena_m=20.0, strategy="mobs"),
        cell(drones=4, arena_m=20.0, failure="generic", failure_rate=2e-4),
        cell(drones=4, arena_m=20.0, failure="in-plume", failure_rate=2e-3),
    ],
    ids=lambda one: one.label(),
)
def test_luck_of_its_own_gives_the_same_distribution(one: Cell) -> None:
    """Kolmogorov-Smirnov at the 0.1 % level, over the time of the end with failures at infinity."""
    slow_count, fast_count = 60, 600
    slow = [reference.Trial(one, reference.OwnLuck(one, 1, k)).run() for k in range(slow_count)]
    fast = run_cell(one, seed=77, first=0, count=fast_count)
    limit = 1.949 * np.sqrt((slow_count + fast_count) / (slow_count * fast_count))
    for what, column in (("success", "source_s"), ("contact", "contact_s")):
        slow_s = np.array(
            [np.inf if getattr(t, what) is None else getattr(t, what) / TICKS_PER_S for t in slow]
        )
        fast_s = fast[column].fillna(np.inf).to_numpy()
        assert ks_distance(slow_s, fast_s) < limit, what
