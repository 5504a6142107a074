"""A wind that varies over the area: advection and diffusion from noisy corners, among obstacles.

J. A. Farrell, J. Murlis, X. Long, W. Li, R. T. Carde: "Filament-based atmospheric dispersion model to achieve short
time-scale structure of odor plumes", Environmental Fluid Mechanics 2, 143-169 (2002). Each of the four corners of a
square has a wind of its own: the mean, a steady random deviation, and coloured noise. Along the edges it is
interpolated, inside it is what `flow_step` makes of that. The model transports momentum without a pressure: no
component of the wind leaves the range of the edges' (and of 0, where obstacles are), but the flow has a divergence,
which `GridWind.divergence_ps` tells.
"""

from __future__ import annotations

import bisect
import functools
import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mission.geometry.formation import FloatArray
from mission.geometry.frames import Vector3, wind_from
from simvehicle.world.coloured_noise import ColouredNoise
from simvehicle.world.flow_states import FlowStates
from simvehicle.world.obstacles import Obstacles
from simvehicle.world.wind_formulas import flow_at, log_law
from simvehicle.world.world_config import GridWindConfig

_CLIP_SD: Final = 3.0
"""A corner's deviations go no further than this many standard deviations: the solver's stability rests on a bound."""
_SAFE_SHARE: Final = 0.8
"""Of the longest stable step, when the step is not configured."""
_LONGEST_SPIN_UP_S: Final = 3600.0
_SLOWEST_MPS: Final = 0.1
_STILL: Final = (0.0, 0.0, 0.0)


