"""A LoCUS swarm in a trial: the rules of `mission` (heirs, healing, gradient, spiral) around flown legs."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mission.geometry.formation import FloatArray, IntArray, rotated
from mission.strategies.locus.rule import (
    ANCHOR_E,
    ANCHOR_N,
    ROTATION,
    RULE_NUMBERS,
    STATE_SIZE,
    contacts,
    locus_begin,
    locus_next,
    turn,
)
from mission.tree.balanced_tree import next_heal, next_rebalance
from simvehicle.compiled import kernel
from simvehicle.trials.flight import (
    ARENA_M,
    HEAL_TICKS,
    HEALING_NOW,
    HEALS,
    LIMIT,
    LIMIT_FACTOR,
    MOVES,
    NOW,
    WAYPOINTS,
    Drones,
    Scene,
    fly_leg,
    read_at,
)
from simvehicle.trials.motion import X, Y, straight_ticks
from simvehicle.trials.randomness import Stream, uniform

# Places in the numbers of a LoCUS swarm, after those of its rule.
HEALING, NOBODY, FIRST_TURN_RAD, DROP_M, LOCUS_NUMBERS = range(RULE_NUMBERS, RULE_NUMBERS + 5)
"""NOBODY: without healing nobody goes on once a drone is lost; else those do whom the root still reaches."""


class Slots(NamedTuple):
    """A formation's `SlotTable`, as kernels take it."""

    level: IntArray
    parent: IntArray
    offset_m: FloatArray
    child_start: IntArray
    child: IntArray


@kernel
def _aim(
    scene: Scene, drones: Drones, slots: Slots, slot: int, drone: int, x: float, y: float, turn_rad: float
) -> None:
    """Send `drone` to its slot of the formation that is anchored at (x, y)."""
    dx, dy = rotated((slots.offset_m[slot, 0], slots.offset_m[slot, 1]), turn_rad)
    most_m = LIMIT_FACTOR * scene.world[ARENA_M]
    drones.targets[drone, 0] = min(max(x + dx, -most_m), most_m)
    drones.targets[drone, 1] = min(max(y + dy, -most_m), most_m)


@kernel
def _clear(numbers: IntArray) -> None:
    for i in range(numbers.shape[0]):
        numbers[i] = 0


@kernel
def _connected(holder: IntArray, parent: IntArray, alive: IntArray, required: IntArray, nobody: bool) -> int:
    """Without healing: mark the drones that the root still reaches through living ones; how many go on.

    With `nobody`: none, once one that holds a slot is lost.
    """
    _clear(required)
    reached = 0
    for slot in range(holder.shape[0]):
        drone = holder[slot]
        if drone >= 0 and alive[drone] == 0 and nobody:
            return 0
        if drone < 0 or alive[drone] == 0:
            continue
        if slot == 0 or (holder[parent[slot]] >= 0 and required[holder[parent[slot]]] == 1):
            required[drone] = 1
            reached += 1
    return reached


@kernel
def _heal(
    scene: Scene,
    drones: Drones,
    labels: IntArray,
    slots: Slots,
    holder: IntArray,
    below: IntArray,
    required: IntArray,
    x: float,
    y: float,
    turn_rad: float,
    drop_ticks: int,
) -> bool:
    """Heal Outer-Level First and rebalance, one drone flying at a time: down, under the swarm, up.

    Drones that fail meanwhile are found between two flights. Returns whether the trial goes on.
    """
    begin = drones.tally[NOW]
    drones.tally[HEALING_NOW] = 1
    moved = False
    while True:
        for slot in range(holder.shape[0]):
            if holder[slot] >= 0 and drones.alive[holder[slot]] == 0:
                holder[slot] = -1
                moved = True
        source, target = next_heal(holder, slots.parent, slots.child_start, slots.child, below)
        if target < 0:
            source, target = next_rebalance(holder, slots.level)
        if target < 0:
            break
        moved = True
        drone = holder[source]
        _clear(required)
        required[drone] = 1
        goes_on = fly_leg(scene, drones, labels, required, drop_ticks)
        if goes_on and drones.alive[drone] == 1:
            _aim(scene, drones, slots, target, drone, x, y, turn_rad)
            goes_on = fly_leg(scene, drones, labels, required, 0)
        if goes_on and drones.alive[drone] == 1:
            goes_on = fly_leg(scene, drones, labels, required, drop_ticks)
        if not goes_on:
            return False
        if drones.alive[drone] == 1:
            holder[source] = -1
            holder[target] = drone
            drones.tally[MOVES] += 1
    drones.tally[HEALING_NOW] = 0
    members = 0
    _clear(required)
    for slot in range(holder.shape[0]):
        if holder[slot] >= 0:
            required[holder[slot]] = 1
            members += 1
    if moved and members > 0:
        drones.tally[HEALS] += 1
        drones.tally[HEAL_TICKS] += drones.tally[NOW] - begin
    return members > 0


