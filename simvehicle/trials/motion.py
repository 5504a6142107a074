"""How a drone of the trials moves from point to point, in closed form, tick by tick exact.

Three models, all horizontal, 16 ticks a second:

* `paper`, the paper authors' position controller: ten updates a tick, each per axis and with h = 0.00625,
  x += v h; v += h a; e = target - x; a = clamp(20 e + 10 (e - e_before) / h, -1000, 1000).
  Away from the clamp an update is linear in (x - target, v, a), so k ticks are one multiplication with the
  10k-th power of a constant matrix. The clamp acts in the first tick or ticks of a leg only (the kick that a new
  target gives to the derivative, and legs over 50 m); these are stepped one by one.
* `pd`, the same with one update a tick, as the authors' program runs on later versions of its simulator.
* `cruise`, a real drone: straight to the target with limited speed and acceleration, from rest to rest,
  then a pause to settle.

A drone's state is a row of 8 numbers: x, y, vx, vy, ax, ay and the control errors ex, ey of the tick before
(x north, y east, metres; `cruise` uses the first two).
"""

from __future__ import annotations

import functools
import math
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta

from mission.geometry.formation import FloatArray
from simvehicle.compiled import kernel, leaf

TICKS_PER_S = 16
X, Y, VX, VY, AX, AY, EX, EY, ROW = range(9)
PD, CRUISE = 0, 1
PD_STEP, PD_P, PD_D, PD_CLAMP = 0.00625, 20.0, 10.0, 1000.0
ARRIVED_M = 0.1
"""`paper` and `pd`: a waypoint is reached when both axes are nearer than this at a tick."""
PAPER_UPDATES = 10
"""`paper`: updates a tick."""
_POWERS = 2048
_FAR = 1 << 40
_SHORT_M = 2.5
_SHORT_TICKS = 256


class Pd(msgspec.Struct, frozen=True, tag="pd", tag_field="model", forbid_unknown_fields=True):
    """The authors' controller."""

    updates: Annotated[int, Meta(ge=1, le=PAPER_UPDATES)] = 1
    """A tick. With one the drone is ten times slower than the gains suggest: 10 m from rest take 18.5 s, not 1.9."""


class Cruise(msgspec.Struct, frozen=True, tag="cruise", tag_field="model", forbid_unknown_fields=True):
    """A real drone's limits."""

    speed_mps: Annotated[float, Meta(gt=0.0)] = 5.0
    acceleration_mps2: Annotated[float, Meta(gt=0.0)] = 2.0
    settle_s: Annotated[float, Meta(ge=0.0)] = 1.0
    """Pause at every waypoint before the reading counts."""


Motion = Pd | Cruise
MotionName = Literal["paper", "pd", "cruise"]
MOTIONS: tuple[MotionName, ...] = ("paper", "pd", "cruise")


def motion_numbers(motion: Motion) -> FloatArray:
    """`motion` as the kernels take it: kind, then the updates of `pd` or the numbers of `cruise`."""
    if isinstance(motion, Pd):
        return np.array([PD, motion.updates, 0.0, 0.0])
    return np.array([CRUISE, motion.speed_mps, motion.acceleration_mps2, motion.settle_s])


def _powers(step: FloatArray, count: int) -> FloatArray:
    table = np.empty((count, 3, 3))
    table[0] = np.eye(3)
    for k in range(1, count):
        table[k] = table[k - 1] @ step
    return table


_UPDATES = _powers(
    np.array([[1.0, PD_STEP, 0.0], [0.0, 1.0, PD_STEP], [-PD_P, -PD_P * PD_STEP - PD_D, 0.0]]),
    PAPER_UPDATES + 1,
)
"""_UPDATES[k] takes (x - target, v, a) forward by k updates."""


@functools.cache
def powers_of(motion: Motion) -> FloatArray:
    """Of these, the k-th takes (x - target, v, a) of `paper` or `pd` forward by k ticks; `cruise` needs none."""
    return _powers(_UPDATES[motion.updates if isinstance(motion, Pd) else 1], _POWERS)


@leaf
def copy_row(source: FloatArray, target: FloatArray) -> None:
    """`target[:] = source`, which the compiler takes ten times longer to compile."""
    for place in range(ROW):
        target[place] = source[place]


