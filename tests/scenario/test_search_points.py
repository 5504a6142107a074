"""The flying strategies on drones that are moving points: no radio, no autopilot, only the decisions."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest

from mission.estimation.estimates import Reading, Scalar
from mission.geometry.formation import FloatArray, Hexagonal, Layout
from mission.geometry.frames import Vector3
from mission.strategies.contract import (
    GoTo,
    Neighbour,
    Observation,
    Order,
    OwnState,
    Stage,
    Strategy,
    TreePlace,
)
from mission.strategies.locus.note import note_of
from mission.strategies.registry import make
from mission.tree.balanced_tree import heal, place

TICK_S = 0.1
SPEED_MPS = 5.0
ACCELERATION_MPS2 = 2.0
ALTITUDE_M = -10.0


class GaussianPlume:
    """Wind towards `bearing_rad`; a vent of width `vent_sd_m`, spreading downwind, with a short upwind tail."""

    def __init__(self, source: tuple[float, float], bearing_rad: float, vent_sd_m: float, peak_ppm: float):
        self.source = source
        self._cos, self._sin = math.cos(bearing_rad), math.sin(bearing_rad)
        self._vent_sd_m = vent_sd_m
        self._peak_ppm = peak_ppm

    def __call__(self, position: Vector3) -> float:
        north, east = position[0] - self.source[0], position[1] - self.source[1]
        along = north * self._cos + east * self._sin
        across = east * self._cos - north * self._sin
        spread = self._vent_sd_m + 0.12 * max(along, 0.0)
        value = self._peak_ppm * (self._vent_sd_m / spread) ** 2 * math.exp(-0.5 * (across / spread) ** 2)
        return value * math.exp(-0.5 * (min(along, 0.0) / self._vent_sd_m) ** 2)


def vector(axes: FloatArray) -> Vector3:
    """As an agent has it: no numpy."""
    north, east, down = axes.tolist()
    return north, east, down


class Point:
    def __init__(self, drone: int, position: Vector3, strategy: Strategy, rng: np.random.Generator) -> None:
        self.drone = drone
        self.position = np.array(position)
        self.velocity = np.zeros(3)
        self.strategy = strategy
        self.rng = rng
        self.excess: float | None = 0.0
        self.variance = 4.0
        self.sensor_works = True
        self.word = self.next_word = b""

    def fly(self, target: Vector3) -> None:
        away = np.array(target) - self.position
        distance = float(np.linalg.norm(away))
        speed = min(SPEED_MPS, math.sqrt(2.0 * ACCELERATION_MPS2 * distance) * 0.8, distance / TICK_S)
        wanted = away / distance * speed if distance > 1e-9 else np.zeros(3)
        change = wanted - self.velocity
        size = float(np.linalg.norm(change))
        if size > ACCELERATION_MPS2 * TICK_S:
            change *= ACCELERATION_MPS2 * TICK_S / size
        self.velocity += change
        self.position += self.velocity * TICK_S

    def sense(self, truth_ppm: float) -> None:
        """A filter in small: first-order smoothing of readings with 2 ppm noise."""
        if not self.sensor_works:
            self.excess = None
            return
        raw = truth_ppm + self.rng.normal(0.0, 2.0)
        moving = float(np.linalg.norm(self.velocity)) > 0.5
        gain = 0.5 if moving or self.excess is None else 0.2
        self.excess = raw if self.excess is None else self.excess + gain * (raw - self.excess)
        self.variance = 4.0 * gain / (2.0 - gain)


class Swarm:
    """The tree protocol's outcome without its messages: everybody knows everything one tick later."""

    def __init__(
        self,
        drones: int,
        plume: Callable[[Vector3], float],
        seed: int,
        strategy: str = "locus",
        layout: Layout | None = None,
        **parameters: object,
    ) -> None:
        self.layout = layout or Hexagonal(10.0)
        self.plume = plume
        self.slots = {drone: drone - 1 for drone in range(1, drones + 1)}
        self.order = Order(1, Stage.FORM, (0.0, 0.0, ALTITUDE_M), 0.0)
        self.readings: dict[int, Reading] = {}
        self.now_s = 0.0
        self.heal_until_s = -1.0
        self.orders = [self.order]
        self.hovering: tuple[Neighbour, ...] = ()
        """Vehicles that make way for nobody."""
        self.points: dict[int, Point] = {}
        for drone in self.slots:
            self.points[drone] = self.new_point(drone, seed, strategy, parameters)

    def new_point(self, drone: int, seed: int, strategy: str, parameters: dict[str, object]) -> Point:
        rng = np.random.default_rng([seed, drone])
        north, east = self.layout.offset_m(self.slots[drone])
        made = make(strategy, layout=self.layout, **parameters)
        return Point(drone, (north, east, ALTITUDE_M), made, rng)

    def lose(self, *drones: int) -> None:
        for drone in drones:
            del self.points[drone]
        self.slots = heal(self.slots, self.layout, drones).slots
        self.heal_until_s = self.now_s + 8.0

    def others(self, point: Point) -> tuple[Neighbour, ...]:
        flying = tuple(
            Neighbour(p.drone, vector(p.position), vector(p.velocity), 0.1, True, word=p.word)
            for p in self.points.values()
            if p is not point
        )
        return (*flying, *self.hovering)

    def tick(self) -> None:
        healing = self.now_s < self.heal_until_s
        given: Order | None = None
        for point in self.points.values():
            family = place(self.slots, self.layout, point.drone)
            co2 = None if point.excess is None else Scalar(float(point.excess), point.variance, 0.05)
            own = OwnState(point.drone, vector(point.position), vector(point.velocity), co2, None, 0.9)
            others = self.others(point)
            tree = TreePlace(
                0,
                self.slots[point.drone],
                self.slots,
                family.parent,
                family.children,
                family.heir,
                family.parent_heir,
                family.root,
                healing,
            )
            known = tuple(self.readings.values()) if family.root == point.drone else ()
            decision = point.strategy.decide(
                Observation(self.now_s, own, others, tree, self.order, known), point.rng
            )
            if decision.reading is not None and decision.reading.order == self.order.sequence:
                self.readings[point.drone] = decision.reading
            if decision.order is not None:
                assert family.root == point.drone
                given = decision.order
            point.next_word = decision.word
            intent = decision.intent
            point.fly(intent.position_ned_m if isinstance(intent, GoTo) else tuple(point.position))
            point.sense(self.plume(tuple(point.position)))
        if given is not None and given.sequence > self.order.sequence and not healing:
            self.order = given
            self.orders.append(given)
            self.readings = {}
        for point in self.points.values():
            point.word = point.next_word
        self.now_s += TICK_S

    def run(self, limit_s: float) -> None:
        while self.now_s < limit_s and self.order.stage not in (Stage.FOUND, Stage.GIVE_UP):
            self.tick()

    def run_until(self, stage: Stage, limit_s: float = 2000.0) -> None:
        while self.order.stage is not stage and self.now_s < limit_s:
            self.tick()
        assert self.order.stage is stage


