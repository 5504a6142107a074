"""The last word before a setpoint leaves the drone: geofence, obstacles, altitude band, separation, speed, staleness.

The guard turns an intent into a velocity, takes away from it whatever would lead over a limit, and says what
held it back. It never makes a drone faster and never trusts a strategy.

Each limit is a half-plane: the part of the velocity that leads towards it may be no larger than a speed from
which the drone can still stop before it (`braking_speed_mps`), a discrete form of a control barrier function
(Ames et al., "Control barrier functions: theory and applications", 2019).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from flightstack.config import LimitsConfig
from flightstack.flight.braking import REACTION_S, braking_speed_mps
from flightstack.flight.columns import columns
from flightstack.flight.guidance import CORRIDOR_M, HOVERS_MPS, horizontal_m, stays, stretch, whereabouts
from flightstack.flight.keeping_clear import kept_clear
from flightstack.flight.surroundings import ObstaclesAround
from flightstack.flight.way_around import Room, Way, WayAround
from flightstack.mavlink.obstacle_distance import Ranges
from flightstack.swarm.peers import FRESH_S
from mission.geometry.frames import Vector3
from mission.geometry.geofence import LocalFence
from mission.geometry.known_obstacles import LocalObstacles
from mission.strategies.contract import GoTo, Hold, Intent, Neighbour, Velocity

SEPARATION_MARGIN_M = 1.0
"""Room over the configured minimum for the positions' own errors."""

AGEING_MPS = 0.5
"""How fast the room around a silent neighbour grows with the age of what it last said."""

AGEING_LIMIT_M = 1.0

LEVEL_M = 2.0
"""A target this near to the drone's own altitude is in the rooms that are in its way here."""

OVER_M = 1.0
"""So much higher than an obstacle's margin a drone flies over it."""

PASSING_MPS = 2.0
"""How fast a corner of the way around something is passed."""

SWAYS_MPS = 1.5
"""What is gone around already may move so fast for a moment, in a gust, and is still gone around."""

LEAST_MPS = 0.5
"""A sensor that sees no farther than the margin does not stop the drone."""

AN_OBSTACLE = "kept clear of an obstacle"

STATION_M = 0.5
"""Nearer than this to an unopposed target, the autopilot's own position controller keeps the station."""


class PositionTarget(msgspec.Struct, frozen=True, tag=True):
    position_ned_m: Vector3


class VelocityTarget(msgspec.Struct, frozen=True, tag=True):
    velocity_ned_mps: Vector3


Setpoint = PositionTarget | VelocityTarget


class Guarded(msgspec.Struct, frozen=True):
    setpoint: Setpoint
    held_by: tuple[str, ...]
    """What took part of the intent away, in words for an operator; empty if nothing did."""