class GridWind:
    """A `WindField`: a pure function of configuration, obstacles, seed, position and time.

    The flow is horizontal and the same at every height, but for the profile and for obstacles: above the top of one
    the air flows as if it were not there. So there is one plane of flow for each distinct height of tops.
    """

    def __init__(self, config: GridWindConfig, seed: int, obstacles: Obstacles | None = None) -> None:
        """`ValueError`: the configured step would let the solver diverge; it names the step that holds."""
        self.config = config
        self.mean_ned_mps: Vector3 = wind_from(config.speed_mps, config.from_deg)
        self.obstacles = Obstacles(()) if obstacles is None else obstacles
        self._has_obstacles = self.obstacles.count > 0
        self.spacing_m = config.spacing_m
        self.nodes = config.cells + 1
        self.south_m = config.centre_north_m - 0.5 * config.length_m
        self.west_m = config.centre_east_m - 0.5 * config.length_m
        self._corner_m = np.array([self.south_m, self.west_m])
        self.step_s = checked_step_s(config)
        self._tops_m = sorted({top for top in self.obstacles.tops_m.tolist() if math.isfinite(top)})
        """Plane k is the air from the k-th of these tops to the next."""
        self._standing = [self.obstacles, *(self.obstacles.taller_than(top_m) for top_m in self._tops_m)]
        self._touching: dict[int, Obstacles] = {}
        spin_up_s = min(2.0 * config.length_m / max(config.speed_mps, _SLOWEST_MPS), _LONGEST_SPIN_UP_S)
        """In which the flow forgets how it was begun, before time 0."""
        self._spin_up = math.ceil(spin_up_s / self.step_s)
        rng = np.random.default_rng([seed & 0xFFFFFFFF, 0x6A1D])
        north, east, _ = self.mean_ned_mps
        spread = np.clip(rng.standard_normal((2, 2, 2)), -_CLIP_SD, _CLIP_SD) * config.spread_mps
        self._steady = np.array([north, east])[:, None, None] + spread
        """(axis, south or north, west or east)"""
        self._noise = ColouredNoise(
            config.noise_bandwidth_radps, config.noise_damping, rng, processes=8, begin_s=-spin_up_s
        )
        self._states = FlowStates(self._first, self._next, begin=-self._spin_up)
        self._held = -1
        self._views: list[tuple[memoryview, memoryview]] = []
        """Of each plane in the held state and in the one after it."""

    # Found when somebody asks for the wind: who makes a world to know its mean does not wait for it.

    @functools.cached_property
    def _solid(self) -> NDArray[np.bool_]:
        """(planes, nodes, nodes)"""
        return np.stack([self._near(standing, 0.5 * self.spacing_m) for standing in self._standing])

    @functools.cached_property
    def _touched(self) -> NDArray[np.bool_]:
        """(planes, nodes - 1, nodes - 1) cells that an obstacle reaches into."""
        reach_m = math.sqrt(0.5) * self.spacing_m
        return np.stack([self._near(standing, reach_m, cells=True) for standing in self._standing])

    @functools.cached_property
    def _touched_bytes(self) -> list[bytes]:
        return [plane.tobytes() for plane in self._touched]

    @property
    def solid(self) -> NDArray[np.bool_]:
        """(nodes, nodes) where there is no flow at the ground: nodes to which an obstacle is nearer than half a cell,
        so that nothing flows through the thinnest wall. Rows go north, columns east."""
        return np.asarray(self._solid[0])

    def wind_ned_mps(self, position_ned_m: Vector3, time_s: float) -> Vector3:
        north_m, east_m, down_m = position_ned_m
        place = max(0.0, time_s) / self.step_s
        index = int(place)
        if index != self._held:
            self._hold(index)
        plane = bisect.bisect_right(self._tops_m, -down_m) if self._tops_m else 0
        row, column = (north_m - self.south_m) / self.spacing_m, (east_m - self.west_m) / self.spacing_m
        if self._has_obstacles and self._inside(plane, row, column, position_ned_m):
            return _STILL
        before, after = self._views[plane]
        north, east = flow_at(before, after, place - index, self.nodes, row, column)  # type: ignore[arg-type]
        roughness_m = self.config.roughness_m
        if roughness_m is None:
            return north, east, 0.0
        strength = log_law(-down_m, roughness_m)
        return strength * north, strength * east, 0.0

    def winds_ned_mps(self, positions_ned_m: FloatArray, time_s: float) -> FloatArray:
        from simvehicle.world.compiled_flow import flow_winds

        positions = np.ascontiguousarray(positions_ned_m, np.float64)
        winds = np.empty((len(positions), 3))
        doubtful = np.empty(len(positions), np.bool_)
        place = max(0.0, time_s) / self.step_s
        index = int(place)
        before, after = self._states.at(index), self._states.at(index + 1)
        flow_winds(
            before.reshape(len(before), -1),
            after.reshape(len(after), -1),
            place - index,
            np.searchsorted(self._tops_m, -positions[:, 2], side="right"),
            self._touched,
            self.nodes,
            self.south_m,
            self.west_m,
            self.spacing_m,
            self.config.roughness_m or 0.0,
            positions,
            winds,
            doubtful,
        )
        if self._has_obstacles:
            doubtful[doubtful] = self.obstacles.stand_at_all(positions[doubtful])
            winds[doubtful] = 0.0
        return winds

    def grid_mps(self, time_s: float, up_m: float = 0.0) -> FloatArray:
        """(2, nodes, nodes) wind to the north and the east at the nodes, as between obstacles that are higher than
        `up_m`, and without the profile; times before 0 count as 0."""
        place = max(0.0, time_s) / self.step_s
        index = int(place)
        plane = bisect.bisect_right(self._tops_m, up_m)
        before, after = self._states.at(index)[plane], self._states.at(index + 1)[plane]
        return np.asarray(before + (place - index) * (after - before))

    def divergence_ps(self, time_s: float) -> FloatArray:
        """(nodes - 2, nodes - 2) divergence of the flow at the ground inside the square, 1/s."""
        wind = self.grid_mps(time_s)
        north = wind[0, 2:, 1:-1] - wind[0, :-2, 1:-1]
        east = wind[1, 1:-1, 2:] - wind[1, 1:-1, :-2]
        return np.asarray((north + east) / (2.0 * self.spacing_m))

    def corners_mps(self, time_s: float) -> FloatArray:
        """(2, 2, 2): north and east wind in the south-western, south-eastern, north-western, north-eastern corner."""
        noise = np.clip(self._noise.at(time_s), -_CLIP_SD, _CLIP_SD).reshape(2, 2, 2)
        return np.asarray(self._steady + noise * self.config.noise_mps)

    # -- the flow ------------------------------------------------------------------------------------------------

    def _first(self) -> FloatArray:
        """The corners' wind over the whole square."""
        corners = self.corners_mps(-self._spin_up * self.step_s)
        share = np.linspace(0.0, 1.0, self.nodes)
        sides = corners[:, 0, None] * (1.0 - share)[:, None] + corners[:, 1, None] * share[:, None]
        flow = sides[:, :, 0, None] * (1.0 - share) + sides[:, :, 1, None] * share
        planes = np.repeat(flow[None], len(self._solid), axis=0)
        planes[np.broadcast_to(self._solid[:, None], planes.shape)] = 0.0
        return planes

    def _next(self, before: FloatArray, index: int) -> FloatArray:
        """The state `index` steps from time 0, after the state `before`."""
        # Loaded here: who configures a uniform wind starts without a compiler.
        from simvehicle.world.compiled_flow import flow_step

        after = np.empty_like(before)
        corners = self.corners_mps(index * self.step_s)
        for old, new, solid in zip(before, after, self._solid, strict=True):
            flow_step(old, new, corners, solid, self.spacing_m, self.config.diffusivity_m2ps, self.step_s)
        return after

    def _hold(self, index: int) -> None:
        before, after = self._states.at(index), self._states.at(index + 1)
        self._views = [
            (old.reshape(-1).data, new.reshape(-1).data) for old, new in zip(before, after, strict=True)
        ]
        self._held = index

    # -- obstacles -----------------------------------------------------------------------------------------------

    def _near(self, standing: Obstacles, within_m: float, *, cells: bool = False) -> NDArray[np.bool_]:
        """Which nodes (or middles of cells) an obstacle is so near to."""
        count, offset = (self.nodes - 1, 0.5) if cells else (self.nodes, 0.0)
        near = np.zeros((count, count), np.bool_)
        for one in standing.each():
            # Looked at where it can be only: a large grid has many nodes far from every obstacle.
            low = np.floor((one.corners_m.min(axis=0) - within_m - self._corner_m) / self.spacing_m - offset)
            high = np.ceil((one.corners_m.max(axis=0) + within_m - self._corner_m) / self.spacing_m - offset)
            (row, column), (rows, columns) = (np.clip(ends, 0, count).astype(int) for ends in (low, high + 1))
            along_n = self.south_m + self.spacing_m * (np.arange(row, rows) + offset)
            along_e = self.west_m + self.spacing_m * (np.arange(column, columns) + offset)
            north, east = np.meshgrid(along_n, along_e, indexing="ij")
            places = np.column_stack([north.ravel(), east.ravel(), np.zeros(north.size)])
            near[row:rows, column:columns] |= (one.clearances_m(places) <= within_m).reshape(north.shape)
        return near

    def _inside(self, plane: int, row: float, column: float, position_ned_m: Vector3) -> bool:
        cells = self.nodes - 1
        if not (0.0 <= row < cells and 0.0 <= column < cells):
            return self.obstacles.stand_at(position_ned_m)
        i, j = int(row), int(column)
        cell = i * cells + j
        if not self._touched_bytes[plane][cell]:
            return False
        # The few that reach into this cell: nobody asks all of the world's thousands of times a second.
        standing = self._touching.get(cell)
        if standing is None:
            middle_m = (self.south_m + (i + 0.5) * self.spacing_m, self.west_m + (j + 0.5) * self.spacing_m)
            standing = self._touching[cell] = self.obstacles.near(middle_m, self.spacing_m)
        return standing.stand_at(position_ned_m)


