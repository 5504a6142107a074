"""A wind that varies over the area: advection and diffusion from noisy corners, around obstacles (Farrell et al. 2002).

J. A. Farrell, J. Murlis, X. Long, W. Li, R. T. Carde: "Filament-based atmospheric dispersion model to achieve short
time-scale structure of odor plumes", Environmental Fluid Mechanics 2, 143-169 (2002). Each of the four corners of a
square has a wind of its own: the mean, a steady random deviation, and coloured noise. Along the edges it is
interpolated, inside it is what `flow_step` makes of that. The model transports momentum without a pressure, so the
flow has a divergence: `GridWind.divergence_ps` tells it.
"""

from __future__ import annotations

import collections
import math
from typing import Final

import numpy as np
import scipy.linalg

from mission.geometry.formation import FloatArray
from mission.geometry.frames import Vector3, wind_from
from simvehicle.world.fields import OPEN_GROUND, ObstacleField
from simvehicle.world.world_config import GridWindConfig

REFERENCE_M: Final = 10.0
"""Where a wind with a profile blows as the grid says, above home: the height at which winds are measured."""
_CLIP_SD: Final = 4.0
"""A corner's noise goes no further than this many standard deviations: the solver's stability rests on a bound."""
_SAFE_SHARE: Final = 0.8
"""Of the longest stable step, when the step is not configured."""
_KEPT: Final = 32
"""States behind the newest that are still known: who asks for earlier times makes the wind flow again from the start."""


class GridWind:
    """A `WindField`: a pure function of configuration, obstacles, seed, position and time."""

    def __init__(self, config: GridWindConfig, seed: int, obstacles: ObstacleField = OPEN_GROUND) -> None:
        """`ValueError`: the configured step would let the solver diverge; it names the step that holds."""
        self.mean_ned_mps: Vector3 = wind_from(config.speed_mps, config.from_deg)
        self.config = config
        self.spacing_m = config.length_m / config.cells
        self.south_m = config.centre_north_m - 0.5 * config.length_m
        self.west_m = config.centre_east_m - 0.5 * config.length_m
        self._seed = seed
        self.step_s = self._checked_step_s()
        self.solid = self._solid_nodes(obstacles)
        """(nodes, nodes) where there is no flow; rows go north, columns east."""
        self._spin_up = math.ceil(2.0 * config.length_m / max(config.speed_mps, 0.1) / self.step_s)
        """Steps before time 0, in which the flow forgets how it was begun."""
        self._begin()

    def wind_ned_mps(self, position_ned_m: Vector3, time_s: float) -> Vector3:
        north, east, _ = self._winds(np.array([position_ned_m]), time_s)[0].tolist()
        return north, east, 0.0

    def winds_ned_mps(self, positions_ned_m: FloatArray, time_s: float) -> FloatArray:
        return self._winds(np.asarray(positions_ned_m, np.float64), time_s)

    def grid_mps(self, time_s: float) -> FloatArray:
        """(2, nodes, nodes) wind to the north and the east `REFERENCE_M` above home; times before 0 count as 0."""
        place = max(0.0, time_s) / self.step_s
        index = int(place)
        before, after = self._state(index), self._state(index + 1)
        return before + (place - index) * (after - before)

    def divergence_ps(self, time_s: float) -> FloatArray:
        """(nodes - 2, nodes - 2) divergence of the flow inside the square, 1/s."""
        wind = self.grid_mps(time_s)
        north = wind[0, 2:, 1:-1] - wind[0, :-2, 1:-1]
        east = wind[1, 1:-1, 2:] - wind[1, 1:-1, :-2]
        return np.asarray((north + east) / (2.0 * self.spacing_m))

    def profile(self, up_m: FloatArray) -> FloatArray:
        """How strong the wind is at heights above home, as a share of that at `REFERENCE_M`: the logarithmic law
        over rough ground, 0 below the roughness."""
        roughness_m = self.config.roughness_m
        if roughness_m is None:
            return np.ones_like(up_m)
        heights = np.maximum(up_m, roughness_m) / roughness_m
        return np.asarray(np.log(heights) / math.log(REFERENCE_M / roughness_m))

    # -- the state -----------------------------------------------------------------------------------------------

    def _begin(self) -> None:
        self._rng = np.random.default_rng([self._seed & 0xFFFFFFFF, 0x6A1D])
        north, east, _ = self.mean_ned_mps
        speed = self.config.speed_mps
        spread = self._clipped(self._rng.standard_normal((2, 2, 2))) * (self.config.corner_spread * speed)
        self._steady = np.array([north, east])[:, None, None] + spread
        """(axis, south or north, west or east)"""
        self._transition, self._kick, sd = _coloured_noise(self.config, self.step_s)
        self._noise = self._rng.standard_normal((2, 8)) * sd[:, None]
        """Value and rate of change of eight processes, in standard deviations."""
        self._states: collections.deque[FloatArray] = collections.deque(maxlen=_KEPT)
        nodes = self.config.cells + 1
        wind = np.zeros((2, nodes, nodes))
        self._fill_edges(wind, everywhere=True)
        wind[:, self.solid] = 0.0
        self._states.append(wind)
        self._newest = -self._spin_up

    def _state(self, index: int) -> FloatArray:
        """The wind after `index` steps."""
        if index <= self._newest - len(self._states):
            self._begin()
        while self._newest < index:
            self._flow()
        return self._states[index - self._newest - 1]

    def _flow(self) -> None:
        # Loaded here: who configures a uniform wind starts without a compiler.
        from simvehicle.world.compiled_flow import flow_step

        before = self._states[-1]
        after = np.empty_like(before)
        self._noise = self._transition @ self._noise + self._kick @ self._rng.standard_normal((2, 8))
        self._fill_edges(after)
        flow_step(before, after, self.solid, self.spacing_m, self.config.diffusivity_m2ps, self.step_s)
        self._states.append(after)
        self._newest += 1

    def _fill_edges(self, wind: FloatArray, *, everywhere: bool = False) -> None:
        """The corners' wind along the edges, or over the whole square."""
        noise = self._clipped(self._noise[0]).reshape(2, 2, 2)
        corners = self._steady + noise * (self.config.corner_noise * self.config.speed_mps)
        share = np.linspace(0.0, 1.0, wind.shape[1])
        west = corners[:, 0, 0, None] * (1.0 - share) + corners[:, 1, 0, None] * share
        east = corners[:, 0, 1, None] * (1.0 - share) + corners[:, 1, 1, None] * share
        if everywhere:
            wind[:] = west[:, :, None] * (1.0 - share) + east[:, :, None] * share
        wind[:, :, 0], wind[:, :, -1] = west, east
        for row, corner in ((0, 0), (-1, 1)):
            wind[:, row] = corners[:, corner, 0, None] * (1.0 - share) + corners[:, corner, 1, None] * share
        wind[:, self.solid] = 0.0

    def _winds(self, positions_ned_m: FloatArray, time_s: float) -> FloatArray:
        wind = self.grid_mps(time_s)
        last = self.config.cells
        rows = np.clip((positions_ned_m[:, 0] - self.south_m) / self.spacing_m, 0.0, last)
        columns = np.clip((positions_ned_m[:, 1] - self.west_m) / self.spacing_m, 0.0, last)
        row, column = (
            np.minimum(rows.astype(np.int64), last - 1),
            np.minimum(columns.astype(np.int64), last - 1),
        )
        a, b = rows - row, columns - column
        south = wind[:, row, column] * (1.0 - b) + wind[:, row, column + 1] * b
        north = wind[:, row + 1, column] * (1.0 - b) + wind[:, row + 1, column + 1] * b
        winds = np.zeros((len(positions_ned_m), 3))
        winds[:, :2] = (south * (1.0 - a) + north * a).T
        winds[:, :2] *= self.profile(-positions_ned_m[:, 2])[:, None]
        return winds

    def _solid_nodes(self, obstacles: ObstacleField) -> np.ndarray[tuple[int, int], np.dtype[np.bool_]]:
        nodes = self.config.cells + 1
        if obstacles is OPEN_GROUND:
            return np.zeros((nodes, nodes), np.bool_)
        north, east = np.meshgrid(
            self.south_m + self.spacing_m * np.arange(nodes),
            self.west_m + self.spacing_m * np.arange(nodes),
            indexing="ij",
        )
        places = np.column_stack([north.ravel(), east.ravel(), np.zeros(nodes * nodes)])
        return np.asarray(obstacles.clearances_m(places) <= 0.0).reshape(nodes, nodes)

    # -- what holds ----------------------------------------------------------------------------------------------

    def _clipped(self, deviations: FloatArray) -> FloatArray:
        return np.clip(deviations, -_CLIP_SD, _CLIP_SD)

    def _checked_step_s(self) -> float:
        longest_s = stable_step_s(self.config)
        if self.config.step_s is None:
            return _SAFE_SHARE * longest_s
        if self.config.step_s > longest_s:
            raise ValueError(
                f"the wind's solver would diverge with a step of {self.config.step_s:g} s; steps up to "
                f"{math.floor(longest_s * 1e4) / 1e4:g} s hold (coarser cells or less diffusivity allow longer ones)"
            )
        return self.config.step_s