class Guard:
    """One drone's guard. `apply` is called once a tick; it remembers the point that a Hold holds, and the way around
    what hovers."""

    def __init__(
        self, limits: LimitsConfig, fence: LocalFence | None, obstacles: LocalObstacles | None = None
    ) -> None:
        self._limits = limits
        self._fence = fence
        self._surroundings = ObstaclesAround(obstacles, limits.obstacle_margin_m)
        self._held_ned_m: Vector3 | None = None
        self._way = WayAround(fence, limits.fence_margin_m, self._surroundings)

    def look(
        self,
        now_s: float,
        position_ned_m: Vector3 | None,
        ranges: Ranges | None,
        neighbours: Sequence[Neighbour],
    ) -> None:
        """Remember what the range finder sees now, wherever the drone is flown from; before `apply`."""
        if position_ned_m is not None and ranges is not None:
            self._surroundings.look(now_s, position_ned_m, ranges, neighbours)

    def apply(
        self,
        intent: Intent,
        position_ned_m: Vector3 | None,
        velocity_ned_mps: Vector3 | None,
        position_age_s: float | None,
        neighbours: Sequence[Neighbour],
        home_ned_m: Vector3 | None = None,
    ) -> Guarded:
        """The setpoint of this tick: always one, and a stop where it is not known what would be safe.

        `home_ned_m`: the drone's own; the way down to it stays free.
        """
        limits = self._limits
        if position_ned_m is None or velocity_ned_mps is None or position_age_s is None:
            return self._stop("own position is not known")
        if position_age_s > limits.position_stale_s:
            return self._stop(f"own position is {position_age_s:.1f} s old")
        if not _all_finite(intent, (*position_ned_m, *velocity_ned_mps, position_age_s), neighbours):
            return self._stop("a position, velocity or target is not a number")
        held_by: list[str] = []
        target: Vector3 | None = None
        around: frozenset[int] = frozenset()
        station = False
        match intent:
            case Hold():
                target = self._held_ned_m = self._held_ned_m or _stopping_point(
                    position_ned_m, velocity_ned_mps, limits.acceleration_mps2
                )
            case GoTo(position_ned_m=wanted):
                self._held_ned_m = None
                target = wanted
            case Velocity(velocity_ned_mps=wanted):
                self._held_ned_m = None
                velocity = self._capped(wanted, limits.speed_mps)
        if target is not None:
            target = self._allowed(target, held_by)
            speed_mps = limits.speed_mps
            if isinstance(intent, GoTo) and intent.speed_mps is not None:
                speed_mps = min(speed_mps, intent.speed_mps)
            way = self._way_to(position_ned_m, target, neighbours, held_by)
            around, station = self._way.avoids, way.last
            target = (*way.point_m, target[2])
            velocity = self._towards(position_ned_m, target, speed_mps, passing=not way.last)
        wanted_velocity = velocity
        velocity = self._keep_apart(position_ned_m, velocity, neighbours, home_ned_m, around, held_by)
        velocity = self._keep_band(position_ned_m, velocity, held_by)
        velocity = self._keep_clear(position_ned_m, velocity_ned_mps, velocity, held_by)
        inside = self._keep_inside(position_ned_m, velocity, held_by)
        velocity = self._keep_clear(position_ned_m, velocity_ned_mps, inside, held_by)
        if velocity != inside and self._fence is not None:  # where the fence had turned it back
            spare_m = self._fence.clearance_m(*position_ned_m[:2]) - limits.fence_margin_m
            velocity = self._able_to_stop(position_ned_m, velocity, spare_m)
        # No faster than it can stop before what it sees first at the end of its sight.
        in_sight_mps = braking_speed_mps(
            self._surroundings.reach_m - limits.obstacle_margin_m, limits.acceleration_mps2
        )
        velocity = self._capped(velocity, max(min(limits.speed_mps, in_sight_mps), LEAST_MPS))
        near = station and target is not None and math.dist(position_ned_m, target) < STATION_M
        if near and target is not None and velocity == wanted_velocity:
            return Guarded(PositionTarget(target), tuple(held_by))
        return Guarded(VelocityTarget(velocity), tuple(held_by))

    def _stop(self, why: str) -> Guarded:
        self._held_ned_m = None
        return Guarded(VelocityTarget((0.0, 0.0, 0.0)), (why,))

    def _allowed(self, target: Vector3, held_by: list[str]) -> Vector3:
        """The target itself, or the nearest point that the altitude band and the fence allow."""
        limits = self._limits
        north_m, east_m, down_m = target
        if self._fence is not None and not self._fence.keeps(north_m, east_m, limits.fence_margin_m):
            north_m, east_m = self._fence.nearest_allowed(north_m, east_m, limits.fence_margin_m)
            held_by.append("the target lies outside the geofence")
        lowest_m, highest_m = -limits.floor_above_home_m, -limits.ceiling_above_home_m
        if not highest_m <= down_m <= lowest_m:
            down_m = min(max(down_m, highest_m), lowest_m)
            held_by.append("the target lies outside the altitude band")
        return north_m, east_m, down_m

    def _way_to(
        self, position: Vector3, target: Vector3, neighbours: Sequence[Neighbour], held_by: list[str]
    ) -> Way:
        """Around the rooms of those that hover here and make way for nobody."""
        rooms = []
        for other in neighbours:
            if not stays(other, SWAYS_MPS if other.drone in self._way.avoids else HOVERS_MPS):
                continue
            (*from_m, from_down_m), (*to_m, to_down_m) = stretch(other)
            below_m = max(
                min(from_down_m, to_down_m) - position[2], position[2] - max(from_down_m, to_down_m), 0.0
            )
            room_m = self._room_m(other)
            if below_m < room_m:
                radius_m = math.sqrt(room_m**2 - below_m**2)
                rooms.append(Room(other.drone, (from_m[0], from_m[1]), (to_m[0], to_m[1]), radius_m))
        level = abs(target[2] - position[2]) < LEVEL_M
        # Around what ends just below a target one goes too: a drone that sways would be stopped at its edge.
        above_home_m = -target[2] - OVER_M if level else -position[2]
        way = self._way.step(position[:2], target[:2], rooms, above_home_m, level=level)
        if way.around or way.walls:
            drones = f"drone{'s' * (len(way.around) > 1)} {', '.join(map(str, way.around))}"
            what = " and ".join([drones] * bool(way.around) + ["an obstacle"] * way.walls)
            held_by.append(
                f"as near to the target as {what} allows" if way.shifted else f"goes around {what}"
            )
        return way

    def _room_m(self, other: Neighbour) -> float:
        """How near to a neighbour no drone may come; of an old position less is known."""
        ageing_m = min(AGEING_MPS * other.age_s, AGEING_LIMIT_M)
        return self._limits.separation_m + SEPARATION_MARGIN_M + ageing_m

    def _towards(
        self, position: Vector3, target: Vector3, speed_mps: float, *, passing: bool = False
    ) -> Vector3:
        limits = self._limits
        north_m, east_m = target[0] - position[0], target[1] - position[1]
        distance_m = math.hypot(north_m, east_m)
        at_target_mps = PASSING_MPS if passing else 0.0
        horizontal_mps = min(
            speed_mps, braking_speed_mps(distance_m, limits.acceleration_mps2) + at_target_mps
        )
        scale = horizontal_mps / distance_m if distance_m > 1e-6 else 0.0
        down_m = target[2] - position[2]
        vertical_mps = min(
            limits.descent_mps if down_m > 0.0 else limits.climb_mps,
            braking_speed_mps(abs(down_m), limits.acceleration_mps2),
        )
        return north_m * scale, east_m * scale, math.copysign(vertical_mps, down_m)

    def _keep_apart(
        self,
        position: Vector3,
        velocity: Vector3,
        neighbours: Sequence[Neighbour],
        home: Vector3 | None,
        around: frozenset[int],
        held_by: list[str],
    ) -> Vector3:
        """Limit how fast the drone closes in on each neighbour; step aside to the right where they would block, but
        for those that its way leads around."""
        limits = self._limits
        near: list[tuple[Vector3, float, float, int, bool]] = []
        least_m = limits.separation_m + SEPARATION_MARGIN_M
        # There the others keep out of the way, and who is blocked there comes down where they do not.
        over_home = home is not None and horizontal_m(position, home) < 2.0 * CORRIDOR_M
        reach_m = least_m + AGEING_LIMIT_M + 4.0 * limits.speed_mps
        for drone, place, room_m in columns(neighbours, position, home, least_m):
            distance_m, towards = _direction(position, place, (1.0, 0.0, 0.0))
            allowed_mps = braking_speed_mps(distance_m - room_m, limits.acceleration_mps2)
            near.append((towards, allowed_mps, distance_m - room_m, drone, True))
        for other in neighbours:
            if not other.airborne:
                continue
            distance_m, towards = _direction(position, whereabouts(other, position), (0.0, 0.0, 1.0))
            if distance_m > reach_m:
                continue
            room_m = least_m if over_home else self._room_m(other)
            approaching_mps = (
                min(0.0, _dot(other.velocity_ned_mps, towards)) if other.age_s < FRESH_S else 0.0
            )
            allowed_mps = braking_speed_mps(distance_m - room_m, limits.acceleration_mps2) + approaching_mps
            near.append((towards, allowed_mps, distance_m - room_m, other.drone, other.drone not in around))
        for _ in range(3):
            for towards, allowed_mps, spare_m, drone, aside in near:
                closing_mps = _dot(velocity, towards)
                if closing_mps <= allowed_mps:
                    continue
                excess_mps = closing_mps - allowed_mps
                velocity = _minus(velocity, towards, excess_mps)
                if aside and spare_m < 2.0 and closing_mps > 0.0:
                    velocity = _sidestep(velocity, towards, min(0.5 * closing_mps, 1.0))
                text = f"kept apart from drone {drone}"
                if text not in held_by:
                    held_by.append(text)
        return velocity

    def _keep_band(self, position: Vector3, velocity: Vector3, held_by: list[str]) -> Vector3:
        limits = self._limits
        down_mps = velocity[2]
        fastest_down = braking_speed_mps(-limits.floor_above_home_m - position[2], limits.acceleration_mps2)
        fastest_up = braking_speed_mps(position[2] + limits.ceiling_above_home_m, limits.acceleration_mps2)
        kept_mps = max(min(down_mps, fastest_down), -fastest_up)
        kept_mps = max(min(kept_mps, limits.descent_mps), -limits.climb_mps)
        if abs(kept_mps - down_mps) > 0.05:
            held_by.append("altitude band")
        return velocity[0], velocity[1], kept_mps

    def _keep_clear(
        self, position: Vector3, velocity: Vector3, wanted: Vector3, held_by: list[str]
    ) -> Vector3:
        kept = kept_clear(position, velocity, wanted, self._surroundings, self._limits)
        if kept != wanted and AN_OBSTACLE not in held_by:
            held_by.append(AN_OBSTACLE)
        return kept

    def _keep_inside(self, position: Vector3, velocity: Vector3, held_by: list[str]) -> Vector3:
        if self._fence is None:
            return velocity
        north_m, east_m = position[0], position[1]
        margin_m = self._limits.fence_margin_m
        if self._fence.keeps(north_m, east_m, margin_m + 4.0 * self._limits.speed_mps):
            return velocity
        spare_m = self._fence.clearance_m(north_m, east_m) - margin_m
        edge_n, edge_e = self._fence.nearest_edge_point(north_m, east_m)
        outward = (edge_n - north_m, edge_e - east_m)
        length_m = math.hypot(*outward)
        if length_m < 1e-3:
            back_n, back_e = self._fence.nearest_allowed(north_m, east_m, margin_m)
            outward = (north_m - back_n, east_m - back_e)
            length_m = max(math.hypot(*outward), 1e-3)
        elif spare_m < -margin_m:
            outward = (-outward[0], -outward[1])  # outside: the edge is the way back
        towards = (outward[0] / length_m, outward[1] / length_m, 0.0)
        allowed_mps = braking_speed_mps(spare_m, self._limits.acceleration_mps2)
        closing_mps = _dot(velocity, towards)
        kept = (
            velocity if closing_mps <= allowed_mps else _minus(velocity, towards, closing_mps - allowed_mps)
        )
        kept = self._able_to_stop(position, kept, spare_m)
        if kept != velocity:
            held_by.append("geofence")
        return kept

    def _able_to_stop(self, position: Vector3, velocity: Vector3, spare_m: float) -> Vector3:
        """Slow down until the drone can stop inside: a corner has a second edge that is not the nearest yet."""
        if self._fence is None:
            return velocity
        needed_m = self._limits.fence_margin_m + min(spare_m, 0.0) - 0.1
        for part in (1.0, 0.8, 0.6, 0.4, 0.2):
            north_mps, east_mps = velocity[0] * part, velocity[1] * part
            stop_s = REACTION_S + math.hypot(north_mps, east_mps) / (1.2 * self._limits.acceleration_mps2)
            stop = position[0] + north_mps * stop_s, position[1] + east_mps * stop_s
            if self._fence.keeps(*stop, needed_m):
                return north_mps, east_mps, velocity[2]
        return 0.0, 0.0, velocity[2]

    def _capped(self, velocity: Vector3, speed_mps: float) -> Vector3:
        limits = self._limits
        horizontal_mps = math.hypot(velocity[0], velocity[1])
        scale = min(1.0, speed_mps / horizontal_mps) if horizontal_mps > 0.0 else 1.0
        down_mps = max(min(velocity[2], limits.descent_mps), -limits.climb_mps)
        return velocity[0] * scale, velocity[1] * scale, down_mps


