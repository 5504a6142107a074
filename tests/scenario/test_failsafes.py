"""What the autopilot does on its own account in a survey: a failsafe is no pilot, and the agent follows it down."""

from __future__ import annotations

import pytest

from flightstack.mavlink.modes import Duty, Flavour, mode_of
from flightstack.swarm.wire import CommandName, Phase
from simvehicle.scenario.swarm import Member, Scenario
from tests.scenario.test_survey_flights import all_landed, scenario

LEAF = 5
OUT_OF_WORDS_S = 12.0


def frozen(flight: Scenario, seconds: float) -> Member:
    """Nothing of what the autopilot says meanwhile reaches the agent, nor is anything sent."""
    member = flight.members[LEAF]
    flight.kill(LEAF)
    flight.run(seconds)
    member.alive = True
    return member


def phases_until_landed(flight: Scenario, member: Member, limit_s: float = 120.0) -> list[Phase]:
    """The phases that an agent passes through until its drone is down, in their order."""
    seen = [member.agent.phase.phase]

    def landed() -> bool:
        phase = member.agent.phase.phase
        if phase is not seen[-1]:
            seen.append(phase)
        return phase is Phase.LANDED

    assert flight.run_until(landed, limit_s), seen
    return seen


@pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
def test_a_landing_by_the_autopilots_failsafe_is_followed_to_the_ground(flavour: str) -> None:
    flight = scenario(flavour=flavour, seed=11)
    flight.run(45.0)
    member = flight.members[LEAF]
    member.vehicle.set_gps(False)
    assert flight.run_until(lambda: member.vehicle.mode == "LAND", 20.0)
    seen = phases_until_landed(flight, member)
    assert Phase.PILOT not in seen
    assert Phase.LANDING in seen
    told = [e.text for _, e in flight.events if e.sender == LEAF and e.code == "failsafe"]
    assert len(told) == 1, "who took it is told once"
    assert told[0].startswith("landing: failsafe of the autopilot: ")
    assert not [e.text for _, e in flight.events if e.sender == LEAF and e.code == "pilot"]
    assert LEAF not in flight.tables[1].held


@pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
def test_an_agent_that_wakes_while_its_vehicle_is_brought_home_follows_it_and_can_start_again(
    flavour: str,
) -> None:
    """The ground station has missed the agent and sent the vehicle home: what the agent never saw is no pilot's."""
    flight = scenario(flavour=flavour, seed=12)
    flight.run(45.0)
    member = flight.members[LEAF]
    flight.kill(LEAF)
    flight.run(8.0)
    member.vehicle.switch_mode(mode_of(Flavour(flavour), Duty.RETURN))
    flight.run(3.0)
    member.alive = True
    flight.run(2.0)
    assert member.agent.phase.phase is Phase.RTL
    assert flight.states[LEAF].position_ned_m is not None, "the others hear where it is"
    assert flight.states[LEAF].phase is Phase.RTL
    seen = phases_until_landed(flight, member)
    assert Phase.PILOT not in seen
    flight.command(CommandName.ABORT)
    assert flight.run_until(lambda: all_landed(flight), 200.0)
    flight.command(CommandName.START)
    assert flight.run_until(lambda: member.vehicle.airborne, 60.0)


@pytest.mark.parametrize("still_s", [1.6, 6.0, 25.0])
def test_a_px4_that_lost_its_setpoints_is_never_taken_for_a_pilots(still_s: float) -> None:
    """It comes home by itself; awake again, the agent has it back, or follows it down."""
    flight = scenario(flavour="px4", seed=13)
    flight.run(45.0)
    member = frozen(flight, still_s)
    flight.command(CommandName.ABORT)
    seen = phases_until_landed(flight, member)
    assert Phase.PILOT not in seen
    assert not [e.text for _, e in flight.events if e.sender == LEAF and e.code == "pilot"]
    assert not member.vehicle.armed


def test_setpoints_that_do_not_reach_a_px4_bring_it_home_as_rtl() -> None:
    """The line to it is dead in one direction: it is heard all the time."""
    flight = scenario(flavour="px4", seed=14)
    flight.run(45.0)
    member = flight.members[LEAF]
    member.vehicle.receive = lambda _link, _data: None  # type: ignore[method-assign]
    assert flight.run_until(lambda: member.agent.phase.phase is Phase.RTL, OUT_OF_WORDS_S)
    flight.run(2.0)
    assert LEAF not in flight.tables[1].held, "the others go on without it"
    assert phases_until_landed(flight, member) == [Phase.RTL, Phase.LANDED]
    told = [e.text for _, e in flight.events if e.sender == LEAF and e.code == "failsafe"]
    assert len(told) == 1
    assert "No offboard signal" in told[0]


@pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
def test_a_pilot_who_takes_it_out_of_a_failsafe_is_a_pilot(flavour: str) -> None:
    flight = scenario(flavour=flavour, seed=15)
    flight.run(45.0)
    member = flight.members[LEAF]
    flight.kill(LEAF)
    flight.run(8.0)
    member.vehicle.switch_mode(mode_of(Flavour(flavour), Duty.RETURN))
    member.alive = True
    flight.run(2.0)
    assert member.agent.phase.phase is Phase.RTL
    member.vehicle.switch_mode(mode_of(Flavour(flavour), Duty.HOLD))
    flight.run(4.0)
    assert member.agent.phase.phase is Phase.PILOT
