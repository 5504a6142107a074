"""The virtual-force rule as the trials compile it."""

from __future__ import annotations

import numpy as np

from mission.strategies.virtual_forces import ENTRY, RANGE_M
from simvehicle.trials.cell import Cell
from simvehicle.trials.outcome import record_trial, run_cell

DOWNWIND = Cell(
    strategy="virtual-forces",
    drones=7,
    plume="gusty",
    arena_m=60.0,
    speed_mps=2.0,
    source=(-45.0, 4.0),
    success_m=4.0,
    limit_ticks=16 * 240,
)


def test_a_swarm_in_the_plume_comes_to_the_source_together() -> None:
    rows = run_cell(DOWNWIND, 1, 0, 40)
    assert rows["contact_s"].notna().all()
    assert rows["success"].mean() > 0.9
    track = record_trial(DOWNWIND, 1, 3).track
    assert track is not None
    last = track.samples_m[np.isfinite(track.samples_m[:, :, 0]).all(axis=1)][-1]
    apart_m = np.hypot(*(last[:, None] - last[None]).transpose(2, 0, 1))[np.triu_indices(7, 1)]
    assert apart_m.max() < RANGE_M
    assert apart_m.min() > 3.0
    assert ENTRY.ticks is not None
