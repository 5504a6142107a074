"""Gas and wind of one seed, recorded once for all the trials that are flown in them.

A plume and its wind cost seconds to compute and cannot go back in time; thousands of trials ask them at all times. So
they are written down, frame by frame, at the nodes of a level grid. `simvehicle.world.compiled_recorded` says what is
between the nodes.
"""

from __future__ import annotations

import math
import os
import pathlib
import shutil
import tempfile
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from mission.geometry.formation import FloatArray
from simvehicle.world.configured import make_wind
from simvehicle.world.fields import GasField, WindField
from simvehicle.world.filaments import Filaments
from simvehicle.world.gas import make_gas
from simvehicle.world.obstacles import Obstacles
from simvehicle.world.wind import GustyWind
from simvehicle.world.world_config import GridWindConfig, WorldConfig
from simvehicle.world.world_problems import problems

_MEMORY_SHARE = 0.25
"""Of the memory that is free: others record beside us, and trials need some too."""
_DISK_LEFT_BYTES = 1 << 30
"""A disk is not filled to the brim."""


class AirRecordingError(ValueError):
    """Air that cannot be recorded; the message is one line for a person."""


class RecordedAir(NamedTuple):
    """Frames of gas and wind over a level area that begins at (0, 0); rows go north, columns east."""

    gas: NDArray[np.float32]
    """(frames, rows, columns) at the nodes, in the plume's unit; 0 inside obstacles."""
    wind_mps: NDArray[np.float32]
    """(frames, 2, rows, columns) of the wind's own nodes: to the north, to the east."""
    solid: NDArray[np.bool_]
    """(rows, columns) of the gas' nodes that are inside an obstacle."""
    gas_origin_m: FloatArray
    """(2,) north and east of the first node."""
    gas_spacing_m: float
    wind_origin_m: FloatArray
    """(2,)"""
    wind_spacing_m: float
    frame_s: float
    """Time between frames; the first is at 0 s."""
    length_m: FloatArray
    """(2,) of the area, to the north and to the east."""


class RecordingRoom(NamedTuple):
    """Where recorded air may go, and how much of it."""

    memory_bytes: int | None = None
    """None: a quarter of what is free."""
    disk_bytes: int = 32 << 30
    directory: pathlib.Path | None = None
    """For what does not fit into memory. None: the system's for temporary files."""


def record_air(
    config: WorldConfig,
    seed: int,
    duration_s: float,
    frame_s: float,
    spacing_m: float,
    *,
    length_m: tuple[float, float] | None = None,
    begin_s: float = 0.0,
    above_home_m: float = 10.0,
    room: RecordingRoom | None = None,
) -> RecordedAir:
    """The air of `config` with this seed from `begin_s` on, for `duration_s`, a frame every `frame_s`.

    At its nodes and at the times of its frames it holds what the world's fields answer there and then, at the height
    `above_home_m`. Frame k is at the world's time `begin_s` + k `frame_s`. A steady plume, or a uniform wind without
    gusts, has one frame. The gas has nodes every `spacing_m`, the wind those of its own grid, if it has one.

    `length_m`: of the area to the north and to the east of (0, 0); None: that of the wind's grid, which begins there.
    `AirRecordingError`: a world that cannot be, or more than there is room for.
    """
    for field, problem in problems(config):
        raise AirRecordingError(f"{field}: {problem}")
    config = msgspec.structs.replace(config, seed=seed)
    area_m = _area_m(config) if length_m is None else length_m
    obstacles = Obstacles(config.obstacles)
    # Gas and wind are asked for the same times: the puffs go with the very wind that is recorded.
    wind = make_wind(config.wind, seed, obstacles)
    gas = make_gas(config.plume, wind, config.origin.amsl_m, seed, obstacles)
    gas_nodes, wind_nodes = _gas_nodes(area_m, spacing_m), _wind_nodes(wind, config, area_m, spacing_m)
    frames = math.ceil(duration_s / frame_s - 1e-6) + 1
    shapes = [
        (frames if isinstance(gas, Filaments) else 1, *gas_nodes.shape),
        (1 if isinstance(wind, GustyWind) and wind.steady else frames, 2, *wind_nodes.shape),
    ]
    gas_frames, wind_frames = _arrays(shapes, room or RecordingRoom())
    _fill(gas, gas_nodes, wind, wind_nodes, begin_s, frame_s, above_home_m, gas_frames, wind_frames)
    places = gas_nodes.places_ned_m(above_home_m)
    return RecordedAir(
        gas_frames,
        wind_frames,
        np.asarray(obstacles.clearances_m(places) <= 0.0).reshape(gas_nodes.shape),
        np.array([gas_nodes.norths_m[0], gas_nodes.easts_m[0]]),
        gas_nodes.spacing_m,
        np.array([wind_nodes.norths_m[0], wind_nodes.easts_m[0]]),
        wind_nodes.spacing_m,
        frame_s,
        np.array(area_m, np.float64),
    )


# -- nodes and frames ------------------------------------------------------------------------------------------


class _Nodes(NamedTuple):
    norths_m: FloatArray
    easts_m: FloatArray
    spacing_m: float

    @property
    def shape(self) -> tuple[int, int]:
        return len(self.norths_m), len(self.easts_m)

    def places_ned_m(self, above_home_m: float) -> FloatArray:
        north, east = np.meshgrid(self.norths_m, self.easts_m, indexing="ij")
        return np.column_stack([north.ravel(), east.ravel(), np.full(north.size, -above_home_m)])


