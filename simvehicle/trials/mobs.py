"""MoBS drones in a trial: each alone, by the rule of `mission.strategies.mobs`."""

from __future__ import annotations

import math

import numpy as np

from mission.strategies.mobs import STATE_SIZE, mobs_begin, mobs_next
from simvehicle.compiled import kernel
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


@kernel
def fly_mobs(
    scene: Scene,
    drones: Drones,
    drone: int,
    label: int,
    draws: Stream,
    step_m: float,
    until: int,
    until_contact: bool,
) -> tuple[int, int]:
    """Fly one drone from tick 0 until `until`, its success, its failure or (with `until_contact`) its contact.

    Returns the ticks of its first contact and of its success (NEVER); `drones.ends` gets that of its failure.
    """
    row = drones.rows[drone]
    state = np.zeros(STATE_SIZE)
    mobs_begin(state, 2.0 * math.pi * uniform(draws))
    most_m = LIMIT_FACTOR * scene.world[ARENA_M]
    drones.targets[drone] = 0.0  # the first spoke begins at the centre
    drones.ends[drone] = NEVER
    now = 0
    contact = NEVER
    while now < until:
        tx, ty = drones.targets[drone, 0], drones.targets[drone, 1]
        ticks = min(leg_ticks(scene.motion, row, tx, ty, scene.powers, drones.work), until - now)
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
        record(drones, drone, label, now, ticks, 0)
        fly(scene.motion, row, tx, ty, ticks, scene.powers)
        now += ticks
        if success <= ticks:
            return contact, now
        if failure <= ticks:
            freeze(row)
            drones.ends[drone] = now
            return contact, NEVER
        if until_contact and contact < NEVER:
            return contact, NEVER
        if now < until:
            value = read_at(scene, row, now)
            x, y = mobs_next(state, row[X], row[Y], value, scene.world[ARENA_M], step_m, uniform(draws))
            drones.targets[drone, 0] = min(max(x, -most_m), most_m)
            drones.targets[drone, 1] = min(max(y, -most_m), most_m)
    return contact, NEVER
