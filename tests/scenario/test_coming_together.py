"""A swarm that somebody leaves in good order, and drones that come back to it in the air."""

from __future__ import annotations

import pytest

from flightstack.mavlink.modes import Duty, Flavour, mode_of
from flightstack.swarm.wire import CommandName, Phase
from tests.scenario.test_survey_flights import all_landed, assert_found, scenario

SURVEYING = {Phase.SEARCHING, Phase.TRACKING}


def test_who_leaves_hovers_until_its_heir_has_its_slot() -> None:
    flight = scenario(seed=9)
    flight.run(45.0)
    held = flight.tables[2].held
    root = flight.members[1]
    root.vehicle.drop_battery_to(0.24)
    assert flight.run_until(lambda: root.agent.phase.phase is Phase.LEAVING, 10.0)
    began_s = flight.now_s
    assert flight.run_until(lambda: root.agent.phase.phase is not Phase.LEAVING, 20.0)
    assert root.agent.phase.phase is Phase.RETURNING
    assert flight.now_s - began_s < 5.0
    assert held[1] in flight.tables[2].held.values(), "its heir has it before it goes"
    assert 1 not in flight.tables[2].held
    assert_found(flight)


@pytest.mark.parametrize("still_s", [2.5, 6.0])
def test_a_px4_that_wakes_after_its_slot_was_given_away_joins_again(still_s: float) -> None:
    """By its own failsafe it was on its way home, and it comes back to whoever sends setpoints."""
    flight = scenario(flavour="px4", seed=13)
    flight.run(45.0)
    held = flight.tables[2].held
    root = flight.members[1]
    flight.freeze(1)
    flight.run(still_s)
    assert 1 not in flight.tables[2].held
    assert root.vehicle.mode == "RTL"
    flight.thaw(1)
    assert flight.run_until(lambda: sorted(flight.tables[2].held) == [1, 2, 3, 4, 5], 10.0)
    assert root.vehicle.mode == "OFFBOARD"
    assert flight.tables[2].held[4] == held[1], "its heir keeps the root's slot"
    assert flight.run_until(lambda: flight.phases() <= SURVEYING and not flight.states[1].healing, 90.0)
    assert_found(flight)
    assert not [e.text for _, e in flight.events if e.sender == 1 and e.code == "pilot"]


def test_an_agent_that_was_restarted_in_the_air_joins_again_when_the_operator_resumes_it() -> None:
    flight = scenario(seed=14)
    flight.run(45.0)
    flight.kill(3)
    flight.run(10.0)
    flight.start_again(3)
    flight.run(5.0)
    assert flight.members[3].agent.phase.phase is Phase.DISARMED, "nobody has given it the vehicle"
    assert flight.members[3].vehicle.airborne
    flight.command(CommandName.RESUME, 3)
    assert flight.run_until(lambda: flight.members[3].agent.phase.phase in SURVEYING, 90.0)
    assert all(sorted(table.held) == [1, 2, 3, 4, 5] for table in flight.tables.values())
    assert len({table.survey for table in flight.tables.values()}) == 1
    assert_found(flight)


def test_a_pilot_who_gives_it_back_after_it_was_replaced_has_it_in_a_free_slot() -> None:
    flight = scenario(seed=5)
    flight.run(45.0)
    flight.members[1].vehicle.switch_mode(mode_of(Flavour.ARDUPILOT, Duty.HOLD))
    assert flight.run_until(lambda: flight.members[1].agent.phase.phase is Phase.PILOT, 5.0)
    assert flight.run_until(lambda: 1 not in flight.tables[2].held, 5.0)
    flight.run(10.0)
    flight.command(CommandName.RESUME, 1)
    assert flight.run_until(lambda: flight.members[1].agent.phase.phase in SURVEYING, 90.0)
    assert sorted(flight.tables[2].held) == [1, 2, 3, 4, 5]
    flight.command(CommandName.ABORT)
    assert flight.run_until(lambda: all_landed(flight), 200.0)
    assert flight.min_separation_m > 4.0
