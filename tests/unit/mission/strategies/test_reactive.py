"""A rule in flight: what an observation becomes, and what a decision says."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.estimation.estimates import Scalar, Wind
from mission.geometry.formation import Hexagonal
from mission.strategies.contract import (
    Decision,
    Hold,
    Neighbour,
    Observation,
    Order,
    OwnState,
    Stage,
    Strategy,
    TreePlace,
    Velocity,
)
from mission.strategies.reactive import beam_ranges, reactive_strategy
from mission.strategies.tick_rule import WORD, OwnSenses, TickRule, numbers

SEEN: list[dict[str, Any]] = []


class EchoParameters(msgspec.Struct, frozen=True):
    speed_mps: float = 2.0
    hops: int = 3


def echo(
    own: OwnSenses, neighbours: Any, count: int, ranges_m: Any, state: Any, word: Any, parameters: Any
) -> tuple[float, float]:
    """Note what is given; remember and say how often it was called."""
    SEEN.append(
        {
            "own": own,
            "neighbours": neighbours[:count].copy(),
            "ranges_m": ranges_m.copy(),
            "state": state.copy(),
            "word": word.copy(),
            "parameters": parameters.copy(),
        }
    )
    state[0] += 1.0
    word[0] = state[0]
    return parameters[0], -1.0


RULE = TickRule(rule=echo, parameters=EchoParameters, range_m=20.0, state_size=1, word_size=1, beams=4)
PLACE = TreePlace(1, 0, {1: 0}, None, (), None, None, 1, False)
ORDER = Order(1, Stage.SEARCH, (100.0, 50.0, -20.0), 0.0)


@pytest.fixture(autouse=True)
def _nothing_seen() -> None:
    SEEN.clear()


def make() -> Strategy:
    entry = reactive_strategy("echo", RULE)
    assert entry.make is not None
    return entry.make(Hexagonal(10.0), EchoParameters())


def own(**changes: Any) -> OwnState:
    usual = OwnState(
        1,
        (103.0, 54.0, -18.0),
        (1.0, 2.0, 0.0),
        Scalar(90.0, 4.0, 0.1),
        Wind((3.0, -1.0, 0.0), 0.1, 0.1),
        0.9,
    )
    return msgspec.structs.replace(usual, **changes)


def neighbour(**changes: Any) -> Neighbour:
    return msgspec.structs.replace(
        Neighbour(2, (108.0, 42.0, -18.0), (0.0, 1.0, 0.0), 0.2, airborne=True), **changes
    )


def decide(
    strategy: Strategy, elapsed_s: float = 5.0, *, me: OwnState | None = None, **changes: Any
) -> Decision:
    seen = Observation(elapsed_s, me or own(), (), PLACE, ORDER, ())
    return strategy.decide(msgspec.structs.replace(seen, **changes), np.random.default_rng(1))


def test_an_observation_becomes_the_rules_arguments() -> None:
    strategy = make()
    decide(strategy, 5.0, neighbours=(neighbour(),), ranges_m=((0.1, 7.0), (math.pi, 3.0), (3.0, 2.5)))
    decide(strategy, 5.25)
    first, second = SEEN
    draw = np.random.default_rng(1).random()
    assert first["own"] == OwnSenses(3.0, 4.0, 1.0, 2.0, 90.0, 3.0, -1.0, 5.0, 0.1, draw)
    np.testing.assert_array_equal(first["neighbours"], [[5.0, -12.0, -1.0, -1.0, 0.0]])
    np.testing.assert_array_equal(first["ranges_m"], [7.0, math.inf, 2.5, math.inf])
    np.testing.assert_array_equal(first["parameters"], [2.0, 3.0])
    assert (first["state"][0], second["state"][0]) == (0.0, 1.0)
    assert (first["word"][0], second["word"][0]) == (0.0, 1.0)
    assert second["own"].interval_s == pytest.approx(0.25)


def test_its_velocity_and_word_become_a_decision() -> None:
    decision = decide(make())
    assert decision.intent == Velocity((2.0, -1.0, -1.0))  # 2 m below the swarm's height: up
    SEEN.clear()
    decide(make(), neighbours=(neighbour(word=decision.word),))
    assert SEEN[0]["neighbours"][0, WORD] == 1.0


def test_before_the_first_order_it_holds() -> None:
    assert decide(make(), order=None) == Decision(Hold())
    assert not SEEN


@pytest.mark.parametrize(
    "away",
    [
        {"airborne": False},
        {"adrift": True},
        {"age_s": 5.0},
        {"position_ned_m": (124.0, 54.0, -18.0)},
    ],
    ids=lambda change: next(iter(change)),
)
def test_who_is_not_there_is_not_shown(away: dict[str, Any]) -> None:
    decide(make(), neighbours=(neighbour(**away),))
    assert len(SEEN[0]["neighbours"]) == 0


@given(st.binary(max_size=60))
@settings(deadline=None, max_examples=200)
def test_whatever_a_neighbour_says_no_rule_is_given_what_is_no_number(word: bytes) -> None:
    SEEN.clear()
    decide(make(), neighbours=(neighbour(word=word),))
    assert np.isfinite(SEEN[0]["neighbours"]).all()


def test_a_word_of_another_strategy_or_of_no_numbers_is_none() -> None:
    for word in (["other", [4.0]], ["echo", [4.0, 5.0]], ["echo", [math.nan]], ["echo", [math.inf]], [1], {}):
        SEEN.clear()
        decide(make(), neighbours=(neighbour(word=msgspec.msgpack.encode(word)),))
        assert SEEN[0]["neighbours"][0, WORD] == 0.0, word


@pytest.mark.parametrize(
    ("co2", "gas"),
    [
        (None, 0.0),
        (Scalar(7.9, 4.0, 0.1), 0.0),
        (Scalar(8.1, 4.0, 0.1), 8.1),
        (Scalar(math.nan, 4.0, 0.1), 0.0),
        (Scalar(90.0, math.nan, 0.1), 0.0),
    ],
)
def test_only_a_trustworthy_excess_is_contact(co2: Scalar | None, gas: float) -> None:
    decide(make(), me=own(excess_co2_ppm=co2, wind=None))
    assert SEEN[0]["own"].gas == gas
    assert (SEEN[0]["own"].wind_north_mps, SEEN[0]["own"].wind_east_mps) == (0.0, 0.0)


def test_beams_take_the_nearest_of_their_sector() -> None:
    given_ = ((-0.2, 9.0), (0.2, 8.0), (1.5, math.inf), (4.7, math.nan), (3.3, 4.0))
    np.testing.assert_array_equal(beam_ranges(given_, 4), [8.0, math.inf, 4.0, math.inf])
    assert beam_ranges(given_, 0).shape == (0,)


def test_a_rule_takes_numbers_only_and_a_real_range() -> None:
    class Words(msgspec.Struct):
        name: str = "x"

    with pytest.raises(TypeError, match="parameter name of a rule must be a number, not 'x'"):
        TickRule(rule=echo, parameters=Words, range_m=5.0)
    with pytest.raises(ValueError, match="range must be above 0 m, not 0"):
        TickRule(rule=echo, parameters=EchoParameters, range_m=0.0)
    assert numbers(EchoParameters()).tolist() == [2.0, 3.0]