@leaf
def _pd_update(row: FloatArray, axis: int, target: float) -> bool:
    """One update of one axis; whether the clamp acted."""
    row[X + axis] += row[VX + axis] * PD_STEP
    row[VX + axis] += row[AX + axis] * PD_STEP
    error = target - row[X + axis]
    wanted = PD_P * error + PD_D * (error - row[EX + axis]) / PD_STEP
    row[EX + axis] = error
    row[AX + axis] = min(max(wanted, -PD_CLAMP), PD_CLAMP)
    return bool(abs(wanted) > PD_CLAMP)


@leaf
def _pd_jump(row: FloatArray, tx: float, ty: float, powers: FloatArray, k: int) -> None:
    """Take `row`, which the clamp has let go, forward by the `k`-th of `powers`."""
    for axis in range(2):
        target = tx if axis == 0 else ty
        d = row[X + axis] - target
        v = row[VX + axis]
        a = row[AX + axis]
        moved = powers[k, 0, 0] * d + powers[k, 0, 1] * v + powers[k, 0, 2] * a
        row[VX + axis] = powers[k, 1, 0] * d + powers[k, 1, 1] * v + powers[k, 1, 2] * a
        row[AX + axis] = powers[k, 2, 0] * d + powers[k, 2, 1] * v + powers[k, 2, 2] * a
        row[X + axis] = target + moved
        row[EX + axis] = -moved


@leaf
def pd_tick(motion: FloatArray, row: FloatArray, tx: float, ty: float) -> bool:
    """One tick; whether the clamp has let go of both axes: it will not act again before the next leg."""
    left = int(motion[1])
    while left > 0:
        clamped_x = _pd_update(row, 0, tx)
        clamped_y = _pd_update(row, 1, ty)
        left -= 1
        if not (clamped_x or clamped_y):
            if left > 0:
                _pd_jump(row, tx, ty, _UPDATES, left)
            return True
    return False


@leaf
def _pd_free(motion: FloatArray, row: FloatArray, tx: float, ty: float, most: int) -> int:
    """Step until the clamp acts on neither axis, at most `most` ticks; the number of ticks."""
    ticks = 0
    while ticks < most:
        ticks += 1
        if pd_tick(motion, row, tx, ty):
            break
    return ticks


@leaf
def pd_place(row: FloatArray, tx: float, ty: float, powers: FloatArray, k: int) -> tuple[float, float]:
    """Where a drone in state `row` is `k` ticks after the clamp has let go."""
    return (
        tx + powers[k, 0, 0] * (row[X] - tx) + powers[k, 0, 1] * row[VX] + powers[k, 0, 2] * row[AX],
        ty + powers[k, 0, 0] * (row[Y] - ty) + powers[k, 0, 1] * row[VY] + powers[k, 0, 2] * row[AY],
    )


@leaf
def _pd_inside(row: FloatArray, tx: float, ty: float, powers: FloatArray, k: int) -> bool:
    x, y = pd_place(row, tx, ty, powers, k)
    return bool(abs(x - tx) < ARRIVED_M and abs(y - ty) < ARRIVED_M)


@leaf
def _pd_first_inside(row: FloatArray, tx: float, ty: float, powers: FloatArray, least: int) -> int:
    """The first tick k >= `least` at which a drone that leaves the clamp in state `row` is inside.

    Each axis is a sum of two decaying exponentials. A short leg, begun with speed left from the one before, can
    enter the square, leave it on the other side and come back: its ticks are tried one by one. A long leg
    (over 2.5 m on an axis) enters once, when any overshoot of the other axis has died away: it is bisected.
    """
    if _pd_inside(row, tx, ty, powers, least):
        return least
    outside = least
    if abs(row[X] - tx) < _SHORT_M and abs(row[Y] - ty) < _SHORT_M:
        while outside < least + _SHORT_TICKS:
            outside += 1
            if _pd_inside(row, tx, ty, powers, outside):
                return outside
    inside = outside + 64
    while not _pd_inside(row, tx, ty, powers, inside):
        outside = inside
        inside = min(2 * inside, powers.shape[0] - 1)
        if outside == inside:
            return _FAR  # cannot be: 2047 ticks bring any leg inside
    while inside - outside > 1:
        middle = (inside + outside) // 2
        if _pd_inside(row, tx, ty, powers, middle):
            inside = middle
        else:
            outside = middle
    return inside


