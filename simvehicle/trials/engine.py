"""Many trials of one kind, compiled: set up from (seed, trial), flown by one of the strategies."""

from __future__ import annotations

import math

import numpy as np

from mission.geometry.formation import FloatArray, IntArray
from mission.strategies.locus.groups import group_begin, group_count
from mission.strategies.locus.seats import nearest_first
from mission.strategies.mobs import STATE_SIZE, mobs_begin
from mission.strategies.mobs_authors import AUTHORS_STATE_SIZE, mobs_authors_begin
from simvehicle.compiled import compiled, kernel
from simvehicle.trials.flight import (
    CONTACT,
    CONTACT_DRONE,
    FOUND,
    HEAL_TICKS,
    HEALS,
    LEGS,
    LIMIT,
    MOVES,
    NEVER,
    NOW,
    ORIGIN_X,
    ORIGIN_Y,
    SUCCESS,
    SURVIVORS,
    TALLY,
    WAYPOINTS,
    Drones,
    Scene,
)
from simvehicle.trials.locus import Slots, fly_locus
from simvehicle.trials.mobs import fly_mobs, fly_mobs_authors
from simvehicle.trials.motion import ROW, X, Y
from simvehicle.trials.randomness import DECISIONS, OWN, Stream, open_stream, uniform
from simvehicle.trials.start import GROUP, MOBS_STEP_M, drone_start, prepare_world

_FIRST_PAUSE = 256
_SHARE = 4
"""Drones on their own are compared after 256 ticks, and whenever a quarter more have passed."""


@kernel
def new_drones(count: int, limit: int, legs: FloatArray) -> Drones:
    tally = np.zeros(TALLY, np.int64)
    tally[LIMIT] = limit
    tally[CONTACT] = NEVER
    tally[CONTACT_DRONE] = -1
    tally[SUCCESS] = NEVER
    return Drones(
        np.zeros((count, ROW)),
        np.zeros((count, 2)),
        np.ones(count, np.int64),
        np.full(count, NEVER),
        np.zeros(count),
        np.ones(count),
        np.zeros((count, ROW)),
        np.zeros(count, np.int64),
        np.full(count, NEVER),
        tally,
        legs,
        np.zeros(ROW),
        np.zeros(FOUND, np.int64),
    )


@kernel
def prepare_drones(drones: Drones, first: int, setup: FloatArray, seed: int, trial: int) -> None:
    """Where drones `first`, `first` + 1, ... start, and when their time runs out."""
    for i in range(drones.alive.shape[0]):
        for place in range(ROW):
            drones.rows[i, place] = 0.0
        drones.survival[i] = 1.0
        drones.rows[i, X], drones.rows[i, Y], drones.fails[i], drones.limits[i] = drone_start(
            setup, seed, trial, first + i
        )


@kernel
def _count(tally: IntArray, drone: int, contact: int, success: int) -> None:
    """What one drone on its own came to."""
    if contact < tally[CONTACT]:
        tally[CONTACT] = contact
        tally[CONTACT_DRONE] = drone
    tally[SUCCESS] = min(tally[SUCCESS], success)


@kernel
def _set_out(drones: Drones, streams: Stream, seed: int, trial: int) -> None:
    """All drones on their own: each has its own stream, and its first leg leads to the centre."""
    for i in range(drones.alive.shape[0]):
        open_stream(streams[i : i + 1], seed, trial, OWN + i)
        drones.targets[i] = 0.0
        drones.begun[i] = 0
        drones.ends[i] = NEVER


