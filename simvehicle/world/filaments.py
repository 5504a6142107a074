"""A plume of puffs that the wind carries: it meanders, is torn, and has gaps (Farrell et al. 2002).

J. A. Farrell, J. Murlis, X. Long, W. Li, R. T. Carde: "Filament-based atmospheric dispersion model to achieve short
time-scale structure of odor plumes", Environmental Fluid Mechanics 2, 143-169 (2002). Each source releases puffs at
even times. A puff goes with the wind at its centre, is shaken by a random walk of its own, and grows:
r(t) = (r0^(2/3) + g t)^(3/2). A puff of mass Q is Q / (pi^(3/2) r^3) exp(-D^2 / r^2) at the distance D.

In two dimensions (`FlatFilamentPlume`) it is Q / (sqrt(8 pi^3) r^3) exp(-D^2 / r^2) with the horizontal distance, as
the fluxotaxis experiments have it: 2^(-3/2) of the formula that conserves Q, cut through the puffs' centres.
"""

from __future__ import annotations

import functools
import math
from typing import Final, NamedTuple

import numpy as np

from mission.geometry.formation import FloatArray
from mission.geometry.frames import Vector3
from simvehicle.world.compiled_barriers import make_barriers
from simvehicle.world.compiled_filaments import (
    BLOCK,
    EAST,
    FIELDS,
    INVERSE_R2,
    LIFT,
    NORTH,
    SIZE,
    UP,
    NumberArray,
    SingleArray,
    carry,
    concentration_at,
    concentrations,
    drop_gone,
    grid_concentrations,
    grid_winds,
    keep_out,
    make_ready,
)
from simvehicle.world.fields import OPEN_GROUND, ObstacleField, WindField
from simvehicle.world.gas_formulas import puff_strength_ppm_m3
from simvehicle.world.grid_wind import GridWind
from simvehicle.world.world_config import FilamentPlume, FlatFilamentPlume

_FIRST_CAPACITY: Final = 64
_FLAT_DOWN_M: Final = -10.0
"""Where a flat plume goes with a wind that is not the same at every height: where winds are measured."""
_SAME: Final = 1e-6
"""Of a step: a time that is so near to the end of one is that end."""
_STAGGER: Final = 0.5 * (math.sqrt(5.0) - 1.0)
"""Sources do not release together: each begins by this share of the time between two puffs after the one before."""


class Puffs(NamedTuple):
    """The puffs that are in the air at a time, source by source, the oldest first."""

    positions_ned_m: FloatArray
    """(n, 3)"""
    radii_m: FloatArray
    """(n,)"""
    source: FloatArray
    """(n,) place of each puff's source in the configuration"""


