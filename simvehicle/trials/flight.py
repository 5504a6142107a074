"""One leg of several drones: who arrives when, who fails, who reads something first, who comes to the source.

Whatever can happen to a drone within a leg is found at its exact tick, but the ticks are only walked through
where something can happen: for a drone whose way passes the plume or the source.
"""

from __future__ import annotations

from typing import NamedTuple

from mission.geometry.formation import FloatArray, IntArray
from simvehicle.compiled import kernel, leaf
from simvehicle.trials.motion import (
    PD,
    ROW,
    TICKS_PER_S,
    VX,
    VY,
    X,
    Y,
    begin_leg,
    copy_row,
    first_inside,
    fly,
    freeze,
    pd_place,
    pd_tick,
)
from simvehicle.trials.plume import HIGH_X, HIGH_Y, LOW_X, LOW_Y, SOURCE_X, SOURCE_Y, reading

NEVER = 1 << 60

# Places in the numbers of a world.
ORIGIN_X, ORIGIN_Y, SUCCESS_M, IN_PLUME_RATE, IN_PLUME_DRAWS, ARENA_M, WORLD_NUMBERS = range(7)

# Places in the tally of a trial, all whole numbers; NEVER where a tick is not reached.
(
    NOW,
    LIMIT,
    CONTACT,
    CONTACT_DRONE,
    SUCCESS,
    HEALS,
    MOVES,
    HEAL_TICKS,
    WAYPOINTS,
    LEGS,
    HEALING_NOW,
    TALLY,
) = range(12)

SURVIVORS = TALLY
"""Column of the results after those of the tally."""

# Places in a recorded leg: drone, first tick, ticks, target, 1 where it is an heir's on its way to another slot,
# then the motion state at its beginning.
LEG_DRONE, LEG_START, LEG_TICKS, LEG_X, LEG_Y, LEG_HEIR, LEG_ROW = range(7)
LEG = LEG_ROW + ROW

# Places in what `walk` finds.
FAILURE, FIRST_CONTACT, FIRST_SUCCESS, FOUND = range(4)

LIMIT_FACTOR = 1.5
"""Drones stay within so many arena radii of the start, per axis (authors)."""
_BESIDE_M = 1.0
_BESIDE_S = 0.1
"""No leg leaves the rectangle between its ends by more than _BESIDE_M + _BESIDE_S * speed, by axis.

The controller is overdamped: a drone that is called away at full speed (`locus-hybrid` does it) runs on by less than
0.08 s * speed, and the kick of a new target adds 6.25 m/s, half a metre."""


class Scene(NamedTuple):
    """What does not change in a trial."""

    motion: FloatArray
    world: FloatArray
    plume: FloatArray
    grid: FloatArray
    powers: FloatArray


class Drones(NamedTuple):
    """What changes, one row or entry a drone."""

    rows: FloatArray
    """(n, ROW) motion states."""
    targets: FloatArray
    """(n, 2) metres north, east."""
    alive: IntArray
    fails: IntArray
    """The tick at which a drone fails of itself."""
    limits: FloatArray
    """It fails in the plume when its chance to have survived so far falls below this."""
    survival: FloatArray
    """That chance."""
    ahead: FloatArray
    """(n, ROW) scratch: the states from which the present leg's arrival is found."""
    begun: IntArray
    """Scratch: the ticks of the present leg at which those states are reached."""
    ends: IntArray
    """Scratch: ticks of the present leg to the drone's failure."""
    tally: IntArray
    legs: FloatArray
    """(m, LEG) record of the legs flown, for plots; m = 0 when nobody wants it."""
    work: FloatArray
    found: IntArray


@leaf
def read_at(scene: Scene, row: FloatArray, tick: int) -> float:
    """What a drone in state `row` reads at `tick`."""
    x = row[X] - scene.world[ORIGIN_X]
    y = row[Y] - scene.world[ORIGIN_Y]
    return reading(scene.plume, scene.grid, x, y, tick / TICKS_PER_S)


@leaf
def _passes(
    scene: Scene,
    row: FloatArray,
    tx: float,
    ty: float,
    low_x: float,
    high_x: float,
    low_y: float,
    high_y: float,
) -> bool:
    """Whether the way from `row` to the target may cross a rectangle that is given relative to the plume."""
    x = scene.world[ORIGIN_X]
    y = scene.world[ORIGIN_Y]
    beside_x = _BESIDE_M + _BESIDE_S * abs(row[VX])
    beside_y = _BESIDE_M + _BESIDE_S * abs(row[VY])
    return bool(
        max(row[X], tx) + beside_x >= x + low_x
        and min(row[X], tx) - beside_x <= x + high_x
        and max(row[Y], ty) + beside_y >= y + low_y
        and min(row[Y], ty) - beside_y <= y + high_y
    )