@kernel
def fly_locus(
    scene: Scene,
    drones: Drones,
    labels: IntArray,
    slots: Slots,
    holder: IntArray,
    numbers: FloatArray,
    draws: Stream,
    centre_x: float,
    centre_y: float,
) -> None:
    """Fly a LoCUS swarm whose members hold the slots in `holder` until the trial ends.

    `holder` has an entry for every slot of the table. The swarm forms up about the centre, and searches from
    there: on the spiral, or as one body on golden spokes.
    """
    count = drones.alive.shape[0]
    below = np.zeros(holder.shape[0], np.int64)
    required = np.ones(count, np.int64)
    window_x = np.zeros(2 * count)
    window_y = np.zeros(2 * count)
    window = np.zeros(2 * count)
    exact = np.zeros(2 * count)
    contact = np.zeros(2 * count)
    weight = np.zeros(2 * count)
    filled = 0
    state = np.zeros(STATE_SIZE)
    bearing_rad = 2.0 * math.pi * uniform(draws)
    locus_begin(state, centre_x, centre_y, numbers[FIRST_TURN_RAD] * uniform(draws), bearing_rad)
    drop_ticks = straight_ticks(scene.motion, numbers[DROP_M], scene.powers, drones.work)
    while True:
        x, y, turn_rad = state[ANCHOR_N], state[ANCHOR_E], state[ROTATION]
        for slot in range(holder.shape[0]):
            if holder[slot] >= 0 and required[holder[slot]] == 1:
                _aim(scene, drones, slots, slot, holder[slot], x, y, turn_rad)
        if not fly_leg(scene, drones, labels, required, 0):
            return
        drones.tally[WAYPOINTS] += 1
        if numbers[HEALING] > 0.0:
            if not _heal(scene, drones, labels, slots, holder, below, required, x, y, turn_rad, drop_ticks):
                return
            members = 0
            for i in range(count):
                members += required[i]
        else:
            members = _connected(holder, slots.parent, drones.alive, required, numbers[NOBODY] > 0.0)
        if members == 0:
            # The root has failed (or with NOBODY anybody) and nobody takes its place: no drone gets another waypoint.
            drones.tally[NOW] = drones.tally[LIMIT]
            return
        # The window: the readings of this waypoint and of the one before, 2 x swarm size of them at most.
        keep = min(filled, members)
        for k in range(keep):
            window_x[k] = window_x[filled - keep + k]
            window_y[k] = window_y[filled - keep + k]
            window[k] = window[filled - keep + k]
        filled = keep
        for slot in range(holder.shape[0]):
            drone = holder[slot]
            if drone >= 0 and required[drone] == 1:
                window_x[filled] = drones.rows[drone, X]
                window_y[filled] = drones.rows[drone, Y]
                window[filled] = read_at(scene, drones.rows[drone], drones.tally[NOW])
                filled += 1
        draw_x, draw_y, draw_turn = uniform(draws), uniform(draws), uniform(draws)
        some = contacts(numbers, window, exact, filled, contact, weight)
        if locus_next(
            state,
            numbers,
            window_x,
            window_y,
            contact,
            exact,
            weight,
            filled,
            filled - keep,
            some,
            0.0,
            0.0,
            draw_x,
            draw_y,
        ):
            turn(state, numbers, draw_turn)