def checked_step_s(config: GridWindConfig) -> float:
    """The solver's step; `ValueError` where the configured one would let it diverge."""
    longest_s = stable_step_s(config)
    if config.step_s is None:
        return _SAFE_SHARE * longest_s
    if config.step_s > longest_s:
        digits = 2 - math.floor(math.log10(longest_s))
        holds_s = math.floor(longest_s * 10.0**digits) / 10.0**digits
        raise ValueError(
            f"the wind's solver would diverge with a step of {config.step_s:g} s; steps up to {holds_s:g} s hold, "
            "and without step_s it finds its own"
        )
    return config.step_s


def nodes_per_s(config: GridWindConfig) -> float:
    """How many nodes the solver updates for a second of the wind: a core does about 1e8 a second."""
    return (config.cells + 1.0) ** 2 / checked_step_s(config)


def fastest_mps(config: GridWindConfig) -> float:
    """No component of the wind of this configuration is ever faster."""
    return config.speed_mps + _CLIP_SD * (config.spread_mps + config.noise_mps)


def stable_step_s(config: GridWindConfig) -> float:
    """The longest step with which no node takes more from its neighbours than there is: dx^2 / (4 K) with the K that
    `flow_step` takes where the wind is fastest."""
    spacing_m = config.spacing_m
    return spacing_m * spacing_m / (4.0 * max(config.diffusivity_m2ps, 0.5 * fastest_mps(config) * spacing_m))
