"""The figures of a survey: from the world's own record, and from what the launcher heard. Pure."""

from __future__ import annotations

import math
import pathlib
from collections.abc import Mapping, Sequence
from typing import TypeVar

import msgspec
import numpy as np
import shapely

from flightstack.transport.radio_model import RadioModel
from mission.geometry.formation import Layout
from mission.geometry.frames import LocalFrame, Vector3
from mission.geometry.geofence import Geofence, LocalFence
from mission.strategies.contract import Stage
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.fleet.truth import LONGEST_STEP_S, STEP_S, VehicleTrack
from simvehicle.survey.agent_faults import Freeze
from simvehicle.survey.healing import Healing, Rejoin, failures, healings, rejoins
from simvehicle.survey.watch import Log
from simvehicle.world.obstacles import TOUCHES_M, Obstacles
from simvehicle.world.world_config import Obstacle

T = TypeVar("T", Healing, Rejoin)

FENCE_TOLERANCE_M = 1.0
"""How far inside a drone must be again before a breach of the fence has ended."""
HOME_M = 5.0
"""A vehicle that landed within this distance of where it started is home."""
HARD_LANDING_MPS = 3.0
"""A vehicle that met the ground faster than this has crashed."""


class DroneSummary(msgspec.Struct, frozen=True):
    drone: int
    agent_alive: bool
    """Its agent still ran at the end."""
    landed: bool
    """Its vehicle was on the ground at the end."""
    crashed: bool
    home_distance_m: float | None
    """Horizontal distance of where it ended from where it started."""
    flight_s: float
    """Time in the air."""
    last_mode: str
    battery_fraction: float | None
    highest_co2_ppm: float | None

    @property
    def away(self) -> bool:
        """It came down somewhere else than at home."""
        return self.landed and self.home_distance_m is not None and self.home_distance_m > HOME_M


class Orphan(msgspec.Struct, frozen=True):
    """A vehicle whose agent died in flight, or was frozen to the end, and what became of it."""

    drone: int
    killed_at_s: float | None
    """When its agent was killed on purpose; None if it died by itself."""
    brought_home_by: str
    """"ground station" if it commanded the return, "autopilot" if that was its own failsafe, "" if nobody did."""
    modes: str
    """The autopilot's from the death on, in order: "GUIDED > RTL"."""
    mode_changed_after_s: float | None
    """How long it flew on in the mode that its agent had left it in."""
    landed_at_s: float | None
    home_distance_m: float | None
    story: str


class Summary(msgspec.Struct, frozen=True):
    """`summary.json`. Times in simulated seconds since the first take-off, NED metres from the survey's origin."""

    outcome: str
    reason: str
    name: str
    drones: int
    alive: int
    """Drones whose agents ran, not frozen, to the end and whose vehicles did not crash."""
    time_to_contact_s: float | None
    """Until the swarm first measured enough to follow it."""
    time_to_source_s: float | None
    """Until the swarm said that it had found the source."""
    source_error_m: float | None
    """Horizontal distance between the estimate and the true source."""
    source_sd_m: float | None
    """The standard deviation of the estimate as the swarm told it; None if it told none."""
    source_estimate_ned_m: Vector3 | None
    source_true_ned_m: Vector3 | None
    min_separation_m: float | None
    """Smallest distance between two flying vehicles, in three dimensions."""
    min_separation_pair: tuple[int, int] | None
    min_separation_at_s: float | None
    configured_separation_m: float
    fence_breaches: int
    min_clearance_m: float | None
    """The nearest that a flying vehicle's middle came to an obstacle, known or not; None without any."""
    obstacles_touched: int
    """How often a flying vehicle touched one."""
    heals: int
    healings: tuple[Healing, ...]
    """How long the swarm took to heal around each failure, in the order of the failures."""
    rejoined: tuple[Rejoin, ...]
    """Drones that were counted out and took a slot again."""
    kills: dict[int, float]
    """Drone -> when its agent was killed on purpose."""
    freezes: tuple[Freeze, ...]
    """When agents were stopped on purpose; without an end: to the end, or until it died."""
    orphans: tuple[Orphan, ...]
    lost_processes: tuple[str, ...]
    """Processes that ended by themselves."""
    missed_deadline_fraction: float
    """Share of all agents' ticks that came too late."""
    per_drone: tuple[DroneSummary, ...]
    simulated_s: float
    """From the first take-off to the end."""
    wall_s: float
    """The whole survey on the machine's clock, start-up included."""
    speedup: float
    """As asked for: an upper limit."""
    speedup_reached: float | None
    """What the machine managed, start-up not included."""
    seed: int
    radio: RadioModel | None
    """Between drones and ground station; None: everything was heard."""
    encrypted: bool
    """Whether the swarm's messages were."""
    log_dir: str
    warnings: tuple[str, ...] = ()


