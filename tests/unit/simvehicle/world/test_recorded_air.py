"""Recorded air is the world's own air: at nodes and frames to the last bit, between them within a stated bound."""

from __future__ import annotations

import math
import pathlib
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.geometry.frames import Geodetic
from simvehicle.world import recorded_air
from simvehicle.world.air import World
from simvehicle.world.compiled_recorded import sample_gas, sample_wind
from simvehicle.world.configured import make_world
from simvehicle.world.filaments import Filaments
from simvehicle.world.gas_formulas import puff_strength_ppm_m3
from simvehicle.world.recorded_air import (
    AirRecordingError,
    RecordedAir,
    RecordingRoom,
    free_memory_bytes,
    record_air,
)
from simvehicle.world.world_config import (
    FilamentPlume,
    FilamentSource,
    FlatFilamentPlume,
    FlatFilamentSource,
    GaussianPlume,
    GridWindConfig,
    LocusGridPlume,
    RectangularObstacle,
    WindConfig,
    WorldConfig,
)

LENGTH_M = 40.0
SPACING_M = 0.8
FRAME_S, BEGIN_S = 1.2, 60.0
UP_M = 3.0
FLAT = FlatFilamentPlume(
    sources=(FlatFilamentSource(north_m=20.0, east_m=30.0), FlatFilamentSource(north_m=8.0, east_m=25.0)),
    initial_radius_m=1.0,
    step_s=0.4,
)
UPRIGHT = FilamentPlume(
    sources=(FilamentSource(north_m=20.0, east_m=30.0, above_home_m=2.0, emission_kgps=0.2),),
    head_start_s=20.0,
)
GRID = GridWindConfig(
    speed_mps=1.0, length_m=LENGTH_M, cells=20, centre_north_m=0.5 * LENGTH_M, centre_east_m=0.5 * LENGTH_M
)
ROCK = RectangularObstacle(centre_north_m=20.0, centre_east_m=20.0, length_north_m=3.0, length_east_m=5.0)
inside_m = st.floats(0.0, LENGTH_M)
frames = st.integers(0, 9)


def config(**changes: Any) -> WorldConfig:
    values: dict[str, Any] = {
        "origin": Geodetic(14.38, -90.6, 2400.0),
        "wind": GRID,
        "plume": FLAT,
        "obstacles": (ROCK,),
        "seed": 11,
    }
    return WorldConfig(**(values | changes))


def recorded(of: WorldConfig, **changes: Any) -> RecordedAir:
    values: dict[str, Any] = {"begin_s": BEGIN_S, "above_home_m": UP_M}
    return record_air(of, of.seed, 9 * FRAME_S, FRAME_S, SPACING_M, **(values | changes))


@numba.njit
def _read(air: Any, north_m: float, east_m: float, time_s: float, wind: Any) -> float:
    sample_wind(air, north_m, east_m, time_s, wind)
    return float(sample_gas(air, north_m, east_m, time_s))


def read(air: RecordedAir, north_m: float, east_m: float, time_s: float) -> tuple[float, float, float]:
    """(gas, wind to the north, to the east) that a vehicle of a trial reads."""
    wind = np.zeros(2)
    gas = _read(air, north_m, east_m, time_s, wind)
    return gas, float(wind[0]), float(wind[1])


def instruments_ppm(world: World, north_m: float, east_m: float, time_s: float) -> float:
    place = (north_m, east_m, -UP_M)
    return world.air_at(place, time_s, (0.0, 0.0, 0.0)).co2_ppm - world.background_co2_ppm


WORLDS = {"flat": make_world(config()), "upright": make_world(config(plume=UPRIGHT))}
AIR = {"flat": recorded(config()), "upright": recorded(config(plume=UPRIGHT))}