def plume_of(seed: int) -> GaussianPlume:
    rng = np.random.default_rng(seed)
    distance, bearing = rng.uniform(40.0, 110.0), rng.uniform(0.0, 2.0 * math.pi)
    source = (distance * math.cos(bearing), distance * math.sin(bearing))
    return GaussianPlume(source, rng.uniform(0.0, 2.0 * math.pi), rng.uniform(4.0, 8.0), 4000.0)


def error_m(swarm: Swarm, plume: GaussianPlume) -> float:
    assert swarm.order.stage is Stage.FOUND
    assert swarm.order.source_ned_m is not None
    return math.dist(swarm.order.source_ned_m[:2], plume.source)


@pytest.mark.parametrize("seed", range(20))
def test_five_drones_find_the_source(seed: int) -> None:
    plume = plume_of(seed)
    swarm = Swarm(5, plume, seed)
    swarm.run(2500.0)
    assert error_m(swarm, plume) < 5.0
    sequences = [order.sequence for order in swarm.orders]
    assert sequences == list(range(1, len(sequences) + 1))


@pytest.mark.parametrize("seed", range(20, 26))
def test_a_lost_leaf_does_not_stop_the_search(seed: int) -> None:
    plume = plume_of(seed)
    swarm = Swarm(5, plume, seed)
    swarm.run(100.0)
    swarm.lose(4)
    swarm.run(2500.0)
    assert error_m(swarm, plume) < 5.0