class Ending(msgspec.Struct, frozen=True):
    """What only the launcher knows."""

    outcome: str
    reason: str
    alive: frozenset[int]
    kills: dict[int, float]
    lost_processes: tuple[str, ...]
    wall_s: float
    speedup_reached: float | None
    log_dir: str
    warnings: tuple[str, ...] = ()
    freezes: tuple[Freeze, ...] = ()
    radio: RadioModel | None = None
    encrypted: bool = False


def summarise(
    name: str,
    fleet: FleetConfig,
    source_ned_m: Vector3,
    geofence: Geofence | None,
    separation_m: float,
    layout: Layout,
    tracks: Mapping[int, VehicleTrack],
    log: Log,
    ending: Ending,
) -> Summary:
    """The figures of one survey. Works with whatever there is: empty tracks, an empty log."""
    found, tracking = log.first(Stage.FOUND), log.first(Stage.TRACK)
    contact = tracking or found
    estimate = found.order.source_ned_m if found else None
    truth = source_ned_m if math.isfinite(source_ned_m[0]) else None
    closest = closest_approach(tracks)
    clearance = obstacle_clearance(tracks, fleet.obstacles)
    homes = {v.id: (v.home_north_m, v.home_east_m) for v in fleet.vehicles}
    drones = tuple(_drone(d, tracks.get(d), homes[d], d in ending.alive) for d in sorted(homes))
    simulated_s = max((float(t.time_s[-1]) for t in tracks.values() if t.airborne.any()), default=0.0)
    return Summary(
        outcome=ending.outcome,
        reason=ending.reason,
        name=name,
        drones=len(homes),
        alive=sum(d.agent_alive and not d.crashed for d in drones),
        time_to_contact_s=_rounded(contact.time_s if contact else None, 1),
        time_to_source_s=_rounded(found.time_s if found else None, 1),
        source_error_m=_rounded(
            math.hypot(estimate[0] - truth[0], estimate[1] - truth[1]) if estimate and truth else None, 2
        ),
        source_sd_m=_rounded(found.order.source_sd_m if found else None, 2),
        source_estimate_ned_m=estimate,
        source_true_ned_m=truth,
        min_separation_m=_rounded(closest.distance_m if closest else None, 2),
        min_separation_pair=closest.pair if closest else None,
        min_separation_at_s=_rounded(closest.time_s if closest else None, 1),
        configured_separation_m=separation_m,
        fence_breaches=fence_breaches(tracks, LocalFrame(fleet.origin), geofence),
        min_clearance_m=_rounded(clearance.nearest_m, 2),
        obstacles_touched=clearance.touches,
        heals=log.heals,
        healings=_rounded_times(healings(log, failures(log, ending.kills.items(), ending.freezes), layout)),
        rejoined=_rounded_times(rejoins(log, ending.freezes)),
        kills={drone: round(at_s, 1) for drone, at_s in ending.kills.items()},
        freezes=tuple(Freeze(f.drone, round(f.at_s, 1), _rounded(f.until_s, 1)) for f in ending.freezes),
        orphans=_orphans(tracks, homes, ending, log),
        lost_processes=ending.lost_processes,
        missed_deadline_fraction=round(log.late_ticks / max(log.ticks, 1), 5),
        per_drone=drones,
        simulated_s=round(simulated_s, 1),
        wall_s=round(ending.wall_s, 1),
        speedup=fleet.speedup,
        speedup_reached=_rounded(ending.speedup_reached, 2),
        seed=fleet.seed,
        radio=ending.radio,
        encrypted=ending.encrypted,
        log_dir=ending.log_dir,
        warnings=(
            *ending.warnings,
            *(
                f"the {fault.kind.replace('_', ' ')} of drone {fault.drone} at {fault.at_s:g} s did not happen: "
                f"the survey had ended"
                for fault in fleet.faults
                if fault.at_s >= simulated_s
            ),
        ),
    )


