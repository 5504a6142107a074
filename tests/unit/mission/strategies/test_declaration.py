"""How a reactive swarm ends: what is gathered, what the root orders, and that it is the same for a new root."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest

from mission.estimation.estimates import Reading, Scalar, Wind
from mission.geometry.formation import Hexagonal, IntArray
from mission.geometry.frames import Vector3
from mission.strategies import registry
from mission.strategies.contract import (
    Decision,
    Neighbour,
    Observation,
    Order,
    OwnState,
    Stage,
    Strategy,
    TreePlace,
)
from mission.strategies.declaration import DeclarationParameters
from mission.strategies.reactive import ReactiveStrategy, reactive_strategy
from mission.strategies.tick_rule import OwnSenses, TickRule

START: Vector3 = (0.0, 0.0, -20.0)
FORM = Order(3, Stage.FORM, START, 0.0)
SEARCH = Order(4, Stage.SEARCH, START, 0.0, apart=True)
SOURCE = (40.0, -10.0)
WIND = Wind((-3.0, 0.0, 0.0), 0.1, 0.1)
"""To the south."""


class PaceParameters(msgspec.Struct, frozen=True):
    pace_mps: float = 1.0


def pace(
    own: OwnSenses, neighbours: Any, count: int, ranges_m: Any, state: Any, word: Any, parameters: Any
) -> tuple[float, float]:
    return parameters[0], 0.0


RULE = TickRule(rule=pace, parameters=PaceParameters, range_m=20.0)
ENTRY = reactive_strategy("pace", RULE)


@pytest.fixture(autouse=True)
def _registered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(registry.BUILT_IN, "pace", ENTRY)


def make(**parameters: Any) -> Strategy:
    return registry.make("pace", layout=Hexagonal(10.0), **parameters)


def excess_ppm(north_m: float, east_m: float) -> float:
    downwind, across = SOURCE[0] - north_m, east_m - SOURCE[1]
    width2 = 16.0 + (0.1 * max(downwind, 0.0)) ** 2
    return 900.0 * 16.0 / width2 * math.exp(-0.5 * (across**2 + min(downwind, 0.0) ** 2) / width2)


def place(drone: int, root: int = 1) -> TreePlace:
    return TreePlace(1, drone - 1, {1: 0, 2: 1, 3: 2}, None, (), None, None, root, False)


def state(drone: int, position_ned_m: Vector3, excess: float) -> OwnState:
    return OwnState(drone, position_ned_m, (0.0, 0.0, 0.0), Scalar(excess, 16.0, 0.1), WIND, 0.9)


def neighbour(drone: int, position_ned_m: Vector3, excess: float, **changes: Any) -> Neighbour:
    return msgspec.structs.replace(
        Neighbour(drone, position_ned_m, (0.0, 0.0, 0.0), 0.2, True, Scalar(excess, 16.0, 0.1), WIND),
        **changes,
    )


def positions(second: int) -> list[Vector3]:
    """Three drones abreast that weave upwind, past the source."""
    north_m, east_m = -20.0 + 0.4 * second, 14.0 * math.sin(second / 9.0)
    return [(north_m, east_m - 10.0 + 8.0 * number, -20.0) for number in (-1, 0, 1)]


def flown(
    strategy: Strategy, drone: int, seconds: range, order: Order, *, root: int = 1, gas: float = 1.0
) -> tuple[list[Decision], Order]:
    """What `drone` decides, once a second, while everybody hears everybody; its orders are carried out."""
    decisions, noise = [], np.random.default_rng(5)
    rng = np.random.default_rng(drone)
    for second in seconds:
        at = positions(second)
        read = [gas * excess_ppm(*spot[:2]) + 4.0 * noise.normal() for spot in at]
        others = tuple(neighbour(n + 1, at[n], read[n]) for n in range(3) if n + 1 != drone)
        own = state(drone, at[drone - 1], read[drone - 1])
        seen = Observation(float(second), own, others, place(drone, root), order, ())
        decisions.append(strategy.decide(seen, rng))
        order = decisions[-1].order or order
        if order.stage.ends_survey:
            break
    return decisions, order


def test_the_root_orders_the_search_the_contact_and_the_end_with_its_variance() -> None:
    decisions, found = flown(make(), 1, range(400), FORM)
    stages = [decision.order.stage for decision in decisions if decision.order is not None]
    assert stages == [Stage.SEARCH, Stage.TRACK, Stage.FOUND]
    assert found.sequence == FORM.sequence + 3
    assert found.apart
    assert found.source_ned_m is not None
    assert found.source_sd_m is not None
    assert found.source_ned_m[2] == START[2]
    assert 5.0 <= found.source_sd_m <= math.hypot(5.0, 5.0)
    assert math.dist(found.source_ned_m[:2], SOURCE) <= 2.0 * found.source_sd_m
    assert all(decision.reading is None for decision in decisions)


def test_others_give_no_orders_and_a_new_root_goes_on_from_what_it_has_heard() -> None:
    heir = make()
    decisions, _ = flown(heir, 2, range(150), SEARCH)
    assert all(decision.order is None for decision in decisions)
    decisions, found = flown(heir, 2, range(150, 400), SEARCH, root=2)
    assert found.stage is Stage.FOUND
    assert found.source_ned_m is not None
    assert found.source_sd_m is not None
    assert math.dist(found.source_ned_m[:2], SOURCE) <= 2.0 * found.source_sd_m
    without, _ = flown(make(), 2, range(150, 400), SEARCH, root=2)
    assert len(decisions) < len(without)


def test_clean_air_is_never_a_source_and_the_search_ends_with_its_time() -> None:
    decisions, order = flown(make(given_up_after_s=120.0), 1, range(400), FORM, gas=0.0)
    stages = [decision.order.stage for decision in decisions if decision.order is not None]
    assert stages == [Stage.SEARCH, Stage.GIVE_UP]
    assert order.source_ned_m is None
    assert len(decisions) == 122


def test_an_area_that_holds_no_source_is_given_up_before_the_time_is_over() -> None:
    strategy, order, elapsed_s = make(source_within_m=20.0), SEARCH, 0.0
    rng = np.random.default_rng(0)
    for _ in range(3):
        for north_m in range(-24, 25, 4):
            for east_m in range(-24, 25, 4):
                elapsed_s += 1.0
                own = state(1, (float(north_m), float(east_m), -20.0), 0.0)
                seen = Observation(elapsed_s, own, (), place(1), order, ())
                order = strategy.decide(seen, rng).order or order
    assert order.stage is Stage.GIVE_UP


def test_whom_the_root_does_not_hear_tells_its_reading_up_the_tree() -> None:
    far, near = make(), make()
    rng = np.random.default_rng(0)
    own = state(3, (0.0, 5.0, -20.0), 70.0)
    root = neighbour(1, (0.0, 0.0, -20.0), 0.0)
    alone = far.decide(Observation(1.0, own, (), place(3), SEARCH, ()), rng)
    assert alone.reading == Reading(3, SEARCH.sequence, own.position_ned_m, 70.0, 16.0)
    assert near.decide(Observation(1.0, own, (root,), place(3), SEARCH, ()), rng).reading is None
    faint = neighbour(1, (0.0, 0.0, -20.0), 0.0, age_s=9.0)
    assert near.decide(Observation(2.0, own, (faint,), place(3), SEARCH, ()), rng).reading is not None


def test_what_comes_up_the_tree_counts_once_and_only_of_those_that_are_not_heard() -> None:
    def track(reading: Reading, *others: Neighbour, times: int = 5) -> int:
        strategy, contacts = make(), 0
        for second in range(times):
            seen = Observation(float(second), state(1, START, 0.0), others, place(1), SEARCH, (reading,))
            order = strategy.decide(seen, np.random.default_rng(0)).order
            contacts += order is not None and order.stage is Stage.TRACK
        assert isinstance(strategy, ReactiveStrategy)
        weights: IntArray = strategy._declaration._evidence.changes
        return int(weights.sum()) * 10 + (contacts > 0)

    told = Reading(3, SEARCH.sequence, (50.0, 0.0, -20.0), 80.0, 16.0)
    assert track(told) == (5 + 1) * 10 + 1  # its own five, and the one that was told
    heard = neighbour(3, (50.0, 0.0, -20.0), 0.0)
    assert track(told, heard) == (5 + 5) * 10
    assert track(msgspec.structs.replace(told, variance_ppm2=math.inf)) == 5 * 10


@pytest.mark.parametrize(
    "changes",
    [
        {"airborne": False},
        {"adrift": True},
        {"age_s": 1.9},
        {"excess_co2_ppm": None},
        {"excess_co2_ppm": Scalar(500.0, 16.0, 30.0)},
        {"excess_co2_ppm": Scalar(500.0, math.inf, 0.1)},
    ],
    ids=str,
)
def test_what_is_old_or_of_no_flying_drone_is_no_contact(changes: dict[str, Any]) -> None:
    strategy = make()
    other = neighbour(2, (5.0, 5.0, -20.0), 500.0, **changes)
    for second in range(5):
        seen = Observation(float(second), state(1, START, 0.0), (other,), place(1), SEARCH, ())
        assert strategy.decide(seen, np.random.default_rng(0)).order is None


def test_flights_have_the_shared_parameters_and_trials_the_rules_own() -> None:
    with pytest.raises(ValueError, match="no parameter 'sd'; it has pace_mps, declared_sd_m"):
        make(sd=1.0)
    with pytest.raises(ValueError, match="strategy pace: declared_sd_m: Expected `float` > 0"):
        make(declared_sd_m=0.0)
    with pytest.raises(ValueError, match=r"no parameter 'declared_sd_m'; it has pace_mps$"):
        registry.checked(ENTRY, {"declared_sd_m": 1.0})
    assert isinstance(make(pace_mps=2.0, declared_sd_m=1.0), ReactiveStrategy)


def test_a_rule_cannot_have_a_parameter_of_the_same_name() -> None:
    class Twice(msgspec.Struct):
        declared_sd_m: float = 1.0

    with pytest.raises(TypeError, match="its rule has a parameter declared_sd_m, which every reactive"):
        reactive_strategy("twice", TickRule(rule=pace, parameters=Twice, range_m=5.0))
    assert DeclarationParameters().declared_sd_m == 5.0
