"""Which of the agents with one drone's number speaks for it."""

from __future__ import annotations

import msgspec
import pytest

from flightstack.swarm.incarnations import SPEAKS_S, TWINS_S, Incarnations
from flightstack.swarm.wire import DroneState, Phase

FLYING = DroneState(
    2, 1, 1, 77, Phase.SEARCHING, (1.0, 2.0, -10.0), (0.5, 0.0, 0.0), 0.0, None, True, True, "GUIDED", 0.9,
    450.0, None, None, 0, 1, 1, False, None, ticks=5000,
)  # fmt: skip


def state(incarnation: int, sequence: int, *, ticks: int = 0, flies: bool = False) -> DroneState:
    phase = Phase.SEARCHING if flies else Phase.DISARMED
    return msgspec.structs.replace(
        FLYING,
        incarnation=incarnation,
        sequence=sequence,
        ticks=ticks,
        phase=phase,
        airborne=flies,
        armed=flies,
    )


@pytest.fixture
def agents() -> Incarnations:
    return Incarnations()


def speaker(agents: Incarnations) -> int:
    assert agents.speaker is not None
    return agents.speaker.incarnation


def test_a_restarted_agent_speaks_once_the_old_one_is_silent(agents: Incarnations) -> None:
    assert agents.hear(0.0, state(1, 50, ticks=900, flies=True))
    assert not agents.hear(SPEAKS_S / 2, state(2, 1))
    assert agents.hear(SPEAKS_S, state(2, 2))
    assert (speaker(agents), agents.restarts) == (2, 0)
    assert not agents.has_twins(SPEAKS_S)


def test_one_that_was_silent_and_speaks_again_counts(agents: Incarnations) -> None:
    agents.hear(0.0, state(1, 1))
    assert agents.hear(2.0, state(2, 1))
    assert agents.restarts == 1
    assert agents.hear(4.0, state(1, 2))
    assert speaker(agents) == 1


def test_late_and_repeated_states_of_anybody_count_nothing(agents: Incarnations) -> None:
    agents.hear(0.0, state(1, 5))
    assert not agents.hear(0.1, state(1, 5))
    assert not agents.hear(0.1, state(1, 4))
    agents.hear(2.0, state(2, 1))
    assert not agents.hear(2.1, state(1, 5))
    assert (speaker(agents), agents.clashes) == (2, 0)


@pytest.mark.parametrize("twin_first", [False, True])
def test_while_two_talk_the_one_that_flies_speaks_then_the_one_that_runs_for_longer(
    agents: Incarnations, twin_first: bool
) -> None:
    for turn in range(20):
        now_s = 0.2 * turn
        flies = turn >= 10
        older, younger = state(7, turn, ticks=500), state(3, turn, ticks=20, flies=flies)
        for told in (younger, older) if twin_first else (older, younger):
            agents.hear(now_s, told)
        assert speaker(agents) == (3 if flies else 7)
    assert agents.has_twins(now_s)
    assert not agents.has_twins(now_s + TWINS_S + 0.1)


def test_late_messages_of_an_agent_that_was_replaced_make_no_twins(agents: Incarnations) -> None:
    agents.hear(0.0, state(1, 1))
    agents.hear(1.0, state(2, 1))
    agents.hear(1.05, state(1, 2))
    for turn in range(20):
        agents.hear(1.2 + 0.2 * turn, state(2, 2 + turn))
        assert not agents.has_twins(1.2 + 0.2 * turn)
    assert speaker(agents) == 2


def test_any_number_of_incarnations_is_survived(agents: Incarnations) -> None:
    for number in range(1000):
        agents.hear(0.01 * number, state(number, 1))
    assert agents.hear(20.0, state(5000, 1))
