"""The virtual-force paper's two arenas: their wind, plume, obstacles and starting places, made from a seed.

A. Marjovi, L. Marques: "Swarm robotic plume tracking for intermittent and time-variant odor dispersion", ECMR 2013,
section III. Its air came from a commercial solver; here puffs are carried by a wind that flows around the obstacles,
0.5 m/s to the east on average. What it leaves open is ours: sizes of puffs, unsteadiness, places of obstacles and
robots, the sensor's noise, and in the small arena its clean-air reading, without which the source's strength would
not matter.
"""

from __future__ import annotations

import math
from typing import Literal

import msgspec
import numpy as np

from mission.geometry.formation import FloatArray
from mission.geometry.frames import Geodetic
from mission.strategies.virtual_forces import VirtualForcesParameters
from simvehicle.trials.tracing.swarm_flight import TracedScene, TracingVehicles, make_place
from simvehicle.trials.tracing.terrain import clearances_of
from simvehicle.trials.trials_error import TrialsError
from simvehicle.world.obstacles import Obstacles
from simvehicle.world.recorded_air import record_air
from simvehicle.world.world_config import (
    FlatFilamentPlume,
    FlatFilamentSource,
    GridWindConfig,
    RectangularObstacle,
    WorldConfig,
)

ArenaName = Literal["small", "large"]
_WIND_MPS, _FROM_DEG = 0.5, 270.0
_NOWHERE = Geodetic(0.0, 0.0, 0.0)
_TRIES = 10_000
_APART = 2.5
"""Robots start so many radii apart at least."""
# Streams of a world's chances.
_LAYOUT, _AIR, _START = range(3)


class Arena(msgspec.Struct, frozen=True, kw_only=True):
    north_m: float
    """Its width; the wind's square is as wide as it is long."""
    east_m: float
    """Its length, downwind."""
    source_m: tuple[float, float]
    start_m: tuple[float, float]
    """Robots start between these distances from the western wall."""
    obstacle_m: tuple[float, float]
    """Sides of the rectangles are drawn between these."""
    gap_m: float
    """Between obstacles, and to walls, source and starting places."""
    corner_spread: float
    corner_noise: float
    noise_bandwidth_radps: float
    diffusivity_m2ps: float
    plume: FlatFilamentPlume
    """Of 1 g/s, in g/m3."""
    vehicles: TracingVehicles
    forces: VirtualForcesParameters
    frame_s: float
    spacing_m: float
    begin_s: float
    """How long the source has been open when the trials begin."""


def _plume(source_m: tuple[float, float], puffs_per_s: float, **puffs: float) -> FlatFilamentPlume:
    source = FlatFilamentSource(north_m=source_m[0], east_m=source_m[1], strength=1.0 / puffs_per_s)
    return FlatFilamentPlume(sources=(source,), puffs_per_s=puffs_per_s, **puffs)


ARENAS: dict[ArenaName, Arena] = {
    "small": Arena(
        north_m=4.0,
        east_m=6.0,
        source_m=(2.0, 0.5),
        start_m=(4.6, 5.8),
        obstacle_m=(0.2, 0.5),
        gap_m=0.25,
        corner_spread=0.1,
        corner_noise=0.2,
        noise_bandwidth_radps=0.3,
        diffusivity_m2ps=0.05,
        plume=_plume(
            (2.0, 0.5),
            5.0,
            initial_radius_m=0.05,
            growth=0.02,
            shaking=0.05,
            reach_m=8.0,
            lifetime_s=60.0,
            step_s=0.1,
        ),
        vehicles=TracingVehicles(
            step_s=0.1,
            speed_mps=0.2,
            radius_m=0.035,
            avoidance_m=0.08,
            arrival_m=0.2,
            limit_steps=3000,
            until_arrival=True,
            range_m=1.0,
            reach_m=0.3,
            detection=0.0,
            noise=0.01,
        ),
        forces=VirtualForcesParameters(
            speed_mps=0.2,
            upwind=20.0,
            repulsion_m3ps=1.0,
            obstacle_m3ps=1.0,
            near_m=0.1,
            sight_m=0.3,
            least_m=0.03,
            gradient_m2ps=50.0,
            attraction_m3ps=1.0,
            far_m=0.5,
            range_m=1.0,
            clean_air=0.03,
        ),
        frame_s=0.5,
        spacing_m=0.08,
        begin_s=30.0,
    ),
    "large": Arena(
        north_m=30.0,
        east_m=40.0,
        source_m=(15.0, 3.0),
        start_m=(30.0, 38.0),
        obstacle_m=(1.0, 3.0),
        gap_m=1.5,
        corner_spread=0.1,
        corner_noise=0.5,
        noise_bandwidth_radps=0.06,
        diffusivity_m2ps=0.5,
        plume=_plume(
            (15.0, 3.0),
            2.0,
            initial_radius_m=0.3,
            growth=0.02,
            shaking=0.1,
            reach_m=60.0,
            lifetime_s=300.0,
            step_s=0.2,
        ),
        vehicles=TracingVehicles(
            step_s=0.2,
            speed_mps=0.5,
            radius_m=0.15,
            avoidance_m=0.35,
            arrival_m=0.5,
            limit_steps=3000,
            until_arrival=True,
            range_m=6.0,
            reach_m=1.0,
            detection=1e-5,
        ),
        forces=VirtualForcesParameters(
            speed_mps=0.5,
            upwind=20.0,
            repulsion_m3ps=1.0,
            obstacle_m3ps=1.0,
            near_m=2.2,
            sight_m=1.0,
            least_m=0.03,
            gradient_m2ps=50.0,
            attraction_m3ps=1.0,
            far_m=3.3,
            range_m=6.0,
        ),
        frame_s=1.0,
        spacing_m=0.5,
        begin_s=150.0,
    ),
}