@pytest.mark.parametrize("seed", range(26, 32))
def test_a_new_root_goes_on_where_the_lost_one_was(seed: int) -> None:
    plume = plume_of(seed)
    swarm = Swarm(5, plume, seed)
    swarm.run(60.0)
    before = swarm.order
    assert before.stage is Stage.SEARCH
    swarm.lose(1)
    swarm.run(100.0)
    assert note_of(swarm.order).search_radius_m > note_of(before).search_radius_m
    assert note_of(swarm.order).search_start_ned_m == note_of(before).search_start_ned_m
    swarm.run_until(Stage.TRACK)
    root = next(drone for drone, slot in swarm.slots.items() if slot == 0)
    swarm.run(swarm.now_s + 10.0)
    swarm.lose(root)
    swarm.run(2500.0)
    assert error_m(swarm, plume) < 5.0


def test_down_to_one_drone() -> None:
    plume = plume_of(3)
    swarm = Swarm(5, plume, 3)
    swarm.run_until(Stage.TRACK)
    swarm.lose(1, 2, 3, 4)
    swarm.run(4000.0)
    assert error_m(swarm, plume) < 5.0


def test_a_broken_sensor_neither_blocks_nor_misleads() -> None:
    for seed in (40, 41):
        plume = plume_of(seed)
        swarm = Swarm(5, plume, seed)
        swarm.points[3].sensor_works = False
        swarm.run(2500.0)
        assert error_m(swarm, plume) < 5.0
        best = note_of(swarm.order).best
        assert best is not None
        assert best.drone != 3


def test_a_drone_that_is_held_back_does_not_stop_the_swarm() -> None:
    plume = plume_of(5)
    swarm = Swarm(5, plume, 5)
    held = swarm.points[2]
    held.fly = lambda target: held.velocity.fill(0.0)  # type: ignore[method-assign]
    swarm.run(60.0)
    assert note_of(swarm.order).search_radius_m > 1.0


def test_an_empty_area_is_given_up() -> None:
    swarm = Swarm(3, lambda position: 0.0, 1, search_radius_m=40.0)
    swarm.run(2500.0)
    assert swarm.order.stage is Stage.GIVE_UP
    assert swarm.order.source_ned_m is None
    assert all(note_of(order).best is None for order in swarm.orders)


def test_holding_while_healing() -> None:
    swarm = Swarm(5, plume_of(1), 1)
    swarm.run(30.0)
    before = swarm.order
    swarm.lose(3)
    while swarm.now_s < swarm.heal_until_s - TICK_S:
        swarm.tick()
    assert swarm.order == before


def test_the_same_seed_flies_the_same_flight() -> None:
    flights = []
    for _ in range(2):
        swarm = Swarm(4, plume_of(2), 2)
        swarm.run(150.0)
        flights.append(swarm.orders)
    assert flights[0] == flights[1]


def test_mobs_drones_search_alone_and_at_least_one_climbs_the_plume() -> None:
    plume = plume_of(7)
    swarm = Swarm(5, plume, 7, strategy="mobs", search_limit_s=3000.0)
    nearest = math.inf
    while nearest > 6.0 and swarm.now_s < 3000.0:
        swarm.tick()
        nearest = min(math.dist(p.position[:2], plume.source) for p in swarm.points.values())
    assert nearest <= 6.0
    stages = [Stage.FORM, Stage.SEARCH, Stage.TRACK]
    assert [order.stage for order in swarm.orders] == stages, "nobody steers another"
    assert len({order.anchor_ned_m for order in swarm.orders}) == 1


@pytest.mark.parametrize(("strategy", "seed"), [("mobs", 7), ("mobs", 8), ("mobs-authors", 7)])
def test_mobs_ends_where_nobody_beat_the_best_reading(strategy: str, seed: int) -> None:
    plume = plume_of(seed)
    swarm = Swarm(5, plume, seed, strategy=strategy, step_m=3.0, search_limit_s=3000.0)
    swarm.run(3200.0)
    assert error_m(swarm, plume) < 12.0  # as near as a moth comes
    assert swarm.order.apart