@kernel
def _later(pause: int) -> int:
    """When drones on their own are next compared. One after another, none is flown far beyond another's success."""
    return pause + max(pause // _SHARE, _FIRST_PAUSE)


@kernel
def _mobs_all(
    scene: Scene, drones: Drones, setup: FloatArray, seed: int, trial: int, until: int, until_contact: bool
) -> None:
    """All drones on their own, up to the first success (or the first contact) of any of them."""
    count = drones.alive.shape[0]
    tally = drones.tally
    streams = np.zeros(count, np.uint64)
    states = np.zeros((count, STATE_SIZE))
    contacts = np.full(count, NEVER)
    _set_out(drones, streams, seed, trial)
    for i in range(count):
        mobs_begin(states[i], 2.0 * math.pi * uniform(streams[i : i + 1]))
    pause = 0
    while pause < until:
        pause = _later(pause)
        for i in range(count):
            if drones.ends[i] < NEVER:
                continue
            contacts[i], success = fly_mobs(
                scene,
                drones,
                i,
                states[i],
                streams[i : i + 1],
                setup[MOBS_STEP_M],
                contacts[i],
                pause,
                until,
                until_contact,
            )
            _count(tally, i, contacts[i], success)
            until = min(until, success)
            if until_contact:
                until = min(until, contacts[i])


@kernel
def mobs_authors_all(
    scene: Scene,
    drones: Drones,
    setup: FloatArray,
    seed: int,
    trial: int,
    until: int,
    bearings_rad: FloatArray,
) -> None:
    """The same by the authors' rule, up to the first success; NaN: the first bearing is drawn."""
    count = drones.alive.shape[0]
    streams = np.zeros(count, np.uint64)
    states = np.zeros((count, AUTHORS_STATE_SIZE))
    contacts = np.full(count, NEVER)
    _set_out(drones, streams, seed, trial)
    for i in range(count):
        drawn_rad = 2.0 * math.pi * uniform(streams[i : i + 1])
        mobs_authors_begin(states[i], drawn_rad if math.isnan(bearings_rad[i]) else bearings_rad[i])
    pause = 0
    while pause < until:
        pause = _later(pause)
        for i in range(count):
            if drones.ends[i] < NEVER:
                continue
            contacts[i], success = fly_mobs_authors(
                scene,
                drones,
                i,
                states[i],
                streams[i : i + 1],
                setup[MOBS_STEP_M],
                contacts[i],
                pause,
                until,
            )
            _count(drones.tally, i, contacts[i], success)
            until = min(until, success)


@kernel
def _settle_mobs(drones: Drones, until: int) -> None:
    """After `_mobs_all`: the time, and who is still alive at it."""
    last = 0
    everybody = True
    for i in range(drones.alive.shape[0]):
        drones.alive[i] = 0 if drones.ends[i] <= until else 1
        if drones.alive[i] == 1:
            everybody = False
        else:
            last = max(last, drones.ends[i])
    drones.tally[NOW] = last if everybody else until
    if drones.tally[CONTACT] > drones.tally[NOW]:
        drones.tally[CONTACT] = NEVER  # a drone's that was flown on beyond another's success


@kernel
def _hybrid(
    scene: Scene,
    drones: Drones,
    labels: IntArray,
    slots: Slots,
    numbers: FloatArray,
    setup: FloatArray,
    seed: int,
    trial: int,
) -> None:
    """Golden spokes, each drone alone, until the first contact; then LoCUS around the drone that made it.

    The call reaches everybody at once (a long-range radio; the formation's own needs none). Who is nearest
    takes the innermost free slot.
    """
    count = drones.alive.shape[0]
    limit = drones.tally[LIMIT]
    _mobs_all(scene, drones, setup, seed, trial, limit, True)
    contact = min(drones.tally[CONTACT], drones.tally[SUCCESS])
    if drones.tally[SUCCESS] < NEVER or contact >= limit:
        _settle_mobs(drones, min(limit, contact))
        return
    # Everybody again, exactly up to the tick of the contact.
    caller = drones.tally[CONTACT_DRONE]
    prepare_drones(drones, 0, setup, seed, trial)
    drones.tally[CONTACT] = NEVER
    drones.tally[LEGS] = 0
    _mobs_all(scene, drones, setup, seed, trial, contact, False)
    drones.tally[CONTACT] = contact
    drones.tally[CONTACT_DRONE] = caller
    _settle_mobs(drones, contact)
    holder = np.full(count, -1, np.int64)
    placed = np.zeros(count, np.int64)
    x, y = drones.rows[caller, X], drones.rows[caller, Y]
    nearest_first(drones.rows[:, X], drones.rows[:, Y], drones.alive, x, y, placed, holder)
    if holder[0] < 0:
        return
    stream = np.zeros(1, np.uint64)
    open_stream(stream, seed, trial, DECISIONS)
    fly_locus(scene, drones, labels, slots, holder, numbers, stream, x, y)


@kernel
def _multi(
    scene: Scene,
    drones: Drones,
    slots: Slots,
    numbers: FloatArray,
    setup: FloatArray,
    seed: int,
    trial: int,
) -> None:
    """Several sub-swarms of about GROUP drones, each a LoCUS swarm of its own on golden spokes of its own."""
    count = drones.alive.shape[0]
    groups = group_count(count, int(setup[GROUP]))
    total = drones.tally
    limit = total[LIMIT]
    stream = np.zeros(1, np.uint64)
    # The first round finds when the trial ends, the second flies everybody exactly until then.
    for last_round in range(2):
        if last_round == 1:
            limit = min(limit, total[SUCCESS])
            total[CONTACT] = NEVER
        total[NOW] = 0
        for group in range(groups):
            first = group_begin(group, groups, count)
            members = group_begin(group + 1, groups, count) - first
            part = new_drones(members, limit, drones.legs if last_round == 1 else drones.legs[:0])
            part.tally[LEGS] = total[LEGS] if last_round == 1 else 0
            prepare_drones(part, first, setup, seed, trial)
            open_stream(stream, seed, trial, OWN + group)
            labels = np.arange(first, first + members)
            holder = np.full(slots.level.shape[0], -1, np.int64)
            for slot in range(members):
                holder[slot] = slot
            fly_locus(scene, part, labels, slots, holder, numbers, stream, 0.0, 0.0)
            total[NOW] = max(total[NOW], part.tally[NOW])
            total[SUCCESS] = min(total[SUCCESS], part.tally[SUCCESS])
            if part.tally[CONTACT] < total[CONTACT]:
                total[CONTACT] = part.tally[CONTACT]
                total[CONTACT_DRONE] = first + part.tally[CONTACT_DRONE]
            if last_round == 1:
                total[LEGS] = part.tally[LEGS]
                for place in (HEALS, MOVES, HEAL_TICKS, WAYPOINTS):
                    total[place] += part.tally[place]
                for i in range(members):
                    drones.alive[first + i] = part.alive[i]


@kernel
def _note(scene: Scene, drones: Drones, result: IntArray, origin: FloatArray) -> None:
    """The outcome of a trial: its tally, how many survived, and where the plume's origin was."""
    for place in range(TALLY):
        result[place] = drones.tally[place]
    result[SURVIVORS] = 0
    for i in range(drones.alive.shape[0]):
        result[SURVIVORS] += drones.alive[i]
    origin[0] = scene.world[ORIGIN_X]
    origin[1] = scene.world[ORIGIN_Y]


@kernel
def _begin(
    scene: Scene, setup: FloatArray, count: int, seed: int, trial: int, limit: int, legs: FloatArray
) -> Drones:
    """The world and the drones of one trial."""
    drones = new_drones(count, limit, legs)
    prepare_world(scene, setup, seed, trial)
    prepare_drones(drones, 0, setup, seed, trial)
    return drones


# One entry a strategy, so that only what is asked for gets compiled. Each flies trials `first`, `first` + 1, ...
# of `count` drones, and fills one row of `results` and `origins` a trial.


@compiled
def run_locus(
    scene: Scene,
    slots: Slots,
    numbers: FloatArray,
    setup: FloatArray,
    count: int,
    seed: int,
    first: int,
    limit: int,
    legs: FloatArray,
    results: IntArray,
    origins: FloatArray,
) -> None:
    draws = np.zeros(1, np.uint64)
    for row in range(results.shape[0]):
        drones = _begin(scene, setup, count, seed, first + row, limit, legs)
        open_stream(draws, seed, first + row, DECISIONS)
        fly_locus(scene, drones, np.arange(count), slots, np.arange(count), numbers, draws, 0.0, 0.0)
        _note(scene, drones, results[row], origins[row])


@compiled
def run_mobs(
    scene: Scene,
    slots: Slots,  # noqa: ARG001 (one signature for all)
    numbers: FloatArray,  # noqa: ARG001
    setup: FloatArray,
    count: int,
    seed: int,
    first: int,
    limit: int,
    legs: FloatArray,
    results: IntArray,
    origins: FloatArray,
) -> None:
    for row in range(results.shape[0]):
        drones = _begin(scene, setup, count, seed, first + row, limit, legs)
        _mobs_all(scene, drones, setup, seed, first + row, limit, False)
        _settle_mobs(drones, min(limit, drones.tally[SUCCESS]))
        _note(scene, drones, results[row], origins[row])


@compiled
def run_mobs_authors(
    scene: Scene,
    slots: Slots,  # noqa: ARG001
    numbers: FloatArray,  # noqa: ARG001
    setup: FloatArray,
    count: int,
    seed: int,
    first: int,
    limit: int,
    legs: FloatArray,
    results: IntArray,
    origins: FloatArray,
) -> None:
    for row in range(results.shape[0]):
        drones = _begin(scene, setup, count, seed, first + row, limit, legs)
        mobs_authors_all(scene, drones, setup, seed, first + row, limit, np.full(count, np.nan))
        _settle_mobs(drones, min(limit, drones.tally[SUCCESS]))
        _note(scene, drones, results[row], origins[row])


@compiled
def run_hybrid(
    scene: Scene,
    slots: Slots,
    numbers: FloatArray,
    setup: FloatArray,
    count: int,
    seed: int,
    first: int,
    limit: int,
    legs: FloatArray,
    results: IntArray,
    origins: FloatArray,
) -> None:
    for row in range(results.shape[0]):
        drones = _begin(scene, setup, count, seed, first + row, limit, legs)
        _hybrid(scene, drones, np.arange(count), slots, numbers, setup, seed, first + row)
        _note(scene, drones, results[row], origins[row])


@compiled
def run_multi(
    scene: Scene,
    slots: Slots,
    numbers: FloatArray,
    setup: FloatArray,
    count: int,
    seed: int,
    first: int,
    limit: int,
    legs: FloatArray,
    results: IntArray,
    origins: FloatArray,
) -> None:
    for row in range(results.shape[0]):
        drones = _begin(scene, setup, count, seed, first + row, limit, legs)
        _multi(scene, drones, slots, numbers, setup, seed, first + row)
        _note(scene, drones, results[row], origins[row])


RUNS = {
    "locus": run_locus,
    "mobs": run_mobs,
    "mobs-authors": run_mobs_authors,
    "locus-hybrid": run_hybrid,
    "locus-multi": run_multi,
}
"""Strategy -> entry."""
