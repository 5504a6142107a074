"""A lattice in flight: seven points that go where they are told, in a plume that is known exactly."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from mission.estimation.estimates import Reading, Scalar, Wind
from mission.geometry.formation import Hexagonal
from mission.geometry.frames import Vector3
from mission.strategies.contract import (
    Decision,
    GoTo,
    Hold,
    Neighbour,
    Observation,
    Order,
    OwnState,
    Stage,
    TreePlace,
)
from mission.strategies.lattice import lattice_rule as rule
from mission.strategies.lattice.lattice_note import LatticeNote, lattice_note, with_lattice_note
from mission.strategies.registry import make

START: Vector3 = (100.0, -50.0, -20.0)
SOURCE = (160.0, -60.0)
TICK_S = 0.5
FORM = Order(3, Stage.FORM, START, 0.0)


def plume_ppm(north_m: float, east_m: float) -> float:
    """Downwind to the south, growing wider."""
    south_m, across_m = SOURCE[0] - north_m, east_m - SOURCE[1]
    if south_m < 0.0:
        return 900.0 * math.exp(-(south_m**2 + across_m**2) / 200.0)
    width_m = 10.0 + 0.15 * south_m
    return 900.0 * (10.0 / width_m) ** 2 * math.exp(-0.5 * (across_m / width_m) ** 2)


class Swarm:
    """Drones 1 to `drones` in slots 0 to `drones` - 1; drone 1 is the root until it is lost."""

    def __init__(self, strategy: str, drones: int = 7, **parameters: object) -> None:
        self.strategy, self.parameters = strategy, parameters
        self.place: dict[int, Vector3] = {
            drone: (START[0] + 9.0 * math.cos(drone), START[1] + 9.0 * math.sin(drone), START[2])
            for drone in range(1, drones + 1)
        }
        self.flown = {drone: self._made() for drone in self.place}
        self.slots = {drone: drone - 1 for drone in self.place}
        self.order: Order = FORM
        self.readings: dict[tuple[int, int], Reading] = {}
        self.targets: dict[int, Vector3] = {}
        self.velocity: dict[int, Vector3] = dict.fromkeys(self.place, (0.0, 0.0, 0.0))
        self.time_s = 0.0
        self.wind: Wind | None = Wind((-4.0, 0.0, 0.0), 0.1, 0.1)
        self.rng = np.random.default_rng(3)

    def _made(self):  # type: ignore[no-untyped-def]
        return make(self.strategy, layout=Hexagonal(8.0), **self.parameters)

    def lose(self, drone: int) -> None:
        """The last slot's holder takes over the slot, as an heir does."""
        slot = self.slots.pop(drone)
        last = max(self.slots, key=self.slots.__getitem__)
        if self.slots[last] > slot:
            self.slots[last] = slot
        del self.place[drone], self.flown[drone]
        self.targets.pop(drone, None)

    def own(self, drone: int) -> OwnState:
        ppm = plume_ppm(*self.place[drone][:2])
        return OwnState(drone, self.place[drone], self.velocity[drone], Scalar(ppm, 1.0, 0.1), self.wind, 0.9)

    def decide(self, drone: int) -> Decision:
        root = min(self.slots, key=self.slots.__getitem__)
        others = tuple(
            Neighbour(other, place, self.velocity[other], 0.1, airborne=True, wind=self.own(other).wind)
            for other, place in self.place.items()
            if other != drone
        )
        tree = TreePlace(1, self.slots[drone], self.slots, None, (), None, None, root, False)
        readings = [one for (sequence, _), one in self.readings.items() if sequence == self.order.sequence]
        seen = Observation(
            self.time_s, self.own(drone), others, tree, self.order, tuple(readings if drone == root else ())
        )
        return self.flown[drone].decide(seen, self.rng)

    def tick(self) -> None:
        order = self.order
        for drone in list(self.place):
            decision = self.decide(drone)
            if decision.reading is not None:
                self.readings[decision.reading.order, drone] = decision.reading
            if decision.order is not None:
                order = decision.order
            assert isinstance(decision.intent, GoTo)
            self.targets[drone] = decision.intent.position_ned_m
        self.order = order
        for drone, target in self.targets.items():
            away = np.subtract(target, self.place[drone])
            share = min(1.0, 4.0 * TICK_S / max(float(np.linalg.norm(away)), 1e-9))
            self.velocity[drone] = tuple((share * away / TICK_S).tolist())  # type: ignore[assignment]
            self.place[drone] = tuple((np.array(self.place[drone]) + share * away).tolist())  # type: ignore[assignment]
        self.time_s += TICK_S

    def fly(self, most_s: float) -> Order:
        while not self.order.stage.ends_survey and self.time_s < most_s:
            self.tick()
        return self.order


@pytest.mark.parametrize("strategy", ["lattice-chemotaxis", "lattice-fluxotaxis"])
def test_a_lattice_declares_the_source_that_it_has_traced(strategy: str) -> None:
    order = Swarm(strategy, patience=16).fly(1200.0)
    assert order.stage is Stage.FOUND
    assert order.source_ned_m is not None
    assert math.dist(order.source_ned_m[:2], SOURCE) < 16.0


@pytest.mark.parametrize("strategy", ["lattice-anemotaxis", "lattice-fluxotaxis"])
def test_who_goes_by_the_wind_declares_nothing_without_one(strategy: str) -> None:
    swarm = Swarm(strategy, patience=16, search_limit_s=600.0)
    swarm.wind = None
    assert swarm.fly(700.0).stage is Stage.GIVE_UP