class ForcesWorld(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One plume with its wind and obstacles, and what is flown in it. Equal numbers and seeds make equal worlds."""

    arena: ArenaName
    number: int
    obstacles: int
    emissions_gps: tuple[float, ...]
    """Of the paper's tracker; the other variants are flown at the middle one: the baseline smells nothing."""
    robots: tuple[int, ...]
    variants: tuple[str, ...]
    """Of `forces_flights.VARIANTS`."""


def make_place_of(world: ForcesWorld, seed: int) -> TracedScene:
    """The arena with the plume of 1 g/s: densities grow with the emission."""
    arena = ARENAS[world.arena]
    obstacles = _obstacles(world, np.random.default_rng([seed, world.number, _LAYOUT]))
    config = WorldConfig(
        origin=_NOWHERE,
        wind=GridWindConfig(
            speed_mps=_WIND_MPS,
            from_deg=_FROM_DEG,
            centre_north_m=0.5 * arena.east_m,
            centre_east_m=0.5 * arena.east_m,
            length_m=arena.east_m,
            corner_spread=arena.corner_spread,
            corner_noise=arena.corner_noise,
            noise_bandwidth_radps=arena.noise_bandwidth_radps,
            diffusivity_m2ps=arena.diffusivity_m2ps,
        ),
        plume=arena.plume,
        obstacles=tuple(obstacles),
    )
    vehicles = arena.vehicles
    air = record_air(
        config,
        int(np.random.default_rng([seed, world.number, _AIR]).integers(2**31)),
        vehicles.limit_steps * vehicles.step_s,
        arena.frame_s,
        arena.spacing_m,
        length_m=(arena.north_m, arena.east_m),
        begin_s=arena.begin_s,
    )
    return make_place(air, np.array([arena.source_m]), Obstacles(obstacles))


def start_places(world: ForcesWorld, place: TracedScene, seed: int, trial: int, robots: int) -> FloatArray:
    """(robots, 2) at random in the arena's downwind end, the first where the plume is thickest there."""
    arena = ARENAS[world.arena]
    rng = np.random.default_rng([seed, world.number, _START, trial])
    radius_m = arena.vehicles.radius_m
    low = np.array([2.0 * radius_m, arena.start_m[0]])
    high = np.array([arena.north_m - 2.0 * radius_m, arena.start_m[1]])
    found = [_thickest(place, low, high, radius_m)]
    for _ in range(_TRIES):
        if len(found) == robots:
            return np.array(found)
        at = rng.uniform(low, high)
        apart_m = np.linalg.norm(np.array(found) - at, axis=1).min()
        if apart_m > _APART * radius_m and clearances_of(place.terrain, at[None])[0] > radius_m:
            found.append(at)
    raise TrialsError(
        f"world {world.number}: no room for {robots} robots at the {world.arena} arena's downwind end"
    )


def _thickest(place: TracedScene, low: FloatArray, high: FloatArray, radius_m: float) -> FloatArray:
    """The node between `low` and `high` with the most gas at time 0."""
    air = place.air
    rows, columns = np.meshgrid(*map(np.arange, air.gas.shape[1:]), indexing="ij")
    nodes = air.gas_origin_m + air.gas_spacing_m * np.column_stack([rows.ravel(), columns.ravel()])
    inside = np.all((nodes >= low) & (nodes <= high), axis=1)
    nodes, gas = nodes[inside], air.gas[0].ravel()[inside]
    free = clearances_of(place.terrain, nodes) > radius_m
    return np.asarray(nodes[free][np.argmax(gas[free])], np.float64)


def obstacle_share(place: TracedScene) -> float:
    """Share of the ground on which something stands."""
    return float(place.air.solid.mean())


def _obstacles(world: ForcesWorld, rng: np.random.Generator) -> list[RectangularObstacle]:
    """Rectangles at random between source and starting places, a gap apart from everything."""
    arena = ARENAS[world.arena]
    found: list[RectangularObstacle] = []
    for _ in range(_TRIES):
        if len(found) == world.obstacles:
            return found
        length_n, length_e = rng.uniform(*arena.obstacle_m, 2)
        low = np.array([0.5 * length_n + arena.gap_m, arena.source_m[1] + 0.5 * length_e])
        high = np.array([arena.north_m - 0.5 * length_n - arena.gap_m, arena.start_m[0] - 0.5 * length_e])
        north_m, east_m = rng.uniform(low, high - (0.0, arena.gap_m))
        beside_n = abs(north_m - arena.source_m[0]) - 0.5 * length_n
        beside_e = abs(east_m - arena.source_m[1]) - 0.5 * length_e
        if math.hypot(max(beside_n, 0.0), max(beside_e, 0.0)) < 2.0 * arena.gap_m:
            continue
        apart = all(
            abs(north_m - other.centre_north_m) > 0.5 * (length_n + other.length_north_m) + arena.gap_m
            or abs(east_m - other.centre_east_m) > 0.5 * (length_e + other.length_east_m) + arena.gap_m
            for other in found
        )
        if apart:
            found.append(
                RectangularObstacle(
                    centre_north_m=float(north_m),
                    centre_east_m=float(east_m),
                    length_north_m=float(length_n),
                    length_east_m=float(length_e),
                )
            )
    raise TrialsError(
        f"world {world.number}: no room for {world.obstacles} obstacles in the {world.arena} arena"
    )
