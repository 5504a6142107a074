"""The world's own record of a flight: where every vehicle really was, read while it is written and afterwards."""

from __future__ import annotations

import dataclasses
import io
import pathlib
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mission.geometry.frames import Vector3
from simvehicle.drone.drones import SimulatedDrones

Floats = NDArray[np.float64]

COLUMNS = (
    "time_s",
    "drone",
    "north_m",
    "east_m",
    "down_m",
    "airborne",
    "armed",
    "mode",
    "co2_ppm",
    "battery_fraction",
)
"""Of the file, in this order; see `simvehicle.fleet.fleet_config.FleetConfig.truth`."""
STEP_S = 0.1
"""Simulated time from one row of a vehicle to its next, on average: a row belongs to the step that it was made in."""
LONGEST_STEP_S = 0.3
"""Two rows of a vehicle that are further apart than this are not neighbours: something is missing between them."""


class TruthRow(NamedTuple):
    time_s: float
    drone: int
    position_ned_m: Vector3
    airborne: bool
    armed: bool
    mode: str
    co2_ppm: float
    battery_fraction: float


def parse_row(line: str) -> TruthRow | None:
    """One line of the file; None for the header and for a line that a dying writer left unfinished."""
    cells = line.strip().split(",")
    if len(cells) != len(COLUMNS):
        return None
    time_s, drone, north_m, east_m, down_m, airborne, armed, mode, co2_ppm, battery = cells
    try:
        return TruthRow(
            float(time_s),
            int(drone),
            (float(north_m), float(east_m), float(down_m)),
            airborne == "1",
            armed == "1",
            mode,
            float(co2_ppm),
            float(battery),
        )
    except ValueError:
        return None


class TruthWriter:
    """Writes the file: a row of every drone ten times a simulated second, flushed once a second.

    `OSError` where the file cannot be written.
    """

    def __init__(self, path: pathlib.Path) -> None:
        self._file = path.open("w", encoding="utf-8")
        self._file.write(",".join(COLUMNS) + "\n")
        self._due_s = 0.0
        self._flush_due_s = 1.0

    def step(self, now_s: float, drones: SimulatedDrones) -> None:
        if now_s < self._due_s:
            return
        self._due_s = max(self._due_s + STEP_S, now_s)
        for drone_id, drone in drones.by_id.items():
            v = drone.vehicle
            north, east, down = v.position_ned_m
            co2_ppm = drones.world.co2_ppm((north, east, down), now_s)
            self._file.write(
                f"{now_s:.2f},{drone_id},{north:.3f},{east:.3f},{down:.3f},{v.airborne:d},{v.armed:d},{v.mode},"
                f"{co2_ppm:.2f},{v.battery_fraction:.4f}\n"
            )
        if now_s >= self._flush_due_s:
            self._flush_due_s = now_s + 1.0
            self._file.flush()

    def close(self) -> None:
        self._file.close()


class TruthTail:
    """Reads what was added to the file since it was last asked. The file need not exist yet."""

    def __init__(self, path: pathlib.Path) -> None:
        self._path = path
        self._file: io.TextIOWrapper | None = None
        self._partial = ""

    def read(self) -> list[TruthRow]:
        if self._file is None:
            try:
                self._file = self._path.open(encoding="utf-8")
            except FileNotFoundError:
                return []
        lines = (self._partial + self._file.read()).split("\n")
        self._partial = lines.pop()
        return [row for row in map(parse_row, lines) if row is not None]

    def close(self) -> None:
        if self._file is not None:
            self._file.close()


@dataclasses.dataclass(frozen=True)
class VehicleTrack:
    """One vehicle's way, sampled about every `STEP_S`; all arrays of one length n."""

    drone: int
    time_s: Floats
    """Seconds since the first take-off of any vehicle."""
    position_ned_m: Floats
    """(n, 3)"""
    airborne: NDArray[np.bool_]
    armed: NDArray[np.bool_]
    modes: tuple[str, ...]
    co2_ppm: Floats
    battery_fraction: Floats

    @property
    def last_ned_m(self) -> Vector3:
        north_m, east_m, down_m = self.position_ned_m[-1]
        return float(north_m), float(east_m), float(down_m)


def read_tracks(path: pathlib.Path) -> dict[int, VehicleTrack]:
    """The whole file, by drone; empty if there is none or nothing in it."""
    tail = TruthTail(path)
    try:
        return make_tracks(tail.read())
    finally:
        tail.close()


def make_tracks(rows: Iterable[TruthRow]) -> dict[int, VehicleTrack]:
    """Rows of any order as tracks, times counted from the first take-off (from the first row if there was none)."""
    by_drone: dict[int, list[TruthRow]] = {}
    start_s, takeoff_s = np.inf, np.inf
    for row in rows:
        by_drone.setdefault(row.drone, []).append(row)
        start_s = min(start_s, row.time_s)
        if row.airborne:
            takeoff_s = min(takeoff_s, row.time_s)
    zero_s = takeoff_s if np.isfinite(takeoff_s) else start_s
    tracks = {}
    for drone, own in sorted(by_drone.items()):
        own.sort(key=lambda row: row.time_s)
        tracks[drone] = VehicleTrack(
            drone,
            np.array([row.time_s for row in own]) - zero_s,
            np.array([row.position_ned_m for row in own]),
            np.array([row.airborne for row in own]),
            np.array([row.armed for row in own]),
            tuple(row.mode for row in own),
            np.array([row.co2_ppm for row in own]),
            np.array([row.battery_fraction for row in own]),
        )
    return tracks