@pytest.mark.parametrize("plume", AIR)
def test_a_flight_and_a_trial_read_the_same_at_every_node_and_frame(plume: str) -> None:
    """`World.air_at` against `sample_gas`: equal to single precision, in and beside obstacles too."""
    air, world = AIR[plume], WORLDS[plume]
    assert air.gas.shape == (10, 51, 51)
    assert air.gas.dtype == np.float32
    seen, solid = 0, 0
    for frame in range(10):
        for row in range(0, 51, 2):
            for column in range(frame % 3, 51, 3):
                north_m, east_m = row * SPACING_M, column * SPACING_M
                ppm = instruments_ppm(world, north_m, east_m, BEGIN_S + frame * FRAME_S)
                gas, north_mps, east_mps = read(air, north_m, east_m, frame * FRAME_S)
                # The background's 420 ppm take the last digits of the smallest excesses.
                assert gas == pytest.approx(ppm, rel=1e-6, abs=1e-12)
                wind = world.wind.wind_ned_mps((north_m, east_m, -UP_M), BEGIN_S + frame * FRAME_S)
                if row % 5 == 0 and column % 5 == 0:  # a node of the wind, 2 m apart
                    assert [north_mps, east_mps] == pytest.approx(wind[:2], rel=1e-6)
                seen += ppm > 1e-5
                solid += bool(air.solid[row, column])
                assert ppm == 0.0 or not air.solid[row, column]
    assert seen > 200
    assert solid > 20


@pytest.mark.parametrize("plume", AIR)
def test_at_nodes_the_frames_are_the_fields_answers_to_the_last_bit(plume: str) -> None:
    air, world = AIR[plume], WORLDS[plume]
    north, east = np.meshgrid(np.arange(51) * SPACING_M, np.arange(51) * SPACING_M, indexing="ij")
    places = np.column_stack([north.ravel(), east.ravel(), np.full(north.size, -UP_M)])
    north, east = np.meshgrid(np.arange(21) * 2.0, np.arange(21) * 2.0, indexing="ij")
    wind_places = np.column_stack([north.ravel(), east.ravel(), np.full(north.size, -UP_M)])
    for frame in (0, 3, 9):
        time_s = BEGIN_S + frame * FRAME_S
        assert air.gas[frame].ravel().tolist() == world.gas.excesses_co2_ppm(places, time_s).tolist()
        winds = world.wind.winds_ned_mps(wind_places, time_s).astype(np.float32)
        assert air.wind_mps[frame, 0].ravel().tolist() == winds[:, 0].tolist()
        assert air.wind_mps[frame, 1].ravel().tolist() == winds[:, 1].tolist()
    assert air.solid.ravel().tolist() == (world.obstacles.clearances_m(places) <= 0.0).tolist()


@settings(max_examples=150, deadline=None)
@given(inside_m, inside_m, frames, st.sampled_from(list(AIR)))
def test_between_nodes_it_is_off_by_no_more_than_the_puffs_curvature_allows(
    north_m: float, east_m: float, frame: int, plume: str
) -> None:
    """Bilinear interpolation over a spacing of h is off by no more than h^2/8 times the sum of the second
    derivatives' bounds. That of peak exp(-D^2/r^2) is 2 peak / r^2 along each axis: together h^2 / (2 r^2) of the
    peak of each puff.
    """
    air = AIR[plume]
    gas, obstacles = WORLDS[plume].gas, WORLDS[plume].obstacles
    assert isinstance(gas, Filaments)
    place, time_s = (north_m, east_m, -UP_M), BEGIN_S + frame * FRAME_S
    if obstacles.clearances_m(np.array([place]))[0] < 2.0 * SPACING_M:
        return  # at an obstacle's wall the field itself jumps to 0
    radii_m = gas.puffs(time_s).radii_m
    # On the ground a puff and its mirror image lie upon each other.
    strength = (
        1.0 / math.sqrt(8.0 * math.pi**3) if plume == "flat" else 2.0 * puff_strength_ppm_m3(0.1, 2402.0)
    )
    bound = float((strength / radii_m**3 * SPACING_M**2 / (2.0 * radii_m**2)).sum())
    exact = gas.excess_co2_ppm(place, time_s)
    rounding = 1e-5 * exact + 2e-7 * float((strength / radii_m**3).sum())
    assert abs(read(air, north_m, east_m, frame * FRAME_S)[0] - exact) <= bound + rounding


def test_between_frames_the_air_stands_still() -> None:
    air = AIR["flat"]
    for frame, later_s in ((0, 0.3), (4, 1.19), (8, 0.6)):
        at_frame = read(air, 17.3, 12.9, frame * FRAME_S)
        assert read(air, 17.3, 12.9, frame * FRAME_S + later_s) == at_frame
        assert at_frame != read(air, 17.3, 12.9, (frame + 1) * FRAME_S)
    assert read(air, 17.3, 12.9, 1e6) == read(air, 17.3, 12.9, 9 * FRAME_S)


