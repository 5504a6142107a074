"""What is wrong with the configuration of a world although every value in it is of its type."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final, TypeAlias

import shapely

from simvehicle.world import obstacles as standing
from simvehicle.world.gas_formulas import puff_strength_ppm_m3
from simvehicle.world.world_config import (
    FilamentPlume,
    FlatFilamentPlume,
    GaussianPlume,
    GridWindConfig,
    LocusGridPlume,
    Obstacle,
    WorldConfig,
)

WAY_M: Final = 2.0
"""Width of a way that counts as free between obstacles."""
MOST_PUFFS: Final = 2_000_000
"""In the air at a time: some 200 MB."""
_BEYOND_M: Final = 100.0
"""So far around everything the ground is open."""
_Place: TypeAlias = tuple[float, float]


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
    for field, source in sources(config):
        yield from _source_problems(config, field, source)
    if isinstance(config.wind, GridWindConfig) and _covers_edges(config.wind, config.obstacles):
        yield (
            "obstacles",
            "they cover the whole edge of the wind's grid, so that no air comes in; move or shrink them",
        )
    for (field, _), shut in zip(
        sources(config), shut_in([p for _, p in sources(config)], config.obstacles), strict=True
    ):
        if shut:
            yield field, f"the source is shut in: no way of {WAY_M:g} m between the obstacles leads out"


def sources(config: WorldConfig) -> list[tuple[str, _Place]]:
    """(field, (north, east) in metres) of each source of gas."""
    plume: object = config.plume
    if isinstance(plume, GaussianPlume | LocusGridPlume):
        return [("plume", (plume.source_north_m, plume.source_east_m))]
    if isinstance(plume, FilamentPlume | FlatFilamentPlume):
        places = [(one.north_m, one.east_m) for one in plume.sources]
        return [(f"plume.sources[{k}]", place) for k, place in enumerate(places)]
    return []


def shut_in(
    places_m: Sequence[_Place],
    obstacles: Sequence[Obstacle],
    *,
    ceiling_m: float = math.inf,
    bounds: shapely.Geometry | None = None,
) -> list[bool]:
    """Of each place, north and east: whether no way that is `WAY_M` wide leads from it to the open ground, or inside
    `bounds` (x north, y east) to the first place. Who may fly as high as `ceiling_m` flies over what ends below.
    """
    outlines = [
        shapely.Polygon(obstacle.outline()) for obstacle in obstacles if standing.top_m(obstacle) >= ceiling_m
    ]
    if not outlines or not places_m:
        return [False] * len(places_m)
    filled = shapely.union_all(outlines).buffer(0.5 * WAY_M)
    points = [shapely.Point(place) for place in places_m]
    if bounds is None:
        everything = shapely.union_all([filled, *points])
        bounds = shapely.box(*everything.buffer(_BEYOND_M).bounds)
        aim = shapely.Point(bounds.bounds[0], bounds.bounds[1])
    else:
        aim = points[0]
    parts = shapely.get_parts(bounds.difference(filled))
    # What stands nearer to an obstacle than half a way's width begins at the nearest free ground.
    return [_part(point, parts) != _part(aim, parts) for point in points]


def _part(point: shapely.Point, parts: Sequence[shapely.Geometry]) -> int | None:
    """Which of the parts a point is in, or nearly in."""
    distances_m = [part.distance(point) for part in parts]
    if not distances_m or min(distances_m) > WAY_M:
        return None
    return distances_m.index(min(distances_m))


def _wind_problems(wind: GridWindConfig) -> Iterator[tuple[str, str]]:
    from simvehicle.world.grid_wind import checked_step_s

    try:
        checked_step_s(wind)
    except ValueError as error:
        yield "wind.step_s", str(error)


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


def _source_problems(config: WorldConfig, field: str, source: _Place) -> Iterator[tuple[str, str]]:
    point = shapely.Point(source)
    for number, obstacle in enumerate(config.obstacles):
        if shapely.Polygon(obstacle.outline()).contains(point):
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
