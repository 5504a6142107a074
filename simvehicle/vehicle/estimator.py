"""What the autopilot believes about its own motion: the truth, with a GPS receiver's slow error on top.

The local frame of an autopilot starts where it was when its GPS first had a fix, as on real vehicles: it is not
the swarm's frame, and it is off by the error of that moment.
"""

from __future__ import annotations

import math

import numpy as np

from mission.geometry.frames import Geodetic, LocalFrame, Vector3

_POSITION_SD_M = (0.15, 0.15, 0.10)
_POSITION_TIME_S = 60.0
_VELOCITY_SD_MPS = 0.02
_DRIFT_MPS2 = 0.06
"""Growth of the velocity error per root second when there is no GPS."""
_CELL_M = 40.0
"""Edge of a cell in which the conversion to latitude and longitude is linear to a tenth of a millimetre."""
_CELLS_KEPT = 1000

_Cell = tuple[Vector3, Geodetic, Vector3, Vector3, Vector3]
"""Middle of a cell (world's NED frame), the same on the earth, slopes per metre north, east and down."""


class Estimator:
    """Position and velocity in the autopilot's local NED frame, and the fix behind them."""

    def __init__(self, frame: LocalFrame, spawn_ned_m: Vector3, rng: np.random.Generator) -> None:
        self._frame = frame
        self._rng = rng
        self._noise = rng.standard_normal((64, 6)).tolist()
        self._row = 0
        self._error_m = [sd * float(x) for sd, x in zip(_POSITION_SD_M, rng.standard_normal(3), strict=True)]
        self._drift_mps = [0.0, 0.0]
        self._drift_m = [0.0, 0.0]
        self.gps = True
        self.gps_error_north_m = 0.0
        """Of a receiver that is wrong: buildings, jamming, spoofing."""
        self.gps_lost_s: float | None = None
        """When the GPS went away; None while it is there."""
        self.origin_ned_m: Vector3 = (
            spawn_ned_m[0] + self._error_m[0],
            spawn_ned_m[1] + self._error_m[1],
            spawn_ned_m[2] + self._error_m[2],
        )
        """The local frame's origin in the world's frame."""
        self.position_m: Vector3 = (0.0, 0.0, 0.0)
        self.velocity_mps: Vector3 = (0.0, 0.0, 0.0)
        self._cells: dict[tuple[int, int, int], _Cell] = {}

    def step(self, now_s: float, dt_s: float, position: list[float], velocity: list[float]) -> None:
        """Take in the truth (world frame)."""
        self._row += 1
        if self._row == len(self._noise):
            self._row = 0
            self._noise = self._rng.standard_normal((64, 6)).tolist()
        noise = self._noise[self._row]
        error = self._error_m
        if self.gps:
            if self.gps_lost_s is not None:
                self._gps_again(dt_s)
            keep = 1.0 - dt_s / _POSITION_TIME_S
            shake = math.sqrt(2.0 * dt_s / _POSITION_TIME_S)
            sd_north_m, sd_east_m, sd_down_m = _POSITION_SD_M
            error[0] = error[0] * keep + sd_north_m * shake * noise[0]
            error[1] = error[1] * keep + sd_east_m * shake * noise[1]
            error[2] = error[2] * keep + sd_down_m * shake * noise[2]
        else:
            if self.gps_lost_s is None:
                self.gps_lost_s = now_s
            for axis in (0, 1):
                self._drift_mps[axis] += _DRIFT_MPS2 * math.sqrt(dt_s) * noise[axis]
                self._drift_m[axis] += self._drift_mps[axis] * dt_s
        origin, drift_m, drift_mps = self.origin_ned_m, self._drift_m, self._drift_mps
        self.position_m = (
            position[0] - origin[0] + error[0] + drift_m[0] + self.gps_error_north_m,
            position[1] - origin[1] + error[1] + drift_m[1],
            position[2] - origin[2] + error[2],
        )
        self.velocity_mps = (
            velocity[0] + drift_mps[0] + _VELOCITY_SD_MPS * noise[3],
            velocity[1] + drift_mps[1] + _VELOCITY_SD_MPS * noise[4],
            velocity[2] + _VELOCITY_SD_MPS * noise[5],
        )

    def _gps_again(self, dt_s: float) -> None:
        """With a fix the dead reckoning's error goes away within about a second."""
        keep = max(0.0, 1.0 - 2.0 * dt_s)
        for axis in (0, 1):
            self._drift_m[axis] *= keep
            self._drift_mps[axis] *= keep
        if max(map(abs, self._drift_m)) < 0.05:
            self._drift_m = [0.0, 0.0]
            self._drift_mps = [0.0, 0.0]
            self.gps_lost_s = None

    def lost_for_s(self, now_s: float) -> float:
        """How long there has been no GPS; 0 while there is."""
        return 0.0 if self.gps or self.gps_lost_s is None else now_s - self.gps_lost_s

    def geodetic(self, position_m: Vector3) -> Geodetic:
        """A point of the local frame on the earth.

        The exact conversion is linearised around the middle of the cell that the point lies in: telemetry asks for it
        hundreds of times a second, for places that are far apart (the vehicle, home, the target).
        """
        origin = self.origin_ned_m
        north, east, down = position_m[0] + origin[0], position_m[1] + origin[1], position_m[2] + origin[2]
        key = round(north / _CELL_M), round(east / _CELL_M), round(down / _CELL_M)
        cell = self._cells.get(key)
        if cell is None:
            if len(self._cells) >= _CELLS_KEPT:
                self._cells.clear()
            cell = self._cells[key] = self._linearised(key)
        middle, at, to_north, to_east, to_down = cell
        north, east, down = north - middle[0], east - middle[1], down - middle[2]
        return Geodetic(
            at.latitude_deg + to_north[0] * north + to_east[0] * east + to_down[0] * down,
            at.longitude_deg + to_north[1] * north + to_east[1] * east + to_down[1] * down,
            at.amsl_m + to_north[2] * north + to_east[2] * east + to_down[2] * down,
        )

    def _linearised(self, key: tuple[int, int, int]) -> _Cell:
        middle = key[0] * _CELL_M, key[1] * _CELL_M, key[2] * _CELL_M
        north, east, down = (self._slope(middle, axis) for axis in (0, 1, 2))
        return middle, self._frame.to_geodetic(middle), north, east, down

    def _slope(self, middle: Vector3, axis: int) -> Vector3:
        """Latitude (degrees), longitude (degrees) and altitude (m) per metre along an axis."""
        ahead, behind = list(middle), list(middle)
        ahead[axis] += 10.0
        behind[axis] -= 10.0
        a = self._frame.to_geodetic((ahead[0], ahead[1], ahead[2]))
        b = self._frame.to_geodetic((behind[0], behind[1], behind[2]))
        return (
            (a.latitude_deg - b.latitude_deg) / 20.0,
            (a.longitude_deg - b.longitude_deg) / 20.0,
            (a.amsl_m - b.amsl_m) / 20.0,
        )

    def local(self, point: Geodetic) -> Vector3:
        """A point on the earth in the local frame."""
        north, east, down = self._frame.to_ned(point)
        origin = self.origin_ned_m
        return north - origin[0], east - origin[1], down - origin[2]