def fastest_mps(config: GridWindConfig) -> float:
    """No wind of this configuration is ever faster."""
    deviation = _CLIP_SD * (config.corner_spread + config.corner_noise) * math.sqrt(2.0)
    return config.speed_mps * (1.0 + deviation)


def stable_step_s(config: GridWindConfig) -> float:
    """The longest step of forward Euler with central differences that cannot grow: dt <= dx^2 / (4 K) for the
    diffusion and dt <= 2 K / (u^2 + v^2) for the advection (Hirt 1968; Hindmarsh, Gresho and Griffiths 1984)."""
    spacing_m, k_m2ps = config.length_m / config.cells, config.diffusivity_m2ps
    fastest = max(fastest_mps(config), 1e-9)
    return min(spacing_m * spacing_m / (4.0 * k_m2ps), 2.0 * k_m2ps / (fastest * fastest))


def _coloured_noise(config: GridWindConfig, step_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(transition, kick, stationary sd) of x'' + 2 d b x' + b^2 x = white noise, sampled exactly; x has the standard
    deviation 1, its rate b."""
    bandwidth, damping = config.noise_bandwidth_radps, config.noise_damping
    transition = np.asarray(
        scipy.linalg.expm(
            step_s * np.array([[0.0, 1.0], [-bandwidth * bandwidth, -2.0 * damping * bandwidth]])
        )
    )
    stationary = np.diag([1.0, bandwidth * bandwidth])
    added = stationary - transition @ stationary @ transition.T
    # Of a step much shorter than the noise's own time the rate alone is kicked; rounding must not make that negative.
    values, vectors = np.linalg.eigh(added)
    kick = vectors * np.sqrt(np.maximum(values, 0.0))
    return transition, kick, np.array([1.0, bandwidth])