@leaf
def passes_plume(scene: Scene, row: FloatArray, tx: float, ty: float) -> bool:
    plume = scene.plume
    return _passes(scene, row, tx, ty, plume[LOW_X], plume[HIGH_X], plume[LOW_Y], plume[HIGH_Y])


@leaf
def passes_source(scene: Scene, row: FloatArray, tx: float, ty: float) -> bool:
    x, y, near = scene.plume[SOURCE_X], scene.plume[SOURCE_Y], scene.world[SUCCESS_M]
    return _passes(scene, row, tx, ty, x - near, x + near, y - near, y + near)


@kernel
def walk(
    scene: Scene,
    start: FloatArray,
    tx: float,
    ty: float,
    start_tick: int,
    ticks: int,
    survival: float,
    limit: float,
    want_contact: bool,
    work: FloatArray,
    found: IntArray,
) -> float:
    """Walk through `ticks` ticks of a leg; `found` gets the ticks of failure, first contact and success.

    Returns the chance to have survived the plume until the end. A drone that fails at a tick reads nothing and
    finds nothing there.
    """
    found[FAILURE] = NEVER
    first_contact = NEVER
    first_success = NEVER
    world, plume, grid = scene.world, scene.plume, scene.grid
    origin_x, origin_y = world[ORIGIN_X], world[ORIGIN_Y]
    draws = int(world[IN_PLUME_DRAWS])
    rate = world[IN_PLUME_RATE]
    near2 = world[SUCCESS_M] * world[SUCCESS_M]
    source_x = origin_x + plume[SOURCE_X]
    source_y = origin_y + plume[SOURCE_Y]
    copy_row(start, work)
    free = False
    begun = 0
    for k in range(1, ticks + 1):
        if scene.motion[0] == PD and not free:
            free = pd_tick(scene.motion, work, tx, ty)
            x, y = work[X], work[Y]
            begun = k
        elif scene.motion[0] == PD and k - begun < scene.powers.shape[0]:
            x, y = pd_place(work, tx, ty, scene.powers, k - begun)
        else:
            copy_row(start, work)
            fly(scene.motion, work, tx, ty, k, scene.powers)
            x, y = work[X], work[Y]
        if rate > 0.0 or (want_contact and first_contact == NEVER):
            value = reading(plume, grid, x - origin_x, y - origin_y, (start_tick + k) / TICKS_PER_S)
            if value > 0.0:
                if first_contact == NEVER:
                    first_contact = k
                kept = 1.0 - rate * value
                if kept < 0.0:
                    kept = 0.0
                for _ in range(draws):
                    survival *= kept
                if survival < limit:
                    # Its contact was at an earlier tick, or not at all.
                    found[FAILURE] = k
                    break
        dx = x - source_x
        dy = y - source_y
        if first_success == NEVER and dx * dx + dy * dy < near2:
            first_success = k
    found[FIRST_CONTACT] = first_contact if first_contact != found[FAILURE] else NEVER
    found[FIRST_SUCCESS] = first_success
    return survival


@leaf
def record(drones: Drones, drone: int, label: int, start_tick: int, ticks: int, heir: int) -> None:
    """Note a leg that begins in the drone's present state, if there is room."""
    at = drones.tally[LEGS]
    if at < drones.legs.shape[0]:
        leg = drones.legs[at]
        leg[LEG_DRONE] = label
        leg[LEG_START] = start_tick
        leg[LEG_TICKS] = ticks
        leg[LEG_X] = drones.targets[drone, 0]
        leg[LEG_Y] = drones.targets[drone, 1]
        leg[LEG_HEIR] = heir
        copy_row(drones.rows[drone], leg[LEG_ROW:])
        drones.tally[LEGS] = at + 1


@kernel
def _begin(scene: Scene, drones: Drones, required: IntArray) -> bool:
    """Look ahead for the required drones that live; whether there is one."""
    some = False
    for i in range(drones.alive.shape[0]):
        drones.ends[i] = NEVER
        if drones.alive[i] == 1 and required[i] == 1:
            some = True
            drones.begun[i] = begin_leg(
                scene.motion, drones.rows[i], drones.targets[i, 0], drones.targets[i, 1], drones.ahead[i]
            )
    return some