def test_the_same_seed_is_the_same_air_and_another_is_another() -> None:
    air = AIR["flat"]
    again = recorded(config())
    assert np.array_equal(air.gas, again.gas)
    assert np.array_equal(air.wind_mps, again.wind_mps)
    other = recorded(config(seed=12))
    assert not np.array_equal(air.gas, other.gas)
    assert not np.array_equal(air.wind_mps, other.wind_mps)


@pytest.mark.parametrize(
    "plume",
    [GaussianPlume(source_north_m=20.0, source_east_m=30.0), LocusGridPlume(source_north_m=2.0, source_east_m=2.0)],
)  # fmt: skip
def test_other_gases_and_winds_are_recorded_too(plume: Any) -> None:
    """What does not change has one frame, which holds for ever."""
    of = config(plume=plume, wind=WindConfig(gust_sd_mps=0.5), obstacles=())
    air, world = recorded(of, length_m=(30.0, 50.0)), make_world(of)
    assert air.gas.shape == (1, 39, 64)
    assert air.wind_mps.shape == (10, 2, 2, 2)
    assert air.length_m.tolist() == [30.0, 50.0]
    for row, column, frame in ((0, 0, 0), (20, 30, 3), (38, 63, 9)):
        north_m, east_m = row * SPACING_M, column * SPACING_M
        gas, north_mps, east_mps = read(air, north_m, east_m, frame * FRAME_S)
        place, time_s = (north_m, east_m, -UP_M), BEGIN_S + frame * FRAME_S
        assert gas == pytest.approx(world.gas.excess_co2_ppm(place, time_s), rel=1e-6)
        assert [north_mps, east_mps] == pytest.approx(world.wind.wind_ned_mps(place, time_s)[:2], rel=1e-6)
    still = recorded(
        config(plume=plume, wind=WindConfig(gust_sd_mps=0.0), obstacles=()), length_m=(30.0, 50.0)
    )
    assert still.wind_mps.shape == (1, 2, 2, 2)


# -- room --------------------------------------------------------------------------------------------------------


def test_what_does_not_fit_into_memory_goes_to_the_disk(tmp_path: pathlib.Path) -> None:
    """The same numbers, read by the same machine code, and nothing is left behind."""
    air = AIR["flat"]
    on_disk = recorded(config(), room=RecordingRoom(memory_bytes=1000, directory=tmp_path))
    assert np.array_equal(air.gas, on_disk.gas)
    assert np.array_equal(air.wind_mps, on_disk.wind_mps)
    for time_s in (0.0, 5.0):
        assert read(on_disk, 17.3, 12.9, time_s) == read(air, 17.3, 12.9, time_s)
    assert numba.typeof(on_disk) == numba.typeof(air)
    assert list(tmp_path.iterdir()) == []


def test_what_fits_nowhere_is_refused_before_it_begins(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(
        AirRecordingError, match=r"0.000139 GB of recorded air do not fit into 1e-06 GB of memory, and more"
    ):
        recorded(config(), room=RecordingRoom(memory_bytes=1000, disk_bytes=2000))
    monkeypatch.setattr(recorded_air, "_DISK_LEFT_BYTES", 1 << 60)
    with pytest.raises(AirRecordingError, match=f"and {tmp_path} has room for 0 GB; record fewer frames"):
        recorded(config(), room=RecordingRoom(memory_bytes=1000, directory=tmp_path))
    monkeypatch.undo()
    with pytest.raises(AirRecordingError, match="nowhere does not take them: No such file or directory"):
        recorded(config(), room=RecordingRoom(memory_bytes=1000, directory=tmp_path / "nowhere"))
    assert free_memory_bytes() > 1 << 24


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"wind": WindConfig()}, "wind: without a grid it says nothing of the area to record"),
        ({"wind": GridWindConfig(length_m=40.0)}, r"with a length_m of 40 m its centre is \(20, 20\)"),
        ({"plume": GaussianPlume(source_north_m=20.0, source_east_m=20.0)}, "plume: the source is inside obstacles"),
    ],
)  # fmt: skip
def test_worlds_that_cannot_be_recorded(changes: dict[str, Any], problem: str) -> None:
    values = changes if "wind" not in changes else changes | {"plume": None, "obstacles": ()}
    with pytest.raises(AirRecordingError, match=problem):
        recorded(config(**values))