def _area_m(config: WorldConfig) -> tuple[float, float]:
    wind = config.wind
    if not isinstance(wind, GridWindConfig):
        raise AirRecordingError("wind: without a grid it says nothing of the area to record; give its length")
    half_m = 0.5 * wind.length_m
    if abs(wind.centre_north_m - half_m) > 1e-6 or abs(wind.centre_east_m - half_m) > 1e-6:
        raise AirRecordingError(
            f"wind.centre_north_m, centre_east_m: the recorded area begins at (0, 0); with a length_m of "
            f"{wind.length_m:g} m its centre is ({half_m:g}, {half_m:g})"
        )
    return wind.length_m, wind.length_m


def _gas_nodes(area_m: tuple[float, float], spacing_m: float) -> _Nodes:
    """From the origin at least to the end of the area."""
    rows, columns = (max(math.ceil(side_m / spacing_m - 1e-9) + 1, 2) for side_m in area_m)
    return _Nodes(
        spacing_m * np.arange(rows, dtype=float), spacing_m * np.arange(columns, dtype=float), spacing_m
    )


def _wind_nodes(
    wind: WindField, config: WorldConfig, area_m: tuple[float, float], spacing_m: float
) -> _Nodes:
    if isinstance(wind, GustyWind):
        return _Nodes(np.array([0.0, max(area_m)]), np.array([0.0, max(area_m)]), max(area_m))
    if not isinstance(config.wind, GridWindConfig):
        return _gas_nodes(area_m, spacing_m)
    own = config.wind
    along_m = own.spacing_m * np.arange(own.cells + 1, dtype=float) - 0.5 * own.length_m
    return _Nodes(own.centre_north_m + along_m, own.centre_east_m + along_m, own.spacing_m)


def _fill(
    gas: GasField,
    gas_nodes: _Nodes,
    wind: WindField,
    wind_nodes: _Nodes,
    begin_s: float,
    frame_s: float,
    above_home_m: float,
    gas_frames: NDArray[np.float32],
    wind_frames: NDArray[np.float32],
) -> None:
    gas_places, wind_places = gas_nodes.places_ned_m(above_home_m), wind_nodes.places_ned_m(above_home_m)
    for frame in range(max(len(gas_frames), len(wind_frames))):
        time_s = begin_s + frame * frame_s
        if frame < len(gas_frames):
            if isinstance(gas, Filaments):
                gas.grid_excesses_co2_ppm(
                    gas_nodes.norths_m, gas_nodes.easts_m, -above_home_m, time_s, gas_frames[frame]
                )
            else:
                gas_frames[frame] = gas.excesses_co2_ppm(gas_places, time_s).reshape(gas_nodes.shape)
        if frame < len(wind_frames):
            winds = wind.winds_ned_mps(wind_places, time_s)[:, :2]
            wind_frames[frame] = winds.T.reshape(2, *wind_nodes.shape)


# -- room ------------------------------------------------------------------------------------------------------


def _arrays(shapes: list[tuple[int, ...]], room: RecordingRoom) -> list[NDArray[np.float32]]:
    """Empty arrays, in memory if there they fit."""
    needed = 4 * sum(math.prod(shape) for shape in shapes)
    memory = int(_MEMORY_SHARE * free_memory_bytes()) if room.memory_bytes is None else room.memory_bytes
    if needed <= memory:
        return [np.empty(shape, np.float32) for shape in shapes]
    directory = room.directory or pathlib.Path(tempfile.gettempdir())
    where = f"{_size(needed)} of recorded air do not fit into {_size(memory)} of memory"
    mend = "record fewer frames or wider nodes"
    if needed > room.disk_bytes:
        raise AirRecordingError(
            f"{where}, and more than {_size(room.disk_bytes)} may not go to the disk; {mend}"
        )
    try:
        free = shutil.disk_usage(directory).free - _DISK_LEFT_BYTES
        if needed > free:
            raise AirRecordingError(f"{where}, and {directory} has room for {_size(max(free, 0))}; {mend}")
        return [_on_disk(shape, directory) for shape in shapes]
    except OSError as error:
        raise AirRecordingError(
            f"{where}, and {directory} does not take them: {error.strerror}; {mend}"
        ) from error


def _on_disk(shape: tuple[int, ...], directory: pathlib.Path) -> NDArray[np.float32]:
    """An array in a file without a name, which is gone with the array, however the process ends."""
    with tempfile.TemporaryFile(dir=directory) as file:
        # Now, so that a full disk is an error here, and not the end of the process at some later frame.
        os.posix_fallocate(file.fileno(), 0, 4 * math.prod(shape))
        return np.asarray(np.memmap(file, np.float32, "r+", shape=shape))


def free_memory_bytes() -> int:
    """What this machine can give without pushing out others."""
    try:
        told = pathlib.Path("/proc/meminfo").read_text(encoding="ascii")
        lines = dict(line.split(":", 1) for line in told.splitlines())
        return int(lines["MemAvailable"].split()[0]) * 1024
    except (OSError, KeyError, ValueError):
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2


def _size(number: int) -> str:
    return f"{number / 1e9:.3g} GB"
