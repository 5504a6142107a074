"""What is wrong with the configuration of a world although every value in it is of its type."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

import shapely

from mission.geometry.frames import Vector3
from simvehicle.world import obstacles as standing
from simvehicle.world.gas_formulas import puff_strength_ppm_m3
from simvehicle.world.world_config import (
    FilamentPlume,
    FilamentSource,
    FlatFilamentPlume,
    FlatFilamentSource,
    GaussianPlume,
    GridWindConfig,
    LocusGridPlume,
    Obstacle,
    WorldConfig,
)

_NARROWEST_WAY_M: Final = 0.1
"""Of a way out that is one at all: worlds may be as small as a room."""
MOST_PUFFS: Final = 2_000_000
"""In the air at a time: some 200 MB."""
MOST_NODES_PER_S: Final = 1e8
"""A core updates about as many a second: with more the wind would be slower than its own time."""
_BEYOND_M: Final = 100.0
"""So far around everything the ground is open."""


def problems(config: WorldConfig) -> Iterator[tuple[str, str]]:
    """(field, what is wrong with it in one clear line)."""
    broken = [(f"obstacles[{number}]", problem) for number, problem in standing.problems(config.obstacles)]
    yield from broken
    if isinstance(config.wind, GridWindConfig):
        yield from _wind_problems(config.wind)
    if isinstance(config.plume, FilamentPlume | FlatFilamentPlume):
        yield from _puff_problems(config.plume, config.origin.amsl_m)
    if broken:
        return  # nobody can tell what is inside an outline that is none
    standing_there = standing.Obstacles(config.obstacles)
    for field, source in sources(config):
        yield from _source_problems(config, standing_there, field, source)
    if isinstance(config.wind, GridWindConfig) and _covers_edges(config.wind, config.obstacles):
        yield (
            "obstacles",
            "they cover the whole edge of the wind's grid, so that no air comes in; move or shrink them",
        )
    aims = sources(config)
    for (field, _), shut in zip(
        aims, shut_in([place for _, place in aims], config.obstacles, way_m=_NARROWEST_WAY_M), strict=True
    ):
        if shut:
            yield field, "the source is shut in: no way between the obstacles leads out; open or move them"


def sources(config: WorldConfig) -> list[tuple[str, Vector3]]:
    """(field, north, east, down in metres) of each source of gas; one without a height is at the ground."""
    plume = config.plume
    if isinstance(plume, GaussianPlume):
        return [("plume", (plume.source_north_m, plume.source_east_m, -plume.source_above_home_m))]
    if isinstance(plume, LocusGridPlume):
        return [("plume", (plume.source_north_m, plume.source_east_m, 0.0))]
    if plume is None:
        return []
    sources: tuple[FilamentSource | FlatFilamentSource, ...] = plume.sources
    return [
        (f"plume.sources[{k}]", (one.north_m, one.east_m, -getattr(one, "above_home_m", 0.0)))
        for k, one in enumerate(sources)
    ]


def shut_in(
    places_ned_m: Sequence[Vector3],
    obstacles: Sequence[Obstacle],
    *,
    way_m: float,
    ceiling_m: float = math.inf,
    bounds: shapely.Geometry | None = None,
) -> list[bool]:
    """Of each place, whatever its height: whether no way that is `way_m` wide leads from it to the open ground.

    With `bounds` (x north, y east): to the first place, inside them. Who may fly as high as `ceiling_m` flies over
    what ends below.
    """
    outlines = [
        shapely.Polygon(obstacle.outline()) for obstacle in obstacles if standing.top_m(obstacle) >= ceiling_m
    ]
    if not outlines or not places_ned_m:
        return [False] * len(places_ned_m)
    filled = shapely.union_all(outlines).buffer(0.5 * way_m)
    points = [shapely.Point(place[:2]) for place in places_ned_m]
    if bounds is None:
        everything = shapely.union_all([filled, *points])
        bounds = shapely.box(*everything.buffer(_BEYOND_M).bounds)
        aim = shapely.Point(bounds.bounds[0], bounds.bounds[1])
    else:
        aim = points[0]
    parts = shapely.get_parts(bounds.difference(filled))
    # What stands nearer to an obstacle than half a way's width begins at the nearest free ground.
    return [_part(point, parts, way_m) != _part(aim, parts, way_m) for point in points]


def _part(point: shapely.Point, parts: Sequence[shapely.Geometry], within_m: float) -> int | None:
    """Which of the parts a point is in, or so near to."""
    distances_m = [part.distance(point) for part in parts]
    if not distances_m or min(distances_m) > within_m:
        return None
    return distances_m.index(min(distances_m))


def _wind_problems(wind: GridWindConfig) -> Iterator[tuple[str, str]]:
    from simvehicle.world.grid_wind import checked_step_s, nodes_per_s

    try:
        checked_step_s(wind)
    except ValueError as error:
        yield "wind.step_s", str(error)
        return
    if (work := nodes_per_s(wind)) > MOST_NODES_PER_S:
        yield (
            "wind.cells",
            f"the wind's solver would update {work:.2g} nodes for each second of wind, {MOST_NODES_PER_S:.0e} are "
            "the most; give fewer cells, or a longer step_s if there is one",
        )


def _puff_problems(plume: FilamentPlume | FlatFilamentPlume, amsl_m: float) -> Iterator[tuple[str, str]]:
    most = len(plume.sources) * plume.puffs_per_s * plume.lifetime_s
    if most > MOST_PUFFS:
        yield (
            "plume.puffs_per_s",
            f"up to {most:,.0f} puffs would be in the air, and {MOST_PUFFS:,} are the most; give fewer of them or a "
            "shorter lifetime_s",
        )
    if isinstance(plume, FilamentPlume):
        strongest = max(plume.sources, key=lambda source: source.emission_kgps)
        puff_kg = strongest.emission_kgps / plume.puffs_per_s
        fresh_ppm = puff_strength_ppm_m3(puff_kg, amsl_m) / plume.initial_radius_m**3
        if fresh_ppm > 1e6:
            yield (
                "plume.initial_radius_m",
                f"a fresh puff would have {fresh_ppm:.3g} ppm at its centre, more than pure CO2; give it a larger "
                "radius, or more puffs_per_s, or a smaller emission_kgps",
            )


def _source_problems(
    config: WorldConfig, obstacles: standing.Obstacles, field: str, source: Vector3
) -> Iterator[tuple[str, str]]:
    for number, obstacle in enumerate(obstacles.each()):
        if obstacle.clearance_m(source) < 0.0:
            yield field, f"the source is inside obstacles[{number}]; move one of them"
    wind = config.wind
    if isinstance(wind, GridWindConfig):
        half_m = 0.5 * wind.length_m
        off_m = max(abs(source[0] - wind.centre_north_m), abs(source[1] - wind.centre_east_m)) - half_m
        if off_m > 0.0:
            yield (
                field,
                (
                    f"the source is {off_m:.4g} m outside the wind's square, ending {half_m:g} m from its centre; "
                    "move it or give wind.length_m more"
                ),
            )


def _covers_edges(wind: GridWindConfig, obstacles: Sequence[Obstacle]) -> bool:
    if not obstacles:
        return False
    half_m = 0.5 * wind.length_m
    edge = shapely.box(
        wind.centre_north_m - half_m,
        wind.centre_east_m - half_m,
        wind.centre_north_m + half_m,
        wind.centre_east_m + half_m,
    ).exterior
    filled = shapely.union_all([shapely.Polygon(one.outline()) for one in obstacles])
    return bool(filled.buffer(0.5 * wind.spacing_m).covers(edge))
