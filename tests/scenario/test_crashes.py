"""Crashes in flight: told with their place, healed around, and never seen where there is none."""

from __future__ import annotations

import math
import re

import pytest

from flightstack.swarm.wire import CommandName, Phase, Severity
from mission.geometry.frames import Geodetic
from simvehicle.scenario.swarm import Scenario
from tests.scenario.test_survey_flights import scenario

TOLD_WITHIN_S = 8.0
"""A fall from the formation takes two seconds."""
HEALED_WITHIN_S = 12.0


def crash(flight: Scenario, victim: int, *, tumbles: bool) -> str:
    """What the drone tells of its crash."""
    vehicle = flight.members[victim].vehicle
    begun_s = flight.now_s
    if tumbles:
        vehicle.set_turned_over(True)
    else:
        vehicle.set_motors(False)

    def told() -> list[str]:
        return [
            e.text for at_s, e in flight.events if at_s > begun_s and (e.sender, e.code) == (victim, "crash")
        ]

    assert flight.run_until(lambda: bool(told()), TOLD_WITHIN_S)
    (text,) = told()
    assert {e.severity for _, e in flight.events if e.code == "crash"} == {Severity.CRITICAL}
    return text


def assert_place(flight: Scenario, victim: int, text: str) -> None:
    found = re.search(r"at (-?\d+\.\d+), (-?\d+\.\d+)$", text)
    assert found is not None
    place = flight.world.frame.to_ned(Geodetic(float(found[1]), float(found[2]), 300.0))
    assert math.dist(place[:2], flight.members[victim].vehicle.position_ned_m[:2]) < 3.0


@pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
@pytest.mark.parametrize("tumbles", [False, True], ids=["flat", "tumbles"])
def test_the_root_crashes_and_the_survey_goes_on(tumbles: bool, flavour: str) -> None:
    flight = scenario(flavour=flavour, seed=4)
    flight.run(40.0)
    begun_s = flight.now_s
    text = crash(flight, 1, tumbles=tumbles)
    assert text.startswith("crashed: ")
    assert_place(flight, 1, text)
    assert flight.members[1].agent.phase.phase is Phase.CRASHED

    def healed() -> bool:
        held = flight.tables[2].held
        return 1 not in held and 0 in held.values()

    assert flight.run_until(healed, HEALED_WITHIN_S)
    assert flight.now_s - begun_s < HEALED_WITHIN_S
    root = next(drone for drone, slot in flight.tables[2].held.items() if slot == 0)
    assert root != 1
    assert not flight.states[1].airborne, "no obstacle to the others"
    order = flight.orders[root].order

    def goes_on() -> bool:
        return flight.orders[root].order.sequence > order.sequence + 2

    assert flight.run_until(goes_on, 120.0)
    assert flight.run_until(lambda: flight.phases() <= {Phase.LANDED, Phase.CRASHED}, 900.0), flight.phases()
    assert flight.source_ned_m is not None
    assert flight.min_separation_m > 4.0
    assert [e.sender for _, e in flight.events if e.code == "crash"] == [1]
    assert not flight.members[1].vehicle.armed, "its motors were stopped"


def test_a_leaf_crashes_and_the_others_fly_on() -> None:
    flight = scenario(seed=5)
    flight.run(45.0)
    leaf = max(flight.tables[1].held.items(), key=lambda held: held[1])[0]
    assert_place(flight, leaf, crash(flight, leaf, tumbles=False))
    assert flight.run_until(lambda: leaf not in flight.tables[1].held, HEALED_WITHIN_S)
    flight.command(CommandName.ABORT)
    assert flight.run_until(lambda: flight.phases() <= {Phase.LANDED, Phase.CRASHED}, 120.0)
    assert all(outcome.result == "accepted" for outcome in flight.outcomes), "the wreck is down already"


def test_the_only_drone_crashes() -> None:
    flight = scenario(count=1, seed=6)
    flight.run(30.0)
    crash(flight, 1, tumbles=False)
    assert flight.run_until(lambda: not flight.members[1].vehicle.armed, 20.0)
    assert flight.members[1].agent.phase.phase is Phase.CRASHED


def test_a_drone_crashes_on_take_off() -> None:
    flight = scenario(seed=7)
    assert flight.run_until(lambda: -flight.members[3].vehicle.position_ned_m[2] > 6.0, 20.0)
    crash(flight, 3, tumbles=True)
    assert flight.run_until(lambda: 3 not in flight.tables[1].held, 40.0)


def test_a_drone_that_returns_crashes_on_the_way() -> None:
    flight = scenario(seed=8)
    flight.run(40.0)
    flight.command(CommandName.RTL)
    assert flight.run_until(lambda: flight.phases() == {Phase.RTL}, 5.0)
    crash(flight, 2, tumbles=False)
    assert flight.run_until(lambda: flight.phases() == {Phase.LANDED, Phase.CRASHED}, 120.0)


def test_what_is_wrongly_taken_for_a_wreck_is_kept_clear_of_and_lands() -> None:
    flight = scenario(seed=10)
    flight.run(40.0)
    flight.members[2].agent._session.believe_crashed("fell, it seems")
    assert flight.run_until(lambda: flight.states[2].phase is Phase.CRASHED, 1.0)
    assert flight.states[2].airborne, "the others keep clear of it"
    assert flight.run_until(lambda: flight.states[2].phase is Phase.LANDING, 8.0)
    assert flight.states[2].airborne
    assert flight.run_until(lambda: flight.states[2].phase is Phase.LANDED, 60.0)
    assert flight.min_separation_m > 4.0
    assert 2 not in flight.tables[1].held


def test_a_wreck_is_not_started_again_before_its_autopilot_was() -> None:
    flight = scenario(count=2, seed=9)
    flight.run(30.0)
    crash(flight, 2, tumbles=True)
    flight.command(CommandName.ABORT)
    assert flight.run_until(lambda: flight.phases() == {Phase.LANDED, Phase.CRASHED}, 120.0)
    again = flight.command(CommandName.START)
    flight.run(1.0)
    (refusal,) = (o for o in flight.outcomes if (o.command, o.sender) == (again, 2))
    assert refusal.reason.startswith("it has crashed (")
    assert refusal.reason.endswith("restart its autopilot")
