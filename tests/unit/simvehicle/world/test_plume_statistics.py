"""Statistics of plumes: of series and fields that are known, and of puffs, which a shorter step must not change."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission.geometry.frames import Geodetic
from simvehicle.world.plume_statistics import (
    plume_statistics,
    plume_width,
    series_statistics,
    whiffs_and_blanks,
)
from simvehicle.world.recorded_air import RecordedAir, record_air
from simvehicle.world.world_config import FlatFilamentPlume, FlatFilamentSource, GridWindConfig, WorldConfig

SPACING_M = 0.5


def air_of(gas: Any, frame_s: float = 2.0) -> RecordedAir:
    frames = np.asarray(gas, np.float32)
    shape = frames.shape[1:]
    sides_m = SPACING_M * (np.array(shape) - 1)
    wind = np.zeros((1, 2, 2, 2), np.float32)
    return RecordedAir(
        frames, wind, np.zeros(shape, bool), np.zeros(2), SPACING_M, np.zeros(2), 50.0, frame_s, sides_m
    )


def test_whiffs_and_blanks_of_a_series_that_is_known() -> None:
    """The first and the last stretch are cut by the recording, and their length is not known."""
    series = np.array([5, 5, 0, 0, 0, 7, 0, 9, 9, 9, 0, 0, 4, 4, 4])
    whiffs_s, blanks_s = whiffs_and_blanks(series, 0.5, 3.0)
    assert whiffs_s.tolist() == [0.5, 1.5]
    assert blanks_s.tolist() == [1.5, 0.5, 1.0]
    both = np.column_stack([series, np.roll(series, 1), np.zeros(15)])
    assert whiffs_and_blanks(both, 0.5, 3.0)[0].tolist() == [0.5, 1.5, 0.5, 1.5]
    assert [len(found) for found in whiffs_and_blanks(np.zeros(20), 0.5, 3.0)] == [0, 0]


def test_the_statistics_of_a_series_that_is_known() -> None:
    series = np.tile([0.0, 0.0, 0.0, 8.0], 100)
    found = series_statistics(series, 0.5, 1.0)
    assert found == (0.75, 4.0, 0.5, 0.5, 1.5, 1.5)
    nothing = series_statistics(np.zeros(50), 0.5, 1.0)
    assert nothing.intermittency == 1.0
    assert all(math.isnan(number) for number in nothing[1:])


@given(st.lists(st.floats(0.0, 1e6), min_size=1, max_size=60), st.floats(0.01, 10.0), st.floats(0.0, 1e5))
def test_whiffs_and_blanks_never_last_longer_than_they_are_recorded(
    readings: list[float], sample_s: float, threshold: float
) -> None:
    whiffs_s, blanks_s = whiffs_and_blanks(np.array(readings), sample_s, threshold)
    assert whiffs_s.sum() + blanks_s.sum() <= sample_s * len(readings) * (1.0 + 1e-9)
    assert abs(len(whiffs_s) - len(blanks_s)) <= 1
    found = series_statistics(np.array(readings), sample_s, threshold)
    assert 0.0 <= found.intermittency <= 1.0


def test_a_plume_that_swings_has_the_width_of_its_own_and_of_its_swing() -> None:
    """A Gaussian ridge to the north of the source, that moves to and fro by a sine."""
    north, east = np.meshgrid(np.arange(161) * SPACING_M, np.arange(161) * SPACING_M, indexing="ij")
    middles_m = 40.0 + 5.0 * np.sin(np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False))
    gas = [np.exp(-0.5 * ((east - middle_m) / 2.0) ** 2) * (north >= 0.0) for middle_m in middles_m]
    width = plume_width(air_of(gas), (0.0, 40.0), 60.0)
    assert width.own_m == pytest.approx(2.0, rel=0.03)
    assert width.meander_m == pytest.approx(5.0 / math.sqrt(2.0), rel=0.03)
    assert width.total_m == pytest.approx(math.hypot(width.own_m, width.meander_m))
    assert math.isnan(plume_width(air_of(np.zeros((3, 40, 40))), (0.0, 0.0), 5.0).own_m)


def test_only_what_the_plume_covers_counts() -> None:
    """A quarter of the ground has gas half of the time, the rest never; a solid node is no ground."""
    gas = np.zeros((40, 16, 16))
    gas[::2, :8, :8] = 2.0
    air = air_of(gas)
    found = plume_statistics(air, 0.5, every=1)
    assert found.plume_share == 0.25
    assert found.series == (0.5, 2.0, 2.0, 2.0, 2.0, 2.0)
    air.solid[8:, :] = True
    assert plume_statistics(air, 0.5, every=1).plume_share == 0.5


@pytest.mark.parametrize("regime", ["laminar", "turbulent"])
def test_half_the_step_changes_a_plumes_statistics_by_less_than_a_twentieth(regime: Any) -> None:
    """Of the puffs of the fluxotaxis experiments; the wind is the same to the bit, the puffs' shaking another."""
    length_m = 60.0
    found = []
    for step_s in (1.2, 0.6):
        config = WorldConfig(
            origin=Geodetic(0.0, 0.0, 0.0),
            wind=GridWindConfig(
                speed_mps=0.5,
                length_m=length_m,
                cells=30,
                centre_north_m=0.5 * length_m,
                centre_east_m=0.5 * length_m,
                regime=regime,
            ),
            plume=FlatFilamentPlume(
                sources=(FlatFilamentSource(north_m=30.0, east_m=45.0),),
                puffs_per_s=5.0,
                step_s=step_s,
                reach_m=80.0,
                lifetime_s=400.0,
            ),
        )
        air = record_air(config, 3, 1800.0, 1.2, 1.0, begin_s=300.0)
        statistics = plume_statistics(air, 1e-3, every=1)
        widths_m = plume_width(air, (30.0, 45.0), 15.0)
        found.append(np.array([*statistics.series, statistics.plume_share, *widths_m]))
    assert np.isfinite(found).all()
    assert found[1] == pytest.approx(found[0], rel=0.05)
