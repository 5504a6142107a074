"""The slow, plain engine of the trials: every drone, every tick, one after another. The yardstick of the fast one.

It knows nothing of closed forms, rectangles or geometric distributions. Its decisions are the rules of `mission`,
called as plain Python. It can be given the fast engine's own luck, tick by tick the same trial, or luck of its
own, drawn afresh at every tick as the paper words it.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable, Iterable, Iterator

import numpy as np

from mission.geometry.formation import rotated
from mission.strategies.locus.gradient import plane_gradient, waypoint_uphill
from mission.strategies.locus.spiral import arm_spacing_m, spiral_point
from mission.strategies.mobs import STATE_SIZE, mobs_begin, mobs_next
from mission.strategies.mobs_authors import (
    AUTHORS_STATE_SIZE,
    DECISION,
    PHASE,
    mobs_authors_begin,
    mobs_authors_next,
)
from mission.tree.balanced_tree import next_heal, next_rebalance
from simvehicle.trials import randomness as luck
from simvehicle.trials.cell import Cell
from simvehicle.world.gas_formulas import LOCUS_CELL_M, LOCUS_WIDTH_M, locus_grid

STEP, P, D, CLAMP = 0.00625, 20.0, 10.0, 1000.0
INSIDE_M = 0.1


def _c_rand(seed: int) -> Iterator[int]:
    """The C library's rand() after srand(seed): GNU's additive feedback generator, the same on every machine."""
    state = [seed or 1]
    for _ in range(30):
        state.append(16807 * state[-1] % (2**31 - 1))
    state += state[:3]
    for _ in range(310):
        state.append((state[-31] + state[-3]) % 2**32)
    while True:
        state.append((state[-31] + state[-3]) % 2**32)
        yield state[-1] >> 1


def authors_trial(seed: int, drones: int = 0) -> tuple[tuple[float, float], list[float]]:
    """Origin of the plume and bearings of the drones' first spokes in the authors' trial of a seed.

    At an arena radius of 100 m. Their program draws the place in decimetres, then an angle for every drone, from
    which the first spoke is one golden angle on.
    """
    rand = _c_rand(seed)
    while True:
        place = [1000 - next(rand) % 2000 for _ in range(2)]
        if math.hypot(*place) <= 1000.0:
            break
    angles = [math.tau * next(rand) / (2**31 - 1) for _ in range(drones)]
    return (place[0] / 10.0, place[1] / 10.0), [angle + math.tau / 1.6180339887 for angle in angles]


def authors_places(count: int) -> list[tuple[float, float]]:
    """Origin of the plume in the authors' trials with seeds 0, 1, ..."""
    return [authors_trial(seed)[0] for seed in range(count)]


class TrialOver(Exception):  # noqa: N818 (not an error)
    """The trial has ended."""


@dataclasses.dataclass
class Axis:
    x: float
    v: float = 0.0
    a: float = 0.0
    before: float = 0.0
    target: float = 0.0

    def tick(self, updates: int) -> None:
        for _ in range(updates):
            self.x += self.v * STEP
            self.v += self.a * STEP
            error = self.target - self.x
            self.a = min(max(P * error + D * (error - self.before) / STEP, -CLAMP), CLAMP)
            self.before = error


class SharedLuck:
    """The fast engine's luck: its streams, its ticks of failure, its chances of survival."""

    def __init__(self, cell: Cell, seed: int, trial: int) -> None:
        self._cell, self._seed, self._trial = cell, seed, trial
        self._survival = np.ones(cell.drones)
        generic = cell.failure_rate if cell.failure == "generic" else 0.0
        self._fails = [
            luck.geometric_tick(self.draws(luck.GENERIC + i)(), generic) for i in range(cell.drones)
        ]
        self._limits = [luck.survival_limit(self.draws(luck.IN_PLUME + i)()) for i in range(cell.drones)]

    def draws(self, kind: int) -> Callable[[], float]:
        stream = np.zeros(1, np.uint64)
        luck.open_stream(stream, self._seed, self._trial, kind)
        return lambda: float(luck.uniform(stream))

    def fails(self, drone: int, tick: int, value: float) -> bool:
        if tick >= self._fails[drone]:
            return True
        if self._cell.failure == "in-plume" and value > 0.0:
            chance = min(self._cell.failure_rate * value, 1.0)
            self._survival[drone] *= (1.0 - chance) ** self._cell.in_plume_draws
        return bool(self._survival[drone] < self._limits[drone])