def _all_finite(intent: Intent, own: Sequence[float], neighbours: Sequence[Neighbour]) -> bool:
    """Their sources check them too, but here nothing may go wrong: a setpoint that is none ends the agent."""
    numbers = list(own)
    match intent:
        case GoTo(position_ned_m=wanted, speed_mps=speed_mps):
            numbers += wanted if speed_mps is None else (*wanted, speed_mps)
        case Velocity(velocity_ned_mps=wanted):
            numbers += wanted
    for other in neighbours:
        numbers += other.home_ned_m or ()
        numbers += (*other.position_ned_m, *other.velocity_ned_mps, other.age_s)
    return math.isfinite(sum(numbers))


def _stopping_point(position: Vector3, velocity: Vector3, acceleration_mps2: float) -> Vector3:
    """Where a drone that brakes now comes to rest: holding there spares it flying back."""
    speed_mps = math.hypot(*velocity)
    ahead_s = speed_mps / (2.0 * acceleration_mps2)
    n, e, d = (p + v * ahead_s for p, v in zip(position, velocity, strict=True))
    return n, e, d


def _direction(position: Vector3, place: Vector3, where_they_meet: Vector3) -> tuple[float, Vector3]:
    """Distance to a place, and the direction of it."""
    north_m, east_m, down_m = (there - here for there, here in zip(place, position, strict=True))
    distance_m = math.hypot(north_m, east_m, down_m)
    if distance_m <= 1e-3:
        return distance_m, where_they_meet
    return distance_m, (north_m / distance_m, east_m / distance_m, down_m / distance_m)


def _dot(a: Vector3, b: Vector3) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _minus(velocity: Vector3, direction: Vector3, speed_mps: float) -> Vector3:
    return (
        velocity[0] - direction[0] * speed_mps,
        velocity[1] - direction[1] * speed_mps,
        velocity[2] - direction[2] * speed_mps,
    )


def _sidestep(velocity: Vector3, towards: Vector3, speed_mps: float) -> Vector3:
    """Add a horizontal motion to the right of `towards`: two drones face to face both give way to the right."""
    length = math.hypot(towards[0], towards[1])
    if length < 0.3:  # the other is above or below: no side is better
        return velocity
    return (
        velocity[0] - towards[1] / length * speed_mps,
        velocity[1] + towards[0] / length * speed_mps,
        velocity[2],
    )