@kernel
def _arrival(scene: Scene, drones: Drones, required: IntArray) -> int:
    """The first tick of the leg at which all required drones that have not failed by then are there at once."""
    tick = 1
    settled = False
    while not settled:
        settled = True
        for i in range(drones.alive.shape[0]):
            if drones.alive[i] == 0 or required[i] == 0 or drones.ends[i] <= tick:
                continue
            there = first_inside(
                scene.motion,
                drones.ahead[i],
                drones.begun[i],
                drones.targets[i, 0],
                drones.targets[i, 1],
                scene.powers,
                tick,
            )
            there = min(there, drones.ends[i])
            if there > tick:
                tick = there
                settled = False
    return tick


@kernel
def _walk_drone(scene: Scene, drones: Drones, i: int, ticks: int, want_contact: bool) -> float:
    return walk(
        scene,
        drones.rows[i],
        drones.targets[i, 0],
        drones.targets[i, 1],
        drones.tally[NOW],
        ticks,
        drones.survival[i],
        drones.limits[i],
        want_contact,
        drones.work,
        drones.found,
    )


@kernel
def _failures(scene: Scene, drones: Drones, longest: int) -> bool:
    """Find for every drone after how many ticks of the leg it fails; whether any does within `longest`."""
    some = False
    for i in range(drones.alive.shape[0]):
        if drones.alive[i] == 0:
            continue
        drones.ends[i] = max(drones.fails[i] - drones.tally[NOW], 1)
        tx, ty = drones.targets[i, 0], drones.targets[i, 1]
        if scene.world[IN_PLUME_RATE] > 0.0 and passes_plume(scene, drones.rows[i], tx, ty):
            _walk_drone(scene, drones, i, min(longest, drones.ends[i] - 1), False)
            drones.ends[i] = min(drones.ends[i], drones.found[FAILURE])
        some = some or drones.ends[i] <= longest
    return some


@kernel
def _watch(scene: Scene, drones: Drones, end: int) -> int:
    """Look for the first contact and the first success within `end` ticks; returns the tick of success."""
    tally = drones.tally
    contact = NEVER
    contact_drone = -1
    success = NEVER
    want_contact = tally[CONTACT] == NEVER
    for i in range(drones.alive.shape[0]):
        if drones.alive[i] == 0:
            continue
        tx, ty = drones.targets[i, 0], drones.targets[i, 1]
        wanted = want_contact or scene.world[IN_PLUME_RATE] > 0.0
        in_plume = wanted and passes_plume(scene, drones.rows[i], tx, ty)
        if in_plume or passes_source(scene, drones.rows[i], tx, ty):
            ticks = min(end, drones.ends[i] - 1)
            drones.survival[i] = _walk_drone(scene, drones, i, ticks, want_contact)
            success = min(success, drones.found[FIRST_SUCCESS])
            if drones.found[FIRST_CONTACT] < contact:
                contact = drones.found[FIRST_CONTACT]
                contact_drone = i
    if want_contact and contact <= min(end, success):
        tally[CONTACT] = tally[NOW] + contact
        tally[CONTACT_DRONE] = contact_drone
    return success


@kernel
def fly_leg(scene: Scene, drones: Drones, labels: IntArray, required: IntArray, hold: int) -> bool:
    """Fly everybody towards the targets until all `required` drones that live have arrived.

    With `hold` above 0: for so many ticks, whoever arrives. Returns whether the trial goes on; it ends at the
    tick of success, at the limit, and when nobody is alive. `labels` are the drones' names in the record.
    """
    tally = drones.tally
    now = tally[NOW]
    count = drones.alive.shape[0]
    if not _begin(scene, drones, required):
        return False
    # Nobody's failure makes the others later: without any the leg is longest.
    end = hold if hold > 0 else _arrival(scene, drones, required)
    if _failures(scene, drones, end) and hold == 0:
        end = _arrival(scene, drones, required)
    end = min(end, tally[LIMIT] - now)
    success = _watch(scene, drones, end)
    end = min(end, success)
    for i in range(count):
        if drones.alive[i] == 1:
            ticks = min(end, drones.ends[i])
            record(drones, i, labels[i], now, ticks, tally[HEALING_NOW] * required[i])
            fly(scene.motion, drones.rows[i], drones.targets[i, 0], drones.targets[i, 1], ticks, scene.powers)
            if drones.ends[i] <= end:
                freeze(drones.rows[i])
                drones.alive[i] = 0
    tally[NOW] = now + end
    if success <= end:
        tally[SUCCESS] = tally[NOW]
        return False
    return bool(tally[NOW] < tally[LIMIT])