@leaf
def _cruise_s(length_m: float, speed_mps: float, acceleration_mps2: float) -> float:
    """Time of a flight from rest to rest."""
    if length_m * acceleration_mps2 >= speed_mps * speed_mps:
        return length_m / speed_mps + speed_mps / acceleration_mps2
    return 2.0 * math.sqrt(length_m / acceleration_mps2)


@leaf
def _cruise_m(time_s: float, length_m: float, speed_mps: float, acceleration_mps2: float) -> float:
    """Distance flown after `time_s` of a flight from rest to rest."""
    whole_s = _cruise_s(length_m, speed_mps, acceleration_mps2)
    if time_s >= whole_s:
        return length_m
    ramp_s = min(speed_mps / acceleration_mps2, 0.5 * whole_s)
    if time_s < ramp_s:
        return 0.5 * acceleration_mps2 * time_s * time_s
    left_s = whole_s - time_s
    if left_s < ramp_s:
        return length_m - 0.5 * acceleration_mps2 * left_s * left_s
    return 0.5 * acceleration_mps2 * ramp_s * ramp_s + speed_mps * (time_s - ramp_s)


@leaf
def begin_leg(motion: FloatArray, row: FloatArray, tx: float, ty: float, ahead: FloatArray) -> int:
    """Look ahead on a leg that begins in state `row`: what `first_inside` needs.

    `pd`: the ticks until the clamp lets go, and in `ahead` the state then; the drone is not inside before.
    `cruise`: the ticks to arrival.
    """
    copy_row(row, ahead)
    if motion[0] == PD:
        return _pd_free(motion, ahead, tx, ty, _FAR)
    length_m = math.hypot(tx - row[X], ty - row[Y])
    whole_s = _cruise_s(length_m, motion[1], motion[2]) + motion[3]
    ticks: int = math.ceil(whole_s * TICKS_PER_S - 1e-9)
    return max(1, ticks)


@leaf
def first_inside(
    motion: FloatArray, ahead: FloatArray, begun: int, tx: float, ty: float, powers: FloatArray, least: int
) -> int:
    """The first tick k >= `least` of a leg at which the drone is at its target; `begin_leg` gave `begun`."""
    if motion[0] == PD:
        return begun + _pd_first_inside(ahead, tx, ty, powers, max(least - begun, 0))
    return max(begun, least)


@leaf
def leg_ticks(
    motion: FloatArray, row: FloatArray, tx: float, ty: float, powers: FloatArray, ahead: FloatArray
) -> int:
    """How many ticks (at least 1) one drone in state `row` needs to arrive at (tx, ty)."""
    begun = begin_leg(motion, row, tx, ty, ahead)
    return first_inside(motion, ahead, begun, tx, ty, powers, 1)


@leaf
def fly(motion: FloatArray, row: FloatArray, tx: float, ty: float, ticks: int, powers: FloatArray) -> None:
    """Take `row` forward by `ticks` ticks of its leg to (tx, ty); the leg begins in state `row`."""
    if motion[0] == PD:
        left = ticks - _pd_free(motion, row, tx, ty, ticks)
        while left > 0:
            k = min(left, powers.shape[0] - 1)
            _pd_jump(row, tx, ty, powers, k)
            left -= k
        return
    length_m = math.hypot(tx - row[X], ty - row[Y])
    if length_m > 0.0:
        share = _cruise_m(ticks / TICKS_PER_S, length_m, motion[1], motion[2]) / length_m
        row[X] += share * (tx - row[X])
        row[Y] += share * (ty - row[Y])


@kernel
def straight_ticks(motion: FloatArray, length_m: float, powers: FloatArray, work: FloatArray) -> int:
    """How many ticks a flight along one axis takes from rest: the climbs and descents of an heir."""
    rest = np.zeros(ROW)
    return leg_ticks(motion, rest, length_m, 0.0, powers, work)


@leaf
def freeze(row: FloatArray) -> None:
    """The drone has failed: it stays where it is and never moves again."""
    for place in range(VX, ROW):
        row[place] = 0.0