class OwnLuck:
    """Luck drawn from NumPy, failures anew at every tick."""

    def __init__(self, cell: Cell, seed: int, trial: int) -> None:
        self._cell = cell
        self._rng = np.random.default_rng([seed, trial])

    def draws(self, kind: int) -> Callable[[], float]:
        return lambda: float(self._rng.random())

    def fails(self, drone: int, tick: int, value: float) -> bool:
        if self._cell.failure == "generic":
            return bool(self._rng.random() < self._cell.failure_rate)
        if self._cell.failure == "in-plume" and value > 0.0:
            chance = self._cell.failure_rate * value
            return any(self._rng.random() < chance for _ in range(self._cell.in_plume_draws))
        return False


class Trial:
    """One trial of LoCUS or MoBS with motion `pd` or `paper`; run it with `run`."""

    def __init__(self, cell: Cell, chance: SharedLuck | OwnLuck) -> None:
        self.cell = cell
        self.luck = chance
        self.tick = 0
        self.contact: int | None = None
        self.success: int | None = None
        self.heals = self.moves = 0
        self.updates = {"pd": 1, "paper": 10}[cell.motion]
        self.grid = locus_grid(cell.plume == "perturbed", not cell.cut_cells)
        world = chance.draws(luck.WORLD)
        while True:
            north, east = (cell.arena_m * (2.0 * world() - 1.0) for _ in range(2))
            if math.hypot(north, east) <= cell.arena_m:
                break
        if cell.cut_cells:
            north, east = math.trunc(10.0 * north) / 10.0, math.trunc(10.0 * east) / 10.0
        self.origin = (north, east)
        row, column = np.unravel_index(int(np.argmax(self.grid)), self.grid.shape)
        middle = 0.0 if cell.cut_cells else 0.5
        self.source = (
            north + (float(row) + middle) * LOCUS_CELL_M,
            east + (float(column) + middle) * LOCUS_CELL_M - LOCUS_WIDTH_M / 2.0,
        )
        if cell.cut_goal:
            goal = [math.trunc(round(10.0 * place) / 10.0) for place in self.source]
            self.source = (float(goal[0]), float(goal[1]))
        self.places: list[tuple[Axis, Axis]] = []
        for i in range(cell.drones):
            start = chance.draws(luck.START + i)
            self.places.append((Axis(8.0 * (2.0 * start() - 1.0)), Axis(8.0 * (2.0 * start() - 1.0))))
        self.alive = [True] * cell.drones

    def read(self, drone: int) -> float:
        north, east = self.places[drone]
        if self.cell.cut_cells:
            return self.read_cut(north.x, east.x)
        row = math.floor((north.x - self.origin[0]) / LOCUS_CELL_M)
        column = math.floor((east.x - self.origin[1] + LOCUS_WIDTH_M / 2.0) / LOCUS_CELL_M)
        if 0 <= row < self.grid.shape[0] and 0 <= column < self.grid.shape[1]:
            return float(self.grid[row, column])
        return 0.0

    def read_cut(self, north: float, east: float) -> float:
        row = math.trunc(10.0 * north) - round(10.0 * self.origin[0])
        column = math.trunc(10.0 * east) - round(10.0 * self.origin[1]) + 200
        if 0 <= row < self.grid.shape[0] and 0 <= column < self.grid.shape[1]:
            return float(self.grid[row, column])
        return 0.0

    def aim(self, drone: int, north: float, east: float) -> None:
        most = 1.5 * self.cell.arena_m
        for axis, target in zip(self.places[drone], (north, east), strict=True):
            axis.target = min(max(target, -most), most)

    def inside(self, drone: int) -> bool:
        return all(abs(axis.target - axis.x) < INSIDE_M for axis in self.places[drone])

    def one_tick(self) -> None:
        self.tick += 1
        for drone, (north, east) in enumerate(self.places):
            if not self.alive[drone]:
                continue
            north.tick(self.updates)
            east.tick(self.updates)
            value = self.read(drone)
            if self.luck.fails(drone, self.tick, value):
                self.alive[drone] = False
                continue
            if value > 0.0 and self.contact is None:
                self.contact = self.tick
            if math.dist((north.x, east.x), self.source) < self.cell.success_m:
                self.success = self.tick
        if self.success is not None or self.tick >= self.cell.limit_ticks or not any(self.alive):
            raise TrialOver

    def fly(self, required: Iterable[int], hold: int = 0) -> None:
        """Until all required drones that live are inside; or for `hold` ticks."""
        required = [drone for drone in required if self.alive[drone]]
        if hold:
            for _ in range(hold):
                self.one_tick()
            return
        if not required:
            raise TrialOver
        while True:
            self.one_tick()
            if all(self.inside(drone) for drone in required if self.alive[drone]):
                return

    def run(self) -> Trial:
        with contextlib.suppress(TrialOver):
            {"mobs": self.mobs, "mobs-authors": self.mobs_authors, "locus": self.locus}[self.cell.strategy]()
        return self

    def mobs(self) -> None:
        cell = self.cell
        states, draws = [], []
        for drone in range(cell.drones):
            draws.append(self.luck.draws(luck.OWN + drone))
            states.append(np.zeros(STATE_SIZE))
            mobs_begin(states[drone], 2.0 * math.pi * draws[drone]())
            self.aim(drone, 0.0, 0.0)
        while True:
            self.one_tick()
            for drone, (north, east) in enumerate(self.places):
                if self.alive[drone] and self.inside(drone):
                    value = self.read(drone)
                    target = mobs_next(
                        states[drone], north.x, east.x, value, cell.arena_m, 1.0, draws[drone]()
                    )
                    self.aim(drone, *target)

    def mobs_authors(self) -> None:
        """By the rule of every tick, and a draw where it decides."""
        cell = self.cell
        states, draws = [], []
        for drone in range(cell.drones):
            draws.append(self.luck.draws(luck.OWN + drone))
            states.append(np.zeros(AUTHORS_STATE_SIZE))
            mobs_authors_begin(states[drone], 2.0 * math.pi * draws[drone]())
            self.aim(drone, 0.0, 0.0)
        while True:
            self.one_tick()
            for drone, (north, east) in enumerate(self.places):
                if self.alive[drone]:
                    decides = states[drone][PHASE] == DECISION
                    pair = [draws[drone]() if decides else 0.0 for _ in range(2)]
                    target = mobs_authors_next(
                        states[drone],
                        1,
                        north.x,
                        east.x,
                        self.read(drone),
                        self.inside(drone),
                        cell.arena_m,
                        1.0,
                        *pair,
                    )
                    self.aim(drone, *target)

    def locus(self) -> None:  # noqa: C901 (the whole algorithm on one page)
        cell = self.cell
        draws = self.luck.draws(luck.DECISIONS)
        layout = cell.formation()
        table = layout.table(cell.drones)
        arms_m = arm_spacing_m(layout.full_levels(cell.drones), cell.r_max_m)
        holder = np.arange(cell.drones)
        members = list(range(cell.drones))
        window: list[tuple[float, float, float]] = []
        draws()  # the fast engine's bearing for spokes, which this strategy does not fly
        turn = math.pi * draws()
        anchor, index = (0.0, 0.0), 0
        climb = Axis(0.0, target=cell.r_min_m)
        climb_ticks = 0
        while climb_ticks == 0 or abs(climb.target - climb.x) >= INSIDE_M:
            climb.tick(self.updates)
            climb_ticks += 1

        def aim(drone: int, slot: int) -> None:
            north, east = rotated(layout.offset_m(slot), turn)
            self.aim(drone, anchor[0] + north, anchor[1] + east)

        def heal() -> None:
            lost = False
            while True:
                for slot, drone in enumerate(holder):
                    if drone >= 0 and not self.alive[drone]:
                        holder[slot], lost = -1, True
                below = np.zeros_like(holder)
                source, target = next_heal(holder, table.parent, table.child_start, table.child, below)
                if target < 0:
                    source, target = next_rebalance(holder, table.level)
                if target < 0:
                    break
                heir = int(holder[source])
                self.fly([heir], climb_ticks)
                if self.alive[heir]:
                    aim(heir, target)
                    self.fly([heir])
                if self.alive[heir]:
                    self.fly([heir], climb_ticks)
                if self.alive[heir]:
                    holder[target], holder[source] = heir, -1
                    self.moves += 1
            self.heals += lost

        while True:
            for slot, drone in enumerate(holder):
                if drone >= 0 and drone in members:
                    aim(int(drone), slot)
            self.fly(members)
            if cell.healing:
                heal()
                members = [int(drone) for drone in holder if drone >= 0]
            else:
                reached: list[int] = []
                for slot in range(cell.drones):
                    if self.alive[slot] and (slot == 0 or table.parent[slot] in reached):
                        reached.append(slot)
                lost = len(reached) < cell.drones
                members = [] if lost and cell.unhealed == "nobody" else reached
            if not members:
                raise TrialOver
            window = window[-len(members) :]
            for drone in (int(d) for d in holder if d >= 0 and d in members):
                north, east = self.places[drone]
                window.append((north.x, east.x, self.read(drone)))
            norths, easts, values = (np.array(column) for column in zip(*window, strict=True))
            slope = plane_gradient(norths, easts, values, np.ones(len(window)), len(window), 1e-6)
            jitter = [cell.jitter_m * (2.0 * draws() - 1.0) for _ in range(2)]
            more = cell.turn_rad * draws()
            uphill, north, east = waypoint_uphill(slope[0], slope[1], *anchor, cell.step_m, *jitter)
            if uphill:
                turn += more
            else:
                index += 1
                north, east = spiral_point(index, arms_m, False)
            anchor = (north, east)
