"""MoBS drones in a trial: each alone, by the rule of `mission.strategies.mobs` or of `mobs_authors`."""

from __future__ import annotations

from mission.geometry.formation import FloatArray
from mission.strategies.mobs import mobs_next
from mission.strategies.mobs_authors import (
    DECISION,
    PHASE,
    TURNED,
    WAIT,
    mobs_authors_next,
)
from simvehicle.compiled import kernel, leaf
from simvehicle.trials.flight import (
    ARENA_M,
    FAILURE,
    FIRST_CONTACT,
    FIRST_SUCCESS,
    IN_PLUME_RATE,
    LIMIT_FACTOR,
    NEVER,
    Drones,
    Scene,
    passes_plume,
    passes_source,
    read_at,
    record,
    walk,
)
from simvehicle.trials.motion import X, Y, fly, freeze, leg_ticks
from simvehicle.trials.randomness import Stream, uniform


@leaf
def _leg(
    scene: Scene,
    drones: Drones,
    drone: int,
    now: int,
    ticks: int,
    contact: int,
    until_contact: bool,
) -> tuple[int, int, int]:
    """Fly one drone `ticks` ticks of its leg, less if it succeeds, fails or (with `until_contact`) makes contact.

    Returns the time now and the ticks of its first contact (`contact` if it had that before) and of its success
    (NEVER); `drones.ends` gets that of its failure.
    """
    row = drones.rows[drone]
    tx, ty = drones.targets[drone, 0], drones.targets[drone, 1]
    failure = max(drones.fails[drone] - now, 1)
    success = NEVER
    in_plume = passes_plume(scene, row, tx, ty)
    wanted = in_plume and (contact == NEVER or scene.world[IN_PLUME_RATE] > 0.0)
    if wanted or passes_source(scene, row, tx, ty):
        drones.survival[drone] = walk(
            scene,
            row,
            tx,
            ty,
            now,
            min(ticks, failure - 1),
            drones.survival[drone],
            drones.limits[drone],
            contact == NEVER,
            drones.work,
            drones.found,
        )
        failure = min(failure, drones.found[FAILURE])
        if contact == NEVER and drones.found[FIRST_CONTACT] < NEVER:
            contact = now + drones.found[FIRST_CONTACT]
            if until_contact:
                ticks = drones.found[FIRST_CONTACT]
        success = drones.found[FIRST_SUCCESS]
    ticks = min(ticks, failure, success)
    record(drones, drone, drone, now, ticks, 0)
    fly(scene.motion, row, tx, ty, ticks, scene.powers)
    now += ticks
    if success <= ticks:
        return now, contact, now
    if failure <= ticks:
        freeze(row)
        drones.ends[drone] = now
    return now, contact, NEVER


@leaf
def _aim(scene: Scene, targets: FloatArray, drone: int, x: float, y: float) -> None:
    most_m = LIMIT_FACTOR * scene.world[ARENA_M]
    targets[drone, 0] = min(max(x, -most_m), most_m)
    targets[drone, 1] = min(max(y, -most_m), most_m)


@kernel
def fly_mobs(
    scene: Scene,
    drones: Drones,
    drone: int,
    state: FloatArray,
    draws: Stream,
    step_m: float,
    contact: int,
    pause: int,
    until: int,
    until_contact: bool,
) -> tuple[int, int]:
    """Fly one drone on, to the first leg's end at or after `pause`, its success, its failure or `until`.

    `contact`: the tick of its first contact before (NEVER), with `until_contact` another end. Returns the ticks of
    its first contact and of its success (NEVER). `drones.begun` is its time now, `drones.ends` the tick of its
    failure.
    """
    row = drones.rows[drone]
    now = drones.begun[drone]
    success = NEVER
    while now < min(pause, until):
        if now > 0:
            value = read_at(scene, row, now)
            x, y = mobs_next(state, row[X], row[Y], value, scene.world[ARENA_M], step_m, uniform(draws))
            _aim(scene, drones.targets, drone, x, y)
        ticks = leg_ticks(
            scene.motion, row, drones.targets[drone, 0], drones.targets[drone, 1], scene.powers, drones.work
        )
        ticks = min(ticks, until - now)
        now, contact, success = _leg(scene, drones, drone, now, ticks, contact, until_contact)
        if success < NEVER or drones.ends[drone] < NEVER or (until_contact and contact < NEVER):
            break
    drones.begun[drone] = now
    return contact, success


@kernel
def fly_mobs_authors(
    scene: Scene,
    drones: Drones,
    drone: int,
    state: FloatArray,
    draws: Stream,
    step_m: float,
    contact: int,
    pause: int,
    until: int,
) -> tuple[int, int]:
    """Like `fly_mobs`; the leg before the first contact ends with it, for the plume is tested at every tick."""
    row = drones.rows[drone]
    now = drones.begun[drone]
    success = NEVER
    while now < min(pause, until):
        before = now
        arrival = int(state[WAIT])
        if arrival == 0:
            arrival = leg_ticks(
                scene.motion,
                row,
                drones.targets[drone, 0],
                drones.targets[drone, 1],
                scene.powers,
                drones.work,
            )
        ticks = min(arrival, until - now)
        now, contact, success = _leg(scene, drones, drone, now, ticks, contact, state[TURNED] == 0.0)
        if success < NEVER or drones.ends[drone] < NEVER:
            break
        if now < until:
            draw_n, draw_e = 0.0, 0.0
            if state[PHASE] == DECISION:
                draw_n, draw_e = uniform(draws), uniform(draws)
            value = read_at(scene, row, now)
            ticks = now - before
            there = ticks == arrival
            x, y = mobs_authors_next(
                state,
                ticks,
                row[X],
                row[Y],
                value,
                there,
                scene.world[ARENA_M],
                step_m,
                draw_n,
                draw_e,
            )
            _aim(scene, drones.targets, drone, x, y)
    drones.begun[drone] = now
    return contact, success