def test_the_ring_stands_evenly_about_the_root_and_closes_when_one_is_lost() -> None:
    swarm = Swarm("lattice-casting")
    for _ in range(20):
        swarm.tick()
    swarm.lose(3)
    for _ in range(20):
        swarm.tick()
        note = lattice_note(swarm.order)
        assert note is not None
        for drone in swarm.place:
            swarm.targets[drone] = swarm.decide(drone).intent.position_ned_m  # type: ignore[union-attr]
        centre = swarm.order.anchor_ned_m
        ring = [target for drone, target in swarm.targets.items() if drone != 1]
        assert [math.dist(centre, place) for place in ring] == pytest.approx([note.state[rule.RADIUS_M]] * 5)
        apart_m = sorted(math.dist(a, b) for k, a in enumerate(ring) for b in ring[:k])
        side_m = 2.0 * note.state[rule.RADIUS_M] * math.sin(math.pi / 5.0)
        assert apart_m[:5] == pytest.approx([side_m] * 5)
    assert swarm.order.apart


def test_an_heir_goes_on_where_the_root_was_lost() -> None:
    swarm = Swarm("lattice-fluxotaxis", patience=16)
    swarm.fly(120.0)
    before = swarm.order
    swarm.lose(1)
    swarm.tick()
    assert swarm.order.sequence in (before.sequence, before.sequence + 1)
    assert swarm.fly(1400.0).stage is Stage.FOUND
    assert swarm.order.source_ned_m is not None
    assert math.dist(swarm.order.source_ned_m[:2], SOURCE) < 16.0


def test_without_a_source_the_search_is_given_up_in_time_and_stays_in_its_square() -> None:
    swarm = Swarm(
        "lattice-fluxotaxis", start_ned_m=[-300.0, 0.0, -20.0], search_radius_m=60.0, search_limit_s=400.0
    )
    swarm.fly(200.0)
    while not swarm.order.stage.ends_survey and swarm.time_s < 500.0:
        swarm.tick()
        north_m, east_m, _ = swarm.order.anchor_ned_m
        assert max(abs(north_m + 300.0), abs(east_m)) <= 52.0 + 1e-9
    assert swarm.order.stage is Stage.GIVE_UP


@pytest.mark.parametrize(
    ("reading", "wind"),
    [
        ({"excess_co2_ppm": math.nan}, {}),
        ({"excess_co2_ppm": 1e300}, {}),
        ({"excess_co2_ppm": -5.0, "variance_ppm2": math.nan}, {}),
        ({"excess_co2_ppm": 1e9}, {"wind_ned_mps": (1e300, 0.0, 0.0)}),
        ({"position_ned_m": (math.nan, 0.0, 0.0)}, {"wind_ned_mps": (math.nan, 0.0, 0.0)}),
    ],
    ids=str,
)
def test_what_cannot_be_leads_the_lattice_nowhere(
    reading: dict[str, object], wind: dict[str, object]
) -> None:
    swarm = Swarm("lattice-fluxotaxis")
    swarm.fly(30.0)
    honest = swarm.own

    def own(drone: int) -> OwnState:
        state = honest(drone)
        assert state.wind is not None
        return (
            msgspec.structs.replace(state, wind=msgspec.structs.replace(state.wind, **wind))
            if drone == 4
            else state
        )

    swarm.own = own  # type: ignore[method-assign]
    before = swarm.order.sequence
    while swarm.time_s < 150.0:
        swarm.tick()
        for key, told in swarm.readings.items():
            if key[1] == 4:
                swarm.readings[key] = msgspec.structs.replace(told, **reading)
        north_m, east_m, _ = swarm.order.anchor_ned_m
        assert math.hypot(north_m - START[0], east_m - START[1]) < 300.0
    assert swarm.order.sequence > before + 3


def test_before_the_first_order_members_hold_and_the_root_forms_the_lattice_where_it_is() -> None:
    swarm = Swarm("lattice-casting")
    seen = Observation(
        0.0, swarm.own(2), (), TreePlace(1, 1, swarm.slots, 1, (), None, None, 1, False), None, ()
    )
    assert swarm.flown[2].decide(seen, swarm.rng) == Decision(Hold())
    root = msgspec.structs.replace(seen, own=swarm.own(1))
    decision = swarm.flown[1].decide(root, swarm.rng)
    assert decision.order is not None
    assert decision.order.anchor_ned_m == pytest.approx(swarm.place[1])


@pytest.mark.parametrize(
    "broken",
    [
        {"start_ned_m": (math.nan, 0.0, 0.0)},
        {"state": (0.0,)},
        {"state": (math.inf,) * rule.LATTICE_STATE},
        {"best": Reading(1, 1, (0.0, 0.0, 0.0), math.nan, 1.0)},
        {"waypoints_since_best": -1},
    ],
    ids=str,
)
def test_a_note_that_says_what_cannot_be_is_none(broken: dict[str, object]) -> None:
    note = LatticeNote((0.0, 0.0, 0.0), (0.0,) * rule.LATTICE_STATE)
    order = with_lattice_note(FORM, note)
    assert lattice_note(order) == note
    fields = msgspec.structs.asdict(note) | broken
    data = msgspec.msgpack.encode(["lattice", *fields.values()])
    assert lattice_note(msgspec.structs.replace(order, note=data)) is None
