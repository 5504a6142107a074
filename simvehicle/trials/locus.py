"""A LoCUS swarm in a trial: the rules of `mission` (heirs, healing, gradient, spiral) around flown legs."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mission.geometry.formation import FloatArray, IntArray, rotated
from mission.strategies.locus.gradient import plane_gradient, waypoint_uphill
from mission.strategies.locus.spiral import spiral_point
from mission.strategies.mobs import STATE_SIZE, mobs_begin, mobs_next
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

# Places in the numbers of a LoCUS swarm.
(
    HEALING,
    STEP_M,
    JITTER_M,
    FIRST_TURN_RAD,
    TURN_RAD,
    ARMS_M,
    DROP_M,
    SPOKES,
    SPOKE_STEP_M,
    LOCUS_NUMBERS,
) = range(10)

_LEAST_EXTENT_M = 1e-6
"""Readings that are nearer together than this were taken at one point."""


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
def _connected(holder: IntArray, parent: IntArray, alive: IntArray, required: IntArray) -> int:
    """Without healing: mark the drones that the root still reaches through living ones; how many they are."""
    _clear(required)
    reached = 0
    for slot in range(holder.shape[0]):
        drone = holder[slot]
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
    weight = np.ones(2 * count)
    filled = 0
    spoke = np.zeros(STATE_SIZE)
    mobs_begin(spoke, 2.0 * math.pi * uniform(draws))
    turn_rad = numbers[FIRST_TURN_RAD] * uniform(draws)
    drop_ticks = straight_ticks(scene.motion, numbers[DROP_M], scene.powers, drones.work)
    x, y = centre_x, centre_y
    index = 0
    while True:
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
            members = _connected(holder, slots.parent, drones.alive, required)
        if members == 0:
            # The root has failed and nobody takes its place: no drone will get another waypoint.
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
        slope_x, slope_y, _ = plane_gradient(window_x, window_y, window, weight, filled, _LEAST_EXTENT_M)
        jitter_x = numbers[JITTER_M] * (2.0 * uniform(draws) - 1.0)
        jitter_y = numbers[JITTER_M] * (2.0 * uniform(draws) - 1.0)
        more_rad = numbers[TURN_RAD] * uniform(draws)
        uphill, x, y = waypoint_uphill(slope_x, slope_y, x, y, numbers[STEP_M], jitter_x, jitter_y)
        if uphill:
            turn_rad += more_rad
        else:
            index += 1
            if numbers[SPOKES] > 0.0:
                dx, dy = mobs_next(spoke, 0.0, 0.0, 0.0, scene.world[ARENA_M], numbers[SPOKE_STEP_M], 0.0)
            else:
                dx, dy = spiral_point(index, numbers[ARMS_M], False)
            x, y = centre_x + dx, centre_y + dy