def _rounded_times(found: tuple[T, ...]) -> tuple[T, ...]:
    """The same with all times (`…_s`) rounded to what the launcher can tell apart."""
    return tuple(
        msgspec.structs.replace(
            one, **{n: _rounded(getattr(one, n), 1) for n in one.__struct_fields__ if n.endswith("_s")}
        )
        for one in found
    )


def write(summary: Summary, directory: pathlib.Path) -> None:
    """Write `summary.json`."""
    text = msgspec.json.format(msgspec.json.encode(summary), indent=2)
    (directory / "summary.json").write_bytes(text + b"\n")


class Approach(msgspec.Struct, frozen=True):
    distance_m: float
    pair: tuple[int, int]
    time_s: float


def closest_approach(tracks: Mapping[int, VehicleTrack]) -> Approach | None:
    """The nearest that two flying vehicles came; between two samples each is taken to fly straight on."""
    best: Approach | None = None
    drones = sorted(tracks)
    for i, a in enumerate(drones):
        for b in drones[i + 1 :]:
            near = _pair_approach(tracks[a], tracks[b])
            if near is not None and (best is None or near[0] < best.distance_m):
                best = Approach(near[0], (a, b), near[1])
    return best


def _pair_approach(a: VehicleTrack, b: VehicleTrack) -> tuple[float, float] | None:
    """(distance_m, time_s) of the closest approach of two flying vehicles; None if they never flew together."""
    # The record has both at the same moments, in hundredths of a second.
    moments_a, moments_b = np.rint(a.time_s * 100.0).astype(int), np.rint(b.time_s * 100.0).astype(int)
    moments, at_a, at_b = np.intersect1d(moments_a, moments_b, return_indices=True)
    time_s = moments / 100.0
    flying = a.airborne[at_a] & b.airborne[at_b]
    if not flying.any():
        return None
    apart = a.position_ned_m[at_a] - b.position_ned_m[at_b]
    # Relative motion from each sample to the next, where the next is near enough and both still fly.
    step = np.zeros_like(apart)
    follows = flying[:-1] & flying[1:] & (np.diff(time_s) <= LONGEST_STEP_S)
    step[:-1][follows] = (apart[1:] - apart[:-1])[follows]
    speed2 = np.einsum("ij,ij->i", step, step)
    share = np.clip(-np.einsum("ij,ij->i", apart, step) / np.where(speed2 > 0.0, speed2, 1.0), 0.0, 1.0)
    distance_m = np.where(flying, np.linalg.norm(apart + share[:, None] * step, axis=1), np.inf)
    nearest = int(np.argmin(distance_m))
    return float(distance_m[nearest]), float(time_s[nearest])


class Clearance(msgspec.Struct, frozen=True):
    nearest_m: float
    touches: int


def obstacle_clearance(tracks: Mapping[int, VehicleTrack], obstacles: Sequence[Obstacle]) -> Clearance:
    """How near flying vehicles came to obstacles; one that touches must come clear before it can touch again."""
    if not obstacles:
        return Clearance(math.inf, 0)
    standing = Obstacles(obstacles)
    nearest_m, touches = math.inf, 0
    for track in tracks.values():
        clearances_m = standing.clearances_m(track.position_ned_m[track.airborne])
        near = clearances_m < TOUCHES_M
        nearest_m = min(nearest_m, float(np.min(clearances_m, initial=math.inf)))
        touches += int(near[:1].sum()) + int((near[1:] & ~near[:-1]).sum())
    return Clearance(nearest_m, touches)


def fence_breaches(tracks: Mapping[int, VehicleTrack], frame: LocalFrame, geofence: Geofence | None) -> int:
    """How often a flying vehicle left the fence; it must come well inside before it can leave it again."""
    if geofence is None:
        return 0
    area = LocalFence(frame, geofence).area
    count = 0
    for track in tracks.values():
        points = shapely.points(track.position_ned_m[:, :2])
        inside = shapely.intersects(area, points)
        clearance_m = np.where(inside, 1.0, -1.0) * shapely.distance(area.boundary, points)
        outside = False
        for clear_m, flies in zip(clearance_m.tolist(), track.airborne.tolist(), strict=True):
            if flies and not outside and clear_m < 0.0:
                outside = True
                count += 1
            elif outside and clear_m > FENCE_TOLERANCE_M:
                outside = False
    return count