@pytest.mark.parametrize(
    "strategy",
    ["mobs", "mobs-authors", "locus-hybrid", "locus-multi", "lattice-casting", "lattice-fluxotaxis"],
)
def test_without_a_plume_every_strategy_gives_up_in_time(strategy: str) -> None:
    swarm = Swarm(6, lambda position: 0.0, 1, strategy=strategy, search_limit_s=150.0)
    swarm.run(300.0)
    assert swarm.order.stage is Stage.GIVE_UP
    assert swarm.order.source_ned_m is None
    assert 150.0 < swarm.now_s < 152.0


@pytest.mark.parametrize("seed", [0, 1])
def test_hybrid_drones_part_and_gather_around_the_first_contact(seed: int) -> None:
    plume = plume_of(seed)
    swarm = Swarm(5, plume, seed, strategy="locus-hybrid")
    swarm.run_until(Stage.SEARCH)
    apart_m = 0.0
    while swarm.order.stage is Stage.SEARCH:
        swarm.tick()
        places = [tuple(p.position) for p in swarm.points.values()]
        apart_m = max(apart_m, *(math.dist(a, b) for a, b in itertools.combinations(places, 2)))
    assert apart_m > 40.0, "a formation would be 20 m across"
    assert swarm.order.stage is Stage.FORM
    seats = dict(note_of(swarm.order).seats)
    away_m = [math.dist(p.position[:2], swarm.order.anchor_ned_m[:2]) for p in swarm.points.values()]
    assert [seats[drone] for drone in swarm.points] == np.argsort(np.argsort(away_m)).tolist()
    swarm.run(2500.0)
    assert error_m(swarm, plume) < 5.0


def test_hybrid_goes_on_without_its_root_and_its_caller() -> None:
    plume = plume_of(5)
    swarm = Swarm(6, plume, 5, strategy="locus-hybrid")
    swarm.run(40.0)
    swarm.lose(1)
    while swarm.order.stage is not Stage.FORM:
        swarm.tick()
    caller = min(swarm.points, key=lambda d: math.dist(swarm.points[d].position, swarm.order.anchor_ned_m))
    swarm.run(swarm.now_s + 60.0)
    swarm.lose(caller)
    swarm.run(3000.0)
    assert error_m(swarm, plume) < 5.0
    assert {drone for drone, _ in note_of(swarm.order).seats} == set(swarm.slots)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_sub_swarms_search_side_by_side_until_one_finds_the_source(seed: int) -> None:
    plume = plume_of(seed)
    swarm = Swarm(6, plume, seed, strategy="locus-multi", group=3, step_m=4.0)
    swarm.run_until(Stage.SEARCH)
    apart_m, until_s = 0.0, swarm.now_s + 60.0
    while swarm.now_s < until_s:
        swarm.tick()
        halves = [[swarm.points[d].position for d in half] for half in ((1, 2, 3), (4, 5, 6))]
        apart_m = max(apart_m, math.dist(*(np.mean(half, axis=0) for half in halves)))
    assert apart_m > 25.0  # they begin 30 m apart
    swarm.run(3000.0)
    assert error_m(swarm, plume) < 5.0
    stages = [order.stage for order in swarm.orders]
    assert stages[:3] == [Stage.FORM, Stage.SEARCH, Stage.TRACK]
    assert stages[-2:] == [Stage.TRACK, Stage.FOUND]
    assert len({order.anchor_ned_m for order in swarm.orders[:-1]}) == 1, (
        "the tree's root steers no sub-swarm"
    )


def test_a_sub_swarm_goes_on_without_its_first_drone() -> None:
    plume = plume_of(4)
    swarm = Swarm(6, plume, 4, strategy="locus-multi", group=3, step_m=4.0)
    swarm.run(60.0)
    swarm.lose(1, 5)
    swarm.run(3000.0)
    assert error_m(swarm, plume) < 5.0
