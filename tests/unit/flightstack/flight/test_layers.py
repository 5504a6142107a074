"""The altitudes of each drone: all different, far enough apart, under the ceiling."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightstack.config import FormationConfig, LimitsConfig
from flightstack.flight.layers import autopilots_above, ceiling_needed_m, highest_agent_m, layers_of

FORMATION, LIMITS = FormationConfig(), LimitsConfig(ceiling_above_home_m=120.0)


@given(st.lists(st.integers(1, 250), min_size=1, max_size=20, unique=True), st.floats(5.0, 20.0))
def test_no_two_drones_cross_at_one_altitude(members: list[int], gap_m: float) -> None:
    formation = FormationConfig(layer_gap_m=gap_m)
    limits = LimitsConfig(ceiling_above_home_m=ceiling_needed_m(len(members), formation))
    layers = [layers_of(drone, members, formation, limits) for drone in members]
    agents = [one.agent_above_home_m for one in layers]
    autopilots = [one.autopilot_above_home_m for one in layers]
    assert max(agents) == highest_agent_m(len(members), formation) < min(autopilots)
    assert max(autopilots) < limits.ceiling_above_home_m
    for a, b in itertools.pairwise(sorted([formation.above_home_m, *agents, *autopilots])):
        assert b - a == pytest.approx(gap_m)


@pytest.mark.parametrize(
    ("drones", "formation", "ceiling_m", "above"),
    [
        (9, FORMATION, 120.0, True),
        (11, FORMATION, 120.0, False),
        (4, FORMATION, 60.0, True),
        (5, FORMATION, 60.0, False),
        (5, FormationConfig(layers=4), 120.0, False),
        (5, FormationConfig(layers=8), 120.0, True),
    ],
)
def test_autopilots_come_home_above_the_agents_where_there_is_room(
    drones: int, formation: FormationConfig, ceiling_m: float, above: bool
) -> None:
    members, limits = range(1, drones + 1), LimitsConfig(ceiling_above_home_m=ceiling_m)
    assert autopilots_above(drones, formation, limits) is above
    layers = layers_of(drones, members, formation, limits)
    assert (layers.autopilot_above_home_m > highest_agent_m(drones, formation)) is above
    assert above or layers.autopilot_above_home_m == layers.agent_above_home_m


def test_with_fewer_layers_than_members_some_share_one() -> None:
    formation, members = FormationConfig(layers=2), (7, 8, 9)
    altitudes = [layers_of(drone, members, formation, LIMITS).agent_above_home_m for drone in members]
    assert altitudes == [15.0, 20.0, 15.0]