def _drone(
    drone: int, track: VehicleTrack | None, home_m: tuple[float, float], agent_alive: bool
) -> DroneSummary:
    if track is None:
        return DroneSummary(drone, agent_alive, True, False, None, 0.0, "", None, None)
    measured = track.co2_ppm[np.isfinite(track.co2_ppm) & track.airborne]
    return DroneSummary(
        drone,
        agent_alive,
        not bool(track.airborne[-1]),
        _crashed(track),
        _rounded(_from_home_m(track, home_m), 2),
        round(float(track.airborne.sum()) * STEP_S, 1),
        track.modes[-1],
        _rounded(float(track.battery_fraction[-1]), 3),
        _rounded(float(measured.max()) if measured.size else None, 1),
    )


def _crashed(track: VehicleTrack) -> bool:
    """Whether it ever met the ground at speed: the sink rate over the samples just before each touch-down."""
    touches = np.flatnonzero(track.airborne[:-1] & ~track.airborne[1:]) + 1
    for touch in touches.tolist():
        before = max(0, touch - 3)
        span_s = float(track.time_s[touch - 1] - track.time_s[before])
        if span_s > 0.0:
            sink_m = float(track.position_ned_m[touch - 1, 2] - track.position_ned_m[before, 2])
            if sink_m / span_s > HARD_LANDING_MPS:
                return True
    return False


def _orphans(
    tracks: Mapping[int, VehicleTrack], homes: Mapping[int, tuple[float, float]], ending: Ending, log: Log
) -> tuple[Orphan, ...]:
    found = []
    for drone, track in tracks.items():
        if drone in ending.alive:
            continue
        died_s = ending.kills.get(drone)
        if died_s is None:
            died_s = next(
                (e.time_s for e in log.events if e.code == "process" and f"drone-{drone} " in e.text), None
            )
        if died_s is None:
            died_s = next((f.at_s for f in ending.freezes if f.drone == drone and f.until_s is None), None)
        if died_s is None:
            continue
        after = np.flatnonzero(track.time_s >= died_s)
        if not after.size or not track.airborne[after[0]]:
            continue
        commanded = any(
            e.code == "bring_home" and e.drone == drone and e.time_s >= died_s for e in log.events
        )
        found.append(
            _orphan(drone, track, after, died_s, homes[drone], drone in ending.kills, commanded=commanded)
        )
    return tuple(found)


def _orphan(
    drone: int,
    track: VehicleTrack,
    after: np.ndarray[tuple[int, ...], np.dtype[np.intp]],
    died_s: float,
    home_m: tuple[float, float],
    killed: bool,
    *,
    commanded: bool,
) -> Orphan:
    modes = [track.modes[int(after[0])]]
    changed_s: float | None = None
    for index in after[track.airborne[after]]:  # on the ground PX4 goes back to the mode that it was left in
        if track.modes[index] != modes[-1]:
            modes.append(track.modes[index])
            if changed_s is None:
                changed_s = float(track.time_s[index]) - died_s
    down = after[~track.airborne[after]]
    landed_s = float(track.time_s[down[0]]) if down.size and not track.airborne[-1] else None
    distance_m = _from_home_m(track, home_m)
    by = "" if changed_s is None else "ground station" if commanded else "autopilot"
    if landed_s is None:
        story = f"still flying at the end in {modes[-1]}, {distance_m:.1f} m from its home"
    elif changed_s is None:
        story = f"came down in {modes[-1]} after {landed_s - died_s:.0f} s, {distance_m:.1f} m from its home"
    else:
        story = (
            f"flew on in {modes[0]} for {changed_s:.1f} s, then {' > '.join(modes[1:])} "
            f"({'sent by the ground station' if commanded else 'its autopilot by itself'}); "
            f"landed {landed_s - died_s:.0f} s after its agent's last word, {distance_m:.1f} m from its home"
        )
    return Orphan(
        drone,
        round(died_s, 1) if killed else None,
        by,
        " > ".join(modes),
        _rounded(changed_s, 1),
        _rounded(landed_s, 1),
        round(distance_m, 2),
        story,
    )


def _from_home_m(track: VehicleTrack, home_m: tuple[float, float]) -> float:
    north_m, east_m, _ = track.last_ned_m
    return math.hypot(north_m - home_m[0], east_m - home_m[1])


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None or not math.isfinite(value) else round(value, digits)
