"""States are those of going straight on, whoever asks for them in which order, and going back costs little."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.geometry.formation import FloatArray
from simvehicle.world.flow_states import FlowStates


class Counted:
    """State k is (k, how many steps led to it); counts how often it was advanced."""

    def __init__(self) -> None:
        self.steps = 0

    def first(self) -> FloatArray:
        return np.array([-5.0, 0.0])

    def following(self, state: FloatArray, index: int) -> FloatArray:
        self.steps += 1
        assert index == state[0] + 1.0
        return np.array([float(index), state[1] + 1.0])

    def states(self) -> FlowStates:
        return FlowStates(self.first, self.following, begin=-5)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.integers(-5, 5000), min_size=1, max_size=12))
def test_any_order_gives_the_states_of_going_straight_on(indices: list[int]) -> None:
    states = Counted().states()
    for index in indices:
        assert states.at(index).tolist() == [float(index), index + 5.0]


def test_two_who_ask_for_times_not_far_apart_cost_no_more_than_one() -> None:
    counted = Counted()
    states = counted.states()
    for index in range(3000):
        states.at(index)
        states.at(max(index - 200, 0))
    assert counted.steps == 2999 + 5


def test_going_far_back_starts_at_a_mark_and_not_at_the_beginning() -> None:
    counted = Counted()
    states = counted.states()
    states.at(20_000)
    before = counted.steps
    states.at(10_100)
    assert counted.steps - before < 2000
    assert len(states._marks) <= 33


def test_large_states_are_kept_in_little_memory() -> None:
    states = FlowStates(lambda: np.zeros(1_000_000), lambda state, _: state, begin=0)
    states.at(5000)
    assert 8e6 * (len(states._marks) + len(states._recent)) < 2.2 * (64 << 20)
    assert len(states._recent) >= 4