class Filaments:
    """A `GasField`: a pure function of configuration, wind, obstacles, seed, position and time.

    Puffs are stepped on a fixed grid of times; between two of them they move straight. The state goes with the time
    that is asked for, which costs nothing as long as time goes on: who asks for an earlier time makes the plume flow
    again from the start. Times before 0 are answered as 0.
    """

    def __init__(
        self,
        config: FilamentPlume | FlatFilamentPlume,
        wind: WindField,
        amsl_m: float,
        seed: int,
        obstacles: ObstacleField = OPEN_GROUND,
    ) -> None:
        """`amsl_m`: altitude of home above mean sea level, for the density of the air. `wind` is asked half a step
        ahead of the puffs, at times that go on as they do."""
        self.config = config
        self._wind = wind
        self._barriers = make_barriers(obstacles)
        self._upright = isinstance(config, FilamentPlume)
        self._sources_m = _source_places(config)
        self._strengths = _strengths(config, amsl_m)
        self._moving_mps = np.array([[s.moving_north_mps, s.moving_east_mps] for s in config.sources])
        self._before: SingleArray
        """(fields, sources, capacity) puffs at the beginning of the step; `_after` at its end."""
        self._numbers: NumberArray
        self._head_steps = math.ceil(config.head_start_s / config.step_s - _SAME)
        self._key = _key(seed)
        same_for_all = isinstance(wind, GridWind) and wind.config.roughness_m is None
        self._one_plane = not self._upright or (same_for_all and not np.isfinite(self._barriers.tops_m).any())
        """Whether the wind's grid alone says what wind a puff has, whatever its height."""
        self._begin()

    @functools.cached_property
    def source_ned_m(self) -> Vector3:
        """The strongest source, the first of equals, where it is at time 0."""
        strongest = int(np.argmax(self._strengths))
        north_m, east_m, up_m = self._sources_m[strongest].tolist()
        return north_m, east_m, -up_m

    def sources_ned_m(self, time_s: float) -> FloatArray:
        """(sources, 3) where the sources are."""
        places = self._sources_m * (1.0, 1.0, -1.0)
        places[:, :2] += self._moving_mps * time_s
        return np.asarray(places)

    def excess_co2_ppm(self, position_ned_m: Vector3, time_s: float) -> float:
        self._ready_at(time_s)
        north_m, east_m, down_m = position_ned_m
        return concentration_at(
            self._ready,
            self._boxes,
            self._old,
            self._sources_m,
            self._barriers,
            self._upright,
            north_m,
            east_m,
            -down_m,
        )

    def excesses_co2_ppm(self, positions_ned_m: FloatArray, time_s: float) -> FloatArray:
        """The same bits as `excess_co2_ppm`; fastest where neighbours stand side by side in the array."""
        self._ready_at(time_s)
        excesses_ppm = np.empty(len(positions_ned_m))
        positions = np.ascontiguousarray(positions_ned_m, np.float64)
        concentrations(
            self._ready,
            self._boxes,
            self._old,
            self._sources_m,
            self._barriers,
            self._upright,
            positions,
            excesses_ppm,
        )
        return excesses_ppm

    def grid_excesses_co2_ppm(
        self,
        norths_m: FloatArray,
        easts_m: FloatArray,
        down_m: float,
        time_s: float,
        excesses_ppm: SingleArray,
    ) -> None:
        """Fill (rows, columns) `excesses_ppm` at the nodes of even `norths_m` and `easts_m`: the same bits."""
        self._ready_at(time_s)
        grid_concentrations(
            self._ready,
            self._old,
            self._sources_m,
            self._barriers,
            self._upright,
            norths_m,
            easts_m,
            -down_m,
            excesses_ppm,
        )

    def puffs(self, time_s: float) -> Puffs:
        """What is in the air."""
        self._ready_at(time_s)
        places, radii, numbers = [], [], []
        for source, count in enumerate(self._old.tolist()):
            ready = self._ready[:, source, :count].astype(np.float64)
            at_m = self._sources_m[source]
            places.append(np.column_stack([ready[NORTH] + at_m[0], ready[EAST] + at_m[1], -ready[UP]]))
            radii.append(1.0 / np.sqrt(ready[INVERSE_R2]))
            numbers.append(np.full(count, source))
        return Puffs(np.concatenate(places), np.concatenate(radii), np.concatenate(numbers))

    # -- the state ---------------------------------------------------------------------------------------------------

    def _begin(self) -> None:
        sources = len(self.config.sources)
        self._step = -self._head_steps
        """The step that the state is in the midst of, from `_before` to `_after`."""
        self._released = np.zeros(sources, np.int64)
        self._counts = np.zeros(sources, np.int64)
        """Of puffs in `_before` and `_after`."""
        self._old = np.zeros(sources, np.int64)
        """Those of them that are in the air already when the step begins."""
        self._room_for(_FIRST_CAPACITY, anew=True)
        self._ready_place = math.nan
        self._go()

    def _room_for(self, capacity: int, *, anew: bool = False) -> None:
        sources = len(self.config.sources)
        rounded = BLOCK * math.ceil(capacity / BLOCK)
        before, numbers = (
            np.zeros((FIELDS, sources, rounded), np.float32),
            np.zeros((sources, rounded), np.uint64),
        )
        if not anew:
            held = self._before.shape[2]
            before[:, :, :held], numbers[:, :held] = self._before, self._numbers
        self._before, self._after, self._numbers = before, before.copy(), numbers
        self._ready = np.zeros((FIELDS, sources, rounded), np.float32)
        self._boxes = np.zeros((6, sources, rounded // BLOCK), np.float32)
        self._winds = np.zeros((3 if self._upright else 2, sources, rounded), np.float32)

    def _ready_at(self, time_s: float) -> None:
        """Puffs as they are at a time, ready to be asked for."""
        place = max(0.0, time_s) / self.config.step_s
        nearest = round(place)
        if abs(place - nearest) < _SAME:
            place = float(nearest)
        if place == self._ready_place:
            return
        step = int(place)
        if step < self._step:
            self._begin()
        while self._step < step:
            self._end_step()
            self._go()
        make_ready(
            self._before, self._after, self._old, place - step, self._strengths, self._ready, self._boxes
        )
        self._ready_place = place

    def _end_step(self) -> None:
        """The end of the step is the beginning of the next."""
        self._before, self._after = self._after, self._before
        self._step += 1
        oldest_place = (self._step + self._head_steps) * self.config.step_s - self.config.lifetime_s
        oldest = (
            np.ceil(oldest_place * self.config.puffs_per_s - self._phases()).clip(min=0.0).astype(np.uint64)
        )
        drop_gone(self._before, self._numbers, self._counts, self.config.reach_m, oldest)

    def _go(self) -> None:
        """From the state at the beginning of the step to that at its end."""
        config = self.config
        self._old = self._counts.copy()
        shares = self._release()
        fresh = self._counts - self._old
        time_s = max(0.0, (self._step + 0.5) * config.step_s)
        self._fill_winds(time_s)
        vertical = config.vertical_shaking if isinstance(config, FilamentPlume) else 0.0
        kept = math.exp(-config.step_s / config.rise_time_s) if isinstance(config, FilamentPlume) else 1.0
        carry(
            self._before,
            self._after,
            self._numbers,
            self._counts,
            fresh,
            shares,
            self._winds,
            np.uint64((self._key + (self._step & 0xFFFFFFFF) * 0xD1B54A32D192ED03) & 0xFFFFFFFFFFFFFFFF),
            config.step_s,
            config.shaking,
            vertical,
            config.growth,
            kept,
        )
        if self._barriers.tops_m.size:
            keep_out(self._before, self._after, self._counts, fresh, self._sources_m, self._barriers)

    def _phases(self) -> FloatArray:
        """(sources,) in puffs: when each source's first is due."""
        return np.asarray((np.arange(len(self.config.sources)) * _STAGGER + 0.5) % 1.0)

    def _release(self) -> SingleArray:
        """Put what is released in this step at its source; returns what share of the step each of them flies."""
        config = self.config
        end_place = (self._step + 1 + self._head_steps) * config.step_s * config.puffs_per_s
        phases = self._phases()
        due = np.floor(end_place - phases + 1.0).astype(np.int64).clip(min=0)
        fresh = due - self._released
        most = int(fresh.max())
        shares = np.zeros((len(fresh), max(most, 1)), np.float32)
        if most == 0:
            return shares
        if int((self._counts + fresh).max()) > self._before.shape[2]:
            self._room_for(2 * int((self._counts + fresh).max()))
        begins_s = self._step * config.step_s
        for source in np.flatnonzero(fresh).tolist():
            first, count, new = int(self._counts[source]), int(fresh[source]), int(self._released[source])
            numbers = np.arange(new, new + count)
            part = np.clip(
                (end_place - numbers - phases[source]) / (config.step_s * config.puffs_per_s), 0.0, 1.0
            )
            shares[source, :count] = part
            born_s = begins_s + (1.0 - part) * config.step_s
            begin = self._before[:, source, first : first + count]
            begin[NORTH] = self._moving_mps[source, 0] * born_s
            begin[EAST] = self._moving_mps[source, 1] * born_s
            begin[UP] = self._sources_m[source, 2]
            begin[SIZE] = config.initial_radius_m ** (2.0 / 3.0)
            begin[LIFT] = self._first_lift_mps()
            self._numbers[source, first : first + count] = numbers
        self._counts += fresh
        self._released = due
        return shares

    def _first_lift_mps(self) -> float:
        """The mean rise over a puff's first step, so that steps of any length make it rise equally in all."""
        if not isinstance(self.config, FilamentPlume):
            return 0.0
        part = self.config.step_s / self.config.rise_time_s
        return self.config.rise_mps * -math.expm1(-part) / part

    def _fill_winds(self, time_s: float) -> None:
        wind, counts = self._wind, self._counts
        if isinstance(wind, GridWind) and self._one_plane:
            corners = np.column_stack(
                [wind.south_m - self._sources_m[:, 0], wind.west_m - self._sources_m[:, 1]]
            ).astype(np.float32)
            grid = wind.grid_mps(time_s).astype(np.float32)
            grid_winds(self._before, counts, grid, corners, 1.0 / wind.spacing_m, self._winds)
            return
        for source, count in enumerate(counts.tolist()):
            begin = self._before[:, source, :count].astype(np.float64)
            down_m = -begin[UP] if self._upright else np.full(count, _FLAT_DOWN_M)
            at_m = self._sources_m[source]
            winds = wind.winds_ned_mps(
                np.column_stack([begin[NORTH] + at_m[0], begin[EAST] + at_m[1], down_m]), time_s
            )
            self._winds[0, source, :count], self._winds[1, source, :count] = winds[:, 0], winds[:, 1]
            if self._upright:
                self._winds[2, source, :count] = -winds[:, 2]


def _source_places(config: FilamentPlume | FlatFilamentPlume) -> FloatArray:
    """(sources, 3) north, east, up at time 0; flat plumes have no height."""
    if isinstance(config, FilamentPlume):
        return np.array([[source.north_m, source.east_m, source.above_home_m] for source in config.sources])
    return np.array([[source.north_m, source.east_m, 0.0] for source in config.sources])


def _strengths(config: FilamentPlume | FlatFilamentPlume, amsl_m: float) -> SingleArray:
    """(sources,) what a puff of 1 m radius has at its centre, in ppm."""
    if isinstance(config, FilamentPlume):
        ppm = [
            puff_strength_ppm_m3(source.emission_kgps / config.puffs_per_s, amsl_m + source.above_home_m)
            for source in config.sources
        ]
    else:
        ppm = [
            source.strength * config.ppm_per_unit / math.sqrt(8.0 * math.pi**3) for source in config.sources
        ]
    return np.array(ppm, np.float32)


def _key(seed: int) -> int:
    """A stream of its own, so that the puffs' noise stays the same when another part draws more or fewer numbers."""
    return int(np.random.default_rng([seed & 0xFFFFFFFF, 0xF11A]).integers(1 << 63))
