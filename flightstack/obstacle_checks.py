"""Obstacles of a drone's file that nobody can fly among, and ways that lead through them."""

from __future__ import annotations

import math
from collections.abc import Iterator

import shapely

from flightstack.config import DroneConfig
from flightstack.flight.layers import layers_of
from mission.geometry.formation import make_layout
from mission.geometry.frames import LocalFrame
from mission.geometry.geofence import LocalFence, LocalPoint
from mission.geometry.known_obstacles import LocalObstacles


def obstacle_problems(config: DroneConfig) -> Iterator[tuple[str, str]]:
    """(field, what is wrong and how to mend it)."""
    if not config.obstacles:
        return
    frame, limits, formation = LocalFrame(config.origin), config.limits, config.formation
    wrong = False
    for index, obstacle in enumerate(config.obstacles):
        problem = obstacle.problem(frame)
        if problem:
            wrong = True
            yield f"obstacles[{index}]", problem
    if wrong:
        return
    layout = make_layout(formation.layout, formation.spacing_m)
    slots = [layout.offset_m(slot) for slot in range(len(config.swarm.members))]
    for index, obstacle in enumerate(config.obstacles):
        alone = LocalObstacles(frame, (obstacle,), limits.obstacle_margin_m)
        for slot, (north_m, east_m) in enumerate(slots):
            if not alone.is_free(north_m, east_m, formation.above_home_m):
                away_m = alone.beside_walls_m(north_m, east_m, formation.above_home_m)
                where = f"{away_m:.1f} m from" if away_m > 0.0 else "inside"
                yield (
                    f"obstacles[{index}]",
                    f"the swarm forms up over the origin, {formation.above_home_m:g} m high, and slot {slot} of its "
                    f"formation is {where} this obstacle; limits.obstacle_margin_m = {limits.obstacle_margin_m:g} m "
                    "are to be kept: move the origin, or form up higher",
                )
                return


def launch_problem(config: DroneConfig, launch_m: LocalPoint) -> str:
    """Why this drone cannot fly from a launch point (north, east) to where the swarm forms up; or nothing."""
    if not config.obstacles:
        return ""
    frame, limits = LocalFrame(config.origin), config.limits
    obstacles = LocalObstacles(frame, config.obstacles, limits.obstacle_margin_m)
    if not obstacles.is_free(*launch_m, 0.0):
        away_m = obstacles.beside_walls_m(*launch_m, 0.0)
        where = f"{away_m:.1f} m from an obstacle" if away_m > 0.0 else "inside an obstacle"
        return (
            f"is {where}; limits.obstacle_margin_m = {limits.obstacle_margin_m:g} m are to be kept: move it"
        )
    layer_m = layers_of(config.drone, config.swarm.members, config.formation, limits).agent_above_home_m
    walls = obstacles.walls(layer_m)
    if walls.is_empty:
        return ""
    everywhere = shapely.union(walls, shapely.MultiPoint([launch_m, (0.0, 0.0)])).envelope.buffer(1.0)
    room = everywhere
    if config.geofence is not None:
        room = LocalFence(frame, config.geofence).room(limits.fence_margin_m)
    free = shapely.get_parts(shapely.difference(room, walls))
    if not any(
        shapely.intersects_xy(part, *launch_m) and shapely.intersects_xy(part, 0.0, 0.0) for part in free
    ):
        return (
            f"has no way to the origin, over which the swarm forms up, in drone {config.drone}'s layer {layer_m:g} m "
            "high: obstacles with their margin shut it in"
        )
    return ""


def obstacle_cautions(config: DroneConfig) -> Iterator[tuple[str, str]]:
    """What the agents fly around, and an autopilot that comes home by itself does not: it flies straight."""
    if not config.obstacles:
        return
    frame, limits = LocalFrame(config.origin), config.limits
    members = config.swarm.members
    home_m = [layers_of(drone, members, config.formation, limits).autopilot_above_home_m for drone in members]
    room = None if config.geofence is None else LocalFence(frame, config.geofence).area.convex_hull
    tall: dict[int, float] = {}
    for index, obstacle in enumerate(config.obstacles):
        least_m = obstacle.top_m + limits.obstacle_margin_m
        beyond = room is not None and not shapely.intersects(room, shapely.Polygon(obstacle.outline(frame)))
        if least_m > min(home_m) and not beyond:  # no way leads beyond the fence
            tall[index] = least_m
    if not tall:
        return
    low = [
        drone
        for drone, above_home_m in zip(members, home_m, strict=True)
        if above_home_m < max(tall.values())
    ]
    who = (
        "every drone"
        if len(low) == len(members)
        else f"drone{'s' * (len(low) > 1)} {', '.join(map(str, low))}"
    )
    enough = f"; {max(tall.values()):g} m are enough" if math.isfinite(max(tall.values())) else ""
    yield (
        f"obstacles[{min(tall)}]",
        f"obstacle{'s' * (len(tall) > 1)} {', '.join(map(str, tall))} {'stand' if len(tall) > 1 else 'stands'} as "
        f"high as the autopilot of {who} comes home by itself (the lowest at {min(home_m):g} m): it flies straight, "
        f"and into what is between it and its home, while agents fly around{enough}",
    )
